"""Readings that stop at the end of their range."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...scenario import ICE_POINT
from ...simulator import FloatArray
from ...telemetry import spells
from ...words import number
from ..samples import noise_of, step_of
from ..suspicion import Suspicion
from .broken import STUCK, Broken

_SLOPE, _CLIPPED = 3, 1.0
"""Samples over which a slope is taken; K, by which a temperature goes on where readings stop."""
_RESTS = 10.0
"""Times that a motion slows more than a parabola, where it comes to rest."""


def clipped(channel: str, times: NDArray[np.datetime64], values: FloatArray, modelled: FloatArray) -> Broken | None:
    """Readings that stop at their highest or lowest, where the temperature goes on."""
    if len(values) < STUCK:
        return None
    for extreme, word in ((values.max(), "above"), (values.min(), "below")):
        first, last = spells(values == extreme).T
        goes_on = _goes_on(modelled if word == "above" else -modelled, first, last)
        beyond = np.maximum(_turns_beyond(values, first, last), goes_on)
        if (beyond > _CLIPPED + 4.0 * step_of(values) + 4.0 * noise_of(values)).sum() < 2:
            continue
        suspicion = Suspicion(
            "clipped", channel, f"{channel} shows nothing {word} {number(float(extreme) - ICE_POINT, 4)} degC",
            f"It stops there {len(first)} times, for up to {int((last - first).max())} samples, where it would go on "
            f"by {number(float(beyond.max()), 2)} K.",
            f"Leave these samples out with a narrower 'valid_range' of {channel}",
        )  # fmt: skip
        return Broken(suspicion, values == extreme)
    return None


def _turns_beyond(values: FloatArray, first: NDArray[np.int64], last: NDArray[np.int64]) -> FloatArray:
    """K by which values [T] would go on in stretches [first, last), as a parabola does that has the slopes beside."""
    after = np.minimum(last, len(values) - 1)
    rise, before = _motion(values, first - 1, -_SLOPE, last - first)
    fall, later = _motion(values, after, _SLOPE, last - first)
    # At an end of the window one slope is known, and speaks for both.
    known = first > _SLOPE, last < len(values) - _SLOPE
    rise, fall = np.where(known[0], rise, np.inf), np.where(known[1], fall, np.inf)
    slope = np.minimum(rise, fall)
    beyond = np.where(np.isfinite(slope), slope, 0.0) * (last - first) / 4.0
    # On a parabola, readings a quarter of the stretch away are lower by that much. Those of a panel that leaves a
    # shadow fast, and then stays, are not.
    away, top = np.maximum((last - first) // 4, 1), values[first]
    lower = [
        np.where(side, np.abs(top - values[np.clip(place, 0, len(values) - 1)]), np.inf)
        for side, place in zip(known, (first - 1 - away, last + away), strict=True)
    ]
    beyond = np.where(np.minimum(*lower) < 0.5 * beyond, 0.0, beyond)
    # What comes to rest goes on by less.
    return np.minimum(beyond, np.minimum(np.where(known[0], before, np.inf), np.where(known[1], later, np.inf)))


def _goes_on(modelled: FloatArray, first: NDArray[np.int64], last: NDArray[np.int64]) -> FloatArray:
    """K by which the model rises in stretches [first, last) of `_SLOPE` samples or more, and falls again; else 0."""
    found = np.zeros(len(first))
    for k in np.flatnonzero(last - first >= _SLOPE):
        inside = modelled[first[k] : last[k]]
        found[k] = inside.max() - max(inside[0], inside[-1])
    return np.nan_to_num(found)


def _motion(
    values: FloatArray, places: NDArray[np.int64], step: int, lengths: NDArray[np.int64]
) -> tuple[FloatArray, FloatArray]:
    """K a sample by which values [t] move up to each place, and K by which they go on where they come to rest.

    step: samples back, or on where it is positive; lengths: samples that it then takes until they move again. They come
    to rest where they slow far more than a parabola does that turns in so long; elsewhere the second is infinite.
    """
    last, middle, first = (values[np.clip(places + k * step, 0, len(values) - 1)] for k in range(3))
    moved, earlier = np.abs(last - middle), np.abs(middle - first)
    slows = (earlier - moved) * lengths > _RESTS * 2.0 * abs(step) * moved
    goes_on = np.full(len(places), np.inf)
    goes_on[slows] = moved[slows] ** 2 / (earlier - moved)[slows]
    return moved / abs(step), goes_on
