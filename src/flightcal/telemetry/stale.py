"""Rows that the ground system repeated: a downlink gap filled with the last row."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from .clean import Nanoseconds, RowKeys

_PRIOR_TRANSITIONS = 10
"""A value's own tendency to repeat counts against the column's as one that was seen so often."""
_MOVES = 0.5
"""A column normally moves on from a value that it repeats less often than that."""
_BY_CHANCE = 0.01
"""Equal rows as long as a run that the telemetry may show by chance, and the run be frozen for all that."""


@dataclass(frozen=True)
class RowContent:
    """What the rows [R] of a file hold, as far as equality goes."""

    keys: RowKeys
    """A 64-bit hash of each row."""
    repeating: NDArray[np.float64]
    """How often a row that is equal to a neighbour is so by chance; 1: no column normally moves on from there."""
    checked: bool
    """Whether any column normally moves; where none does, a frozen row cannot be told from a quiet one."""


def row_content(frame: pd.DataFrame, times: Nanoseconds, named: Collection[str]) -> RowContent:
    """Compares the rows of `frame` in order of `times` [R], ns.

    named: which columns channels use. Any other column that counts rows (a clock, a frame counter) is left out, as it
    goes on where the ground system repeats a row.
    """
    order = np.argsort(times, kind="stable")
    ordered = frame.iloc[order]
    columns = [name for name in ordered if name in named or not _counts_rows(ordered[name])]
    hashes = pd.util.hash_pandas_object(ordered[columns], index=False).to_numpy().astype(np.uint64)
    again = hashes[1:] == hashes[:-1]
    suspect = np.append(again, False) | np.append(False, again)
    witnesses = [_witness(ordered[name], suspect) for name in _apart(ordered[columns])]
    keys, repeating = np.empty_like(hashes), np.ones(len(hashes))
    keys[order] = hashes
    repeating[order] = np.prod([chance for chance, _ in witnesses], axis=0)
    return RowContent(keys, repeating, checked=any(share < _MOVES for _, share in witnesses))


def _apart(frame: pd.DataFrame) -> list[str]:
    """The columns without those that an earlier one tells, or is told by: counts of a sensor, and what they mean."""
    kept: dict[str, NDArray[np.intp]] = {}
    for name in frame:
        codes, values = pd.factorize(frame[name])
        # A column that never has a value twice tells any other.
        if not any(2 * len(values) < len(codes) and _is_told(codes, row_keys) for row_keys in kept.values()):
            kept[name] = codes
    return list(kept)


def _is_told(codes: NDArray[np.intp], by: NDArray[np.intp]) -> bool:
    """Whether equal values of one column always stand beside equal ones of the other, for each of several values."""
    pairs = len(np.unique((codes.astype(np.int64) + 1) << 32 | (by + 1)))
    return 2 < pairs == max(codes.max(), by.max()) + 1 and pairs <= 2 * (min(codes.max(), by.max()) + 1)


def repeats(keys: RowKeys, repeating: NDArray[np.float64]) -> NDArray[np.int64]:
    """For each row [T], in order of time, that only repeats the one before it: how many equal rows there are, else 0.

    repeating: how often each row repeats by chance. The first of equal rows is a genuine sample. Equal rows as come by
    chance, as where samples are close to each other and coarse, are a quiet spacecraft.
    """
    changes = np.ones(len(keys), dtype=bool)
    changes[1:] = keys[1:] != keys[:-1]
    starts = np.flatnonzero(changes)
    lengths = np.diff(np.append(starts, len(keys)))
    by_chance = len(keys) * np.minimum.reduceat(repeating, starts) ** (lengths - 1.0)
    lengths[by_chance > _BY_CHANCE] = 0
    return np.where(changes, 0, lengths[np.cumsum(changes) - 1])


def _witness(column: pd.Series, suspect: NDArray[np.bool_]) -> tuple[NDArray[np.float64], float]:
    """How often suspect rows [R] repeat the column's value by chance, where it normally moves; how often it repeats.

    Both 0 to 1; the first is 1 elsewhere. How often a value repeats is counted outside of the row's own run of equal
    values; where the value hardly occurs otherwise, the whole column's tendency stands in. Zero tells nothing: a
    current is zero all through an eclipse.
    """
    codes, values = pd.factorize(column)
    chance = np.ones(len(codes))
    changes = np.append(True, codes[1:] != codes[:-1])
    share = 1.0 - np.count_nonzero(changes[1:]) / max(len(codes) - 1, 1)
    witness = suspect & (codes >= 0)
    if pd.api.types.is_numeric_dtype(column.dtype):
        witness &= column.to_numpy(dtype=float, na_value=np.nan) != 0
    if not witness.any():
        return chance, share
    starts = np.flatnonzero(changes)
    lengths = np.diff(np.append(starts, len(codes)))[np.cumsum(changes) - 1][witness]
    code = codes[witness]
    rows = np.bincount(codes[codes >= 0], minlength=len(values))[code] - lengths
    runs = np.bincount(codes[starts][codes[starts] >= 0], minlength=len(values))[code] - 1
    other_rows, other_runs = len(codes) - lengths, len(starts) - 1
    column_repeats = np.divide(other_rows - other_runs, other_rows, out=np.ones(len(lengths)), where=other_rows > 0)
    repeating = (rows - runs + _PRIOR_TRANSITIONS * column_repeats) / (rows + _PRIOR_TRANSITIONS)
    chance[witness] = np.where(repeating < _MOVES, repeating, 1.0)
    return chance, share


def _counts_rows(column: pd.Series) -> bool:
    """Whether a column, in order of time, only rises, only falls, or nearly always moves by the same step."""
    if pd.api.types.is_numeric_dtype(column.dtype) and not pd.api.types.is_bool_dtype(column.dtype):
        steps = np.diff(column.to_numpy(dtype=float, na_value=np.nan))
    elif pd.api.types.is_string_dtype(column.dtype) or pd.api.types.is_datetime64_any_dtype(column.dtype):
        # A clock written as text sorts as it runs.
        steps = np.diff(column.rank(method="dense").to_numpy(dtype=float))
    else:
        return False
    if len(steps) < 2 or not np.any(steps):
        return False
    if np.all(steps > 0) or np.all(steps < 0):
        return True
    values, counts = np.unique(steps[~np.isnan(steps)], return_counts=True)
    return bool(len(values) and values[np.argmax(counts)] != 0 and counts.max() >= 0.9 * len(steps))
