"""Ornstein-Uhlenbeck processes at times that need not be even: drawn, and taken apart."""

from __future__ import annotations

import numpy as np

from ...simulator import FloatArray


def correlate(innovations: FloatArray, seconds: FloatArray, time: float) -> FloatArray:
    """An Ornstein-Uhlenbeck process [T] at `seconds` [T] from innovations [T] with its stationary scale."""
    decay = np.exp(-np.diff(seconds) / time)
    added = innovations.copy()
    added[1:] *= np.sqrt(1.0 - decay * decay)
    value, process = 0.0, []
    # Numbers of Python's own: one after the other, NumPy's take many times as long.
    for kept, new in zip([0.0, *decay.tolist()], added.tolist(), strict=False):
        value = kept * value + new
        process.append(value)
    return np.array(process)


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
