"""What is wrong with the times of rows: order, duplicates, gaps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Nanoseconds = NDArray[np.int64]
RowKeys = NDArray[np.uint64]

GAP_FACTOR = 1.5
"""An interval longer than this many usual ones lacks at least one sample."""
_LONGEST_CYCLE, _CYCLES = 20, 10
"""At most so many intervals make a cycle, and there are at least so many cycles."""
_SAME, _MOSTLY = 0.2, 0.6
"""Cycles whose length differs by less than this share are the same; so many are, or there is no cycle."""


@dataclass(frozen=True)
class RowOrder:
    """Rows in order of time, one for each time."""

    kept: NDArray[np.int64]
    """Indices [T] of the rows that are kept, in order of time."""
    unsorted: int
    """Rows that stood after a row of a later time."""
    duplicates: int
    """Dropped rows: a row of the same time and content is kept."""
    conflicts: NDArray[np.int64]
    """Times (ns) of the dropped rows whose content differs from that of the row kept."""


def clock_text(time: np.datetime64) -> str:
    """A time as messages and tables give it, to a second."""
    return str(np.datetime_as_string(time, unit="s"))


def order_rows(times: Nanoseconds, keys: RowKeys) -> RowOrder:
    """Sort rows by time and keep the first of each time.

    times: [R] ns. keys: [R], equal for rows of equal content.
    """
    order = np.argsort(times, kind="stable")
    sorted_times, sorted_keys = times[order], keys[order]
    first = np.ones(len(times), dtype=bool)
    first[1:] = sorted_times[1:] != sorted_times[:-1]
    kept_key = sorted_keys[np.flatnonzero(first)][np.cumsum(first) - 1]
    duplicate = ~first & (sorted_keys == kept_key)
    return RowOrder(
        kept=order[first],
        unsorted=int(np.count_nonzero(times < np.maximum.accumulate(times))),
        duplicates=int(np.count_nonzero(duplicate)),
        conflicts=sorted_times[~first & ~duplicate],
    )


def sampling_interval(times: Nanoseconds) -> float:
    """Median interval of increasing times [T] (ns), in seconds; NaN for fewer than two."""
    return float(np.median(np.diff(times))) / 1e9 if len(times) > 1 else np.nan


@dataclass(frozen=True)
class Gap:
    """Samples are missing between two times (ns)."""

    start: int
    end: int
    samples: int
    """How many are missing, at the usual number of samples in such a time."""


def find_gaps(times: Nanoseconds) -> list[Gap]:
    """Gaps between increasing times [T] (ns): intervals far longer than the longest usual one."""
    lengths = np.diff(times) / 1e9
    longest, mean = usual_intervals(lengths)
    return [
        Gap(int(times[i]), int(times[i + 1]), max(1, round((lengths[i] - longest) / mean)))
        for i in np.flatnonzero(lengths > GAP_FACTOR * longest)
    ]


def usual_interval(times: NDArray[np.datetime64]) -> float:
    """Mean interval of increasing times [T], T > 1, where there is no gap, s; over whole cycles of packets."""
    nanoseconds = times.astype("datetime64[ns]").astype(np.int64)
    return usual_intervals(np.diff(nanoseconds) / 1e9)[1]


def usual_intervals(lengths: NDArray[np.float64]) -> tuple[float, float]:
    """The longest interval that is no gap, and the mean interval, of intervals [T - 1] between samples, s.

    Packets with time stamps of their own come in cycles, such as 2 s, 2 s and 56 s: so many intervals are a cycle as
    always add up to the same. Without a cycle 19 of 20 intervals are taken to be usual.
    """
    best, found = _MOSTLY, (float(np.quantile(lengths, 0.95)), float(np.median(lengths)))
    for size in range(1, max(1, min(_LONGEST_CYCLE, len(lengths) // _CYCLES)) + 1):
        cycles = np.lib.stride_tricks.sliding_window_view(lengths, size)
        sums = cycles.sum(axis=1)
        usual = float(np.median(sums))
        regular = np.abs(sums - usual) < _SAME * usual
        if (share := float(regular.mean())) > best:
            best, found = share, (float(np.median(cycles[regular].max(axis=1))), usual / size)
    return found
