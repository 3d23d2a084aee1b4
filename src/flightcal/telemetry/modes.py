"""Which column of a telemetry file tells the satellite's mode, and when that changes."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import pyarrow as pa

from ..scenario import NamedChange, changes_in
from ._times import Nanoseconds, is_text

_NAME = re.compile(r"(?i)(^|[^a-z])modes?([^a-z]|$)|mode$|(?-i:Mode)")
_MOST = 12
"""Modes: a column with more different values tells something else."""
_SHORTEST = 2.0
"""Samples that a mode lasts in the mean: what changes faster is no mode."""
_STARTS = re.compile(r"(?i)start|begin|from|^aos|_on$|\bon$")
_ENDS = re.compile(r"(?i)end|stop|until|^los|_off$|\boff$|finish")
_ACTIVITY = re.compile(r"(?i)activity|mode|name|type|event|task|operation|payload|instrument|station|what")
NOTHING, _ACTIVE = "nominal", "active"
"""The mode while none of the activities of a log goes on, and while one without a name does."""
_SELDOM = 0.01
"""Share of the samples, below which a value that never lasts for two is of corrupt frames."""


@dataclass(frozen=True)
class FoundModes:
    """A column with modes."""

    column: str
    times: Nanoseconds
    """[M] ns since 1970 of rows, rising: the first and the last of each mode."""
    names: tuple[str, ...]
    """[M] of the mode in them; of a number, with "mode" before it."""
    sampled: bool
    """Whether rows are samples, between which modes change; else each row is a change."""
    of_activities: bool = False
    """Whether each lasted from a time to a time, and `NOTHING` goes on before and between them."""

    @property
    def changes(self) -> tuple[NamedChange, ...]:
        """The first is the first row; times are since 1970."""
        return changes_in((1e-9 * self.times).tolist(), self.names, sampled=self.sampled)


def modes_in(table: pa.Table, names: list[str], times: Nanoseconds, *, alone: bool = False) -> FoundModes | None:
    """The first column of those named that tells a mode in each row of a table; times: [rows] ns. None: none does.

    alone: nothing else is in the table, which so may have a row for each change.
    """
    for name in names:
        column = table[name]
        integer = pa.types.is_integer(column.type)
        if not _NAME.search(name) or not (integer or is_text(column) or pa.types.is_dictionary(column.type)):
            continue
        cells = ["" if cell is None else str(cell).strip() for cell in column.to_pylist()]
        if not alone:
            whole = lasting([cell for cell in cells if cell])
            cells = [cell if cell in whole else "" for cell in cells]
        words = [f"mode {cell}" if integer else cell for cell in cells if cell]
        found = _first_and_last(FoundModes(name, times[[cell != "" for cell in cells]], tuple(words), True))
        samples = len(words) >= _SHORTEST * len(found.changes)
        if 1 < len(set(words)) <= _MOST and (alone or samples):
            return replace(found, sampled=samples)
    return None


def start_and_end(one: str, other: str) -> bool:
    """Whether two columns are called as the start and the end of something."""
    return bool(_STARTS.search(one) and _ENDS.search(other))


def activities_in(table: pa.Table, starts: str, ends: str, times: Nanoseconds, until: Nanoseconds) -> FoundModes | None:
    """A log that has a row for each activity, with when it starts and when it ends, as modes. None: it is no such log.

    starts, ends: the columns of these times; times, until: [rows] ns of both.
    """
    order = np.argsort(times, kind="stable")
    times, until = times[order], until[order]
    if (until <= times).any() or (until[:-1] > times[1:]).any():
        return None
    others = [name for name in table.column_names if name not in (starts, ends) and is_text(table[name])]
    column = next((name for name in others if _ACTIVITY.search(name)), others[0] if others else None)
    cells = (
        [_ACTIVE] * len(times) if column is None else [str(cell or "").strip() for cell in table[column].to_pylist()]
    )
    if not all(cells) or len(set(cells)) > _MOST or NOTHING in cells:
        return None
    at: dict[int, str] = {}
    for row, start, end in zip(order.tolist(), times.tolist(), until.tolist(), strict=True):
        at |= {start: cells[row], end: NOTHING}  # what starts as another ends follows it
    return FoundModes(column or starts, np.array(list(at), np.int64), tuple(at.values()), False, True)


def lasting(cells: Sequence[Any]) -> set[Any]:
    """Values but those of corrupt frames, which are few and last for one sample each."""
    together = {one for one, other in pairwise(cells) if one == other}
    return {cell for cell, count in Counter(cells).items() if cell in together or count >= _SELDOM * len(cells)}


def _first_and_last(rows: FoundModes) -> FoundModes:
    """The first and the last row of each mode, of rows in any order; of one time the last counts."""
    last = dict(zip(rows.times.tolist(), rows.names, strict=True))
    times = sorted(last)
    names = [last[at] for at in times]
    new = [k == 0 or names[k] != names[k - 1] for k in range(len(names))]
    kept = [k for k in range(len(names)) if new[k] or k + 1 == len(names) or new[k + 1]]
    return replace(rows, times=np.array([times[k] for k in kept], np.int64), names=tuple(names[k] for k in kept))


def both(one: FoundModes | None, other: FoundModes | None) -> FoundModes | None:
    """Of two files of a packet."""
    if one is None or other is None:
        return one or other
    times, names = np.concatenate([one.times, other.times]), (*one.names, *other.names)
    return _first_and_last(replace(one, times=times, names=names, sampled=one.sampled and other.sampled))
