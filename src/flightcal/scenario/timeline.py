"""Timelines of modes and of attitudes from files, in the place of lists in the scenario."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any, get_args

from pydantic import TypeAdapter, ValidationError

from .attitude import NamedAttitude
from .document import Issue
from .fields import Time
from .units import Quantity, did_you_mean, show

_OF_EACH = 2.0
"""Rows for each change, from which on rows are samples, if they are at a rate."""
_AT_A_RATE, _SHARE = 0.1, 2.0 / 3.0
"""Of the usual time between two rows: what this share of all times differ from it at most."""
_TIME = TypeAdapter[Any](Time)
_WITHIN = Quantity("s", above=0)


@dataclass(frozen=True)
class NamedChange:
    """From a time on something has another name."""

    at: float
    """s"""
    within: float
    """s of the time that the change lies in, `at` in its middle; 0: it is known."""
    name: str


def changes_in(seconds: Sequence[float], names: Sequence[str], *, sampled: bool) -> tuple[NamedChange, ...]:
    """What changes in rows [R] at times that rise; the first row is one. sampled: it does so between two of them."""
    new = [k for k, name in enumerate(names) if k == 0 or name != names[k - 1]]
    between = [seconds[k] - seconds[k - 1] if sampled and k else 0.0 for k in new]
    return tuple(
        NamedChange(seconds[k] - 0.5 * offset, offset, names[k]) for k, offset in zip(new, between, strict=True)
    )


def _are_samples(seconds: Sequence[float], changes: int) -> bool:
    """Whether rows [R] of which so many are changes are samples: there are many, at a steady rate."""
    gaps = [after - before for before, after in pairwise(seconds)]
    usual = median(gaps) if gaps else 0.0
    steady = sum(abs(gap - usual) <= _AT_A_RATE * usual for gap in gaps) >= _SHARE * len(gaps)
    return steady and len(seconds) >= _OF_EACH * changes


def with_timeline(written: dict[str, Any], folder: Path) -> tuple[dict[str, Any], list[Issue]]:
    """The simulator's block with the timeline that `timeline_file` has; a block without one as it is.

    A row for each change, or for each sample: where many at a steady rate repeat a mode, it changes between two rows.
    """
    return _filled(written, folder, ("simulator", "timeline_file"), "mode", _names(written, "modes"), "one of 'modes'")


def with_attitudes(written: dict[str, Any], folder: Path) -> tuple[dict[str, Any], list[Issue]]:
    """The environment's block with the attitudes that a `timeline_file` has, likewise."""
    attitude = written.get("attitude")
    if not isinstance(attitude, dict):
        return written, []
    here, names = (
        ("environment", "attitude", "timeline_file"),
        list(dict.fromkeys([*_names(attitude, "named"), *get_args(NamedAttitude)])),
    )
    filled, found = _filled(attitude, folder, here, "attitude", names, f"one of {', '.join(names)}")
    return {**written, "attitude": filled}, found


def _names(written: dict[str, Any], key: str) -> list[str]:
    return list(found) if isinstance(found := written.get(key), dict) else []


def _filled(
    written: dict[str, Any], folder: Path, here: tuple[str, ...], column: str, names: list[str], expected: str
) -> tuple[dict[str, Any], list[Issue]]:
    """A block with the changes of a file, whose column `column` has `names`."""
    name = written.get("timeline_file")
    if name is None:
        return written, []
    if not isinstance(name, str):
        return written, [Issue(here, f"found {show(name)}, expected the name of a CSV file")]
    if written.get("timeline"):
        return written, [Issue(here, "found 'timeline' too, expected one of them")]
    try:
        with (folder / name).open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file)
            rows = [(reader.line_num, row) for row in reader]
    except FileNotFoundError:
        wrong = f"found {show(name)}, which is not there, expected a path relative to the scenario"
        return written, [Issue(here, wrong)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        return written, [Issue(here, f"found {show(name)}, which cannot be read: {error}")]
    found, wrong = _changes(rows, column, names, expected)
    if wrong:
        return written, [Issue(here, f"{name}{wrong}")]
    return {**written, "timeline": found}, []


def _changes(
    rows: list[tuple[int, dict[str, Any]]], column: str, names: list[str], expected: str
) -> tuple[list[dict[str, Any]], str]:
    """Changes, or what is wrong with the first row, behind its line's number, that is wrong."""
    if not rows or not {"at", column} <= set(rows[0][1]):
        columns = ", ".join(map(str, rows[0][1])) if rows else "no row"
        return [], f": found {columns}, expected the columns at and {column}"
    times: list[datetime] = []
    cells: list[str] = []
    within: list[float] = []
    for number, row in rows:
        name, written = (row[column] or "").strip(), (row.get("within") or "").strip()
        try:
            at = _TIME.validate_python((row["at"] or "").strip())
        except ValidationError as error:
            return [], f", line {number}: {error.errors()[0]['msg'].removeprefix('Value error, ')}"
        try:
            within.append(_WITHIN.read(written) if written else 0.0)
        except ValueError as error:
            return [], f", line {number}: within: {error}"
        if name not in names:
            hint = did_you_mean(name, names)
            return [], f", line {number}: found the {column} {show(name)}, expected {expected}{hint}"
        if times and at <= times[-1]:
            return [], f", line {number}: found {at.isoformat()}, expected a time after {times[-1].isoformat()}"
        times.append(at)
        cells.append(name)
    seconds = [(at - times[0]).total_seconds() for at in times]
    found = changes_in(seconds, cells, sampled=False)
    if any(within):
        known = dict(zip(seconds, within, strict=True))
        found = tuple(replace(change, within=known[change.at]) for change in found)
    elif _are_samples(seconds, len(found)):
        found = changes_in(seconds, cells, sampled=True)
    return [
        {"at": times[0] + timedelta(seconds=change.at), column: change.name}
        | ({"within": _WITHIN.write(change.within)} if change.within and column == "mode" else {})
        for change in found
    ], ""
