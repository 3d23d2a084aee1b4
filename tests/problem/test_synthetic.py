"""Telemetry that the likelihood itself makes, and problems with it in the place of the measured one."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from flightcal.problem import build_problem, heat_in_prior
from flightcal.problem.synthetic import simulate_telemetry, with_drawn_heat, with_telemetry
from flightcal.scenario import HalfNormal
from tests import small


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    scenario, data = small.closed_loop(tmp_path_factory.mktemp("synthetic"))
    data["body_temp"][40:60] = np.nan
    data["heater_status"][50:55] = np.nan
    problem = build_problem(scenario, data)
    theta = problem.priors.median()
    theta[problem.names.index("noise.body_temp")] = 0.3
    return problem, data, theta


def test_the_residuals_have_the_noise_of_theta_and_the_gaps_stay(made):
    problem, _, theta = made
    rng = np.random.default_rng(1)
    run = problem.windows[0].simulate(theta)
    draws = [simulate_telemetry(problem, theta, rng)[0] for _ in range(50)]
    residuals = np.stack([temperatures - run.temperatures for temperatures, _ in draws])
    assert np.array_equal(np.isfinite(residuals[0]), problem.windows[0].valid)
    # 8,000 samples or more fix a standard deviation to 0.8%; four standard errors.
    assert np.nanstd(residuals, axis=(0, 1)) == pytest.approx(problem.windows[0].noise(theta), rel=0.032)
    status = draws[0][1]
    assert np.array_equal(np.isfinite(status), np.isfinite(problem.windows[0].status))
    assert np.array_equal(status[np.isfinite(status)], run.status[np.isfinite(status)])


def test_a_simulator_that_knows_its_error_has_it_in_the_telemetry(made):
    problem, _, theta = made

    class Erring:
        """The problem's simulator, as if a surrogate: its error is 3 and 0.5 K of two shapes in time."""

        error_basis = np.zeros((len(problem.windows[0].times), 2, 2))

        def __getattr__(self, name):
            return getattr(problem.windows[0].simulator, name)

        def simulate(self, theta):
            return replace(problem.windows[0].simulator.simulate(theta), error_variance=np.array([9.0, 0.25]))

    Erring.error_basis[:, 0, 0] = 1.0
    Erring.error_basis[::2, 1, 1] = 1.0
    (window,) = problem.windows
    erring, rng = replace(problem, windows=(replace(window, simulator=Erring()),)), np.random.default_rng(5)
    run = problem.windows[0].simulate(theta)
    draws = np.stack([simulate_telemetry(erring, theta, rng)[0][0] - run.temperatures for _ in range(2000)])
    noise = problem.windows[0].noise(theta) ** 2
    # A variance of 2,000 draws is known to 3.2%; four standard errors.
    assert np.var(draws[:, 7], axis=0) == pytest.approx([9.0 + noise[0], noise[1]], rel=0.13)
    assert np.var(draws[:, 8], axis=0) == pytest.approx([9.0 + noise[0], 0.25 + noise[1]], rel=0.13)
    # The same draw of a shape at all times.
    assert np.cov(draws[:, 7, 0], draws[:, 20, 0])[0, 1] == pytest.approx(9.0, rel=0.13)


def test_a_problem_with_other_telemetry_is_as_if_it_had_been_measured(made):
    problem, data, theta = made
    ((observed, status),) = simulate_telemetry(problem, theta, np.random.default_rng(2))
    other = with_telemetry(problem, data, [(observed, status)])
    measured = data.copy(deep=True)
    at = {"time": problem.windows[0].times}
    measured["body_temp"].loc[at], measured["panel_temp"].loc[at] = observed.T
    measured["heater_status"].loc[at] = status[:, 0]
    built = build_problem(problem.scenario, measured)
    z = problem.to_z(theta)

    def likelihood(of):
        return of.log_density(of.to_z(theta)) - of.priors.at(of.to_z(theta)).log_density

    assert other.entries is problem.entries
    assert other.open_loop.entries is problem.entries
    assert likelihood(other) == pytest.approx(likelihood(built))
    assert likelihood(other.open_loop) == pytest.approx(likelihood(built.open_loop))
    assert other.log_density_and_gradient(z)[0] == pytest.approx(other.log_density(z))
    assert np.array_equal(data["heater_status"].values, made[1]["heater_status"].values, equal_nan=True)


def test_status_with_a_likelihood_has_its_timing_errors_and_false_samples(tmp_path):
    written = small.content()
    written["observations"]["heater_status"]["likelihood"] = {"switch_times": {"timing": "60 s", "error_rate": 0.1}}
    problem = build_problem(*small.closed_loop(tmp_path, written))
    theta = problem.priors.median()
    run = problem.windows[0].simulate(theta)
    rng = np.random.default_rng(4)
    draws = np.stack([simulate_telemetry(problem, theta, rng)[0][1][:, 0] for _ in range(400)])
    seconds = (problem.windows[0].times - problem.windows[0].times[0]) / np.timedelta64(1, "s")
    far = np.abs(seconds[:, None] - run.switches.time).min(axis=1) > 300.0
    assert 20 < far.sum() < len(far) - 20
    wrong = draws != run.status[:, 0]
    # 400 draws of a share of 0.1: five standard errors of all far samples together.
    assert wrong[:, far].mean() == pytest.approx(0.1, abs=5 * np.sqrt(0.09 / (400 * far.sum())))
    first = run.switches.time[0]
    middle = np.argmin(np.abs(seconds - first))
    happened = norm.cdf((seconds[middle] - first) / 60.0)
    on = run.switches.on[0] * happened + (1.0 - run.switches.on[0]) * (1.0 - happened)
    assert draws[:, middle].mean() == pytest.approx(0.8 * on + 0.1, abs=5 * 0.5 / 20)


def test_the_open_loop_follows_the_new_status(made):
    problem, data, theta = made
    ((observed, status),) = simulate_telemetry(problem, theta, np.random.default_rng(3))
    other = with_telemetry(problem, data, [(observed, 1.0 - status)])
    (run,) = other.open_loop.simulate(theta)
    # Driven by the reverse of the status, the body is warm when it should be cold.
    assert np.corrcoef(run.temperatures[60:, 0], problem.windows[0].simulate(theta).temperatures[60:, 0])[0, 1] < 0.9


def test_drawn_heat_has_the_sizes_that_are_told_and_moves_the_temperatures(tmp_path):
    content = small.content() | {"heat": {"gains": None}}
    scenario, data = small.closed_loop(tmp_path, content)
    problem = build_problem(scenario, data)
    theta, rng, shares, moved = problem.priors.median(), np.random.default_rng(3), [], []
    cold = problem.windows[0].simulate(theta).temperatures
    model = heat_in_prior(problem)
    for _ in range(200):
        heated, sizes = with_drawn_heat(problem, rng)
        assert set(sizes) == set(model.names)
        shares.append([sizes[name] / prior.scale for name, prior in model.priors.items()])
        half_normal = [isinstance(prior, HalfNormal) for prior in model.priors.values()]
        moved.append(heated.windows[0].simulate(theta).temperatures - cold)
    half_normal, shares = np.array(half_normal), np.array(shares)
    # The mean square of 200 is known to 10%; four standard errors.
    assert np.mean(np.square(shares[:, half_normal]), axis=0) == pytest.approx(1.0, rel=0.4)
    # Of half of Student's t the mean has an error of 7%, with three degrees of freedom.
    expected = 2.0 * np.sqrt(3.0) / np.pi
    assert np.mean(shares[:, ~half_normal], axis=0) == pytest.approx(expected, rel=0.3)
    assert np.std(moved, axis=0).max() > 0.5


def test_without_heat_in_the_scenario_none_is_drawn(made):
    problem, _, _ = made
    assert with_drawn_heat(problem, np.random.default_rng(0)) == (problem, {})


def test_the_priors_of_initial_temperatures_stay_those_around_the_first_telemetry(made):
    problem, data, theta = made
    warmer = [
        (observed + 5.0, status) for observed, status in simulate_telemetry(problem, theta, np.random.default_rng(0))
    ]
    found = with_telemetry(problem, data, warmer)
    for new, old in ((found, problem), (found.open_loop, problem.open_loop)):
        assert [window.reads for window in new.windows] == [window.reads for window in old.windows]


def test_drawn_heat_has_the_time_errors_of_changes_of_mode(tmp_path):
    content = small.content() | {"heat": {}}
    content["simulator"]["modes"] = {"idle": {"body": "5 W"}, "busy": {"body": "60 W"}}
    content["simulator"]["timeline"] = [
        {"at": "2024-03-01T00:00:00", "mode": "idle"},
        {"at": "2024-03-01T01:00:00", "mode": "busy", "within": "10 min"},
    ]
    problem = build_problem(*small.closed_loop(tmp_path, content))
    rng = np.random.default_rng(2)
    (window,) = problem.windows
    column = window.network.network.columns.index("heat.body")
    drives = [with_drawn_heat(problem, rng)[0].windows[0].network.drive for _ in range(60)]
    around, later = (int(np.searchsorted(drives[0].times, hours * 3600.0)) - 1 for hours in (1.0, 1.3))
    heat = np.stack([drive.inputs[:, :, column].mean(axis=1) for drive in drives])
    # 55 W for about 600 s / sqrt(12), within ten minutes; else some watts.
    assert heat[:, around].std() > 3.0 * heat[:, later].std()
