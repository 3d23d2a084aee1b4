from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from flightcal.prediction import extremes, is_plan
from flightcal.prediction.limits import limit_scores, read_limits_told, with_limits

TIMES = np.datetime64("2031-05-28T00:00", "ns") + np.arange(4) * np.timedelta64(10, "m")
LIMITS = {"tank": (280.0, None), "radio": (None, 320.0)}


def window(lowest=(279.0, 281.0, 281.5, 283.0), observed=np.nan):
    """Three channels and four draws; the first sample was flown."""
    mean = np.array([[270.0, 300.0, 290.0], [281.0, 310.0, 290.0], [283.0, 305.0, 290.0], [282.0, 300.0, 291.0]])
    draws = np.array([lowest, (300.0,) * 4, (290.0,) * 4]).T
    return xr.Dataset(
        {
            "observed": (("time", "channel"), np.concatenate([np.full((1, 3), 285.0), np.full((3, 3), observed)])),
            "scored": ("time", [False, True, True, True]),
            "mean": (("by", "time", "channel"), mean[None]),
            "lowest": (("simulation", "channel"), draws),
            "highest": (("simulation", "channel"), draws + 20.0),
        },
        {"time": TIMES, "channel": ["tank", "radio", "frame"], "by": ["stochastic"]},
        {"interval": 0.95} | ({"planned": 1} if np.isnan(observed) else {}),
    )


def told(prediction):
    return {(extreme.channel, extreme.end): extreme for extreme in extremes(prediction, "plan")}


def test_the_chance_is_the_share_of_draws_that_go_beyond_the_limit():
    found = told(with_limits(window(), LIMITS))
    assert found["tank", "lowest"].chance == 0.25
    assert found["radio", "highest"].chance == 0.0
    assert np.isnan(found["tank", "highest"].chance)
    assert np.isnan(found["frame", "lowest"].limit)
    assert found["tank", "lowest"].time == TIMES[1]
    assert str(found["tank", "lowest"]) == (
        "plan: tank below its limit of 6.85 degC: chance 25.0%; lowest 8.1 (6.0 to 9.7) degC"
    )


@pytest.mark.parametrize(
    ("lowest", "words"),
    [((283.0,) * 1000, "below 0.1%"), ((279.0,) * 1000, "above 99.9%"), ((279.0,) + (283.0,) * 999, "0.1%")],
)
def test_a_chance_is_told_as_finely_as_the_draws_tell_it(lowest, words):
    prediction = window().drop_vars(["lowest", "highest"])
    draws = np.array([lowest, (300.0,) * 1000, (290.0,) * 1000]).T
    prediction["lowest"] = prediction["highest"] = (("simulation", "channel"), draws)
    assert told(with_limits(prediction, LIMITS))["tank", "lowest"].chance_in_words == words


def test_only_a_plan_has_chances_among_its_scores():
    assert [
        (score.channel, score.metric, score.value) for score in limit_scores(with_limits(window(), LIMITS), "plan")
    ] == [
        ("tank", "below_limit", 0.25),
        ("radio", "above_limit", 0.0),
    ]
    measured = with_limits(window(observed=285.0), LIMITS)
    assert not is_plan(measured)
    assert limit_scores(measured, "test") == []


def test_the_likeliest_to_pass_its_limit_is_told_first(tmp_path):
    one, other = (with_limits(window(lowest), LIMITS) for lowest in ((281.0,) * 4, (279.0, 279.5, 281.0, 282.0)))
    measured = with_limits(window(observed=285.0), LIMITS)
    file = tmp_path / "prediction.nc"
    xr.DataTree.from_dict({"test.one": one, "test.other": other, "test.past": measured}).to_netcdf(file)
    found = [(extreme.window, extreme.channel, extreme.chance) for extreme in read_limits_told(file)]
    assert found[0] == ("test.other", "tank", 0.5)
    assert {row[0] for row in found} == {"test.one", "test.other"}
    assert len(found) == 4
