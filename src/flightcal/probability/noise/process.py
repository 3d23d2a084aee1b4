"""Ornstein-Uhlenbeck processes at times that need not be even: drawn, and taken apart."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from ...simulator import FloatArray

_LONGEST = 200.0
"""Correlation times that are summed at once: further back e to their power is no longer a number."""


def correlate(innovations: FloatArray, seconds: FloatArray, time: float) -> FloatArray:
    """An Ornstein-Uhlenbeck process [T] at `seconds` [T] from innovations [T] with its stationary scale."""
    since = (seconds - seconds[0]) / time
    added = innovations.copy()
    added[1:] *= np.sqrt(-np.expm1(-2.0 * np.diff(since)))
    process, before = np.empty(len(since)), 0.0
    for first, end in _pieces(since):
        if first:
            added[first] += before * np.exp(since[first - 1] - since[first])
        grown = np.exp(since[first:end] - since[first])
        process[first:end] = np.cumsum(grown * added[first:end]) / grown
        before = process[end - 1]
    return process


def _pieces(since: FloatArray) -> Iterator[tuple[int, int]]:
    """First places of stretches of times [T], in correlation times, that are summed at once, and their ends."""
    edges = [0, *(np.flatnonzero(np.diff(since // _LONGEST)) + 1).tolist(), len(since)]
    return pairwise(edges)


def filtered(residual: FloatArray, seconds: FloatArray, deviation: float, time: float, white: float) -> FloatArray:
    """Innovations [T] of an Ornstein-Uhlenbeck process beside white noise, in deviations of the first one's, K."""
    found = np.full(len(residual), np.nan)
    expected, variance, before = 0.0, 0.0, -np.inf
    for t in np.flatnonzero(np.isfinite(residual)):
        kept = np.exp(-(seconds[t] - before) / time)
        expected, variance = kept * expected, kept**2 * variance + (1.0 - kept**2) * deviation**2
        off, total = residual[t] - expected, variance + white**2
        found[t] = off * np.sqrt((deviation**2 + white**2) / total)
        gain = variance / total
        expected, variance, before = expected + gain * off, (1.0 - gain) * variance, seconds[t]
    return found
