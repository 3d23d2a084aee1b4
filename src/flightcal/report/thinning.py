"""Fewer points for the eye: dots keep the extremes of every stretch, and lines go where those of all points go."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

_SEEN = 0.003
"""Share of a plot's height by which a line may be off: less than the eye sees."""
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


def followed(time: NDArray[np.datetime64], columns: Sequence[Array], most: int) -> Indices:
    """Indices of samples between which straight lines go where the columns [T] do, NaN where missing.

    Of the samples that are left out the one farthest off comes next (Douglas and Peucker 1973, Cartographica 10, 112),
    until none is off by more than the eye sees, or `most` are drawn.
    """
    size = len(time)
    if size <= most:
        return np.arange(size)
    x = (time - time[0]).astype("timedelta64[ns]").astype(float)
    y = np.stack(columns)
    known = np.isfinite(y)
    height = float(np.ptp(y[known])) if known.any() else 0.0
    ends = np.flatnonzero((known[:, 1:] != known[:, :-1]).any(axis=0))
    chosen = np.unique([0, *ends, *(ends + 1), size - 1]).tolist()

    def farthest(start: int, end: int) -> tuple[float, int, int, int]:
        """Minus how far the farthest sample in between is off, which it is, and the two."""
        share = (x[start + 1 : end] - x[start]) / max(x[end] - x[start], 1.0)
        straight = y[:, [start]] + (y[:, [end]] - y[:, [start]]) * share
        off = np.nan_to_num(np.abs(y[:, start + 1 : end] - straight)).max(axis=0)
        k = int(off.argmax())
        return -float(off[k]), start + 1 + k, start, end

    left = [farthest(start, end) for start, end in itertools.pairwise(chosen) if end - start > 1]
    heapq.heapify(left)
    while left and len(chosen) < most and -left[0][0] > _SEEN * height:
        _, k, start, end = heapq.heappop(left)
        chosen.append(k)
        for one, other in ((start, k), (k, end)):
            if other - one > 1:
                heapq.heappush(left, farthest(one, other))
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
    column_steps = [_steps(time[np.isfinite(column)]) for column in columns.T]
    return min((float(np.median(steps)) for steps in column_steps if steps.size), default=None)


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
