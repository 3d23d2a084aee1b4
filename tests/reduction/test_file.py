"""The reduction file: patterns, thermostats, and what is wrong with a file, said plainly."""

from copy import deepcopy

import pytest

from flightcal.errors import FlightcalError, ScenarioError
from flightcal.reduction.file import is_reduction, load_task
from flightcal.reduction.thermostats import switching_shifts
from tests.reduction import craft


def test_a_pattern_stands_for_all_numbers_that_fit(tmp_path):
    task = load_task(craft.write(tmp_path))
    assert len(task.scenario.parameters["blanket"].scales) == 24
    assert task.scenario.parameters["power"].unit == "W"


def software(**changes):
    content = deepcopy(craft.SPACECRAFT["software"])
    content["heaters"]["battery"].update(changes)
    return {"software": content}


def test_thresholds_of_an_on_off_line_are_those_of_the_thermostat(tmp_path):
    task = load_task(craft.write(tmp_path))
    heater = task.scenario.simulator.heaters["battery"]
    assert (heater.on_below, heater.off_above, heater.power) == pytest.approx((287.15, 288.65, 20.0))
    assert len(task.notes) == 1
    assert task.notes[0].startswith("heater line 'battery': noise of 0.05 K")


def test_noisy_thermistors_shift_where_the_software_switches(tmp_path):
    found = []
    for noise in (0.0, 0.1):
        battery = {"node": "battery", "noise": f"{noise} K"}
        spacecraft = {"thermistors": {**craft.SPACECRAFT["thermistors"], "battery_1": battery}}
        task = load_task(craft.write(tmp_path, spacecraft=spacecraft))
        assert task.scenario.simulator.heaters["battery"].on_below == 287.15
        found.append(switching_shifts(task.mission)["battery"])
    (on, off), (noisy_on, noisy_off) = found
    # Without noise at most the 0.04 K that the battery moves in a control cycle.
    assert -0.04 < on < 0.0 < off < 0.04
    # The first of some noisy readings to cross is about a standard deviation early.
    assert 0.03 < noisy_on - on < 0.25
    assert 0.03 < off - noisy_off < 0.25


def test_control_by_pulse_width_becomes_a_narrow_hysteresis_and_is_noted(tmp_path):
    law = {"set_point": "15 degC", "gain": "0.2 1/K", "integral_time": "1 hour", "period": "60 s"}
    content = software(pulse_width=law)
    del content["software"]["heaters"]["battery"]["thermostat"]
    task = load_task(craft.write(tmp_path, {"pulse_width_band": "0.1 K"}, content))
    heater = task.scenario.simulator.heaters["battery"]
    assert (heater.on_below, heater.off_above) == pytest.approx((288.10, 288.20))
    assert any("hysteresis of 0.1 K" in note for note in task.notes)


def test_what_the_thermostat_leaves_out_is_noted(tmp_path):
    limits = {"on_below": "14 degC", "off_above": "15 degC", "minimum_on": "60 s"}
    content = software(thermostat=limits)
    content["software"]["enabled"]["safe"] = []
    notes = load_task(craft.write(tmp_path, spacecraft=content)).notes
    assert any("minimum times" in note for note in notes)
    assert any("switched off in safe" in note for note in notes)


def test_a_mode_of_the_flight_that_switches_a_heater_off_is_refused(tmp_path):
    content = software()
    content["software"]["enabled"]["imaging"] = []
    with pytest.raises(ScenarioError, match="the mode 'imaging', in which the enable table switches heater line 'batt"):
        load_task(craft.write(tmp_path, spacecraft=content))


def test_a_line_that_heats_two_nodes_is_refused(tmp_path):
    content = software(branches={"nominal": {"power": {"battery": "20 W", "unit": "5 W"}}})
    with pytest.raises(FlightcalError, match=r"reduce.yaml: heater line 'battery': found 2 nodes"):
        load_task(craft.write(tmp_path, spacecraft=content))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"sensors": ["nothing"]}, r"sensors: found 'nothing', expected one of battery_1"),
        ({"methods": "projection"}, r"reduce.yaml:\d+: methods: unknown key 'methods'"),
        ({"method": "condensation"}, r"reduce.yaml:\d+: method: found 'condensation', expected projection"),
        ({"tolerance": 0.3}, r"tolerance: found 0.3 without a unit"),
        (
            {"parameters": {"p": {"sets": "faces.nowhere*.absorptivity", "prior": {"uniform": [0, 1]}}}},
            r"reduce.yaml:\d+: parameters.p.sets: found 'faces.nowhere\*.absorptivity', which fits no number",
        ),
        (
            {"parameters": {"p": {"sets": "nodes.battery.capacity", "prior": {"uniform": ["1 W", "2 W"]}}}},
            r"parameters.p.prior",
        ),
        (
            {"held_out": {"windows": {"short": {"start": "2024-03-01T00:00:00", "orbits": 0.5}}}},
            r"held_out.windows.short: found \d+ s, expected half as much again",
        ),
        (
            {
                "training": {
                    "windows": {
                        "w": {
                            "start": "2024-03-01T00:00:00",
                            "orbits": 2,
                            "timeline": [{"at": "10 s", "mode": "sleep"}],
                        }
                    }
                }
            },
            r"training.windows.w.timeline.0.mode: found 'sleep', expected one of imaging, nominal",
        ),
    ],
)
def test_what_is_wrong_is_named_with_its_place(tmp_path, changes, message):
    with pytest.raises(ScenarioError, match=message):
        load_task(craft.write(tmp_path, changes))


def test_a_conductance_that_depends_on_temperature_is_refused(tmp_path):
    conductors = deepcopy(craft.SPACECRAFT["conductors"])
    conductors[0]["conductance_slope"] = "0.002 1/K"
    task = craft.write(tmp_path, spacecraft={"conductors": conductors})
    with pytest.raises(
        ScenarioError, match=r"spacecraft.yaml:(\d+): conductors.0.conductance_slope: found 0.002 1/K"
    ) as told:
        load_task(task)
    line = int(str(told.value).split(":")[1])
    written = (tmp_path / "spacecraft.yaml").read_text(encoding="utf-8").splitlines()
    assert "conductance_slope" in written[line - 1]


def test_a_capacity_that_depends_on_temperature_is_refused_with_its_line(tmp_path):
    nodes = craft.SPACECRAFT["nodes"] | {
        "unit": {"capacity": "3000 J/K", "capacity_slope": "0.002 1/K", "initial": "10 degC"}
    }
    with pytest.raises(
        ScenarioError, match=r"spacecraft.yaml:\d+: nodes.unit.capacity_slope: found 0.002 1/K, expected"
    ):
        load_task(craft.write(tmp_path, spacecraft={"nodes": nodes}))


def test_a_missing_spacecraft_is_a_message(tmp_path):
    with pytest.raises(ScenarioError, match=r"elsewhere.yaml"):
        load_task(craft.write(tmp_path, {"spacecraft": "elsewhere.yaml"}))


def test_a_reduction_is_told_from_a_scenario(tmp_path):
    path = craft.write(tmp_path)
    assert is_reduction(path)
    (tmp_path / "scenario.yaml").write_text("name: small\nsimulator: {}\n")
    assert not is_reduction(tmp_path / "scenario.yaml")
    assert not is_reduction(tmp_path / "nowhere.yaml")
