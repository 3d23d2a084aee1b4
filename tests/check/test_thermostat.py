"""What a thermostat does beside what its status says."""

import numpy as np
import pytest

from flightcal.check.thermostat import copied, disobeyed, exchanged, inferred, unfollowed
from flightcal.problem import build_window
from flightcal.words import moment
from tests import small

from .cases import named


def test_a_status_is_told_that_does_not_do_what_the_thresholds_say(tmp_path):
    scenario, data = small.closed_loop(tmp_path)
    assert list(disobeyed(build_window(scenario, data, "train"))) == []
    cold = {
        "body_temp": ("time", data["body_temp"].values - 4.0),
        "heater_status": ("time", np.zeros(data.sizes["time"])),
    }
    ((told, constant),) = disobeyed(build_window(scenario, data.assign(cold), "train"))
    assert (told.kind, told.about, constant) == ("thermostat", "heater", True)
    assert "'off'" in told.sentence
    assert "below 'on_below' (10" in told.sentence


def test_a_status_that_comes_at_times_of_its_own_is_told_too(tmp_path):
    scenario, data = small.closed_loop(tmp_path)
    even = np.arange(data.sizes["time"]) % 2 == 0
    cold = {
        "body_temp": ("time", np.where(even, data["body_temp"].values - 4.0, np.nan)),
        "heater_status": ("time", np.where(even, np.nan, 0.0)),
    }
    ((told, constant),) = disobeyed(build_window(scenario, data.assign(cold), "train"))
    assert (told.about, constant) == ("heater", True)


def test_a_thermostat_that_switches_elsewhere_is_told_by_its_switches(tmp_path):
    """A shift of 2.3 K is too little to tell by how often it is on where it should be off."""
    scenario, data = small.closed_loop(tmp_path)
    off = {"body_temp": ("time", data["body_temp"].values + 2.3)}
    ((told, constant),) = disobeyed(build_window(scenario, data.assign(off), "train"))
    assert (told.about, constant) == ("heater", False)
    off_by = float(told.sentence.partition("by ")[2].split()[0])
    assert off_by == pytest.approx(2.3, abs=0.3)
    less = {"body_temp": ("time", data["body_temp"].values + 1.5)}
    assert list(disobeyed(build_window(scenario, data.assign(less), "train"))) == []


def test_thresholds_that_were_changed_in_the_window_are_told_with_the_time(tmp_path):
    scenario, data = small.closed_loop(tmp_path)
    window = build_window(scenario, data, "train")
    half = len(window.times) // 2

    def with_shift(shift):
        moved = data["body_temp"].values + np.where(data["time"].values >= window.times[half], shift, 0.0)
        return list(disobeyed(build_window(scenario, data.assign(body_temp=("time", moved)), "train")))

    ((told, constant),) = with_shift(-1.8)
    switches = window.times[1:][np.diff(window.status[:, 0]) != 0.0]
    first = switches[switches >= window.times[half]][0]
    assert (told.kind, told.about, constant) == ("thermostat", "heater", False)
    assert f"from {moment(first)} UTC on" in told.title
    assert float(told.sentence.rpartition("by ")[2].split()[0].replace("−", "-")) == pytest.approx(-1.8, abs=0.3)
    assert with_shift(-0.7) == []


def test_a_heater_is_known_to_be_off_where_its_sensor_is_always_warm(tmp_path):
    scenario, data = small.closed_loop(tmp_path)
    assert set(inferred(scenario, data, "heater")) == {0.5}
    warm = data.assign(body_temp=("time", data["body_temp"].values + 20.0))
    assert not inferred(scenario, warm, "heater").any()
    nothing = data.assign(body_temp=("time", np.full(data.sizes["time"], np.nan)))
    assert set(inferred(scenario, nothing, "heater")) == {0.5}


def test_a_heater_is_known_to_be_on_while_its_sensor_is_far_below_and_off_while_it_is_far_above(tmp_path):
    scenario, data = small.closed_loop(tmp_path)
    heater = scenario.network.switches["heater"]
    read = np.repeat(
        [heater.on_below - 5.0, heater.on_below - 1.0, heater.off_above + 5.0, heater.off_above - 5.0], 100
    )
    read = np.append(read, np.full(data.sizes["time"] - len(read), heater.on_below))
    read[20:30:2] = np.nan
    read[50:80] = np.nan
    on = inferred(scenario, data.assign(body_temp=("time", read)), "heater")
    # Over a gap of half an hour it may have switched.
    assert set(on[:50]) == set(on[80:100]) == {1.0}
    assert set(on[50:80]) == {0.5}
    assert set(on[200:300]) == {0.0}
    assert set(on[100:200]) == set(on[300:]) == {0.5}


def test_gain_and_bias_are_no_warmth(tmp_path):
    written = small.content()
    written["observations"]["body_temp"] |= {"gain": 3.0, "bias": "5 K"}
    scenario, data = small.closed_loop(tmp_path, written)
    assert data["body_temp"].min() > scenario.network.switches["heater"].on_below + 10.0
    assert set(inferred(scenario, data, "heater")) == {0.5}


def with_a_second_heater(**thresholds):
    written = small.content()
    heater = {"node": "panel", "power": "1 W", "sensor": "panel", "measured_by": "second_status"}
    written["simulator"]["heaters"]["second"] = heater | thresholds
    written["telemetry"]["channels"]["second_status"] = {"column": "heater", "kind": "status"}
    written["observations"]["second_status"] = {"heater": "second"}
    return written


def test_two_thermostats_with_one_status_are_told(tmp_path):
    written = with_a_second_heater(on_below="-60 degC", off_above="-50 degC")
    _, data = small.closed_loop(tmp_path)
    scenario, _ = small.load(tmp_path, written)

    def told(status):
        return list(copied(build_window(scenario, data.assign(second_status=("time", status)), "train")))

    (suspicion,) = told(data["heater_status"].values)
    assert (suspicion.kind, suspicion.about) == ("same status", "heater second")
    assert suspicion.title == "heater and second have the same status"
    assert told(1.0 - data["heater_status"].values) == []


def cycled(samples, period, low, high):
    """Readings, K, and status of a heater that is on while its sensor goes from one threshold, degC, to the other."""
    phase = np.arange(samples) % period / period
    on = phase < 0.5
    share = np.where(on, 2.0 * phase, 2.0 - 2.0 * phase)
    return 273.15 + low + (high - low) * share, on.astype(float)


def test_two_thermostats_whose_thresholds_are_exchanged_are_told(tmp_path):
    written = with_a_second_heater(on_below="8 degC", off_above="11 degC")
    scenario, data = small.load(tmp_path, written)
    names = ("body_temp", "heater_status"), ("panel_temp", "second_status")
    for channels, values in zip(names, (cycled(421, 20, 10.0, 13.0), cycled(421, 26, 8.0, 11.0)), strict=True):
        data = data.assign({name: ("time", one) for name, one in zip(channels, values, strict=True)})
    assert list(exchanged(build_window(scenario, data, "train"))) == []
    first, second = written["simulator"]["heaters"].values()
    for key in ("on_below", "off_above"):
        first[key], second[key] = second[key], first[key]
    (suspicion,) = exchanged(build_window(small.load(tmp_path, written)[0], data, "train"))
    assert (suspicion.kind, suspicion.about) == ("thresholds exchanged", "heater second")
    assert suspicion.title == "The thresholds of heater and second are exchanged"


@pytest.mark.parametrize(("capacity", "told"), [("100 J/K", True), ("3000 J/K", False)])
def test_a_heater_that_switches_between_the_samples_of_its_status_is_told(tmp_path, capacity, told):
    written = small.content()
    written["simulator"]["nodes"]["body"]["capacity"] = capacity
    scenario, data = small.closed_loop(tmp_path, written)
    found = unfollowed(build_window(scenario, data, "train"))
    assert [(suspicion.kind, suspicion.about) for suspicion in found] == ([("sampling", "heater")] if told else [])


@pytest.mark.slow
def test_missed_switches_are_no_wrong_where_the_heaters_node_is_held(tmp_path):
    written = small.content()
    written["simulator"]["nodes"]["body"]["capacity"] = "100 J/K"
    written["parameters"]["body"] = {
        "sets": "nodes.body.capacity",
        "prior": {"lognormal": {"median": "100 J/K", "factor": 1.3}},
    }
    scenario, data = small.closed_loop(tmp_path, written)
    assert not named(scenario, data)
