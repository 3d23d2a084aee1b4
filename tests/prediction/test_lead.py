"""How a plan begins: its telemetry, or training, simulated on up to its start."""

import numpy as np
import pytest

from flightcal.prediction import lead
from tests.prediction.test_heat import drawn_of, flown, predicted, written

START, END = "2024-03-01T05:30:00", "2024-03-01T07:00:00"
CHANNELS = ("body_temp", "panel_temp")


@pytest.fixture(scope="module")
def flew(tmp_path_factory):
    return flown(tmp_path_factory.mktemp("flown"), 0.0)


@pytest.fixture(scope="module")
def drawn(flew, tmp_path_factory):
    """A problem with heat, its draws and their heat: all windows to train on end before what the tests change."""
    content = written()
    content["windows"]["test"] = {"plan": {"start": START, "end": END, "planned": True}}
    return drawn_of(tmp_path_factory.mktemp("drawn"), content, flew)


def planned(drawn, flew, last):
    """A prediction of a plan where telemetry ends at a time; only what the Sun does is planned."""
    known = flew.where(flew["time"] < np.datetime64(last), np.nan)
    return predicted((known.assign(flags=flew["flags"], sun=flew["sun"]), *drawn), "test.plan")


def off_at_first(prediction, flew):
    """How far the first mean is off, and the first interval's width, K, of each channel."""
    first, truth = prediction.isel(time=0), flew.sel(time=prediction["time"][0])
    return [
        (
            abs(float(first["mean"].sel(channel=name) - truth[name])),
            float((first["upper"] - first["lower"]).sel(channel=name)),
        )
        for name in CHANNELS
    ]


def test_telemetry_that_ended_hours_before_is_simulated_on(drawn, flew):
    found = planned(drawn, flew, "2024-03-01T03:01:00")
    assert found["time"].values[0] == np.datetime64(START)
    assert found["scored"].values.all()
    assert found.attrs["initial_state"] == "that of the last telemetry, simulated on"
    for off, width in off_at_first(found, flew):
        assert off < 1.5
        assert width < 6.0


def test_without_recent_telemetry_a_plan_begins_as_training_has_it_days_before(drawn, flew, monkeypatch):
    monkeypatch.setattr(lead, "_LONGEST", 0.0)
    monkeypatch.setattr(lead, "_ORBITS", 0.8)
    monkeypatch.setattr(lead, "_BRIDGED", 0.0)
    found = planned(drawn, flew, "2024-03-01T03:01:00")
    assert found.attrs["initial_state"] == "simulated from 1 h before on, from where training had it"
    for off, width in off_at_first(found, flew):
        assert off < 2.5
        assert width < 8.0


def test_a_gap_in_a_driver_that_a_plan_needs_is_not_simulated(drawn, flew, monkeypatch):
    monkeypatch.setattr(lead, "_BRIDGED", 0.0)
    gap = flew.copy(deep=True)
    minutes = (gap["time"].values - gap["time"].values[0]) / np.timedelta64(1, "m")
    gap["sun"].values[(minutes > 190) & (minutes < 290)] = np.nan
    found = planned(drawn, gap, "2024-03-01T03:01:00")
    assert found.attrs["initial_state"] == "simulated from 1 h before on, from where training had it"
    assert np.isfinite(found["mean"].values).all()


def test_where_nothing_before_a_plan_can_be_simulated_it_begins_as_unsure_as_that_is(drawn, flew, monkeypatch):
    monkeypatch.setattr(lead, "_BRIDGED", 0.0)
    gap = flew.copy(deep=True)
    minutes = (gap["time"].values - gap["time"].values[0]) / np.timedelta64(1, "m")
    gap["sun"].values[(minutes > 190) & (minutes < 330)] = np.nan
    found = planned(drawn, gap, "2024-03-01T03:01:00")
    assert found.attrs["initial_state"] == lead.UNKNOWN
    for off, width in off_at_first(found, flew):
        assert width > 2.0 * off
        assert width > 8.0


def test_of_a_plan_that_is_partly_flown_what_is_still_to_come_has_extremes(drawn, flew):
    found = planned(drawn, flew, "2024-03-01T06:00:00")
    times = found["time"].values
    coming = times >= np.datetime64("2024-03-01T06:00")
    assert found.attrs["planned"] == 1
    np.testing.assert_array_equal(np.isfinite(found["observed"].values).any(axis=1), ~coming)
    # The first minutes tell where it begins.
    np.testing.assert_array_equal(found["scored"].values, times > np.datetime64("2024-03-01T05:40"))
    truth = flew.sel(time=times[coming])
    for name in CHANNELS:
        assert abs(float(found["lowest"].sel(channel=name).median() - truth[name].min())) < 1.5
        assert abs(float(found["highest"].sel(channel=name).median() - truth[name].max())) < 1.5


def test_a_last_sample_at_its_start_makes_no_plan_a_test(drawn, flew):
    found = planned(drawn, flew, "2024-03-01T05:30:30")
    assert np.isfinite(found["observed"].values[0]).any()
    assert not np.isfinite(found["observed"].values[found["scored"].values]).any()


def test_what_heaters_do_before_a_plan_is_no_part_of_its_duty_cycle(drawn, flew):
    found = planned(drawn, flew, "2024-03-01T03:01:00")
    duty = found["status"].mean("time").values
    np.testing.assert_allclose(found["duty_cycle"].mean("simulation"), duty, atol=0.03)
