"""Which column of a telemetry file tells the satellite's mode, and when that changes."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np
import pyarrow as pa

from ._times import Nanoseconds, is_text

_NAME = re.compile(r"(?i)(^|[^a-z])modes?([^a-z]|$)|mode$|(?-i:Mode)")
_MOST = 12
"""Modes: a column with more different values tells something else."""
_SHORTEST = 2.0
"""Samples that a mode lasts in the mean: what changes faster is no mode."""


@dataclass(frozen=True)
class FoundModes:
    """A column with modes."""

    column: str
    times: Nanoseconds
    """[M] ns since 1970 of the changes, rising; the first is the first sample."""
    names: tuple[str, ...]
    """[M] of the mode from then on; of a number, with "mode" before it."""


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
        words = [f"mode {cell}" if integer else cell for cell in cells if cell]
        found = changes(FoundModes(name, times[[cell != "" for cell in cells]], tuple(words)))
        if 1 < len(set(words)) <= _MOST and (alone or len(words) >= _SHORTEST * len(found.names)):
            return found
    return None


def changes(samples: FoundModes) -> FoundModes:
    """Those of the samples, in any order, at which the mode is another than before; of one time the last counts."""
    last = dict(zip(samples.times.tolist(), samples.names, strict=True))
    times = sorted(last)
    kept = [at for k, at in enumerate(times) if k == 0 or last[at] != last[times[k - 1]]]
    return replace(samples, times=np.array(kept, np.int64), names=tuple(last[at] for at in kept))


def both(one: FoundModes | None, other: FoundModes | None) -> FoundModes | None:
    """Of two files of a packet."""
    if one is None or other is None:
        return one or other
    return changes(replace(one, times=np.concatenate([one.times, other.times]), names=(*one.names, *other.names)))
