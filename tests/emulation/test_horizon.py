"""How much of the small satellite's window an emulator of runs through the priors is asked for."""

import numpy as np
import pytest

from flightcal.emulation.active import noise_level
from flightcal.emulation.design import start_design
from flightcal.emulation.emulator import simulated_priors
from flightcal.emulation.horizon import beginning, farthest_emulator
from flightcal.problem import build_window
from tests import derivative_free


@pytest.fixture(scope="module", params=[False, True], ids=["no heater", "heater"])
def case(request, tmp_path_factory):
    scenario, telemetry = derivative_free.scene(tmp_path_factory.mktemp("horizon"), heater=request.param)
    window = build_window(scenario, telemetry, "train")
    return window, telemetry, derivative_free.runs_at(window, start_design(simulated_priors(window), 50, 5))


def test_a_beginning_is_the_window_on_the_first_samples(case):
    window, telemetry, _ = case
    first = beginning(telemetry, window, 40)
    np.testing.assert_array_equal(first.times, window.times[:40])
    np.testing.assert_array_equal(first.observed, window.observed[:40])
    assert first.reads == window.reads


def test_an_emulator_is_asked_as_far_as_it_tells_runs_apart(case):
    window, _, runs = case
    emulator = farthest_emulator(runs, simulated_priors(window), noise_level(window), np.ones(len(runs), bool))
    samples = len(emulator.runs.times)
    if not runs.heaters:
        assert samples == len(window.times)
        return
    # A thermostat's phase is lost after a few cycles, each of some 20 minutes.
    assert samples <= 45
    np.testing.assert_array_equal(emulator.runs.temperatures, runs.temperatures[:, :samples])
    error = emulator.leave_one_out()[0][:, samples // 2 :, 0]
    body = runs.temperatures[:, samples // 2 : samples, 0]
    assert np.sqrt(np.mean(error**2)) < 0.3 * np.sqrt(np.mean((body - body.mean(axis=0)) ** 2))


def test_noise_that_hides_the_error_needs_no_shorter_window(case):
    window, _, runs = case
    judged = np.ones(len(runs), bool)
    emulator = farthest_emulator(runs, simulated_priors(window), np.array([3.0, 3.0]), judged)
    assert len(emulator.runs.times) == len(window.times)
