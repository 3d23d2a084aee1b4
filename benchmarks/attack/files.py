"""A scenario and its telemetry as files, and what flightcal says of them."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from flightcal.check import Suspects, suspects
from flightcal.problem import build_problem
from flightcal.report import Verdict
from flightcal.scenario import load_scenario
from flightcal.telemetry import read


def put(folder: Path, written: Mapping[str, Any], table: pd.DataFrame) -> Path:
    """The scenario's file, beside that of its telemetry."""
    table.to_csv(folder / "telemetry.csv", index=False)
    file = folder / "scenario.yaml"
    file.write_text(json.dumps(written), encoding="utf-8")
    return file


def looked_at(written: Mapping[str, Any], table: pd.DataFrame) -> Suspects:
    """What is suspected of a scenario and its telemetry, from their files. Raises FlightcalError."""
    with tempfile.TemporaryDirectory() as folder:
        scenario = load_scenario(put(Path(folder), written, table))
        data = read(scenario)
        return suspects(build_problem(scenario, data), data)


def not_well(verdict: Verdict, *states: str) -> tuple[str, ...]:
    """Titles of what is in one of these states, in their order."""
    found = [finding for answer in verdict.answers for finding in answer.findings]
    return tuple(one.title for state in states for one in found if one.state == state)
