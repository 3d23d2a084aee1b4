"""Several windows to train on: an emulator for each, and one posterior, against that of the real simulators."""

from functools import partial

import numpy as np
import pytest

from flightcal.calibration import calibrate_nuts
from flightcal.emulation import design
from flightcal.emulation.active import learn
from flightcal.emulation.horizon import beginning
from flightcal.emulation.influence import emulated
from flightcal.problem import build_problem
from flightcal.scenario import EmulatorSettings, NutsSettings
from tests import derivative_free

NUTS = NutsSettings(chains=2, draws=500, warmup=150)
TRAIN = {
    "dawn": {"start": "2024-03-01T00:00:00", "end": "2024-03-01T01:10:00"},
    "noon": {"start": "2024-03-01T03:20:00", "end": "2024-03-01T05:00:00"},
}


def weak(theta):
    return theta[0] < 0.45


def evaluate(window, thetas):
    """Runs that fail in one of the windows where the link is weak."""
    return derivative_free.evaluate(window, thetas, weak if window.label == "noon" else lambda _: False)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return derivative_free.scene(tmp_path_factory.mktemp("windows"), heater=False, train=TRAIN)


@pytest.fixture(scope="module")
def problem(scene):
    return build_problem(*scene)


@pytest.fixture(scope="module")
def learnt(problem, scene):
    settings, first = EmulatorSettings(runs=280, start=80, batch=40), partial(beginning, scene[1])
    return learn(problem, evaluate, derivative_free.nothing(problem), settings, 5, beginning=first)


@pytest.mark.slow
def test_the_posterior_is_that_of_the_real_simulators(problem, learnt):
    """Means within 0.2 standard deviations and standard deviations within 20%."""
    assert learnt.reached
    assert learnt.problem.names == problem.names
    starts = [("active learning", learnt.theta)]
    found = calibrate_nuts(learnt.problem, NUTS, 2, starts=starts, random_starts=0).flat
    exact = calibrate_nuts(problem, NUTS, 1).flat
    deviation = exact.std(axis=0)
    np.testing.assert_array_less(np.abs(found.mean(axis=0) - exact.mean(axis=0)) / deviation, 0.2)
    np.testing.assert_allclose(found.std(axis=0) / deviation, 1.0, atol=0.2)


@pytest.mark.slow
def test_every_theta_is_run_on_every_window_within_the_budget(problem, learnt):
    dawn, noon = learnt.runs
    assert learnt.rounds[0].runs == 80
    assert learnt.rounds[-1].runs == len(dawn) + len(noon) <= 280
    np.testing.assert_array_equal(dawn.theta[:, :3], noon.theta[:, :3])  # what the windows share
    assert (dawn.theta[:, 3:] != noon.theta[:, 3:]).all()
    np.testing.assert_array_equal(dawn.round, noon.round)
    for window, learnt_window in zip(problem.windows, learnt.problem.windows, strict=True):
        assert len(emulated(learnt_window).emulator.runs.times) == len(window.times)


@pytest.mark.slow
def test_a_run_that_fails_in_one_window_is_learnt_from_in_the_other(learnt):
    dawn, noon = learnt.runs
    assert dawn.finished.all()
    assert 0 < (~noon.finished).sum() == learnt.rounds[-1].failed
    assert learnt.failures.startswith(f"noon: {learnt.rounds[-1].failed} of {len(noon)} runs failed")
    assert learnt.rounds[-1].validation.channels[0].channel == "dawn: body_temp"


def test_what_only_some_windows_have_is_run_again_on_all(problem):
    stored, asked = [], {"dawn": 0, "noon": 0}

    def counted(window, thetas):
        if len(stored) == 2:
            raise KeyboardInterrupt
        asked[window.label] += len(thetas)
        return evaluate(window, thetas)

    settings = EmulatorSettings(runs=280, start=80)
    with pytest.raises(KeyboardInterrupt):
        learn(problem, counted, derivative_free.nothing(problem), settings, 5, save=stored.append)
    dawn, noon = stored.pop()
    assert asked == {"dawn": 16, "noon": 16}
    with pytest.raises(KeyboardInterrupt):
        learn(problem, counted, (dawn, noon.take(slice(0, 13))), settings, 5, save=stored.append)
    assert asked == {"dawn": 24, "noon": 24}
    again, at_noon = stored[-1]
    np.testing.assert_array_equal(again.theta[:16], dawn.theta)
    np.testing.assert_array_equal(at_noon.theta[:16], noon.theta)
    np.testing.assert_array_equal(again.theta[:, :3], at_noon.theta[:, :3])


def test_runs_are_thetas_of_a_calibration_whose_parameters_drift(scene):
    scenario, telemetry = scene
    link = scenario.parameters["link"].model_copy(update={"drift": 0.3})
    drifting = scenario.model_copy(update={"parameters": scenario.parameters | {"link": link}})
    problem = build_problem(drifting, telemetry)
    thetas = design.start_thetas(problem, 6, 1)
    inside = [problem.at(window, thetas)[:, window.simulated] for window in problem.windows]
    assert (inside[0][:, 0] != inside[1][:, 0]).all()
    runs = tuple(derivative_free.runs_at(*both) for both in zip(problem.windows, inside, strict=True))
    back = design.thetas_of(problem, runs)
    for window, theta in zip(problem.windows, inside, strict=True):
        np.testing.assert_allclose(problem.at(window, back)[:, window.simulated], theta, rtol=1e-9)
