"""Outputs at the telemetry's own times, from the states on the grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .kernel import interpolate, spread
from .system import FloatArray, IntArray


@dataclass(frozen=True)
class Sampling:
    """Where samples lie on the grid: between point `index` and the next, a share `weight` of the way."""

    index: NDArray[np.int64]
    """[T]."""
    weight: FloatArray
    """[T] 0..1."""

    def interpolate(self, on_grid: FloatArray, states: IntArray, offsets: FloatArray) -> FloatArray:
        """[K+1, n] on the grid -> [T, N] at the samples: the states [N] that the channels measure, plus offsets [N]."""
        at_samples = np.empty((len(self.index), len(states)))
        interpolate(self.index, self.weight, on_grid, states, offsets, at_samples)
        return at_samples

    def spread(self, at_samples: FloatArray, states: IntArray, points: int, count: int) -> FloatArray:
        """The transpose of `interpolate`: [T, N] -> [points, count]."""
        on_grid = np.zeros((points, count))
        spread(self.index, self.weight, at_samples, states, on_grid)
        return on_grid


def locate(samples: FloatArray, grid: FloatArray) -> Sampling:
    """Where samples (s) lie on a grid with possible double points."""
    index = np.clip(np.searchsorted(grid, samples + 1e-9, side="right") - 1, 0, len(grid) - 2)
    length = grid[index + 1] - grid[index]
    weight = np.divide(samples - grid[index], length, out=np.zeros_like(samples), where=length > 0)
    return Sampling(index, np.clip(weight, 0.0, 1.0))
