"""From a scenario file to the blocks that could be read, the whole scenario, and what is wrong with it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from .blocks import Draft, draft_of_data
from .document import Document, Problem, read_document
from .numbers import Settable, settable_of
from .parameters import read_observations, read_parameters
from .reduced import fill_in
from .schema import Scenario
from .uncertain import read_discrepancy, read_noise_block
from .units import show
from .windows import flat_windows
from .wording import problems_of, unknown_key, written_keys


@dataclass(frozen=True)
class Reading:
    """A scenario file as far as it could be read."""

    document: Document
    draft: Draft
    numbers: dict[str, Settable]
    """What parameters may set, from the blocks that could be read."""
    scenario: Scenario | None
    """null: the file does not fit the schema."""
    problems: tuple[Problem, ...]
    """What is wrong with YAML, schema and units; references between blocks are not looked at."""


def read_scenario(path: Path, telemetry: Path | None = None) -> Reading:
    """The scenario file at `path`; nothing wrong with it is raised.

    telemetry: replaces where telemetry is read from: a file, or a folder with files of the same names.
    """
    document = read_document(path)
    problems = list(document.problems)
    data = document.data
    if not isinstance(data, dict):
        if not problems:
            problems.append(Problem((), f"found {show(data)}, expected a mapping (key: value)"))
        return Reading(document, draft_of_data({}), {}, None, tuple(problems))
    if "folder" in data:
        problems.append(Problem(("folder",), unknown_key("folder", written_keys(Scenario))))
    data = {**data, "folder": path.parent}
    if telemetry is not None:
        data["telemetry"] = _elsewhere(data.get("telemetry"), telemetry.absolute())
    if isinstance(data.get("simulator"), dict):
        data["simulator"], found = fill_in(data["simulator"], path.parent)
        problems += found
    if "windows" in data:
        data["windows"] = flat_windows(data["windows"], document.lines)
    data, draft, numbers, found = _read_values(data)
    problems += found
    scenario = None
    try:
        scenario = Scenario.model_validate(data)
    except ValidationError as error:
        problems += problems_of(error)
    return Reading(document, draft, numbers, scenario if not problems else None, tuple(problems))


def _read_values(data: dict[str, Any]) -> tuple[dict[str, Any], Draft, dict[str, Settable], list[Problem]]:
    """Data with the numbers whose units depend on other blocks in SI: observations first, then parameters."""
    problems: list[Problem] = []
    for key, reader in (("noise", read_noise_block), ("discrepancy", read_discrepancy)):
        if key in data:
            data[key], found = reader(data[key], (key,))
            problems += found
    if isinstance(data.get("observations"), dict):
        data["observations"], found = read_observations(data["observations"])
        problems += found
    draft = draft_of_data({**data, "parameters": {}})
    numbers = settable_of(draft)
    if isinstance(data.get("parameters"), dict):
        data["parameters"], found = read_parameters(data["parameters"], numbers, draft)
        problems += found
    return data, draft_of_data(data), numbers, problems


def _elsewhere(telemetry: Any, place: Path) -> Any:
    if not isinstance(telemetry, dict):
        return telemetry
    files = telemetry.get("file")
    names = [files] if isinstance(files, str) else files
    if not place.is_dir() or not isinstance(names, list):
        return {**telemetry, "file": [str(place)]}
    return {**telemetry, "file": [str(place / Path(str(name)).name) for name in names]}
