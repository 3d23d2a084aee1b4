"""The spacecraft file: the example, and what is wrong with a broken one."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from flightcal.cli import app
from flightcal.commands.fly import fly_to_csv
from flightcal.errors import RunError, ScenarioError
from flightcal.operational.file import load_spacecraft
from flightcal.operational.simulator import fly

EXAMPLE = Path(__file__).parents[2] / "examples" / "leo_observer" / "spacecraft.yaml"
TEXT = EXAMPLE.read_text(encoding="utf-8")


def broken(folder, old, new):
    assert TEXT.count(old) >= 1
    file = folder / "spacecraft.yaml"
    file.write_text(TEXT.replace(old, new, 1), encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def mission():
    return load_spacecraft(EXAMPLE)


@pytest.fixture(scope="module")
def flight(mission):
    return fly(mission.spacecraft, mission.start, mission.duration, seed=mission.seed)


def test_the_example_is_a_full_order_model(flight):
    assert len(flight.nodes) >= 200
    assert np.isfinite(flight.temperatures).all()
    # The outer layer of insulation that sees space alone: balance of both its sides, from within at 278 to 290 K.
    assert flight.temperatures.min() == pytest.approx(283.0 * (0.021 / 0.821) ** 0.25, abs=4.0)
    assert flight.temperatures.max() < 400.0


def test_the_bus_weighs_what_its_file_says(mission):
    cells = [
        n.capacity for name, n in mission.spacecraft.scenario.simulator.nodes.items() if re.match(r"bus\.[^i]*$", name)
    ]
    assert len(cells) == 96
    assert sum(cells) == pytest.approx(250.0 * 950.0 * 0.01 * 2 * (0.6 * 0.6 + 0.6 * 0.8 + 0.6 * 0.8))


def test_its_battery_stays_in_its_band_though_a_thermistor_and_a_branch_fail(mission, flight):
    battery = flight.temperatures[:, flight.nodes.index("battery")] - 273.15
    assert battery[flight.cycle_times > 9000.0].min() > 21.5
    assert battery.max() < 24.5
    line = [*mission.spacecraft.software.heaters].index("battery")
    later = flight.cycle_times > 9000.0
    assert flight.power[later, line].max() == 23.0, "the redundant branch heats"


def test_modes_follow_the_timeline(flight):
    for first, last, mode in ((31200.0, 31920.0, "imaging"), (33300.0, 33480.0, "nominal")):
        within = (flight.cycle_times >= first) & (flight.cycle_times < last)
        assert {mode for mode, there in zip(flight.modes, within, strict=True) if there} == {mode}


def test_the_command_writes_telemetry_once(tmp_path):
    short = broken(tmp_path, "duration: 115200 s", "duration: 600 s")
    out = tmp_path / "telemetry.csv"
    done = CliRunner().invoke(app, ["fly", str(short), "--out", str(out)])
    assert done.exit_code == 0, done.output
    assert re.search(r"223 nodes, 50 control cycles; [\d,]+ times real time", done.output)
    table = pd.read_csv(out)
    assert len(table) == 10
    assert list(table.columns[:3]) == ["time", "TT_STR", "TT_BAT"]
    assert table["time"][1] == "2024-02-29T16:01:00"
    assert 20.0 < table["TT_BAT"][0] < 24.0
    again = CliRunner().invoke(app, ["fly", str(short), "--out", str(out)])
    assert again.exit_code == 1
    assert "nothing is overwritten" in again.output


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("thickness: 10 mm", "thickness: 10", "boxes.bus.thickness: found 10 without a unit"),
        ("thickness: 10 mm", "thicknes: 10 mm", "unknown key 'thicknes'"),
        ("material: honeycomb\n    mesh: 4\n", "material: steel\n    mesh: 4\n", "found the material 'steel'"),
        ("insulation: blanket}", "insulation: foil}", "found the insulation 'foil'"),
        ("negative: {coating: white}", "negative: {coating: whit}", "found the coating 'whit'"),
        ("negative: {coating: white}", "negative: {paint: white}", "unknown key 'paint'"),
        ('between: [frame, "bus.x-[2,1]"]', 'between: [frame, "bus.x-[9,9]"]', "which is no node"),
        ("size: [0.6 m, 0 m, 0.6 m]", "size: [0.6 m, 0.1 m, 0.6 m]", "expected exactly one zero"),
        ("kind: stuck, stuck_at: 60 degC", "kind: stuck", "expected stuck_at with kind 'stuck'"),
        ("sensor: tank\n", "sensor: tanks\n", "found 'tanks', expected one of"),
        ("initial_mode: nominal", "initial_mode: normal", "initial mode: found 'normal'"),
        (
            "thermostat: {on_below: 18 degC, off_above: 20 degC, minimum_on: 60 s}\n",
            "without_sensor: off\n",
            "exactly one of 'thermostat'",
        ),
        ("  orbit: {", "  #orbit: {", "environment: found no orbit"),
        ("period: 60 s\n  quantum", "period: 55 s\n  quantum", "a multiple of the control cycle"),
        ("name: leo_observer", "name: [", "not well-formed YAML"),
    ],
)
def test_what_is_wrong_is_said_with_its_place(tmp_path, old, new, message):
    file = broken(tmp_path, old, new)
    done = CliRunner().invoke(app, ["fly", str(file), "--out", str(tmp_path / "out.csv")])
    assert done.exit_code == 1
    assert message in done.output
    assert "spacecraft" in done.output
    assert not (tmp_path / "out.csv").exists()


@pytest.mark.parametrize(
    ("old", "new", "field"),
    [
        ("mesh: 4\n", "mesh: many\n", "boxes.bus.mesh"),
        ("inside: black", "inside: blak", "boxes.bus.inside"),
        (
            "frame: {capacity: 1500 J/K}",
            "frame: {capacity: 1500 J/K, capacity_slope: 0.001 1/K}",
            "nodes.frame.capacity_slope: found 0.001 1/K, expected none",
        ),
    ],
)
def test_a_message_names_the_line(tmp_path, old, new, field):
    file = broken(tmp_path, old, new)
    line = TEXT[: TEXT.index(old)].count("\n") + 1
    with pytest.raises(ScenarioError, match=re.escape(f"{file}:{line}: {field}")):
        load_spacecraft(file)


def test_the_command_keeps_parts_of_a_second(tmp_path):
    short = broken(tmp_path, "duration: 115200 s", "duration: 60 s")
    text = short.read_text().replace("step: 12 s", "step: 0.5 s").replace("period: 12 s", "period: 0.5 s")
    short.write_text(text.replace("  period: 60 s\n", "  period: 0.5 s\n"))
    out = tmp_path / "telemetry.csv"
    done = CliRunner().invoke(app, ["fly", str(short), "--out", str(out)])
    assert done.exit_code == 0, done.output
    assert list(pd.read_csv(out)["time"][:2]) == ["2024-02-29T16:00:00.000", "2024-02-29T16:00:00.500"]


def test_a_folder_that_is_not_there_is_said_before_the_flight(tmp_path):
    out = tmp_path / "nowhere" / "telemetry.csv"
    with pytest.raises(RunError, match="found no folder"):
        fly_to_csv(EXAMPLE, out, None)
