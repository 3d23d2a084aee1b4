"""How much of the small satellite's window an emulator of runs through the priors is asked for."""

import numpy as np
import pytest

from flightcal.emulation.active import noise_level, simulated_priors, start_design
from flightcal.emulation.horizon import beginnings, farthest_emulator
from flightcal.problem import build_problem
from tests import derivative_free


@pytest.fixture(scope="module", params=[False, True], ids=["no heater", "heater"])
def case(request, tmp_path_factory):
    scenario, telemetry = derivative_free.scene(tmp_path_factory.mktemp("horizon"), heater=request.param)
    problem = build_problem(scenario, telemetry)
    runs = derivative_free.empty(problem, 20).add(
        derivative_free.evaluator(derivative_free.simulator(problem, 20))(
            start_design(simulated_priors(problem), 50, 5)
        ),
        0,
    )
    return problem, telemetry, runs


def test_a_beginning_is_the_problem_on_the_first_samples(case):
    problem, telemetry, _ = case
    beginning = beginnings(problem, telemetry)(40)
    np.testing.assert_array_equal(beginning.times, problem.times[:40])
    np.testing.assert_array_equal(beginning.observed, problem.observed[:40])
    assert beginning.names == problem.names
    z = problem.to_z(problem.priors.median())
    np.testing.assert_allclose(beginning.to_theta(z), problem.to_theta(z))


def test_an_emulator_is_asked_as_far_as_it_tells_runs_apart(case):
    problem, _, runs = case
    z, noise = simulated_priors(problem).to_z(runs.theta), noise_level(problem)
    window, judged = slice(0, len(problem.times)), np.ones(len(runs), bool)
    emulator, samples = farthest_emulator(runs, z, noise, window, judged)
    if not runs.heaters:
        assert samples == len(problem.times)
        assert len(emulator.runs.times) == len(runs.times)  # what comes after the window too
        return
    # A thermostat's phase is lost after a few cycles, each of some 20 minutes.
    assert samples <= 45
    assert len(emulator.runs.times) == samples
    np.testing.assert_array_equal(emulator.runs.temperatures, runs.temperatures[:, :samples])
    error = emulator.leave_one_out()[0][:, samples // 2 :, 0]
    body = runs.temperatures[:, samples // 2 : samples, 0]
    assert np.sqrt(np.mean(error**2)) < 0.3 * np.sqrt(np.mean((body - body.mean(axis=0)) ** 2))


def test_noise_that_hides_the_error_needs_no_shorter_window(case):
    problem, _, runs = case
    z, judged = simulated_priors(problem).to_z(runs.theta), np.ones(len(runs), bool)
    _, samples = farthest_emulator(runs, z, np.array([3.0, 3.0]), slice(0, len(problem.times)), judged)
    assert samples == len(problem.times)
