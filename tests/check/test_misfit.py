"""Where and when a simulation is farthest from the telemetry."""

from dataclasses import replace

import numpy as np
import pytest

from flightcal.check.misfit import Misfit, misfit
from flightcal.check.prepared import prepared
from tests import small

from .cases import boxed, pointed, spoilt, sunlit


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """The small satellite in an orbit with eclipses, and the telemetry of its own model."""
    return small.closed_loop(tmp_path_factory.mktemp("flown"), sunlit())


def where(scenario, data):
    view = prepared(scenario, data)
    return misfit(view, view.middle)


def test_the_worst_channel_is_told_with_the_state_in_which_it_is_worst(flown):
    scenario, data = flown
    on = data["heater_status"].to_numpy() > 0.5
    found = where(scenario, spoilt(data, panel_temp=data["panel_temp"] + 12.0 * on))
    assert (found.channel, found.when) == ("panel_temp", "while heater is on")
    assert found.then > 1.25 * found.typical


def test_an_attitude_is_a_state_too(tmp_path):
    written = boxed()
    written["environment"]["attitude"] = pointed((0.5, 0.1, 0.7, 0.5))
    scenario, data = small.closed_loop(tmp_path, written)
    inside = data["time"].to_numpy() >= np.datetime64("2024-03-01T02:20:00")
    found = where(scenario, spoilt(data, panel_temp=data["panel_temp"] + 12.0 * inside))
    assert (found.channel, found.when) == ("panel_temp", "in attitude 'third'")


def test_what_is_off_all_the_time_is_of_no_state(flown):
    scenario, data = flown
    view = prepared(scenario, data)
    found = misfit(replace(view, telemetry=spoilt(data, body_temp=data["body_temp"] + 40.0)), view.middle)
    assert (found.channel, found.when, found.then) == ("body_temp", "", found.typical)
    assert found.typical == pytest.approx(40.0, rel=0.1)


def test_samples_that_are_not_there_count_for_nothing(flown):
    scenario, data = flown
    nothing = spoilt(data, panel_temp=np.full(data.sizes["time"], np.nan))
    assert where(scenario, nothing).channel == "body_temp"


def test_words_tell_the_channel_and_when():
    assert Misfit("a", 2.0, "in the shadow", 4.0).words == "The misfit is largest in a: 2.0 K, and 4.0 K in the shadow."
    assert Misfit("a", 2.0, "", 2.0).words == "The misfit is largest in a: 2.0 K."
