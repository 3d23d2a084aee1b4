"""Broken telemetry: each folder holds a case and the message that its user gets."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ruamel.yaml import YAML

from flightcal.errors import TelemetryError
from flightcal.scenario.schema import TelemetryFile, Window
from flightcal.telemetry import driver_series, read_telemetry, select_window

CASES = sorted(path.parent for path in (Path(__file__).parent / "broken" / "telemetry").glob("*/case.yaml"))


def use(folder: Path, case: dict[str, Any]) -> None:
    """What a run does with telemetry, as far as the case goes."""
    dataset = read_telemetry(TelemetryFile(**case["telemetry"]), folder, period=case.get("period"))
    if "window" in case:
        select_window(dataset, Window(**case["window"]))
    if "driver" in case:
        driver_series(dataset, case["driver"]["channel"], np.array([case["driver"]["at"]], dtype="datetime64[ns]"))


def test_there_are_enough_cases():
    assert len(CASES) >= 22


@pytest.mark.parametrize("folder", CASES, ids=lambda folder: folder.name)
def test_broken_telemetry_gives_its_message(folder: Path):
    case = YAML(typ="safe").load(folder / "case.yaml")
    with pytest.raises(TelemetryError) as caught:
        use(folder, case)
    assert str(caught.value) == case["message"].rstrip("\n")
