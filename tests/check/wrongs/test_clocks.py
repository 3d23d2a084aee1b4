"""Times that are late, early or in another zone."""

from datetime import timedelta

import numpy as np
import pandas as pd
import pytest

from flightcal.check.prepared import prepared
from flightcal.check.wrongs.clocks import channel_clocks, clocks, rates, status_clocks, temperature_clocks
from flightcal.environment.orbit import propagator
from flightcal.scenario import CircularOrbit
from tests import small

from ..cases import named, of_three, spoilt, sunlit


def test_a_clock_is_rather_off_by_less_than_half_an_orbit(tmp_path):
    view = prepared(*small.closed_loop(tmp_path, sunlit()))
    assert view is not None
    late, alias = clocks(view, [1200.0, 1200.0 - view.window.period])
    assert alias.odds > late.odds + 1.0
    # The same less an orbit is looked at too, where that is nearer to a step of the first look.
    assert alias.closer is not None
    titles = [wrong.words.title for wrong in alias.closer()]
    assert "The telemetry's clock is 20.0 min late" in titles


def test_a_clock_that_is_off_by_an_hour_but_for_an_orbit_is_told_of_both(tmp_path):
    view = prepared(*small.closed_loop(tmp_path, sunlit()))
    assert view is not None
    period = view.window.period
    first, far, second = (
        wrong.words.sentence for wrong in clocks(view, [3600.0 - period, 4.0 * 3600.0 - 3.0 * period, 1300.0])
    )
    assert "whole orbits more or less may be as good, such as 1 h late." in first
    assert "such as 4 h late." in far
    assert "may be as good." in second


def test_a_clock_that_is_late_is_named_with_the_minutes(tmp_path):
    scenario, data = small.closed_loop(tmp_path, sunlit())
    late = data.assign_coords(time=data["time"] + np.timedelta64(20, "m"))
    assert named(scenario, data) == ()
    first = named(scenario, late)[0]
    assert first.kind == "clock"
    assert first.title.endswith("late")
    assert float(first.title.split()[4]) == pytest.approx(20.0, abs=1.5)


@pytest.mark.slow
def test_a_clock_that_is_off_by_no_step_of_the_search_is_named_to_some_seconds(tmp_path):
    scenario, data = small.closed_loop(tmp_path, sunlit())
    first = named(scenario, data.assign_coords(time=data["time"] + np.timedelta64(1097, "s")))[0]
    assert (first.kind, first.title[-4:]) == ("clock", "late")
    assert float(first.advice.split()[-2]) == pytest.approx(-1097.0, abs=10.0)


@pytest.mark.slow
def test_a_clock_that_is_late_is_named_where_positions_hardly_reach_beyond_the_window(tmp_path):
    written = sunlit()
    orbit = CircularOrbit.model_validate(written["environment"]["orbit"])
    times = np.datetime64("2024-02-29T23:50", "ns") + np.arange(0, 442, 2) * np.timedelta64(1, "m")
    table = pd.DataFrame(propagator(orbit)(times)[0], columns=["x", "y", "z"])
    table.insert(0, "time", np.datetime_as_string(times, unit="s"))
    table.to_csv(tmp_path / "positions.csv", index=False)
    written["environment"]["orbit"] = {"positions": "positions.csv"}
    scenario, data = small.closed_loop(tmp_path, written)
    first = named(scenario, data.assign_coords(time=data["time"] + np.timedelta64(20, "m")))[0]
    assert first.kind == "clock"
    assert float(first.title.split()[4]) == pytest.approx(20.0, abs=1.5)


@pytest.mark.parametrize(("period", "tried"), [(None, False), ("20 min", True), ("90 min", False)])
def test_shifts_do_not_step_over_the_turns_of_a_body_that_spins(tmp_path, period, tried):
    written = sunlit()
    spin = {"spin_axis": [0, 0, 1], "direction": [1, 0, 1]}
    written["environment"]["attitude"] = spin if period is None else {**spin, "period": period}
    view = prepared(*small.closed_loop(tmp_path, written))
    assert view is not None
    titles = [wrong.words.title for wrong in clocks(view)]
    assert ("The telemetry's clock is 10.0 min early" in titles) == tried
    assert "The telemetry's clock is 8.0 min early" in titles


@pytest.mark.slow
def test_a_clock_of_another_zone_is_named_with_the_hours(tmp_path):
    scenario, data = small.closed_loop(tmp_path, sunlit())
    late = data.assign_coords(time=data["time"] + np.timedelta64(330, "m"))
    window = scenario.windows["train"]
    moved = window.model_copy(
        update={"start": window.start + timedelta(hours=5.5), "end": window.end + timedelta(hours=5.5)}
    )
    found = named(scenario.model_copy(update={"windows": {"train": moved}}), late)[:2]
    # Without modes whole orbits more or less are as good.
    assert ("clock", "The telemetry's clock is 5.5 h late") in [
        (suspicion.kind, suspicion.title) for suspicion in found
    ]


@pytest.mark.slow
def test_a_clock_that_goes_too_fast_is_named(tmp_path):
    scenario, data = small.closed_loop(tmp_path, sunlit())
    times = data["time"].values
    fast = data.assign_coords(time=times[0] + ((times - times[0]) * 1.05))
    found = {suspicion.about: suspicion for suspicion in named(scenario, fast)[:2]}
    assert found["rate"].kind == "clock"
    assert "too fast" in found["rate"].title


def test_without_an_orbit_all_temperatures_together_are_tried_beside_several_drivers_and_by_hours(tmp_path):
    written = small.content()
    written["environment"]["period"] = "63 h"
    alone = prepared(*small.closed_loop(tmp_path, written))
    written["telemetry"]["channels"]["other"] = written["telemetry"]["channels"]["sun"] | {"column": "other"}
    written["simulator"]["loads"]["other"] = {"node": "body", "driver": "other", "coefficient": "1 W/A"}
    other = np.random.default_rng(1).uniform(0.0, 5.0, 421)
    scenario, data = small.load(tmp_path, written, columns={"other": other})
    view = prepared(scenario, small.telemetry_of(scenario, data))
    assert not list(temperature_clocks(alone))
    tried = {wrong.words.title: wrong for wrong in temperature_clocks(view)}
    assert "body_temp and panel_temp are 60.0 min late" in tried
    # The telemetry begins with the window: of its three hours less than 70% would be left.
    assert "body_temp and panel_temp are 60.0 min early" not in tried
    assert np.isfinite([wrong.odds for wrong in tried.values()]).all()


def in_packets(scenario, packets):
    """The scenario with channels in packets."""
    channels = {
        name: channel.model_copy(update={"packet": packets.get(name)})
        for name, channel in scenario.telemetry.channels.items()
    }
    return scenario.model_copy(update={"telemetry": scenario.telemetry.model_copy(update={"channels": channels})})


@pytest.mark.slow
def test_a_packet_of_another_time_zone_is_named(tmp_path):
    scenario, data = small.closed_loop(tmp_path, of_three())
    late = {name: np.roll(data[name].values, 60) for name in ("panel_temp", "other_temp")}
    packets = {"body_temp": "bus", "panel_temp": "outside", "other_temp": "outside"}
    first = named(in_packets(scenario, packets), spoilt(data, **late))[0]
    assert first.kind == "channel clock"
    assert first.title.startswith("packet outside is ")
    assert float(first.title.split()[3]) == pytest.approx(60.0, abs=5.0)


@pytest.mark.slow
def test_a_packet_of_another_day_is_named(tmp_path):
    scenario, data = small.load(tmp_path, of_three(), hours=29.0)
    data = small.telemetry_of(scenario, data)
    day = 24 * 60
    late = {name: np.roll(data[name].values, day) for name in ("panel_temp", "other_temp")}
    packets = {"body_temp": "bus", "panel_temp": "outside", "other_temp": "outside"}
    first = named(in_packets(scenario, packets), spoilt(data, **late))[0]
    assert first.title == "packet outside is 24 h late"


def test_the_packet_of_all_temperatures_is_late_beside_status_and_drivers(flown):
    scenario, data = flown
    split = in_packets(scenario, {"body_temp": "tcs", "panel_temp": "tcs", "heater_status": "eps", "sun": "eps"})
    early = {name: np.roll(data[name].values, -12) for name in ("heater_status", "sun")}
    titles = {suspicion.about: suspicion.title.split() for suspicion in named(split, spoilt(data, **early))}
    title = titles["body_temp panel_temp"]
    assert title[1] == "tcs"
    assert title[5] == "late"
    assert float(title[3]) == pytest.approx(12.0, abs=2.0)


def test_a_driver_that_is_late_is_named_with_the_minutes(flown):
    scenario, data = flown
    first = named(scenario, spoilt(data, sun=np.roll(data["sun"].values, 15)))[0]
    assert (first.kind, first.about) == ("driver clock", "sun")
    assert first.title.endswith("late")
    assert float(first.title.split()[4]) == pytest.approx(15.0, abs=1.0)


def test_no_clock_is_off_by_less_than_lies_between_two_samples_of_what_heats(flown):
    scenario, data = flown
    seldom = np.where(np.arange(data.sizes["time"]) % 15 == 0, data["sun"].to_numpy(), np.nan)
    view = prepared(scenario, spoilt(data, sun=seldom))
    assert view.apart(["sun"]) == 900.0
    assert {wrong.words.title for wrong in clocks(view, [600.0, 1200.0])} == {"The telemetry's clock is 20.0 min late"}


def test_no_status_is_late_by_less_than_lies_between_two_of_its_samples(flown):
    scenario, data = flown
    seldom = np.where(np.arange(data.sizes["time"]) % 5 == 0, data["heater_status"].to_numpy(), np.nan)
    view = prepared(scenario, spoilt(data, heater_status=seldom))
    assert len(list(status_clocks(view, [150.0, 900.0]))) == 1


def test_no_channel_is_late_by_less_than_lies_between_two_of_its_samples(flown):
    scenario, data = flown
    seldom = np.where(np.arange(data.sizes["time"]) % 10 == 0, data["panel_temp"].to_numpy(), np.nan)
    view = prepared(scenario, spoilt(data, panel_temp=seldom))
    assert {(wrong.about, wrong.words.title) for wrong in channel_clocks(view, [300.0], [["body_temp"]])}
    assert not list(channel_clocks(view, [300.0], [["panel_temp"]]))


@pytest.mark.slow
def test_channels_of_one_unit_that_are_late_together_are_named_together(tmp_path):
    """Nothing says that they come in one packet."""
    written = sunlit()
    for name, capacity in (("first", 500), ("second", 900)):
        written["simulator"]["nodes"][name] = {"capacity": f"{capacity} J/K", "initial": "-10 degC"}
        written["simulator"]["conductors"].append({"between": [name, "panel"], "conductance": "1 W/K"})
        written["telemetry"]["channels"][f"{name}_temp"] = {"column": "panel", "unit": "degC", "kind": "temperature"}
        written["observations"][f"{name}_temp"] = {"node": name}
    scenario, data = small.closed_loop(tmp_path, written)
    late = {name: ("time", np.roll(data[name].values, 12)) for name in ("first_temp", "second_temp")}
    first = named(scenario, data.assign(late))[0]
    assert (first.kind, set(first.about.split())) == ("channel clock", {"first_temp", "second_temp"})
    assert float(first.title.split()[4]) == pytest.approx(12.0, abs=1.0)


def test_a_clock_that_is_late_and_gains_little_is_late(tmp_path):
    """Of 3 h one that gains 11 s, and is 4 min late from the beginning on, is hardly too fast."""
    view = prepared(*small.closed_loop(tmp_path, sunlit()))
    assert view is not None
    assert not list(rates(view, [0.001], late=240.0))
    assert len(list(rates(view, [0.001], late=30.0))) == 1
