"""The log density against scipy's distributions, its derivatives against differences."""

import gc
import weakref
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from flightcal.errors import ScenarioError, TelemetryError
from flightcal.problem import build_problem, build_window, initial_priors
from flightcal.simulator import SimulationFailure
from tests import small

PRIORS = {
    "link": stats.lognorm(s=np.log(1.3), scale=0.6),
    "panel_size": stats.uniform(0.7, 0.7),
    "power": stats.truncnorm(-5, 5, loc=30, scale=3),
    "noise.body_temp": stats.halfnorm(scale=2.0),
}


@pytest.fixture(scope="module")
def problem(tmp_path_factory):
    scenario, data = small.closed_loop(tmp_path_factory.mktemp("problem"))
    data["body_temp"].values[40:55] = np.nan
    data["panel_temp"].values[[0, 100]] = np.nan
    return build_problem(scenario, data)


def exact(folder):
    """A problem without residuals: telemetry without noise, noise levels given."""
    written = small.content()
    written["observations"]["body_temp"]["noise"] = "0.1 K"
    scenario, data = small.closed_loop(folder, written, noise=0.0)
    problem = build_problem(scenario, data)
    return problem, problem.to_z(truth(problem))


def truth(problem):
    values = {"noise.body_temp": 0.1, "initial.body": 285.0, "initial.panel": 262.0} | small.TRUTH
    return np.array([values[name] for name in problem.names])


def near_truth(problem, seed, spread=0.05):
    rng = np.random.default_rng(seed)
    return problem.to_z(truth(problem)) + spread * rng.standard_normal(len(problem.names))


def test_theta_holds_parameters_inferred_noise_and_initial_temperatures_in_this_order(problem):
    assert problem.names == ("link", "panel_size", "power", "noise.body_temp", "initial.body", "initial.panel")
    np.testing.assert_allclose(problem.windows[0].noise(truth(problem)), [0.1, 0.1])


@pytest.mark.parametrize("seed", range(3))
def test_log_density_is_likelihood_times_prior_times_jacobian(problem, seed):
    z = near_truth(problem, seed)
    theta = problem.to_theta(z)
    first, second, third = problem.windows[0].observed[:3]
    priors = {
        **PRIORS,
        "initial.body": stats.norm(first[0], 2.0),
        "initial.panel": stats.norm(2.0 * second[1] - third[1], 2.0),  # its first sample is missing
    }
    expected = sum(priors[name].logpdf(value) for name, value in zip(problem.names, theta, strict=True))
    # By differences of the fourth order.
    far, near = (problem.to_theta(z + step) - problem.to_theta(z - step) for step in (2e-3, 1e-3))
    expected += np.log((8.0 * near - far) / 12e-3).sum()
    simulated = problem.windows[0].simulate(theta).temperatures
    noise = np.array([theta[3], 0.1])
    expected += np.nansum(stats.norm(simulated, noise).logpdf(problem.windows[0].observed))
    assert problem.log_density(z) == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("seed", range(3))
def test_gradient_agrees_with_differences_of_the_log_density(problem, seed):
    z = near_truth(problem, seed)
    value, gradient = problem.log_density_and_gradient(z)
    assert value == pytest.approx(problem.log_density(z), rel=1e-12)
    for k, name in enumerate(problem.names):
        step = np.zeros_like(z)
        step[k] = 1e-5
        expected = (problem.log_density(z + step) - problem.log_density(z - step)) / 2e-5
        assert gradient[k] == pytest.approx(expected, rel=1e-4, abs=1e-3), name


def test_without_residuals_the_gauss_newton_hessian_is_the_hessian(tmp_path):
    problem, z = exact(tmp_path)
    step = 1e-5 * np.eye(len(z))
    gradients = [problem.log_density_and_gradient(z + s)[1] - problem.log_density_and_gradient(z - s)[1] for s in step]
    expected = -np.stack(gradients) / 2e-5
    found = problem.gauss_newton_hessian(z)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(found / scale, expected / scale, atol=1e-4)
    assert np.linalg.cond(found) > 10, "a trivial case would not tell a wrong Jacobian"


class Surrogate:
    """A simulator that may be off in two shapes, by more where the link is stronger."""

    def __init__(self, simulator, shapes):
        self.simulator, self.error_basis = simulator, shapes

    def __getattr__(self, name):
        return getattr(self.simulator, name)

    def simulate(self, theta):
        return replace(self.simulator.simulate(theta), error_variance=theta[0] * np.array([0.04, 0.3]))

    def simulate_many(self, thetas):
        return [self.simulate(theta) for theta in thetas]

    def linearise(self, theta):
        _, cotangent = self.simulator.linearise(theta)

        def both(temperatures_bar, variance_bar):
            theta_bar = cotangent(temperatures_bar)
            theta_bar[0] += variance_bar @ np.array([0.04, 0.3])
            return theta_bar

        return self.simulate(theta), both


@pytest.fixture(scope="module")
def surrogate(problem):
    times = np.linspace(0.0, 1.0, len(problem.windows[0].times))
    shapes = np.stack([np.cos(np.outer(times, [2.0, 3.0])), np.sin(np.outer(times, [7.0, 5.0]))], axis=-1)
    (window,) = problem.windows
    return replace(problem, windows=(replace(window, simulator=Surrogate(window.simulator, shapes)),))


@pytest.mark.parametrize("seed", range(2))
def test_the_error_of_a_surrogate_is_in_the_density_and_its_gradient(problem, surrogate, seed):
    z = near_truth(problem, seed)
    value, gradient = surrogate.log_density_and_gradient(z)
    assert value == pytest.approx(surrogate.log_density(z), rel=1e-12)
    assert abs(value - problem.log_density(z)) > 1.0
    for k, step in enumerate(1e-5 * np.eye(len(z))):
        difference = (surrogate.log_density(z + step) - surrogate.log_density(z - step)) / 2e-5
        assert gradient[k] == pytest.approx(difference, rel=1e-4, abs=1e-3)


def test_what_a_surrogate_may_be_off_by_tells_nothing_of_the_parameters(problem, surrogate):
    """J^T C^-1 J with the dense covariance C of the residuals, in the parameters and initial temperatures."""
    z = near_truth(problem, 0)
    theta, valid = problem.to_theta(z), problem.windows[0].valid.ravel()
    shapes = surrogate.windows[0].simulator.error_basis.reshape(-1, 2)[valid]
    covariance = np.diag(
        np.broadcast_to(problem.windows[0].noise(theta) ** 2, problem.windows[0].observed.shape).ravel()[valid]
    )
    covariance += shapes @ np.diag(theta[0] * np.array([0.04, 0.3])) @ shapes.T
    jacobian = problem.jacobians(z)[0].reshape(-1, len(z))[valid]
    expected = jacobian.T @ np.linalg.solve(covariance, jacobian) + np.diag(problem.priors.precision(z))
    found = surrogate.gauss_newton_hessian(z)
    kept = np.ix_(problem.windows[0].simulated, problem.windows[0].simulated)
    np.testing.assert_allclose(found[kept], expected[kept], rtol=1e-6, atol=1e-6 * np.abs(expected).max())


def test_the_noise_level_has_the_curvature_of_residuals_of_its_size(problem):
    """Where the mean square residual is sigma^2, minus d2 / d(log sigma)2 is 2 T exactly, plus the prior's."""
    z = problem.to_z(truth(problem))
    k = problem.names.index("noise.body_temp")
    residual = problem.windows[0].observed[:, 0] - problem.windows[0].simulate(problem.to_theta(z)).temperatures[:, 0]
    theta = problem.to_theta(z)
    theta[k] = np.sqrt(np.nanmean(residual**2))
    z = problem.to_z(theta)
    step = np.zeros_like(z)
    step[k] = 1e-3
    second = (problem.log_density(z + step) - 2 * problem.log_density(z) + problem.log_density(z - step)) / 1e-6
    assert problem.gauss_newton_hessian(z)[k, k] == pytest.approx(-second, rel=1e-4)
    assert np.isfinite(residual).sum() == len(residual) - 15


def test_the_jacobian_is_that_of_the_adjoint(problem):
    z = near_truth(problem, 5)
    weights = np.random.default_rng(0).normal(size=problem.windows[0].observed.shape)
    theta = problem.to_theta(z)
    _, pull_back = problem.windows[0].simulator.linearise(theta[problem.windows[0].simulated])
    slope = (problem.to_theta(z + 1e-6) - problem.to_theta(z - 1e-6)) / 2e-6
    expected = np.zeros_like(z)
    expected[problem.windows[0].simulated] = pull_back(weights)
    expected *= slope
    found = np.tensordot(weights, problem.jacobians(z)[0], 2)
    np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-3 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("name", "value"),
    [("initial.panel", np.nan), ("power", np.nan), ("link", np.nan), ("initial.panel", 1e80), ("link", 1e80)],
)
def test_a_point_that_cannot_be_simulated_has_no_density_and_raises_nothing(problem, name, value):
    z = near_truth(problem, 0)
    z[problem.names.index(name)] = value
    assert problem.log_density(z) == -np.inf
    density, gradient = problem.log_density_and_gradient(z)
    assert density == -np.inf
    np.testing.assert_array_equal(gradient, 0.0)


def test_a_jacobian_next_to_a_failure_names_the_direction(problem):
    z = near_truth(problem, 0)
    z[problem.names.index("initial.panel")] = np.nan
    with pytest.raises(SimulationFailure, match="fails, in the direction of"):
        problem.jacobians(z)[0]


def test_samples_that_are_nan_count_for_nothing(tmp_path):
    scenario, data = small.closed_loop(tmp_path)
    whole = build_problem(scenario, data)
    z = near_truth(whole, 1)
    theta = whole.to_theta(z)
    gone = np.arange(30, 70)
    (window,) = whole.windows
    terms = stats.norm(window.simulate(theta).temperatures, window.noise(theta)).logpdf(window.observed)
    data["body_temp"].values[gone] = np.nan
    cut = build_problem(scenario, data)
    assert cut.log_density(z) == pytest.approx(whole.log_density(z) - terms[gone, 0].sum(), rel=1e-12)
    residual = (window.observed - window.simulate(theta).temperatures) ** 2
    residual[gone, 0] = np.nan
    assert cut.rmse(theta[None]) == pytest.approx([np.sqrt(np.nanmean(residual))])


def test_rmse_is_nan_where_a_simulation_fails_and_weighs_wrong_heater_status(problem):
    theta = truth(problem)
    bad = theta.copy()
    bad[problem.names.index("initial.body")] = np.nan
    assert np.isnan(problem.rmse(np.stack([theta, bad]))).tolist() == [False, True]
    other = theta.copy()
    other[problem.names.index("power")] = 36.0
    plain, weighted = (problem.rmse(other[None], weight)[0] for weight in (0.0, 3.0))
    wrong = np.nanmean(np.abs(problem.windows[0].status - problem.windows[0].simulate(other).status))
    assert wrong > 0.05
    assert weighted**2 - plain**2 == pytest.approx(9.0 * wrong)


def test_initial_priors_stand_at_the_first_samples_or_at_what_the_scenario_writes(tmp_path):
    written = small.content()
    written["observations"].pop("panel_temp")
    written["observations"]["body_temp"]["bias"] = "1.5 K"
    scenario, data = small.closed_loop(tmp_path, written)
    problem = build_problem(scenario, data)
    body, panel = (problem.priors.priors[problem.names.index(f"initial.{node}")] for node in ("body", "panel"))
    assert body.mean == pytest.approx(data["body_temp"].values[0] - 1.5)
    assert (panel.mean, panel.standard_deviation) == (263.15, 5.0)


_WARMING = [191.7, 228.9, 266.9, 291.5, 299.0, 301.0]
"""K, of an array from the end of an eclipse on."""


@pytest.mark.parametrize(
    ("seconds", "readings", "expected"),
    [
        ([0.0, 60.0, 120.0, 180.0], [300.0, 294.0, 288.0, 282.0], 300.0),
        ([20.0, 80.0, 140.0, 200.0], [298.0, 292.0, 286.0, 280.0], 300.0),
        ([600.0, 660.0, 720.0, 780.0], [298.0, 292.0, 286.0, 280.0], 304.0),
        ([0.0, 60.0, 120.0, 180.0], [298.0, np.nan, 286.0, 280.0], 298.0),
        ([0.0, *np.arange(60.0, 1800.0, 60.0)], [400.0, *np.linspace(294.0, 126.0, 29)], 300.0),
        ([0.0, *np.arange(60.0, 1800.0, 60.0)], [*_WARMING, *np.linspace(300.0, 299.0, 24)], _WARMING[0]),
        ([0.0, *np.arange(60.0, 1800.0, 60.0)], [400.0, 290.0, 300.0, 310.0, *np.full(26, 310.0)], 280.0),
        ([30.0], [290.0], 290.0),
        ([0.0, 60.0, 120.0], [290.0, 290.0, 290.0], 290.0),
    ],
    ids=["ramp", "later", "much later", "missing", "spike", "out of a shadow", "spike, then a step", "one", "constant"],
)
def test_an_initial_temperature_is_expected_where_the_first_samples_come_from(tmp_path, seconds, readings, expected):
    scenario, _ = small.closed_loop(tmp_path, small.content())
    priors = initial_priors(scenario, ("body_temp",), np.array(seconds), np.array(readings)[:, None])
    assert priors["initial.body"].mean == pytest.approx(expected)


def test_the_open_loop_twin_is_driven_by_the_measured_status_and_shares_theta(problem):
    assert problem.open_loop is not None
    assert problem.open_loop.names == problem.names
    assert np.isfinite(problem.open_loop.windows[0].simulator.drive.measured).all()
    assert problem.open_loop.open_loop is None


def test_a_window_that_is_not_there_is_named(tmp_path):
    scenario, data = small.load(tmp_path)
    with pytest.raises(ScenarioError, match="window 'validation' is not in the scenario, which has train, test"):
        build_problem(scenario, data, "validation")


def test_a_span_cuts_the_window_to_its_first_samples(tmp_path):
    scenario, data = small.load(tmp_path)
    first, whole = build_window(scenario, data, "test", span=600.0), build_window(scenario, data, "test")
    np.testing.assert_array_equal(first.times, whole.times[:11])
    np.testing.assert_array_equal(first.observed, whole.observed[:11])


def without_samples(data, scenario, window, minutes):
    """The telemetry without temperatures for so long after a window's start."""
    start = np.datetime64(scenario.windows[window].start)
    late = (data["time"].values >= start) & (data["time"].values < start + np.timedelta64(minutes, "m"))
    gap = data.copy(deep=True)
    for channel in ("body_temp", "panel_temp"):
        gap[channel].values[late] = np.nan
    return gap


@pytest.mark.parametrize(("minutes", "later"), [(5, 0), (45, 45)])
def test_a_window_whose_start_lies_in_a_gap_begins_at_its_first_sample(tmp_path, minutes, later):
    scenario, data = small.closed_loop(tmp_path)
    data = without_samples(data, scenario, "test", minutes)
    start, end = np.datetime64(scenario.windows["test"].start), np.datetime64(scenario.windows["test"].end)
    window = build_window(scenario, data, "test")
    assert window.start - start == np.timedelta64(later, "m")
    assert window.span[1] == end
    seen = {name: observation for name, observation in scenario.observations.items() if name != "panel_temp"}
    half_seen = build_window(scenario.model_copy(update={"observations": seen}), data, "test")
    unobserved = scenario.initial_state.unobserved
    assert half_seen.reads["initial.panel"].standard_deviation == (20.0 if later else unobserved)
    assert unobserved < 20.0
    assert window.network.drive.times[-1] == pytest.approx((end - window.start) / np.timedelta64(1, "s"))
    first = build_window(scenario, data, "test", span=600.0)
    assert first.times[0] == window.times[0]
    assert first.times[-1] - window.start <= np.timedelta64(10, "m")


def test_a_window_right_after_training_begins_with_it_also_in_a_gap(tmp_path):
    scenario, data = small.closed_loop(tmp_path)
    data = without_samples(data, scenario, "test", 45)
    before = scenario.windows["train"].model_copy(update={"end": scenario.windows["test"].start, "orbits": None})
    scenario = scenario.model_copy(update={"windows": {**scenario.windows, "train": before}})
    assert build_window(scenario, data, "test").start == np.datetime64(scenario.windows["test"].start)
    first = build_window(scenario, data, "test", span=600.0)
    assert np.isfinite(first.observed).any()


def test_initial_temperatures_are_expected_where_the_first_readings_are_without_their_sensors_errors(tmp_path):
    written = small.content()
    written["observations"]["body_temp"] |= {"gain": 1.1, "bias": "0.5 K"}
    problem = build_problem(*small.closed_loop(tmp_path, written))
    prior = problem.priors.priors[problem.names.index("initial.body")]
    reading = problem.windows[0].observed[0, 0] - 273.15
    assert prior.mean == pytest.approx(273.15 + (reading - 0.5) / 1.1, abs=1e-9)


def test_a_window_to_train_on_without_a_temperature_is_refused(tmp_path):
    scenario, data = small.closed_loop(tmp_path)
    for channel in ("body_temp", "panel_temp"):
        data[channel].values[:] = np.nan
    with pytest.raises(TelemetryError, match="found no valid temperature, expected some to train on"):
        build_problem(scenario, data)


def test_a_problem_that_is_let_go_gives_back_its_memory_at_once(tmp_path):
    scenario, data = small.load(tmp_path, small.content())
    gc.collect()
    gc.disable()
    try:
        problem = build_problem(scenario, data)
        problem.log_density_and_gradient(problem.to_z(problem.priors.median()))
        kept = weakref.ref(problem)
        del problem
        assert kept() is None
    finally:
        gc.enable()
