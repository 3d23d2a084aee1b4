"""Stretches in another attitude than the scenario says."""

import re
from datetime import datetime

import numpy as np
import pytest

from flightcal.check.wrongs.stretches import _PIECES, likeliest
from tests import small

from ..cases import boxed, named, pointed


def spans(title):
    """An attitude, and from when to when it was."""
    _, attitude, rest = title.split("'")
    begin, end = (datetime.fromisoformat(time) for time in rest.split()[1:4:2])
    return attitude, begin, end


def test_a_safe_mode_that_the_scenario_does_not_know_of_is_named_with_its_times(tmp_path):
    written = boxed()
    written["environment"]["attitude"] = {
        "timeline": [
            {"at": "2024-03-01T00:00:00", "attitude": "nadir"},
            {"at": "2024-03-01T02:00:00", "attitude": "sun_pointing"},
            {"at": "2024-03-01T02:40:00", "attitude": "nadir"},
        ]
    }
    _, data = small.closed_loop(tmp_path, written)
    written["environment"]["attitude"] = "nadir"
    scenario, _ = small.load(tmp_path, written)
    first = named(scenario, data)[0]
    assert (first.kind, first.about) == ("attitude", "stretch sun_pointing")
    attitude, begin, end = spans(first.title)
    assert attitude == "sun_pointing"
    assert abs((begin - datetime(2024, 3, 1, 2, 0)).total_seconds()) < 200.0
    assert abs((end - datetime(2024, 3, 1, 2, 40)).total_seconds()) < 200.0


@pytest.mark.slow
def test_turns_of_the_face_that_takes_most_sunlight_are_tried(tmp_path):
    """To charge a battery, in an attitude that the scenario does not name."""
    written = boxed()
    written["simulator"]["faces"]["back"] |= {"area": "0.2 m^2"}
    charging = {
        "aligned": {"axis": [-1, 0, 0], "towards": "sun"},
        "constrained": {"axis": [0, 0, 1], "towards": "nadir"},
    }
    written["environment"]["attitude"] = {
        "timeline": [
            {"at": "2024-03-01T00:00:00", "attitude": "nadir"},
            {"at": "2024-03-01T02:00:00", "attitude": charging},
            {"at": "2024-03-01T02:40:00", "attitude": "nadir"},
        ]
    }
    _, data = small.closed_loop(tmp_path, written)
    written["environment"]["attitude"] = "nadir"
    scenario, _ = small.load(tmp_path, written)
    first = named(scenario, data)[0]
    attitude, begin, end = spans(first.title)
    assert attitude == "[-1, 0, 0] to the Sun"
    assert abs((begin - datetime(2024, 3, 1, 2, 0)).total_seconds()) < 200.0
    assert abs((end - datetime(2024, 3, 1, 2, 40)).total_seconds()) < 200.0


@pytest.mark.slow
def test_two_slews_that_the_scenario_does_not_know_of_are_named_together(tmp_path):
    written = boxed()
    written["environment"]["attitude"] = attitude = pointed((0.5, 0.1, 0.7, 0.5))
    stays = attitude["timeline"][:1]
    slews = [("01:35", "third"), ("01:55", "one"), ("03:05", "other"), ("03:25", "one")]
    attitude["timeline"] = stays + [{"at": f"2024-03-01T{at}:00", "attitude": name} for at, name in slews]
    _, data = small.closed_loop(tmp_path, written)
    attitude["timeline"] = stays
    scenario, _ = small.load(tmp_path, written)
    first = named(scenario, data)[0]
    assert first.about == "stretch third other"
    # It begins in the shadow, where attitudes are much alike.
    assert re.search("'third' from 2024-03-01T01:[23]", first.sentence)
    assert "'other' from 2024-03-01T03:0" in first.sentence


def test_the_likeliest_stretches_are_those_that_explain_most_each_beside_the_others():
    rng = np.random.default_rng(4)
    effects = rng.standard_normal((4000, 2 * _PIECES))
    there = np.zeros(2 * _PIECES)
    there[10:30], there[_PIECES + 50 : _PIECES + 55] = 1.0, 1.0
    residual = effects @ there + rng.standard_normal(4000)
    found = likeliest(effects.T @ residual, effects.T @ effects, 2, 20.0)
    assert found[-1] == [(0, 10, 30), (1, 50, 55)]
    assert [len(stretches) for stretches in found] == sorted({len(stretches) for stretches in found})


@pytest.mark.parametrize("nothing", [0.0, 1.0])
def test_where_no_attitude_explains_anything_there_is_no_stretch(nothing):
    rng = np.random.default_rng(5)
    effects = rng.standard_normal((4000, _PIECES))
    residual = nothing * rng.standard_normal(4000)
    assert likeliest(effects.T @ residual, effects.T @ effects, 1, 10.0) == []
