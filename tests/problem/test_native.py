"""The log density as one C function, against the same put together step by step in Python."""

import numpy as np
import pytest

from flightcal.calibration.nuts import sample
from flightcal.problem import build_problem
from flightcal.problem.coordinates import Whitening, whitening
from flightcal.problem.native import DENSITY_NOT_FINITE, REASONS
from flightcal.scenario import NutsSettings
from flightcal.simulator import SimulationFailure
from flightcal.simulator.kernels.forward import TOO_MANY_SWITCHES
from tests import small
from tests.probability.residual_cases import iid_log_likelihood


@pytest.fixture(scope="module")
def problem(tmp_path_factory):
    scenario, data = small.closed_loop(tmp_path_factory.mktemp("native"))
    data["body_temp"].values[40:55] = np.nan
    return build_problem(scenario, data)


@pytest.fixture(scope="module")
def coordinates(problem):
    values = {"noise.body_temp": 0.1, "initial.body": 285.0, "initial.panel": 262.0} | small.TRUTH
    z = problem.to_z(np.array([values[name] for name in problem.names]))
    return whitening(z, problem.gauss_newton_hessian(z))


def step_by_step(problem, z):
    """The log density and its gradient from the simulator, the likelihood and the priors."""
    prior = problem.priors.at(z)
    try:
        run, pull_back = problem.windows[0].simulator.linearise(prior.theta[problem.windows[0].simulated])
    except SimulationFailure:
        return -np.inf, np.zeros_like(z)
    value, temperatures_bar, noise_bar = iid_log_likelihood(
        problem.windows[0].observed, run.temperatures, problem.windows[0].noise(prior.theta)
    )
    theta_bar = np.zeros_like(z)
    theta_bar[problem.windows[0].simulated] = pull_back(temperatures_bar)
    channels, positions = problem.windows[0].inferred_noise
    theta_bar[positions] += noise_bar[channels]
    return prior.log_density + value, prior.gradient + prior.slope * theta_bar


@pytest.mark.parametrize("seed", range(4))
def test_it_is_what_its_parts_give(problem, coordinates, seed):
    w = 2.0 * np.random.default_rng(seed).standard_normal(len(problem.names))
    value, gradient = problem.native_density(coordinates)(w)
    expected, by_z = step_by_step(problem, coordinates.to_z(w))
    assert value == pytest.approx(expected, rel=1e-12)
    np.testing.assert_allclose(gradient, coordinates.factor.T @ by_z, rtol=1e-9, atol=1e-9 * np.abs(gradient).max())


def test_it_is_what_its_parts_give_in_straight_coordinates(problem, coordinates):
    w = 0.5 * np.random.default_rng(5).standard_normal(len(problem.names))
    wide = 1e-3 * problem.gauss_newton_hessian(coordinates.mean)
    straight = whitening(coordinates.mean, wide, problem.priors)
    assert straight.straight is not None
    z = straight.to_z(w)
    assert np.abs(z - whitening(coordinates.mean, wide).to_z(w)).max() > 1e-3
    value, gradient = problem.native_density(straight)(w)
    expected, by_z = step_by_step(problem, z)
    assert value == pytest.approx(expected, rel=1e-12)
    expected = straight.pull_back(z, by_z)
    np.testing.assert_allclose(gradient, expected, rtol=1e-9, atol=1e-9 * np.abs(gradient).max())


def test_it_is_what_its_parts_give_with_errors_of_the_sensors(tmp_path):
    written = small.content()
    written["observations"]["body_temp"] |= {"lag": "100 s"}
    errors = {
        "body_temp.lag": ["20 s", "300 s"],
        "panel_temp.time_offset": ["-60 s", "60 s"],
        "panel_temp.gain": [0.9, 1.1],
    }
    for name, bounds in errors.items():
        written["parameters"][name.replace(".", "_")] = {"sets": f"observations.{name}", "prior": {"uniform": bounds}}
    problem = build_problem(*small.closed_loop(tmp_path, written))
    plain = whitening(np.zeros(len(problem.names)), np.eye(len(problem.names)))
    density = problem.native_density(plain)
    for z in 0.5 * np.random.default_rng(0).standard_normal((3, len(problem.names))):
        value, gradient = density(z)
        expected, by_z = step_by_step(problem, z)
        assert value == pytest.approx(expected, rel=1e-12)
        np.testing.assert_allclose(gradient, by_z, rtol=1e-9, atol=1e-9 * np.abs(by_z).max())
        assert (gradient != 0.0).all()


def test_a_call_leaves_nothing_behind_for_the_next(problem, coordinates):
    density = problem.native_density(coordinates)
    points = np.random.default_rng(9).standard_normal((5, len(problem.names)))
    points[2] = 1e200
    first = [density(w) for w in points]
    again = [problem.native_density(coordinates)(w) for w in points]
    for (value, gradient), (expected, expected_gradient) in zip(first, again, strict=True):
        assert value == expected
        np.testing.assert_array_equal(gradient, expected_gradient)


def test_a_failed_simulation_has_no_density_is_counted_and_named(problem, coordinates):
    density = problem.native_density(coordinates)
    for w in (np.full(len(problem.names), 1e200), np.full(len(problem.names), np.nan)):
        value, gradient = density(w)
        assert value == -np.inf
        np.testing.assert_array_equal(gradient, 0.0)
    assert (density.gradients, density.failures, density.draws) == (2, 2, 0)
    assert density.last_failure == REASONS[DENSITY_NOT_FINITE]


def test_a_gradient_that_is_not_finite_is_no_density(problem, coordinates):
    origin = np.zeros(len(problem.names))
    assert np.isfinite(problem.native_density(coordinates)(origin)[0])
    steep = Whitening(coordinates.mean + coordinates.factor.sum(axis=1), 1e307 * np.eye(len(origin)))
    density = problem.native_density(steep)
    assert density(origin)[0] == -np.inf
    assert density.last_failure == REASONS[DENSITY_NOT_FINITE]


def test_a_thermostat_that_chatters_has_no_density_and_is_named(tmp_path):
    problem = build_problem(*small.load(tmp_path, small.chattering()))
    density = problem.native_density(whitening(np.zeros(len(problem.names)), np.eye(len(problem.names))))
    assert density(problem.to_z(problem.priors.median()))[0] == -np.inf
    assert density.last_failure == REASONS[TOO_MANY_SWITCHES]


def test_chains_of_the_c_function_draw_what_chains_of_python_draw(problem, coordinates):
    settings = NutsSettings(chains=2, draws=150, warmup=100)

    def draw(native):
        return sample(lambda z: step_by_step(problem, z), coordinates, settings, 3, native=native)

    with_native, with_python = draw(problem.native_density), draw(lambda _: None)
    # The same seed and the same density: only rounding tells them apart, which trajectories magnify slowly.
    np.testing.assert_allclose(with_native.z[:, :20], with_python.z[:, :20], atol=1e-3)
    assert with_native.gradients == with_python.gradients
    assert with_native.statistics["n_steps"].sum() + with_native.warmup_gradients <= with_native.gradients
    assert (with_native.failures, with_native.interrupted) == (0, False)
    assert with_native.z.shape == (2, 150, len(problem.names))


def test_one_compilation_serves_all_problems(problem, coordinates, tmp_path):
    """Every kernel gets the same kind of call with a heater and without, whatever the sizes."""

    def kinds(density):
        return {row.kernel: row.call.kind for row in density.program.rows}

    found = kinds(problem.native_density(coordinates))
    written = small.content()
    del written["simulator"]["heaters"], written["parameters"]["power"]
    written["observations"] = {name: item for name, item in written["observations"].items() if "heater" not in item}
    scenario, data = small.closed_loop(tmp_path, written)
    other = build_problem(scenario, data)
    without = kinds(other.native_density(whitening(np.zeros(len(other.names)), np.eye(len(other.names)))))
    assert len(found) >= 8
    assert without == found
