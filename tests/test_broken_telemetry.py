"""Broken telemetry: each folder holds a case and the message that its user gets."""

from __future__ import annotations

import shutil
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ruamel.yaml import YAML
from typer.testing import CliRunner

from flightcal.cli import app
from flightcal.errors import TelemetryError
from flightcal.scenario import TelemetryFile, Window
from flightcal.telemetry import driver_series, read_telemetry, select_window

CASES = sorted(path.parent for path in (Path(__file__).parent / "broken" / "telemetry").glob("*/case.yaml"))


def use(folder: Path, case: dict[str, Any]) -> None:
    """What a run does with telemetry, as far as the case goes."""
    dataset = read_telemetry(TelemetryFile(**case["telemetry"]), folder, period=case.get("period"))
    if "window" in case:
        select_window(dataset, Window(**case["window"]), called="train")
    if "driver" in case:
        driver_series(dataset, case["driver"]["channel"], np.array([case["driver"]["at"]], dtype="datetime64[ns]"))


def test_there_are_enough_cases():
    assert len(CASES) >= 45


@pytest.mark.parametrize("folder", CASES, ids=lambda folder: folder.name)
def test_broken_telemetry_gives_its_message(folder: Path):
    case = YAML(typ="safe").load(folder / "case.yaml")
    with pytest.raises(TelemetryError) as caught:
        use(folder, case)
    assert str(caught.value) == case["message"].rstrip("\n")


def scenario_around(case: dict[str, Any]) -> dict[str, Any]:
    """A scenario, sound in itself, that uses the case's telemetry, window and driver."""
    telemetry = dict(case["telemetry"])
    if isinstance(telemetry.get("average"), (int, float)):
        telemetry["average"] = f"{telemetry['average']} s"
    model: dict[str, Any] = {"nodes": {"body": {"capacity": "900 J/K", "initial": "20 degC"}}}
    temperatures = [name for name, channel in telemetry["channels"].items() if channel["kind"] == "temperature"]
    window = case.get("window", {"start": "2024-03-01T00:00:00", "end": "2024-03-01T00:10:00"})
    if "driver" in case:
        end = case["driver"]["at"].replace(tzinfo=None) + timedelta(seconds=60)
        window = {"start": "2024-03-01T00:00:00", "end": end.isoformat()}
        load = {"node": "body", "driver": case["driver"]["channel"], "coefficient": "12 W/A"}
        model["loads"] = {"sun": load}
    if not temperatures:
        temperatures = ["battery"]
        telemetry["channels"] |= {"battery": {"column": "battery", "kind": "temperature", "unit": "degC"}}
    return {
        "name": "broken",
        "telemetry": telemetry,
        "environment": {} if "period" in case["message"] else {"period": f"{case.get('period', 5400)} s"},
        "simulator": model,
        "parameters": {"capacity": {"scales": "nodes.body.capacity", "prior": {"uniform": [0.5, 2]}}},
        "observations": {temperatures[0]: {"node": "body"}},
        "heat": "none",
        "windows": {"train": window},
    }


@pytest.mark.parametrize("command", ["lint", "calibrate"])
@pytest.mark.parametrize("folder", CASES, ids=lambda folder: folder.name)
def test_commands_say_what_is_wrong_and_leave_nothing_behind(folder: Path, command: str, tmp_path: Path):
    case = YAML(typ="safe").load(folder / "case.yaml")
    shutil.copytree(folder, tmp_path / "case")
    scenario, run = tmp_path / "case" / "scenario.yaml", tmp_path / "run"
    YAML(typ="safe").dump(scenario_around(case), scenario)
    result = CliRunner().invoke(app, [command, str(scenario), *(["--out", str(run)] if command == "calibrate" else [])])
    output = result.output
    assert isinstance(result.exception, SystemExit), result.exception  # and not what a traceback would show
    assert result.exit_code == 1, output
    assert "Traceback" not in output
    assert not run.exists()
    # What the scenario alone shows is found before the telemetry is read, and named with its line.
    by_line = f"{scenario}:" in output
    assert not by_line or "expected" in output
    # With a driver the first moment that cannot be bridged comes earlier in a window than in the case.
    message = case["message"].split(" at ")[0] if "driver" in case else case["message"].rstrip("\n")
    assert by_line or message in output
