"""Sensors that are slow, and channels that are means."""

import numpy as np
import pytest

from ..cases import named, spoilt


def followed(values, minutes):
    """What a sensor reads that follows values [T], a minute apart, with a lag."""
    read = np.array(values)
    for k in range(1, len(read)):
        read[k] = read[k - 1] + (values[k] - read[k - 1]) * (1.0 - np.exp(-1.0 / minutes))
    return read


def test_a_slow_sensor_is_named_with_its_lag(flown):
    scenario, data = flown
    slow = spoilt(data, panel_temp=followed(data["panel_temp"].values, 12.0))
    first = named(scenario, slow)[0]
    assert (first.kind, first.about) == ("slow", "panel_temp")
    assert "lag" in first.title
    assert float(first.title.split()[-2]) == pytest.approx(12.0, rel=0.3)


def test_where_a_slow_sensors_node_begins_is_not_what_its_first_sample_says(flown, named_of):
    """The sensor was 30 K warmer than its panel when the window began."""
    scenario, data = flown
    left = 30.0 * np.exp(-np.arange(data.sizes["time"]) / 12.0)
    first = named_of(
        scenario, spoilt(data, panel_temp=followed(data["panel_temp"].values, 12.0) + left), "slow", "channels"
    )[0]
    assert (first.kind, first.about) == ("slow", "panel_temp")
    assert float(first.title.split()[-2]) == pytest.approx(12.0, rel=0.2)


def test_a_slow_sensor_that_the_scenario_knows_of_is_no_wrong(flown):
    scenario, data = flown
    slow = spoilt(data, panel_temp=followed(data["panel_temp"].values, 12.0))
    known = scenario.observations["panel_temp"].model_copy(update={"lag": 720.0})
    observations = {**scenario.observations, "panel_temp": known}
    assert named(scenario.model_copy(update={"observations": observations}), slow) == ()


def test_a_slow_sensor_of_a_thermostat_explains_that_it_is_disobeyed(flown):
    scenario, data = flown
    slow = spoilt(data, body_temp=followed(data["body_temp"].values, 20.0))
    assert "thermostat" not in {suspicion.kind for suspicion in named(scenario, slow)}


def test_a_smoothed_channel_is_named_with_the_time(flown):
    scenario, data = flown
    smooth = np.convolve(np.pad(data["panel_temp"].values, 20, mode="edge"), np.ones(41) / 41.0, mode="valid")
    first = named(scenario, spoilt(data, panel_temp=smooth))[0]
    assert (first.kind, first.about) == ("slow", "panel_temp")
    assert "smoothed" in first.title
    assert float(first.title.split()[-2]) == pytest.approx(41.0, rel=0.3)


def test_what_means_hold_from_beyond_the_window_is_not_known(flown, named_of):
    """The same means, of a panel that was much colder before the window and much warmer after it."""
    scenario, data = flown
    panel = data["panel_temp"].values
    around = np.concatenate([np.full(20, panel[0] - 20.0), panel, np.full(20, panel[-1] + 20.0)])
    means = spoilt(data, panel_temp=np.convolve(around, np.ones(41) / 41.0, mode="valid"))
    first = named_of(scenario, means, "slow", "channels")[0]
    assert (first.kind, first.about) == ("slow", "panel_temp")
    assert "smoothed" in first.title


def test_a_mean_of_the_time_before_each_sample_is_no_clock_that_is_late(flown, named_of):
    scenario, data = flown
    earlier = np.pad(data["panel_temp"].values, (30, 0), mode="edge")
    means = spoilt(data, panel_temp=np.convolve(earlier, np.ones(31) / 31.0, mode="valid"))
    first = named_of(scenario, means, "slow", "channels", "clocks")[0]
    assert (first.kind, first.about) == ("earlier mean", "panel_temp")
    assert first.title.startswith("panel_temp is the mean of the ")
    assert float(first.title.split()[-3]) == pytest.approx(31.0, rel=0.3)
