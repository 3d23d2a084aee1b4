"""Where and when the states are looked at: at the telemetry's own times, wherever these lie in the steps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .system import FloatArray


class Sensors(NamedTuple):
    """What the temperature channels measure. What a channel says of its state's temperature x is, with errors [3, N],

        y(t) = gain (x(t + time offset) - 273.15 K) + 273.15 K + bias:

    gain and bias are slope and offset of the reading in degC, as a calibration curve has them about the ice point.
    Before the window's start and after its end x goes on in a straight line for a minute, and then stays.
    """

    state: NDArray[np.integer]
    """[N]."""
    moved: NDArray[np.bool_]
    """[N] whether samples may be of other times than their tags say: where its time offset is not always zero."""


@dataclass(frozen=True)
class Observation:
    """Where and when the states are looked at."""

    times: FloatArray
    """[T] s from the window's start, not decreasing."""
    sensors: Sensors


NOTHING = Observation(np.zeros(0), Sensors(np.zeros(0, np.int64), np.zeros(0, np.bool_)))


class Place(NamedTuple):
    """Where times lie on the grid: between `point` and the next, a share `weight` of the way."""

    point: NDArray[np.int64]
    """[T], not decreasing."""
    weight: FloatArray
    """[T] 0..1."""


def locate(times: FloatArray, grid: FloatArray) -> Place:
    """Where times (s, ascending) lie on a grid."""
    index = np.clip(np.searchsorted(grid, times + 1e-9, side="right") - 1, 0, len(grid) - 2)
    weight = (times - grid[index]) / (grid[index + 1] - grid[index])
    return Place(index, np.clip(weight, 0.0, 1.0))
