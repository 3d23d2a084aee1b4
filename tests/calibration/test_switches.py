"""States of heaters without a status: exchanged as long as that makes telemetry more probable."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from flightcal.calibration.switches import HeaterTimes, exchanged, with_shifts, with_states
from flightcal.problem import Held

TIMES = 60
EDGES = np.linspace(0.0, 60.0 * TIMES, TIMES + 1)


def heater(on, may_go_on=None, may_go_off=None, place=0):
    anywhere = np.ones(TIMES + 1, bool)
    return HeaterTimes(
        heater=place,
        edges=EDGES,
        on=np.asarray(on, bool),
        instead=(),
        may_go_on=anywhere if may_go_on is None else may_go_on,
        may_go_off=anywhere if may_go_off is None else may_go_off,
        response=np.empty((0, 0, TIMES)),
        interval=30.0,
    )


def states(*spans):
    on = np.zeros(TIMES, bool)
    for begin, end in spans:
        on[begin:end] = True
    return on


def told(true, now, seed=0, noise=0.05):
    """Slope and curvature of a body that a heater warms up, whose temperature is measured every 30 s."""
    rng = np.random.default_rng(seed)
    seconds = np.arange(0.0, EDGES[-1], 30.0)
    # 10 W into 1,000 J/K, which cool down with a time constant of 20 min.
    response = np.stack(
        [
            10.0 / 1000.0 * 1200.0 * (np.exp(-(seconds - end).clip(0.0) / 1200.0) - np.exp(-(seconds - begin) / 1200.0))
            * (seconds >= begin)
            for begin, end in itertools.pairwise(EDGES)
        ],
        axis=1,
    )  # fmt: skip
    left = response @ (true.astype(float) - now) + noise * rng.standard_normal(len(seconds))
    return response.T @ left / noise**2, response.T @ response / noise**2


CASES = {
    "a spell too few": (states((10, 20), (40, 50)), states((10, 20))),
    "a spell too many": (states((10, 20)), states((10, 20), (40, 50))),
    "spells too late": (states((10, 20), (40, 50)), states((13, 23), (43, 53))),
    "on at first": (states((0, 12), (40, 50)), states((40, 50))),
    "never off": (states((0, TIMES)), states((0, 20))),
    "a break too few": (states((10, 20), (25, 50)), states((10, 50))),
    "right": (states((10, 20), (40, 50)), states((10, 20), (40, 50))),
}


@pytest.mark.parametrize(("true", "now"), CASES.values(), ids=CASES)
@pytest.mark.parametrize("seed", range(3))
def test_what_a_heater_did_is_found(true, now, seed):
    (found,) = exchanged([heater(now)], *told(true, now, seed))
    # The noise may move a switch by one time.
    assert np.count_nonzero(np.diff(found)) == np.count_nonzero(np.diff(true))
    assert np.count_nonzero(found != true) <= 1


def test_heaters_that_warm_the_same_body_are_told_apart_by_where_they_may_switch():
    first, second = states((10, 20)), states((30, 45))
    slope, curvature = told(first | second, states())
    here = [np.isin(np.arange(TIMES + 1), places) for places in ((9, 10, 11), (19, 20, 21), (29, 30, 31), (44, 45, 46))]
    heaters = [heater(states(), here[0], here[1]), heater(states(), here[2], here[3], place=1)]
    both = np.tile(slope, 2), np.tile(curvature, (2, 2))
    found = exchanged(heaters, *both)
    for on, true in zip(found, (first, second), strict=True):
        assert np.count_nonzero(on != true) <= 1


def test_a_heater_switches_nowhere_but_where_its_sensor_allows_it():
    true = states((10, 20))
    nowhere = np.zeros(TIMES + 1, bool)
    (found,) = exchanged([heater(states(), may_go_on=nowhere)], *told(true, states()))
    assert not np.any(~found[:-1] & found[1:])


def test_what_is_not_needed_is_not_switched():
    """Of noise alone, a hundred times: it is not taken for a spell in more than a few."""
    none = states()
    changed = [exchanged([heater(none)], *told(none, none, seed, noise=1.5))[0].any() for seed in range(100)]
    assert sum(changed) <= 10


def test_a_switch_that_stays_keeps_its_moment_and_another_is_where_it_was_found():
    held = Held(
        "train", ((0.0, 3600.0, 0), (0.0, 3600.0, 1)), ((615.0, 1190.0, 0), (5.0, 9.0, 1)), ((615.0, 0, 300.0),)
    )
    heater_times = heater(states((10, 20)))
    assert with_states(held, heater_times, heater_times.on) is held
    found = with_states(held, heater_times, states((10, 20), (40, 60)))
    assert found.on == ((5.0, 9.0, 1), (615.0, 1190.0, 0), (2400.0, 3600.0, 0))
    # The end of the window is no switch.
    assert found.switches == ((615.0, 0, 120.0), (1190.0, 0, 120.0), (2400.0, 0, 120.0))
    rarely = replace(heater_times, interval=300.0)
    assert {within for _, _, within in with_states(held, rarely, states((10, 20), (40, 60))).switches} == {600.0}
    known = with_states(held, heater_times, states((10, 20), (40, 60)), keeps=True)
    assert known.switches == ((615.0, 0, 300.0), (1190.0, 0, 120.0), (2400.0, 0, 120.0))


def test_a_switch_that_is_moved_is_known_twice_as_well_down_to_an_interval():
    gaps, on = ((0.0, 3600.0, 0),), ((600.0, 1200.0, 0), (2400.0, 3600.0, 0))
    held = Held("train", gaps, on, ((600.0, 0, 400.0), (1200.0, 0, 80.0), (2400.0, 0, 60.0)))
    found = with_shifts(held, np.array([50.0, -500.0, 10.0]), [0], 60.0)
    assert found.on == ((550.0, 1160.0, 0), (2390.0, 3600.0, 0))
    assert found.switches == ((550.0, 0, 200.0), (1160.0, 0, 60.0), (2390.0, 0, 60.0))
