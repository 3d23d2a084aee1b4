"""Heaters that are not what the scenario says."""

import numpy as np
import pytest

from flightcal.check.prepared import prepared
from flightcal.check.wrongs import Words, Wrong
from flightcal.check.wrongs.heaters import heaters, obedient, statuses
from tests import small

from ..cases import named, silent, spoilt


def test_an_inverted_status_is_named(flown):
    scenario, data = flown
    first = named(scenario, spoilt(data, heater_status=1.0 - data["heater_status"]))[0]
    assert (first.kind, first.about) == ("status inverted", "heater_status")


@pytest.mark.parametrize(("column", "key"), [("heater", "bits"), ("other", "column")])
def test_swapped_statuses_are_exchanged_by_what_tells_them_apart(tmp_path, column, key):
    written = small.content()
    channels, heaters_of = written["telemetry"]["channels"], written["simulator"]["heaters"]
    channels["heater_status"]["bits"] = 0
    channels["other_status"] = {"column": column, "kind": "status", "bits": 1 if key == "bits" else 0}
    heaters_of["other"] = {**heaters_of["heater"], "node": "panel", "sensor": "panel", "measured_by": "other_status"}
    scenario, data = small.load(tmp_path, written, columns={"other": 0})
    view = prepared(scenario, data)
    assert view is not None
    advice = [wrong.words.advice for wrong in statuses(view) if "swapped" in wrong.words.title]
    assert advice == [f"Exchange '{key}' of heater_status and other_status in 'telemetry: channels'"]


def test_a_heater_of_half_the_power_is_named_with_both(tmp_path, named_of):
    written = small.content()
    del written["parameters"]["power"]
    written["simulator"]["heaters"]["heater"]["power"] = "14 W"
    _, data = small.closed_loop(tmp_path)
    scenario, _ = small.load(tmp_path, written)
    first = named_of(scenario, data, "heaters", "written")[0]
    assert (first.kind in ("heater", "number"), "power" in first.title) == (True, True)
    assert "2.0 times" in first.title or "0.50 times" in first.title
    assert "14.0" in first.sentence


def test_no_power_is_tried_that_is_about_right(tmp_path):
    written = small.content()
    del written["parameters"]["power"]
    view = prepared(*small.closed_loop(tmp_path, written))
    place = view.network.network.paths.index("heaters.heater.power")
    nearer = [near for wrong in heaters(view) if wrong.closer for close in wrong.closer() for near in close.closer()]
    powers = [wrong.window.network.mapping.written[place] for wrong in nearer if wrong.window is not None]
    tried = np.array(powers) / 30.0
    assert np.min(np.abs(tried - 1.0)) == pytest.approx(0.25, abs=0.15)
    assert np.min(np.abs(tried - 1.0)) >= 0.25


def test_thresholds_at_which_a_heater_does_not_switch_are_named(flown):
    scenario, data = flown
    heater = scenario.network.heaters["heater"]
    higher = heater.model_copy(update={"on_below": heater.on_below + 7.0, "off_above": heater.off_above + 7.0})
    model = scenario.network.model_copy(update={"heaters": {"heater": higher}})
    first = named(scenario.model_copy(update={"simulator": model}), data)[0]
    assert (first.kind, first.about) == ("thresholds", "heater")
    assert "below its thresholds" in first.title


def test_a_thermostat_switches_where_readings_turn_and_holds_between():
    read = np.array([285.0, 281.0, 280.1, 281.5, 284.9, 284.5, 281.0, 280.0])
    on = obedient(read, 280.0, 285.0)
    assert on is not None
    assert on.tolist() == [0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 1.0]
    assert obedient(np.full(8, 283.0), 280.0, 285.0) is None
    assert obedient(read[2:5], 280.0, 285.0) is None


@pytest.mark.parametrize("thresholds", [("50 degC", "55.4 degC"), ("-10 degC", "-7 degC")], ids=["on", "off"])
def test_thresholds_of_a_heater_without_a_status_are_named_where_it_would_never_switch(tmp_path, thresholds, named_of):
    _, data = small.closed_loop(tmp_path)
    written = silent(small.content())
    below, above = thresholds
    written["simulator"]["heaters"]["heater"] |= {"on_below": below, "off_above": above}
    scenario, _ = small.load(tmp_path, written)
    first = named_of(scenario, data, "heaters", "channels")[0]
    assert (first.kind, first.about) == ("thresholds", "heater")
    assert ("below 'on_below'" if below == "50 degC" else "above 'on_below'") in first.sentence


def test_a_heater_without_a_status_that_heats_another_node_is_named(tmp_path, named_of):
    _, data = small.closed_loop(tmp_path)
    written = silent(small.content())
    written["simulator"]["heaters"]["heater"]["node"] = "panel"
    scenario, _ = small.load(tmp_path, written)
    first = named_of(scenario, data, "heaters", "channels")[0]
    assert (first.kind, first.about) == ("heater", "heater")
    assert first.title == "heater heats body, not panel"


@pytest.mark.parametrize("thresholds", [("60 degC", "65 degC"), ("-90 degC", "-80 degC")], ids=["on", "off"])
def test_a_heater_without_a_status_that_never_switches_is_not_suspected(tmp_path, thresholds, named_of):
    written = small.content()
    below, above = thresholds
    second = {"node": "panel", "power": "5 W", "sensor": "panel", "on_below": below, "off_above": above}
    written["simulator"]["heaters"]["second"] = second | {"measured_by": "second_status"}
    written["telemetry"]["channels"]["second_status"] = {"column": "heater", "kind": "status"}
    _, data = small.closed_loop(tmp_path, written)
    del written["telemetry"]["channels"]["second_status"]
    written["simulator"]["heaters"]["second"] = second
    scenario, _ = small.load(tmp_path, written)
    assert named(scenario, data) == ()
    warmer = spoilt(data, panel_temp=data["panel_temp"].to_numpy() + 12.0)
    first = named_of(scenario, warmer, "heaters", "channels")[0]
    assert (first.kind, first.about) == ("bias", "panel_temp")


def test_a_heater_that_has_lost_a_string_is_named_with_the_time(tmp_path):
    scenario, data = small.closed_loop(tmp_path)
    simulator = small.simulator_of(scenario, data)
    # From 01:10 on half of its heat is lacking.
    view = prepared(scenario, data)
    on = np.repeat(view.network.drive.measured[:, 0] * (view.network.drive.times[:-1] >= 4200.0), 2)
    heat = np.zeros((len(view.network.network.heated), len(on)))
    heat[view.network.network.heated.index("body")] = -14.0 * on
    window = view.simulated_by(drive=view.network.with_heat(heat).drive)
    theta = view.problem.at(view.window, view.problem.to_theta(view.middle))[view.window.simulated]
    for name, value in small.TRUTH.items():
        place = view.network.parameters.index(name.replace("_", ".", 1) if name.startswith("initial") else name)
        theta[place] = value
    read = window.network.simulate(theta).temperatures
    noise = 0.1 * np.random.default_rng(2).standard_normal(read.shape)
    inside = np.isin(data["time"].values, view.window.times)
    weak = data.copy(deep=True)
    for k, channel in enumerate(simulator.channels):
        weak[channel].values[inside] = (read + noise)[:, k]
    (first,) = [suspicion for suspicion in named(scenario, weak) if suspicion.kind == "heater"]
    assert first.about == "heater from a time on"
    assert 0.3 < float(first.title.split(" has ")[1].split()[0]) < 0.7
    hour, minute = map(int, first.title.split("T")[1].split()[0].split(":"))
    assert 60 * hour + minute == pytest.approx(70.0, abs=15.0)


def test_all_heaters_are_tried_together(tmp_path):
    written = small.content()
    blocks = written["simulator"]["heaters"]
    blocks["second"] = blocks["heater"] | {"node": "panel", "power": "10 W"}
    del written["parameters"]["power"]
    view = prepared(*small.closed_loop(tmp_path, written))
    powers = [view.network.network.paths.index(f"heaters.{name}.power") for name in ("heater", "second")]
    together = [wrong for wrong in heaters(view) if wrong.about == "every heater"]
    assert [wrong.window.network.mapping.written[powers].tolist() for wrong in together] == [
        [30.0 * factor, 10.0 * factor] for factor in (0.25, 0.5, 2.0, 4.0)
    ]


def test_a_heaters_power_is_more_likely_off_than_a_number_of_equal_odds():
    def odds(kind):
        return Wrong(kind, "a", Words("", "", ""), tries=4.0).odds

    assert odds("heater") == pytest.approx(np.log(4.0))
    assert odds("number") > odds("heater")
    assert odds("thermostat") > odds("status inverted")
