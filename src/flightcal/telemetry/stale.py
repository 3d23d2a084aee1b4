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


@dataclass(frozen=True)
class RowContent:
    """What the rows [R] of a file hold, as far as equality goes."""

    keys: RowKeys
    """A 64-bit hash of each row."""
    moving: NDArray[np.bool_]
    """Whether a row equal to one of its neighbours has a column that normally moves on from the value it has there."""
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
    witnesses = [_witness(ordered[name], suspect) for name in columns]
    keys, moving = np.empty_like(hashes), np.zeros(len(hashes), dtype=bool)
    keys[order] = hashes
    moving[order] = np.any([moves for moves, _ in witnesses], axis=0)
    return RowContent(keys, moving, checked=any(share < 0.5 for _, share in witnesses))


def repeats(keys: RowKeys, moving: NDArray[np.bool_]) -> NDArray[np.int64]:
    """For each row [T], in order of time, that only repeats the one before it: how many equal rows there are, else 0.

    The first of equal rows is a genuine sample. Equal rows without a column that normally moves are a quiet spacecraft.
    """
    changes = np.ones(len(keys), dtype=bool)
    changes[1:] = keys[1:] != keys[:-1]
    starts = np.flatnonzero(changes)
    lengths = np.diff(np.append(starts, len(keys)))
    lengths[~np.logical_or.reduceat(moving, starts)] = 0
    return np.where(changes, 0, lengths[np.cumsum(changes) - 1])


def _witness(column: pd.Series, suspect: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], float]:
    """At which suspect rows [R] a column normally moves on from its value, and how often (0 to 1) it repeats at all.

    How often a value repeats is counted outside of the row's own run of equal values; where the value hardly occurs
    otherwise, the whole column's tendency stands in. Zero tells nothing: a current is zero all through an eclipse.
    """
    codes, values = pd.factorize(column)
    moves = np.zeros(len(codes), dtype=bool)
    changes = np.append(True, codes[1:] != codes[:-1])
    share = 1.0 - np.count_nonzero(changes[1:]) / max(len(codes) - 1, 1)
    witness = suspect & (codes >= 0)
    if pd.api.types.is_numeric_dtype(column.dtype):
        witness &= column.to_numpy(dtype=float, na_value=np.nan) != 0
    if not witness.any():
        return moves, share
    starts = np.flatnonzero(changes)
    own = np.diff(np.append(starts, len(codes)))[np.cumsum(changes) - 1][witness]
    code = codes[witness]
    rows = np.bincount(codes[codes >= 0], minlength=len(values))[code] - own
    runs = np.bincount(codes[starts][codes[starts] >= 0], minlength=len(values))[code] - 1
    other_rows, other_runs = len(codes) - own, len(starts) - 1
    column_repeats = np.divide(other_rows - other_runs, other_rows, out=np.ones(len(own)), where=other_rows > 0)
    repeating = (rows - runs + _PRIOR_TRANSITIONS * column_repeats) / (rows + _PRIOR_TRANSITIONS)
    moves[witness] = repeating < 0.5
    return moves, share


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
