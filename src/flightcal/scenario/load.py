"""Reads a scenario file."""

from __future__ import annotations

from pathlib import Path

from ..errors import ScenarioError
from .lint import examine
from .schema import Scenario


def load_scenario(path: str | Path, *, telemetry: str | Path | None = None) -> Scenario:
    """The scenario in the file at `path`; its `folder` is the file's.

    telemetry: replaces where telemetry is read from: a file, or a folder with files of the same names.
    Raises ScenarioError, whose message lists everything wrong with the file, a line each.
    """
    scenario, findings = examine(path, telemetry)
    if scenario is None:
        raise ScenarioError("\n".join(map(str, findings)))
    return scenario
