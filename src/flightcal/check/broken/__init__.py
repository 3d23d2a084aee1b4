"""Sensors that are broken by their own telemetry alone: a look is a file, and the first that finds something counts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...simulator import FloatArray
from .broken import Broken
from .clipped import clipped
from .filled import filled
from .held import held, interpolated
from .repeating import repeating
from .spikes import spikes
from .stuck import stuck, stuck_often, stuck_throughout
from .wrapped import wrapped

__all__ = ["Broken", "broken", "stuck_throughout"]


def broken(channel: str, times: NDArray[np.datetime64], values: FloatArray, modelled: FloatArray) -> Broken | None:
    """What is wrong with a channel's samples [T] K; modelled: [T] K as the simulator has them, NaN: not known."""
    valid = np.flatnonzero(np.isfinite(values))
    for look in (filled, wrapped, interpolated, stuck_often, spikes, held, stuck, clipped, repeating):
        found = look(channel, times[valid], values[valid], modelled[valid])
        if found is not None:
            useless = np.zeros(len(values), bool)
            useless[valid] = found.useless
            return replace(found, useless=useless)
    return None
