"""Samples far from those beside them."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ...scenario import ICE_POINT
from ...simulator import FloatArray
from ...words import moment, number
from ..samples import noise_of
from ..suspicion import Suspicion
from .broken import GAP, Broken, leave_out

_MOST_SPIKES = 3
_SPIKE = (3.0, 12.0, 4.0, 2.0)
"""A spike is larger than so many K, so many deviations of the noise, so many times what is usual, and so many times
what the model has."""
_MOVED = 0.5
"""Share of a spike's height by which the temperature moves from sample to sample, from which it is none."""
_MANY = (0.03, 15.0)
"""Share of the samples that may be spikes, where they are so many times what is usual."""


def spikes(channel: str, times: NDArray[np.datetime64], values: FloatArray, modelled: FloatArray) -> Broken | None:
    """One sample, or two in a row, far from those before and after."""
    if len(values) < 20:
        return None
    height = _heights(times, values)
    least, noises, usual, models = _SPIKE
    order = np.argsort(-height)
    many = max(_MOST_SPIKES, round(_MANY[0] * len(values)))
    beyond = min(usual * float(height[order[_MOST_SPIKES]]), _MANY[1] * float(height[order[many]]))
    limit = max(least, noises * noise_of(values), beyond)
    if np.isfinite(modelled).all():
        limit = max(limit, models * float(_heights(times, modelled).max()))
    high = height > limit
    if not high.any():
        return None
    first = order[0]
    what = "a spike" if high.sum() == 1 else f"{high.sum()} spikes"
    suspicion = Suspicion(
        "spike", channel, f"{channel} has {what}",
        f"At {moment(times[first])} UTC it reads {number(float(values[first]) - ICE_POINT, 3)} degC, "
        f"{number(float(height[first]), 2)} K away from the samples around it.",
        leave_out(channel, times, high) if high.sum() <= _MOST_SPIKES
        else f"Leave them out with a narrower 'valid_range' of {channel}",
    )  # fmt: skip
    return Broken(suspicion, high)


def _heights(times: NDArray[np.datetime64], values: FloatArray) -> FloatArray:
    """[T] K by which one sample, or two in a row, are above those before and after, or below; else 0.

    Where the temperature moves by half as much before or after, they are the end of that motion, and no spike.
    """
    usual = np.median(np.diff(times))
    found = np.zeros(len(values))
    for wide in (1, 2):
        rows = sliding_window_view(values, wide + 4)
        apart = np.max(sliding_window_view(np.diff(times), wide + 3)[:, 1:-1], axis=1)
        before, inside, after = rows[:, [0, 1]], rows[:, 2:-2], rows[:, [-2, -1]]
        away = np.stack([inside - before[:, [1]], inside - after[:, [0]]])
        height = np.maximum(away.min(axis=(0, 2)), (-away).min(axis=(0, 2))).clip(0.0)
        moves = np.maximum(np.abs(np.diff(before)), np.abs(np.diff(after)))[:, 0]
        height[(apart >= GAP * usual) | (moves > _MOVED * height)] = 0.0
        for k in range(wide):
            peak = found[2 + k : 2 + k + len(height)]
            np.maximum(peak, height, out=peak)
    return found
