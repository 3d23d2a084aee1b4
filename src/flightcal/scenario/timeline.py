"""Timelines of modes and of attitudes from files, in the place of lists in the scenario."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from .document import Problem
from .fields import Time
from .units import did_you_mean, show

_ATTITUDES = ("nadir", "sun_pointing")


def with_timeline(written: dict[str, Any], folder: Path) -> tuple[dict[str, Any], list[Problem]]:
    """The simulator's block with the timeline that `timeline_file` has; a block without one as it is.

    A row for each change, or for each sample: rows that repeat the mode before them change nothing.
    """
    return _filled(written, folder, ("simulator", "timeline_file"), "mode", _names(written, "modes"), "one of 'modes'")


def with_attitudes(written: dict[str, Any], folder: Path) -> tuple[dict[str, Any], list[Problem]]:
    """The environment's block with the attitudes that a `timeline_file` has, likewise."""
    attitude = written.get("attitude")
    if not isinstance(attitude, dict):
        return written, []
    here, names = ("environment", "attitude", "timeline_file"), [*_names(attitude, "named"), *_ATTITUDES]
    filled, found = _filled(attitude, folder, here, "attitude", names, f"one of {', '.join(names)}")
    return {**written, "attitude": filled}, found


def _names(written: dict[str, Any], key: str) -> list[str]:
    return list(found) if isinstance(found := written.get(key), dict) else []


def _filled(
    written: dict[str, Any], folder: Path, here: tuple[str, ...], column: str, names: list[str], expected: str
) -> tuple[dict[str, Any], list[Problem]]:
    """A block with the changes of a file, whose column `column` has `names`."""
    name = written.get("timeline_file")
    if name is None:
        return written, []
    if not isinstance(name, str):
        return written, [Problem(here, f"found {show(name)}, expected the name of a CSV file")]
    if written.get("timeline"):
        return written, [Problem(here, "found 'timeline' too, expected one of them")]
    try:
        with (folder / name).open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.DictReader(file))
    except FileNotFoundError:
        wrong = f"found {show(name)}, which is not there, expected a path relative to the scenario"
        return written, [Problem(here, wrong)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        return written, [Problem(here, f"found {show(name)}, which cannot be read: {error}")]
    found, wrong = _changes(rows, column, names, expected)
    if wrong:
        return written, [Problem(here, f"{name}{wrong}")]
    return {**written, "timeline": found}, []


def _changes(
    rows: list[dict[str, Any]], column: str, names: list[str], expected: str
) -> tuple[list[dict[str, Any]], str]:
    """Changes, or what is wrong with the first row that is wrong."""
    if not rows or not {"at", column} <= set(rows[0]):
        columns = ", ".join(map(str, rows[0])) if rows else "no row"
        return [], f": found {columns}, expected the columns at and {column}"
    changes: list[dict[str, Any]] = []
    for number, row in enumerate(rows, start=2):
        name = (row[column] or "").strip()
        try:
            at = TypeAdapter(Time).validate_python((row["at"] or "").strip())
        except ValidationError as error:
            return [], f", line {number}: {error.errors()[0]['msg'].removeprefix('Value error, ')}"
        if name not in names:
            hint = did_you_mean(name, names)
            return [], f", line {number}: found the {column} {show(name)}, expected {expected}{hint}"
        if changes and at <= changes[-1]["at"]:
            return [], f", line {number}: found {at.isoformat()}, expected a time after {changes[-1]['at'].isoformat()}"
        if not changes or name != changes[-1][column]:
            changes.append({"at": at, column: name})
    return changes, ""
