"""Simple wrongs of the small satellite, named before any sampling."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from flightcal.check import SUSPECTS, Suspects, suspects
from flightcal.check.evidence import Fit
from flightcal.check.findings import suspected
from flightcal.check.misfit import Misfit
from flightcal.check.network_view import HEAT
from flightcal.check.page import _suspects
from flightcal.check.prepared import prepared
from flightcal.check.suspects import _of_many
from flightcal.check.suspicion import Suspicion, part_of, ranked, unexplained
from flightcal.check.white_box import finalists
from flightcal.check.wrongs import Words, Wrong
from flightcal.check.wrongs.heaters import obedient
from flightcal.problem import build_problem
from flightcal.progress import SILENT
from flightcal.run import Run, open_run, read_json
from flightcal.scenario import Heat, HeatPattern
from flightcal.simulator import SimulationFailure
from tests import small

from .cases import named, silent, spoilt, sunlit


def test_nothing_is_suspected_where_nothing_is_wrong(flown):
    assert named(*flown) == ()


def test_a_channel_that_is_stuck_throughout_is_named_and_warns_of_nothing(flown, recwarn):
    scenario, data = flown
    first = named(scenario, spoilt(data, panel_temp=np.full(data.sizes["time"], 280.0)))[0]
    assert (first.kind, first.about) == ("stuck", "panel_temp")
    assert not [warning for warning in recwarn if issubclass(warning.category, RuntimeWarning)]


def test_a_heater_without_a_status_beside_one_that_has_it_is_no_error(tmp_path):
    written = small.content()
    second = {"node": "panel", "power": "5 W", "sensor": "panel", "on_below": "-90 degC", "off_above": "-80 degC"}
    written["simulator"]["heaters"]["second"] = second
    _, data = small.closed_loop(tmp_path)
    scenario, _ = small.load(tmp_path, written)
    assert named(scenario, data) == ()


def test_a_status_that_is_always_off_is_told_by_its_thresholds(flown):
    scenario, data = flown
    heater = scenario.network.heaters["heater"]
    higher = heater.model_copy(update={"on_below": heater.on_below + 4.0, "off_above": heater.off_above + 4.0})
    model = scenario.network.model_copy(update={"heaters": {"heater": higher}})
    off = spoilt(data, heater_status=0.0 * data["heater_status"])
    first = named(scenario.model_copy(update={"simulator": model}), off)[0]
    assert (first.kind, first.about) == ("thermostat", "heater")


def test_a_channel_that_is_stuck_late_in_a_long_window_is_named(tmp_path):
    """What explains the telemetry is looked for in the first four orbits, of 90 min."""
    written = small.content()
    written["windows"]["train"]["end"] = "2024-03-01T12:00:00"
    written["windows"]["test"] = {"start": "2024-03-01T12:00:00", "end": "2024-03-01T14:00:00"}
    scenario, data = small.load(tmp_path, written, hours=14.5)
    data = small.telemetry_of(scenario, data)
    values = data["panel_temp"].to_numpy().copy()
    values[600:710] = values[600]
    told = named(scenario, spoilt(data, panel_temp=values))
    assert [(suspicion.kind, suspicion.about) for suspicion in told] == [("stuck", "panel_temp")]
    assert "2024-03-01 10:00" in told[0].sentence


def test_a_channel_that_is_stuck_in_the_window_to_test_on_is_named_there_too(flown):
    scenario, data = flown
    values = data["panel_temp"].to_numpy().copy()
    start = int(np.searchsorted(data["time"].to_numpy(), np.datetime64("2024-03-01T02:00:00")))
    values[start:] = values[start]
    told = [suspicion for suspicion in named(scenario, spoilt(data, panel_temp=values)) if suspicion.kind == "stuck"]
    assert [suspicion.about for suspicion in told] == ["panel_temp", "panel_temp"]
    assert "in all" in told[1].sentence
    assert "03:30" in told[1].advice or "03:29" in told[1].advice


def test_a_status_that_never_changes_is_told_where_its_thermostat_acts(flown):
    scenario, data = flown
    found = named(scenario, spoilt(data, heater_status=0.0 * data["heater_status"]))
    assert ("thermostat", "heater") in [(suspicion.kind, suspicion.about) for suspicion in found]
    assert all("status" in suspicion.title or "status of heater" in suspicion.advice for suspicion in found)


def test_what_explains_a_disobeyed_thermostat_is_named_though_little_else_tells_it(flown, monkeypatch):
    scenario, data = flown
    off = spoilt(data, body_temp=data["body_temp"].to_numpy() + 5.0)
    for module in ("white_box", "suspicion"):
        monkeypatch.setattr(sys.modules[f"flightcal.check.{module}"], "CLEAR", 1e6)
    first = named(scenario, off)[0]
    assert (first.kind, first.about) == ("bias", "body_temp")
    assert not named(scenario, spoilt(data, panel_temp=data["panel_temp"].to_numpy() + 8.0))


def test_telemetry_is_compared_too_where_no_status_says_when_a_heater_is_on(tmp_path):
    _, data = small.closed_loop(tmp_path)
    scenario, _ = small.load(tmp_path, silent(small.content()))
    assert named(scenario, data) == ()
    fahrenheit = spoilt(data, panel_temp=1.8 * (data["panel_temp"].values - 273.15) + 32.0 + 273.15)
    first = named(scenario, fahrenheit)[0]
    assert (first.kind, first.about) == ("unit", "panel_temp")


def heated_and_lit(load, capacity):
    """One light node that the Sun heats for a part of each orbit, and a heater for the rest, beside a heavy one."""
    written = small.content()
    model = written["simulator"]
    model["nodes"] |= {
        "panel": {"capacity": f"{capacity} J/K", "initial": "16 degC"},
        "body": {"capacity": "1e6 J/K", "initial": "10 degC"},
    }
    model["conductors"] = [
        {"between": ["body", "panel"], "conductance": "0.2 W/K"},
        {"between": ["panel", "space"], "radiative": "0.012 m^2"},
    ]
    thresholds = {"on_below": "15 degC", "off_above": "19 degC"}
    model["heaters"]["heater"] |= {"node": "panel", "sensor": "panel", "power": "12 W", **thresholds}
    model["loads"]["sun"]["coefficient"] = f"{load} W/A"
    power = {"mean": "12 W", "standard_deviation": "1.5 W", "lower": "6 W", "upper": "18 W"}
    written["parameters"] = {
        "link": {
            "sets": "conductors.body-panel.conductance",
            "prior": {"lognormal": {"median": "0.2 W/K", "factor": 1.4}},
        },
        "power": {"sets": "heaters.heater.power", "prior": {"truncated_normal": power}},
    }
    written["windows"]["train"]["end"] = "2024-03-01T06:00:00"
    written["windows"]["test"] = {"start": "2024-03-01T06:00:00", "end": "2024-03-01T06:45:00"}
    return written


@pytest.mark.parametrize(("load", "capacity", "power"), [(8.0, 500.0, 12.5), (12.0, 950.0, 12.0), (8.0, 950.0, 11.5)])
def test_a_heater_without_a_status_may_be_on_for_another_share_in_each_part_of_an_orbit(
    tmp_path, load, capacity, power
):
    written = heated_and_lit(load, capacity)
    _, data = small.closed_loop(tmp_path, written, link=0.2, power=power, initial_panel=289.0, initial_body=283.0)
    scenario, _ = small.load(tmp_path, silent(written))
    assert named(scenario, data) == ()


def test_a_status_that_never_changes_is_told_too_where_it_comes_at_times_of_its_own(flown):
    scenario, data = flown
    even = np.arange(data.sizes["time"]) % 2 == 0
    status = np.where(even, np.nan, 0.0)
    apart = spoilt(data, body_temp=np.where(even, data["body_temp"], np.nan), heater_status=status)
    assert ("thermostat", "heater") in [(suspicion.kind, suspicion.about) for suspicion in named(scenario, apart)]


def test_a_thermostats_own_telemetry_says_when_it_was_on(flown):
    scenario, data = flown
    heater = scenario.network.heaters["heater"]
    on = obedient(data["body_temp"].to_numpy(), heater.on_below, heater.off_above)
    assert on is not None
    assert (on != data["heater_status"].to_numpy()).mean() < 0.05


def test_the_likeliest_are_looked_at_closely_and_not_only_those_that_gain_most():
    """Units of a driver gain a little more at first look than the right size, which a closer look finds."""
    units = [Wrong("driver", "load", Words(f"{10**k} times", "", ""), tries=8.0) for k in (1, 2, 3)]
    size = Wrong("driver", "load", Words("0.5 times", "", ""), tries=1.0)
    hopeless = Wrong("bias", "a", Words("", "", ""), tries=1.0)
    assert finalists([6.1, 5.6, 5.6, 4.4, 1.0], [*units, size, hopeless]) == [size, *units[:2]]


def test_what_gains_the_same_about_the_same_is_looked_at_once():
    """A timeline that is late by seven hours or by eight has no change in the window."""
    hours = [Wrong("mode", "timeline", Words(f"{k} h", "", "")) for k in (7, 8, 9)]
    one = Wrong("mode", "timeline", Words("1 h", "", ""))
    assert finalists([6.0, 6.0, 6.0, 5.0], [*hours, one]) == [hours[0], one]


def test_units_of_a_number_do_not_keep_its_size_from_being_looked_at():
    units = [Wrong("number", name, Words("", "", "")) for name in ("area", "area", "emissivity", "emissivity")]
    sizes = [
        Wrong("number", name, Words("", "", ""), closer=lambda: iter(())) for name in ("area", "area", "emissivity")
    ]
    assert finalists([9.0, 8.0, 7.0, 6.0, 5.0, 4.5, 4.0], [*units, *sizes]) == [*units[:3], sizes[0], sizes[2]]


def test_what_explains_most_is_looked_at_closely_however_long_its_odds_are():
    kinds = ("bias", "gain", "drift", "slow")
    likely = [Wrong(kinds[k // 3], str(k), Words("", "", "")) for k in range(12)]
    burst = Wrong("missing heat", "a", Words("", "", ""), tries=1e9)
    gains = [40.0 - k for k in range(12)]
    assert finalists([*gains, 35.5], [*likely, burst]) == likely
    assert finalists([*gains, 45.0], [*likely, burst]) == [*likely, burst]


def test_each_number_of_an_orbit_that_may_be_wrong_is_looked_at_closely():
    """That which is wrong may gain less at first look than others, for eclipses last minutes."""
    numbers = [Wrong("orbit", str(k), Words("", "", ""), closer=lambda: iter(())) for k in range(6)]
    gains = [40.0, 39.0, 38.0, 30.0, 20.0, 10.0]
    assert finalists(gains, numbers) == numbers[:5]


def test_of_every_other_kind_that_is_not_much_less_likely_one_is_looked_at_closely():
    likely = [Wrong(("bias", "gain", "drift", "slow")[k // 3], str(k), Words("", "", "")) for k in range(12)]
    others = [Wrong("mode", "a", Words("", "", "")), Wrong("mode", "b", Words("", "", ""))]
    gains = [40.0 - k for k in range(12)]
    assert finalists([*gains, 17.0, 16.5], [*likely, *others]) == [*likely, others[0]]
    assert finalists([*gains, 15.0, 14.5], [*likely, *others]) == likely


def test_telemetry_that_nothing_explains_is_said_not_to_be_of_the_scenario(flown):
    scenario, data = flown
    seconds = 60.0 * np.arange(data.sizes["time"])
    wild = {
        "body_temp": 285.0 + 15.0 * np.sin(2.0 * np.pi * seconds / 2900.0),
        "panel_temp": 300.0 + 20.0 * np.sin(2.0 * np.pi * seconds / 1700.0),
    }
    noise = 0.1 * np.random.default_rng(0).standard_normal((2, len(seconds)))
    first = named(
        scenario, spoilt(data, **{name: wild[name] + series for name, series in zip(wild, noise, strict=True)})
    )[0]
    assert first.kind == "everything"


def test_it_is_said_why_a_network_is_not_compared(flown, monkeypatch):
    scenario, data = flown

    def fails(*given):
        raise SimulationFailure("a temperature is not finite")

    monkeypatch.setattr(sys.modules["flightcal.check.suspects"], "climbed", fails)
    (said,) = _suspects(suspects(build_problem(scenario, data), data))
    assert said.text.endswith("looked at: a temperature is not finite. Nothing was found.")


def test_heat_that_the_scenario_expects_is_usual(flown):
    """A pattern over an angle, or one of a large share, is not taken for a wrong."""
    scenario, data = flown
    over = Heat(pattern=HeatPattern(over="sun", scale=0.3))
    assert prepared(scenario.model_copy(update={"heat": over}), data).window.scenario.heat.pattern == over.pattern
    less = Heat(pattern=HeatPattern(scale=0.01))
    assert prepared(scenario.model_copy(update={"heat": less}), data).window.scenario.heat == HEAT


def test_what_a_channel_shows_by_itself_comes_first_and_is_left_out(flown):
    scenario, data = flown
    values = data["panel_temp"].to_numpy().copy()
    values[60:] = values[60]
    found = named(scenario, spoilt(data, panel_temp=values))
    assert [suspicion.kind for suspicion in found] == ["stuck", "stuck"]  # the window to test on too


@pytest.mark.parametrize("kind", ["spike", "held", "interpolated"])
@pytest.mark.parametrize(("channels", "told"), [(2, ["a", "b"]), (5, ["a b c d e"])])
def test_what_many_channels_show_has_one_reason(channels, told, kind):
    spikes = [Suspicion(kind, name, "", f"{name} reads much.", "") for name in "abcde"[:channels]]
    other = Suspicion("stuck", "f", "", "", "")
    found = _of_many([other, *spikes, *spikes[:1]])
    assert [suspicion.about for suspicion in found if suspicion.kind == kind][: len(told)] == told
    assert other in found
    assert len(found) == (2 if channels == 5 else 4)


def test_a_clock_that_is_off_stands_before_a_spike(tmp_path):
    scenario, data = small.closed_loop(tmp_path, sunlit())
    late = data.assign_coords(time=data["time"] + np.timedelta64(20, "m"))
    late["panel_temp"].values[100] += 9.0
    kinds = [suspicion.kind for suspicion in named(scenario, late)]
    assert (kinds[0], kinds[-1]) == ("clock", "spike")


def test_the_stage_keeps_what_was_found(flown, tmp_path):
    scenario, data = flown
    wrong = spoilt(data, heater_status=1.0 - data["heater_status"])
    problem = build_problem(scenario, wrong)
    with open_run(tmp_path / "run", {}, "", {}, 1) as folder:
        run = Run(folder, SILENT)
        run.given("of this test", problem, wrong)
        found = run.stage(SUSPECTS, problem, wrong)
        assert found.lines[0].startswith("likely wrong: heater_status is inverted. ")
        assert read_json(tmp_path / "run" / "suspects.json")["found"][0]["title"] == "heater_status is inverted"
        assert run.stage(SUSPECTS, problem, wrong) == found


def test_findings_name_the_best_and_below_it_the_others():
    stuck = Suspicion("stuck", "a", "a is stuck", "It is.", "Leave it out")
    bias = Suspicion("bias", "b", "b reads 3 K too high", "It does.", "Check it", 40.0)
    unit = Suspicion("unit", "c", "c is in degF", "It is.", "Convert it", 30.0)
    found = suspected(Suspects((stuck, bias, unit), True))
    assert [finding.title for finding in found] == [
        "Likely wrong: a is stuck",
        "Likely wrong, one of 2: b reads 3 K too high",
    ]
    assert found[1].details == ("Or: c is in degF.",)
    assert [finding.state for finding in suspected(Suspects((), True))] == ["good"]
    assert [finding.state for finding in suspected(Suspects((), True), reached=False)] == ["warn"]
    assert suspected(Suspects()) == []


def test_what_was_not_compared_with_the_simulator_is_a_caution_and_a_line_that_says_why():
    found = Suspects(why_not="a temperature is not finite")
    (caution,) = suspected(found)
    assert caution.state == "warn"
    assert caution.title.startswith("Not looked for: wrong clocks, units, biases, swapped channels")
    assert found.why_not in caution.text
    (line,) = found.lines
    assert line.startswith("not looked for: wrong clocks")
    assert line.endswith(found.why_not)


def test_that_no_simple_wrong_explains_the_telemetry_is_no_wrong():
    found = Suspects(tuple(unexplained(fit(5.0, 900.0), None, [])), True)
    assert [finding.title for finding in suspected(found)] == ["No simple wrong explains the telemetry"]
    assert found.lines[0].startswith("No simple wrong explains the telemetry. Neither")


def test_a_wrong_that_others_are_as_good_as_is_printed_as_one_of_several():
    bias = Suspicion("bias", "b", "b reads 3 K too high", "It does.", "Check it", 40.0)
    stuck = Suspicion("stuck", "a", "a is stuck", "It is.", "Leave it out")
    unit = Suspicion("unit", "c", "c is in degF", "It is.", "Convert it", 30.0)
    heads = [line.split(":")[0] for line in Suspects((stuck, bias, unit), True).lines]
    assert heads == ["likely wrong", "likely wrong, one of 2", "likely wrong, one of 2"]
    assert Suspects((bias,), True).lines[0].startswith("likely wrong: b reads")


def fit(misfit, lacking, size=4.0, farthest=1.0):
    return Fit(0.0, size, misfit, lacking, farthest, *np.zeros((3, 1)))


def better(kind, after, nats=50.0):
    return after, Suspicion(kind, "panel_temp", f"{kind} is wrong", "", "", nats)


def test_a_model_that_no_wrong_brings_nearer_is_of_another_telemetry_only_where_it_is_far_off():
    assert unexplained(fit(2.5, 300.0), None, []) == []
    assert [suspicion.kind for suspicion in unexplained(fit(4.5, 900.0), None, [])] == ["everything"]
    assert unexplained(fit(1.5, 300.0), None, [better("bias", fit(1.2, 250.0))]) == []


def test_what_is_only_a_part_is_told_as_a_part():
    where = Misfit("panel_temp", 3.0, "in the shadow", 5.0)
    (told,) = unexplained(fit(2.5, 300.0), where, [better("bias", fit(2.0, 200.0))])
    assert "part of it, at most: bias is wrong" in told.sentence
    assert "largest in panel_temp: 3.0 K, and 5.0 K in the shadow" in told.sentence


def test_a_wrong_that_leaves_most_of_a_misfit_is_not_named_however_many_nats_it_gains():
    crude = fit(1.8, 300.0)
    assert ranked([better("bias", fit(1.1, 100.0), 200.0)], crude) == []
    assert [suspicion.kind for suspicion in ranked([better("bias", fit(1.1, 50.0), 250.0)], crude)] == ["bias"]


def test_a_clock_that_explains_much_is_named_whatever_a_real_satellite_s_model_lacks_beside():
    real = fit(3.3, 550.0)
    clock, heat = better("clock", fit(1.2, 155.0), 390.0), better("missing heat", fit(0.9, 95.0), 366.0)
    bias = better("bias", fit(1.2, 155.0), 395.0)
    assert [suspicion.kind for suspicion in ranked([bias, clock, heat], real)] == ["clock", "missing heat"]
    assert ranked([better("clock", fit(3.0, 500.0), 50.0)], real) == []
    assert ranked([better("clock", fit(1.1, 100.0), 25.0)], fit(1.2, 160.0)) == []


def test_a_parameter_may_be_farther_off_where_an_orbit_explains_all():
    """An orbit is found to a tenth of a degree, and something makes up for the rest."""
    after = fit(0.6, 35.0, size=1.0, farthest=6.0)
    assert [
        suspicion.kind for suspicion in ranked([better("orbit", after), better("bias", after)], fit(300.0, 9e4))
    ] == ["orbit"]
    assert ranked([better("orbit", fit(1.1, 35.0, farthest=6.0))], fit(300.0, 9e4)) == []
    # And the clock of a packet where it explains nearly all.
    for left, named_kinds in ((8.0, ["channel clock"]), (60.0, [])):
        late = better("channel clock", fit(0.4, left, size=1.0, farthest=5.7), 120.0)
        assert [suspicion.kind for suspicion in ranked([late], fit(0.7, 140.0))] == named_kinds


def test_beside_a_simulator_that_is_only_run_a_wrong_that_leaves_it_far_off_is_not_named():
    other = better("clock", fit(4.9, 1100.0, size=1.0), 1800.0)
    assert ranked([other], fit(11.6, 2900.0), 0.5, 8.0, 2.0) == []
    (told,) = unexplained(fit(11.6, 2900.0), None, [other], run_only=True)
    assert "heat" not in told.sentence
    assert told.sentence.endswith("3.4 times what is usual. A part of it, at most: clock is wrong.")


def test_two_sensors_of_one_node_stand_behind_what_explains_about_as_much():
    """Of two panels alike, that is what any wrong of one of them looks like."""
    found = [better("doubled", fit(0.3, 0.0), 144.0), better("number", fit(0.3, 0.0), 119.0)]
    assert [suspicion.kind for suspicion in ranked(found, fit(1.4, 60.0))] == ["number", "doubled"]
    assert [suspicion.kind for suspicion in ranked(found[:1], fit(1.4, 60.0))] == ["doubled"]


def test_a_wrong_that_leaves_what_is_usual_is_named_though_it_leaves_much_of_little():
    assert [suspicion.kind for suspicion in ranked([better("bias", fit(0.4, 30.0, size=2.0))], fit(0.5, 48.0))] == [
        "bias"
    ]
    assert ranked([better("bias", fit(0.4, 30.0, size=4.0))], fit(0.5, 48.0)) == []


@pytest.mark.parametrize(("nats", "kinds"), [(15.0, []), (30.0, ["gain"])])
def test_what_explains_little_of_much_is_not_named_though_it_leaves_what_is_just_usual(nats, kinds):
    """As a gain beside a real satellite whose model has but two nodes."""
    found = ranked([better("gain", fit(0.75, 218.0, size=2.0), nats)], fit(0.4, 244.0))
    assert [suspicion.kind for suspicion in found] == kinds


@pytest.mark.parametrize(("left", "nats", "told"), [(54.0, 80.0, True), (120.0, 80.0, False), (54.0, 20.0, False)])
def test_what_explains_a_good_part_is_a_caution(left, nats, told):
    nothing, where = fit(0.8, 138.0), Misfit("panel_temp", 18.0, "", 18.0)
    helps = [better("gain", fit(0.5, left), nats)]
    assert ranked(helps, nothing) == []
    (finding,) = suspected(Suspects((), True, "", where, part_of(helps, nothing)))
    assert finding.state == "warn"
    assert ("gain is wrong" in finding.title) == told


def test_what_leaves_more_than_nothing_wrong_is_not_named():
    """Without a status a heater's heat may stand for heat that is missing: a number is more probable and fits worse."""
    nothing = fit(0.4, 0.0, size=1.0)
    assert ranked([better("number", fit(0.52, 5.0, size=1.0), 55.0)], nothing) == []
    assert [suspicion.kind for suspicion in ranked([better("number", fit(0.4, 0.0, size=1.0), 55.0)], nothing)] == [
        "number"
    ]


def test_what_leaves_nothing_unusual_stands_before_what_leaves_much_and_explains_little_more():
    crude, much = fit(1.8, 300.0), better("between", fit(1.1, 50.0), 78.0)
    for nats, kinds in ((61.8, ["swapped", "between"]), (50.0, ["between"])):
        whole = better("swapped", fit(0.4, 1.0, size=1.0), nats)
        assert [suspicion.kind for suspicion in ranked([much, whole], crude)] == kinds
    # Without a channel that belongs nowhere there is always less that is unusual.
    without = better("unrelated", fit(0.4, 1.0, size=1.0), 70.0)
    assert [suspicion.kind for suspicion in ranked([much, without], crude)] == ["between", "unrelated"]
    # Of two that leave nothing unusual the likelier stands first.
    both = [better("bias", fit(0.4, 1.0, size=1.0), 78.0), better("swapped", fit(0.4, 1.0, size=1.0), 70.0)]
    assert [suspicion.kind for suspicion in ranked(both, crude)] == ["bias", "swapped"]


def test_only_what_explains_about_as_well_is_named_beside_the_best():
    crude = fit(1.8, 300.0)
    of = [better(kind, fit(0.4, 1.0), nats) for kind, nats in (("clock", 200.0), ("bias", 165.0), ("unit", 150.0))]
    assert [suspicion.kind for suspicion in ranked(of, crude)] == ["clock", "bias"]
    of = [better(kind, fit(0.4, 1.0), nats) for kind, nats in (("clock", 20.0), ("bias", 11.0), ("unit", 9.0))]
    assert [suspicion.kind for suspicion in ranked(of, crude)] == ["clock", "bias"]


def test_where_a_crude_model_is_off_is_told_and_no_cause(flown):
    """Both temperatures wander by some kelvin in ways of their own, as nothing in the scenario does."""
    scenario, data = flown
    minutes = np.arange(data.sizes["time"])
    waves = {"body_temp": np.sin(2.0 * np.pi * minutes / 47.0), "panel_temp": np.sin(2.0 * np.pi * minutes / 71.0)}
    wandering = spoilt(data, **{name: data[name] + 3.0 * wave for name, wave in waves.items()})
    found = suspects(build_problem(scenario, wandering), wandering)
    assert found.misfit is not None
    assert {suspicion.kind for suspicion in found.found} <= {"everything"}
    assert found.misfit.channel in suspected(found)[-1].text


@pytest.mark.parametrize("others", [[], ["bias"], ["orbit"]])
def test_an_orbit_that_all_others_tell_goes_before_a_channel_that_does_not_belong(flown, monkeypatch, others):
    """A light array alone shows an eclipse that is far off so clearly that nothing else explains it."""

    def tried(view, odd, progress):
        if np.isfinite(view.observed[:, view.channels.index("panel_temp")]).any():
            return fit(300.0, 9e4), [better("unrelated", fit(1.0, 10.0), 9e4)]
        return fit(2.0, 100.0), [better(kind, fit(0.9, 1.0), 60.0) for kind in others]

    monkeypatch.setattr(sys.modules[suspects.__module__], "_tried", tried)
    first = ["orbit"] if "orbit" in others else []
    assert [suspicion.kind for suspicion in named(*flown)] == [*first, "unrelated"]


def test_a_wrong_beside_which_something_else_is_far_off_is_not_named():
    """Such as a level that is tens of kelvin beside the model, where only the shape agrees."""
    assert ranked([better("unit", fit(0.3, 0.0, size=1.0, farthest=5.5))], fit(1.9, 400.0)) == []


def test_a_gain_of_next_to_nothing_is_no_gain():
    near = Wrong("gain", "a", Words("", "", ""), least=0.3, most=2.0)
    at = fit(0.4, 0.0)
    assert near.matters(replace(at, added=np.array([-1.9])))
    assert not near.matters(replace(at, added=np.array([-3.0])))


def test_what_is_not_written_can_only_be_added():
    less = Wrong("constant heat", "a", Words("", "", ""), least=0.2, lacked=True)
    at = fit(0.4, 0.0)
    assert less.matters(replace(at, added=np.array([0.5])))
    assert not less.matters(replace(at, added=np.array([-0.5])))
    assert replace(less, lacked=False).matters(replace(at, added=np.array([-0.5])))


def test_samples_that_are_lost_are_named_before_anything_else(flown):
    """Later samples are tagged as if they followed at once: both channels jump."""
    scenario, data = flown
    values = {name: data[name].values.copy() for name in ("body_temp", "panel_temp")}
    for name, readings in values.items():
        readings[90:-40] = data[name].values[130:]
    found = suspects(build_problem(scenario, spoilt(data, **values)), spoilt(data, **values)).found
    assert [(suspicion.kind, suspicion.about) for suspicion in found] == [("order", "time")]


@pytest.mark.parametrize("name", ["train.second", "test.later"])
def test_a_spike_in_another_window_is_named_too(tmp_path, name):
    written = small.content()
    whole = written["windows"]["train"]
    spans = {"train.first": (0, 60), "train.second": (60, 120), "test.later": (120, 170)}
    begin = np.datetime64(whole["start"])
    windows = {}
    for window, (first, end) in spans.items():
        group, _, called = window.partition(".")
        start, stop = (str(begin + np.timedelta64(minutes, "m")) for minutes in (first, end))
        windows.setdefault(group, {})[called] = {"start": start, "end": stop}
    written["windows"] = windows
    scenario, data = small.closed_loop(tmp_path, written)
    values = data["body_temp"].to_numpy().copy()
    at = int(np.searchsorted(data["time"].to_numpy(), begin + np.timedelta64(spans[name][0] + 20, "m")))
    values[at] += 40.0
    found = suspects(build_problem(scenario, data), data.assign(body_temp=("time", values)))
    assert [(suspicion.kind, suspicion.about) for suspicion in found.found] == [("spike", "body_temp")]


def test_where_nothing_else_explains_it_the_sensor_of_a_heater_without_a_status_is_in_another_unit(
    tmp_path, monkeypatch
):
    """By what it reads the heater would never be on."""
    _, data = small.closed_loop(tmp_path, small.content())
    scenario, _ = small.load(tmp_path, silent(small.content()))
    for module in ("white_box", "suspicion"):
        monkeypatch.setattr(sys.modules[f"flightcal.check.{module}"], "CLEAR", 1e6)
    celsius = data["body_temp"].to_numpy() - 273.15
    (suspicion,) = named(scenario, spoilt(data, body_temp=1.8 * celsius + 32.0 + 273.15))
    assert suspicion.title == "body_temp is in degF, and is read as degC"
