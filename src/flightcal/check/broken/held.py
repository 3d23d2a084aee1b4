"""One reading of many: the rest hold it, or are on lines between."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...simulator import FloatArray
from ..suspicion import Suspicion
from .broken import STUCK, Broken

_HELD = 3
"""Samples, from which a reading that is held for so many is worth a word."""
_KNOTS, _MOST_BETWEEN = 8, 120
"""Readings at least, and samples between two at most, where lines are drawn between them;"""
_NEARER, _NEARLY_ALL = 15.0, 0.95
"""times that nearly all samples are nearer to these lines than readings to lines of others: a curve is four times."""


def held(channel: str, times: NDArray[np.datetime64], values: FloatArray, modelled: FloatArray) -> Broken | None:
    """One reading of many, which all samples up to the next repeat."""
    changes = np.flatnonzero(np.diff(values) != 0.0) + 1
    if len(changes) < 10:
        return None
    stride = int(np.gcd.reduce(np.diff(changes)))
    if stride < _HELD:
        return None
    suspicion = Suspicion(
        "held", channel, f"{channel} holds each reading for {stride} samples",
        f"Its value changes every {stride} samples or a multiple of that, and never between: one of {stride} "
        "is a measurement.",
        f"Keep one of {stride} samples of {channel}",
    )  # fmt: skip
    return Broken(suspicion, np.diff(values, prepend=values[0]) == 0.0)


def interpolated(
    channel: str, times: NDArray[np.datetime64], values: FloatArray, modelled: FloatArray
) -> Broken | None:
    """One reading of many, and straight lines between them."""
    if len(values) < STUCK:
        return None
    seconds = (times - times[0]) / np.timedelta64(1, "s")
    places = np.rint(seconds / np.median(np.diff(seconds))).astype(np.int64)
    # The largest bend is at a reading.
    beside = np.diff(places, 2) == 0
    after = places - places[1:-1][np.argmax(np.abs(np.diff(values, 2)) * beside)]
    strides = range(min(_MOST_BETWEEN, len(values) // _KNOTS), _HELD - 1, -1)
    stride = next((k for k in strides if _on_lines(seconds, values, after % k == 0)), None)
    if stride is None:
        return None
    suspicion = Suspicion(
        "interpolated", channel, f"{channel} has straight lines between readings",
        f"One of {stride} samples is a reading, and those between are on the line from each to the next.",
        f"Keep one of {stride} samples of {channel}, or take them as they were sent",
    )  # fmt: skip
    return Broken(suspicion, after % stride != 0)


def _on_lines(seconds: FloatArray, values: FloatArray, kept: NDArray[np.bool_]) -> bool:
    """Whether values [T] are far nearer to the lines between some of them than these are to those of every second."""
    if kept.sum() < _KNOTS:
        return False
    at, known = seconds[kept], values[kept]
    # Lines at the ends go on to readings outside.
    between = ~kept & (seconds > at[0]) & (seconds < at[-1])
    off = np.abs(values - np.interp(seconds, at, known))[between]
    bends = known[1:-1:2] - np.interp(at[1:-1:2], at[::2], known[::2])
    return bool(_NEARER * np.quantile(off, _NEARLY_ALL) < np.median(np.abs(bends)))
