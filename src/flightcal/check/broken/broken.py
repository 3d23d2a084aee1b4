"""A channel that is broken, and which of its samples are of no use."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...simulator import FloatArray
from ...telemetry import spells
from ..suspicion import Suspicion

STUCK = 30
"""Equal samples that no sensor shows where the model moves."""
GAP = 2.5
"""Times the usual time between samples, from which two are no longer beside each other."""


@dataclass(frozen=True)
class Broken:
    """What is wrong with a channel, and which of its samples are of no use."""

    suspicion: Suspicion
    useless: NDArray[np.bool_]
    """[T]."""


def leave_out(channel: str, times: NDArray[np.datetime64], useless: NDArray[np.bool_]) -> str:
    """Advice to leave samples out of a channel's at times [T]; half a sample longer, for a mean is of such a time."""
    first, end = spells(useless).T
    half = np.median(np.diff(times)) // 2
    ends = np.datetime_as_string(np.stack([times[first] - half, times[end - 1] + half], axis=1), unit="ms")
    texts = (tuple(str(name).removesuffix(".000") for name in pair) for pair in ends)
    spans = ", ".join(f"{{start: {start}, end: {end}}}" for start, end in texts)
    return f"Leave it out: 'leave_out: [{spans}]' of {channel} in 'telemetry: channels'"


def between(values: FloatArray, first: int, end: int) -> NDArray[np.bool_]:
    """[t] which of the values are from the first on and before the end."""
    places = np.arange(len(values))
    return (places >= first) & (places < end)
