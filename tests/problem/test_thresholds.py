"""Temperatures of thermostats' sensors when measured switches show that heaters went on and off."""

import numpy as np
import pytest

from flightcal.problem import build_problem
from flightcal.problem.thresholds import SCATTERS, Passages, _reached, _Switches, passages, usual_scatter

from .. import small

NONE = np.zeros((1, 0)), np.zeros(0, bool)
TRIED = np.linspace(-1.5, 1.5, 151)
"""K, thresholds."""


def seen(drawn_at, sign=1.0):
    """Log likelihood [o, c] of one switch of a sensor that falls by 0.01 K/s, 30 s after its last sample."""
    seconds = np.arange(0.0, 601.0, 10.0)
    found = _Switches(np.array([0.0]), np.array([600.0]), np.array([[drawn_at]]))
    reached, happened = _reached(seconds, sign * (6.0 - 0.01 * seconds)[None], found, sign)
    sides = ((reached, happened), NONE) if sign > 0.0 else (NONE, (reached, happened))
    switch_passages = Passages(*zip(*sides, strict=True), np.full(1, np.nan))
    return switch_passages.log_likelihood(0 if sign > 0.0 else 1, TRIED[None])[0]


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("later", [0.0, 30.0, 60.0])
def test_a_threshold_is_what_the_sensor_had_reached_when_its_heater_switched(later, sign):
    likeliest = TRIED[np.argmax(seen(600.0 + later, sign)[:, 0])]
    assert likeliest == pytest.approx(-0.01 * sign * later, abs=0.01 + 0.5 * (TRIED[1] - TRIED[0]))


def test_a_heater_that_has_not_switched_has_a_threshold_below_what_its_sensor_saw():
    found = seen(np.inf)[:, 0]
    assert (found[TRIED < 0.0] > -1e-6).all()
    assert (found[TRIED > 0.2] < -20.0).all()


def test_a_simulation_that_failed_says_nothing():
    sides = (np.full((1, 1), np.nan), np.zeros((1, 0))), (np.ones(1, bool), np.zeros(0, bool))
    found = Passages(*sides, np.full(1, np.nan))
    assert not found.log_likelihood(0, TRIED[None]).any()
    assert not found.log_of_middle(TRIED[None]).any()
    assert not found.cycles


def test_sensors_are_looked_at_where_statuses_change(tmp_path):
    problem = build_problem(*small.closed_loop(tmp_path, small.content() | {"heat": {}}, noise=0.02))
    (window,) = problem.open_loop.windows
    known = dict(zip(problem.names, problem.priors.median(), strict=True)) | small.TRUTH
    theta = problem.at(window, np.array(list(known.values()))[None])
    (found,) = passages(window, theta, None, np.zeros((1, len(window.switching.time))))
    changes = np.diff(window.status[:, 0])
    for side, (way, threshold) in enumerate(((1.0, 283.15), (-1.0, 286.15))):
        reached = found.reached[side][0][found.happened[side]]
        # The first too: until then the threshold was not reached.
        assert len(reached) == (changes == way).sum()
        # Its heater warms the body by 0.3 K in the half minute by which midway may be off.
        np.testing.assert_allclose(reached, threshold, atol=0.5)


def test_a_thermostat_is_expected_to_scatter_as_readings_of_its_thermistor_do(tmp_path):
    content = small.content()
    content["observations"]["body_temp"]["noise"] = "0.2 K"
    for node, usual in (("body", 0.2), ("panel", 0.15)):
        content["observations"]["body_temp"]["node"] = node
        window = build_problem(*small.load(tmp_path, content)).windows[0]
        (found,) = usual_scatter(window, np.full(len(window.names), 1.0))
        assert found == pytest.approx(usual)


def test_scatters_are_even_steps_of_their_logarithm():
    """Otherwise their prior, which is of the logarithm, counts some of them more."""
    np.testing.assert_allclose(np.diff(np.log(SCATTERS), n=2), 0.0, atol=1e-12)
