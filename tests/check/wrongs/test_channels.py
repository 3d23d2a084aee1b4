"""Channels that are biased, swapped or in another unit."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from flightcal.check.prepared import prepared
from flightcal.check.wrongs.channels import of_all, other_nodes, swaps, unrelated
from tests import small

from ..cases import TRAY, in_three, named, of_three, spoilt, sunlit


@pytest.mark.parametrize(("channel", "bias"), [("body_temp", 9.0), ("panel_temp", 30.0), ("panel_temp", -60.0)])
def test_a_bias_is_named_with_its_size(flown, channel, bias):
    """Also a large one, of which the node's initial temperature, from its first samples, is as far off."""
    scenario, data = flown
    first = named(scenario, spoilt(data, **{channel: data[channel] + bias}))[0]
    assert (first.kind, first.about) == ("bias", channel)
    assert float(first.title.split()[2]) == pytest.approx(abs(bias), abs=2.0)
    assert first.title.endswith("high" if bias > 0 else "low")


def test_a_channel_of_a_node_that_none_reads_is_named_wherever_it_is_said_to_begin(tmp_path):
    """What reads a node that is warmer by about as much is no biased sensor."""
    written = in_three()
    scenario, data = small.closed_loop(tmp_path, written, columns=TRAY)
    written["observations"]["tray_temp"] = {"node": "body"}
    written["simulator"]["nodes"]["tray"]["initial"] = "-30 degC"
    written["initial_state"] = {"unobserved": "3 K"}
    scenario, _ = small.load(tmp_path, written, columns=TRAY)
    assert named(scenario, data)[0].title == "tray_temp is of tray, not of body"


@pytest.mark.slow
def test_a_bias_beside_another_sensor_of_the_node_may_be_two_nodes(tmp_path):
    scenario, data = small.closed_loop(tmp_path, of_three())
    first = named(scenario, spoilt(data, other_temp=data["other_temp"] + 8.0))[0]
    assert first.title.endswith("K too high, or has a node of its own")
    assert first.advice.startswith("Check whether other_temp and panel_temp are of one node, then")


def test_fahrenheit_read_as_celsius_is_named(flown):
    scenario, data = flown
    read = 1.8 * (data["panel_temp"] - 273.15) + 32.0 + 273.15
    first = named(scenario, spoilt(data, panel_temp=read))[0]
    assert (first.kind, first.about) == ("unit", "panel_temp")
    assert "degF" in first.title


def test_celsius_read_as_fahrenheit_is_rather_that_than_a_bias(flown):
    """The body swings by 3 K: its readings are off by about the same all the time."""
    scenario, data = flown
    read = 273.15 + (data["body_temp"].to_numpy() - 273.15 - 32.0) / 1.8
    assert named(scenario, spoilt(data, body_temp=read))[0].title == "body_temp is in degC, and is read as degF"


def test_swapped_channels_are_named(flown):
    scenario, data = flown
    first = named(scenario, spoilt(data, body_temp=data["panel_temp"], panel_temp=data["body_temp"]))[0]
    assert first.kind == "swapped"


def test_a_channel_that_drifts_is_named(flown):
    scenario, data = flown
    drift = 10.0 * np.arange(data.sizes["time"]) / 180.0
    first = named(scenario, spoilt(data, body_temp=data["body_temp"] + drift))[0]
    assert (first.kind, first.about) == ("drift", "body_temp")


def test_a_channel_with_a_wrong_gain_is_named(flown):
    scenario, data = flown
    read = 273.15 + 1.6 * (data["body_temp"] - 273.15)
    first = named(scenario, spoilt(data, body_temp=read))[0]
    assert (first.kind, first.about) == ("gain", "body_temp")


@pytest.fixture
def cold(tmp_path):
    """A satellite whose heater is off all the time."""
    written = in_three()
    written["simulator"]["heaters"]["heater"] |= {"on_below": "-60 degC", "off_above": "-50 degC"}
    return small.closed_loop(tmp_path, written, columns=TRAY)


def test_a_thermistor_of_another_curve_is_right_at_25_degc(cold, named_of):
    scenario, data = cold
    read = 298.15 + 1.4 * (data["panel_temp"] - 298.15)
    first = named_of(scenario, spoilt(data, panel_temp=read), "channels")[0]
    assert (first.kind, first.about) == ("gain", "panel_temp")
    gain, bias = (float(number) for number in re.findall(r"(?:gain|bias): (-?[\d.]+)", first.advice))
    assert gain == pytest.approx(1.4, abs=0.1)
    assert bias == pytest.approx(25.0 * (1.0 - gain), abs=0.02)


def test_what_reads_all_sensors_wrong_is_named_with_its_gain_and_bias(cold):
    scenario, data = cold
    read = {name: 298.15 + 0.65 * (data[name] - 298.15) for name in ("body_temp", "panel_temp", "tray_temp")}
    first = named(scenario, spoilt(data, **read))[0]
    assert (first.kind, first.about) == ("gain", "every temperature")
    bias, gain = (float(number) for number in re.findall(r"-?\d+\.\d+", first.sentence))
    assert gain == pytest.approx(0.65, abs=0.07)
    assert 0.0 < bias < 16.0


def test_a_constant_that_all_channels_have_in_common_is_told_of_all(flown):
    (both, _) = of_all(prepared(*flown))
    assert both.about == "every temperature"
    assert both.columns.max() == pytest.approx(8.0)
    words = both.words(SimpleNamespace(added=np.array([0.5])))
    assert words.title == "Every temperature reads 4.0 K too high"


def test_the_curve_of_another_sensor_is_named(tmp_path):
    scenario, data = small.closed_loop(tmp_path, sunlit())
    read = data["panel_temp"].values
    middle, half = 0.5 * (read.max() + read.min()), 0.5 * np.ptp(read)
    first = named(scenario, spoilt(data, panel_temp=read + 6.0 * ((read - middle) / half) ** 2))[0]
    assert (first.kind, first.about) == ("curve", "panel_temp")


def test_a_mean_of_two_sensors_is_between_them(flown):
    scenario, data = flown
    mean = 0.5 * (data["body_temp"].values + data["panel_temp"].values)
    first = named(scenario, spoilt(data, panel_temp=mean))[0]
    assert (first.kind, first.about) == ("between", "panel_temp")
    assert 0.4 < float(first.sentence.split("%")[0].split()[-1]) / 100.0 < 0.6


def test_a_sensor_that_reads_another_node_is_not_between_the_two(flown):
    scenario, data = flown
    noise = 0.1 * np.random.default_rng(5).standard_normal(data.sizes["time"])
    found = named(scenario, spoilt(data, panel_temp=data["body_temp"].values + noise))
    assert found
    assert "between" not in [suspicion.kind for suspicion in found]


def test_a_second_sensor_of_a_node_that_takes_another_s_only_one_is_told_apart(tmp_path):
    view = prepared(*small.closed_loop(tmp_path, of_three()))
    read = {name: observation.node for name, observation in view.window.scenario.observations.items()}
    for wrong in other_nodes(view):
        node = wrong.words.title.split(" is of ")[1].split(",")[0]
        only = list(read.values()).count(read[wrong.about]) == 1
        assert (wrong.kind == "doubled") == (only and node in read.values()), wrong.words.title


def test_columns_are_tried_as_shifted_by_one(tmp_path):
    view = prepared(*small.closed_loop(tmp_path, of_three()))
    shifted = [wrong.observed for wrong in swaps(view) if wrong.words.title == "Every channel is its neighbour's"]
    assert len(shifted) == 2
    for k, by in enumerate((1, -1)):
        np.testing.assert_array_equal(shifted[k], view.observed[:, [by % 3, (1 + by) % 3, (2 + by) % 3]])


def test_any_three_of_more_channels_are_tried_as_each_others_both_ways():
    truth = np.array([[1.0, 2.0, 3.0, 4.0]])
    view = SimpleNamespace(channels=("a", "b", "c", "d"), observed=truth[:, [2, 0, 1, 3]])
    turned = [wrong for wrong in swaps(view) if wrong.words.title.endswith("are each other's")]
    assert len({tuple(wrong.observed[0]) for wrong in turned}) == len(turned) == 8
    (right,) = [wrong for wrong in turned if (wrong.observed == truth).all()]
    assert right.words.sentence.startswith("With the readings of b for a, of c for b and of a for c")


def test_of_a_channel_of_no_place_the_driver_of_its_nodes_load_is_told_too(flown):
    view = prepared(*flown)
    sentences = {wrong.about: wrong.words.sentence for wrong in unrelated(view)}
    assert "or sun, which a load of it follows, is another column." in sentences["panel_temp"]
    assert "follows" not in sentences["body_temp"]
