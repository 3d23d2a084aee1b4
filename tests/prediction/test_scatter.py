"""Thermostats that switch around their thresholds, in predictions."""

from dataclasses import replace

import numpy as np
import pytest

from flightcal.prediction import predict
from flightcal.prediction.ensemble import propagate
from flightcal.problem import build_problem

from .. import small

SCATTER = 0.06  # K


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    written = small.content()
    written["simulator"]["heaters"]["heater"]["scatter"] = f"{SCATTER} K"
    return small.closed_loop(tmp_path_factory.mktemp("scatter"), written)


def thetas_of(problem, count):
    values = {"noise.body_temp": 0.1, "initial.body": 285.0, "initial.panel": 262.0} | small.TRUTH
    return np.tile([values[name] for name in problem.names], (count, 1))


def test_the_first_switch_is_off_by_the_scatter_over_the_rate_of_the_sensor(case):
    problem = build_problem(*case, "test")
    count = 600
    runs = problem.windows[0].simulate_as_flown(thetas_of(problem, count), np.random.default_rng(1))
    first = np.array([run.switches.time[0] for run in runs])
    assert len(np.unique(first)) == count
    exact = problem.windows[0].simulate(thetas_of(problem, 1)[0])
    seconds = (problem.windows[0].times - problem.windows[0].times[0]) / np.timedelta64(1, "s")
    at = np.searchsorted(seconds, exact.switches.time[0])
    body = exact.temperatures[:, problem.windows[0].simulator.channels.index("body_temp")]
    rate = (body[at - 1] - body[at - 2]) / (seconds[at - 1] - seconds[at - 2])
    # A standard deviation from 600 draws is known to 3%; the rate changes a little from before to after.
    assert first.std() == pytest.approx(SCATTER / abs(rate), rel=0.12)
    assert abs(first.mean() - exact.switches.time[0]) < 4 * first.std() / np.sqrt(count) + 1.0
    off = np.array([run.switches.time[:6] for run in runs]) - exact.switches.time[:6]
    assert off[:, 5].std() > 1.5 * off[:, 1].std(), "the phase of the cycle diffuses from switch to switch"


def test_few_simulations_scatter_as_the_same_ones_among_many(case):
    problem = build_problem(*case, "test")
    few, many = (problem.windows[0].simulate_as_flown(thetas_of(problem, n), np.random.default_rng(1)) for n in (2, 20))
    for one, other in zip(few, many[:2], strict=True):
        # One by one and side by side differ by rounding.
        np.testing.assert_allclose(one.switches.time, other.switches.time, atol=1e-6)


def test_a_simulator_with_an_error_scatters_as_its_network_does(case):
    problem = build_problem(*case, "test")
    (window,) = problem.windows
    error = {"error_basis": np.zeros((*window.observed.shape, 1)), "error_variance": np.array([0.04])}
    inexact = replace(window.simulator, **error)
    runs, expected = (
        version.simulate_as_flown(thetas_of(problem, 4), np.random.default_rng(1))
        for version in (replace(window, simulator=inexact), window)
    )
    for run, exact in zip(runs, expected, strict=True):
        np.testing.assert_array_equal(run.switches.time, exact.switches.time)
        assert run.error_variance == 0.04


def test_each_heater_has_its_own_scatter(tmp_path):
    written = small.content()
    heaters = written["simulator"]["heaters"]
    heaters["heater"]["scatter"] = "0.06 K"
    heaters["other"] = {
        "node": "panel", "power": "5 W", "sensor": "panel",
        "on_below": "-60 degC", "off_above": "-55 degC", "scatter": "0.2 K",
    }  # fmt: skip
    simulator = build_problem(*small.load(tmp_path, written)).windows[0].simulator
    assert simulator.heaters == ("heater", "other")
    np.testing.assert_allclose(simulator.scatter, [0.06, 0.2])


def test_exact_thermostats_draw_nothing(tmp_path):
    problem = build_problem(*small.closed_loop(tmp_path), "test")
    rng = np.random.default_rng(1)
    problem.windows[0].simulate_as_flown(thetas_of(problem, 2), rng)
    assert rng.random() == np.random.default_rng(1).random()


def test_scatter_widens_the_prediction_of_a_new_window_and_not_that_of_the_training_window(case, tmp_path):
    for window in ("train", "test"):
        problem = build_problem(*case, window)
        exact = build_problem(*small.closed_loop(tmp_path), window)
        thetas = thetas_of(problem, 200)
        with_scatter, without = (
            propagate(p.windows[0], thetas, 0.95, np.random.default_rng(1)) for p in (problem, exact)
        )
        body = problem.windows[0].simulator.channels.index("body_temp")
        wide, narrow = ((e.model_upper - e.model_lower)[:, body] for e in (with_scatter, without))
        np.testing.assert_allclose(narrow, 0.0, atol=1e-9)
        if window == "train":
            np.testing.assert_allclose(wide, 0.0, atol=1e-9)
        else:
            assert wide.mean() > SCATTER


def test_a_prediction_says_that_its_thermostats_scatter(case):
    draws = thetas_of(build_problem(*case, "train"), 20)
    for interval in ("interval_contains", "model_interval_contains"):
        told = [predict(build_problem(*case), case[1], window, {}, draws, seed=1)[0] for window in ("train", "test")]
        said = [prediction.attrs[interval] for prediction in told]
        assert ["scatter of the thermostats" in words for words in said] == [False, True]


def test_simulations_with_very_many_switches_scatter_too(tmp_path):
    written = small.content()
    written["simulator"]["heaters"]["heater"] |= {"off_above": "10.05 degC", "scatter": "0.001 K"}
    problem = build_problem(*small.load(tmp_path, written), "test")
    values = {"noise.body_temp": 0.1, "initial.body": 283.16, "initial.panel": 262.0} | small.TRUTH
    thetas = np.tile([values[name] for name in problem.names], (4, 1))
    runs = problem.windows[0].simulate_as_flown(thetas, np.random.default_rng(1))
    assert min(len(run.switches.time) for run in runs) > 2 * len(problem.windows[0].times)
    assert len({run.switches.time[0] for run in runs}) == 4
