"""The timeline of modes from a file, in the place of a list in the scenario."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from .document import Problem
from .fields import Time
from .units import did_you_mean, show

_HERE = ("simulator", "timeline_file")
_COLUMNS = ("at", "mode")


def with_timeline(written: dict[str, Any], folder: Path) -> tuple[dict[str, Any], list[Problem]]:
    """The simulator's block with the timeline that `timeline_file` has; a block without one as it is.

    A row for each change, or for each sample: rows that repeat the mode before them change nothing.
    """
    name = written.get("timeline_file")
    if name is None:
        return written, []
    if not isinstance(name, str):
        return written, [Problem(_HERE, f"found {show(name)}, expected the name of a CSV file")]
    if written.get("timeline"):
        return written, [Problem(_HERE, "found 'timeline' too, expected one of them")]
    try:
        with (folder / name).open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.DictReader(file))
    except FileNotFoundError:
        wrong = f"found {show(name)}, which is not there, expected a path relative to the scenario"
        return written, [Problem(_HERE, wrong)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        return written, [Problem(_HERE, f"found {show(name)}, which cannot be read: {error}")]
    found, wrong = _changes(rows, list(written.get("modes") or ()) if isinstance(written.get("modes"), dict) else [])
    if wrong:
        return written, [Problem(_HERE, f"{name}{wrong}")]
    return {**written, "timeline": found}, []


def _changes(rows: list[dict[str, Any]], modes: list[Any]) -> tuple[list[dict[str, Any]], str]:
    """Changes of mode, or what is wrong with the first row that is wrong."""
    if not rows or not set(_COLUMNS) <= set(rows[0]):
        columns = ", ".join(map(str, rows[0])) if rows else "no row"
        return [], f": found {columns}, expected the columns {' and '.join(_COLUMNS)}"
    changes: list[dict[str, Any]] = []
    for number, row in enumerate(rows, start=2):
        mode = (row["mode"] or "").strip()
        try:
            at = TypeAdapter(Time).validate_python((row["at"] or "").strip())
        except ValidationError as error:
            return [], f", line {number}: {error.errors()[0]['msg'].removeprefix('Value error, ')}"
        if mode not in modes:
            return (
                [],
                f", line {number}: found the mode {show(mode)}, expected one of 'modes'{did_you_mean(mode, modes)}",
            )
        if changes and at <= changes[-1]["at"]:
            return [], f", line {number}: found {at.isoformat()}, expected a time after {changes[-1]['at'].isoformat()}"
        if not changes or mode != changes[-1]["mode"]:
            changes.append({"at": at, "mode": mode})
    return changes, ""
