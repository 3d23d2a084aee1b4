"""Fewer points for the eye: long series keep the extremes of every stretch, so that no peak is lost."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

BREAK = 5.0
"""A step longer than so many nominal ones is a gap, across which no line is drawn."""


def extremes(columns: Sequence[Array], bins: int) -> Indices:
    """Indices of samples to draw: first, last, and in each of `bins` stretches the extremes of every column.

    columns: of [T], NaN where missing. A series of no more than two samples a column and bin is kept whole.
    """
    size = len(columns[0])
    if size <= 2 * len(columns) * bins:
        return np.arange(size)
    edges = np.linspace(0, size, bins + 1).astype(int)
    chosen = {0, size - 1}
    for start, end in itertools.pairwise(edges):
        for column in columns:
            part = column[start:end]
            if np.isfinite(part).any():
                chosen |= {start + int(np.nanargmin(part)), start + int(np.nanargmax(part))}
    return np.array(sorted(chosen), dtype=np.intp)


def changes(values: Array) -> Indices:
    """Indices of samples of a step line that must be drawn: each change's two sides, first and last."""
    if values.size == 0:
        return np.arange(0)
    same = (values[1:] == values[:-1]) | (np.isnan(values[1:]) & np.isnan(values[:-1]))
    after = np.flatnonzero(~same) + 1
    return np.unique(np.concatenate([[0], after - 1, after, [values.size - 1]])).astype(np.intp)


def _steps(time: NDArray[np.datetime64]) -> NDArray[np.int64]:
    """ns, [T - 1]."""
    return np.diff(time).astype("timedelta64[ns]").astype(np.int64)


def usual_step(time: NDArray[np.datetime64], columns: Array) -> float | None:
    """ns between two samples of the column [T, N] that has them most often, NaN where it has none; null: none has two.

    Where each channel has a clock of its own, times of all of them come in bursts.
    """
    own = [_steps(time[np.isfinite(column)]) for column in columns.T]
    return min((float(np.median(steps)) for steps in own if steps.size), default=None)


def gaps(time: NDArray[np.datetime64], usual: float | None = None) -> Indices:
    """Indices of the samples after which telemetry pauses for more than `BREAK` usual steps (ns; null: of `time`)."""
    steps = _steps(time)
    return np.flatnonzero(steps > BREAK * (usual or np.median(steps))) if steps.size else np.arange(0)


def stretches(
    flags: NDArray[np.bool_], time: NDArray[np.datetime64], usual: float | None = None
) -> list[tuple[int, int]]:
    """First sample of every stretch in which `flags` [T] holds, and the sample at which it ends.

    A stretch ends at the first sample that does not hold, or at its own last one where a gap or the end follows.
    usual: ns, as of `gaps`.
    """
    pauses = set(gaps(time, usual).tolist())
    found, start = [], None
    for i, flag in enumerate(flags):
        if flag and start is None:
            start = i
        last = i == flags.size - 1
        if start is not None and (not flag or i in pauses or last):
            found.append((start, i))
            start = None
    return found


def break_lines(
    time: NDArray[np.datetime64], indices: Indices, columns: Sequence[Array], usual: float | None = None
) -> tuple[NDArray[np.datetime64], list[Array]]:
    """The chosen samples, with a NaN set into every gap so that lines break there: time and columns.

    usual: ns, as of `gaps`.
    """
    pauses = gaps(time, usual)
    if not pauses.size:
        return time[indices], [column[indices] for column in columns]
    kept = np.union1d(indices, np.concatenate([pauses, pauses + 1]))
    places = np.searchsorted(kept, pauses) + 1
    middle = time[pauses] + (time[pauses + 1] - time[pauses]) // 2
    return np.insert(time[kept], places, middle), [np.insert(c[kept], places, np.nan) for c in columns]
