"""Normal noise whose shape is known, and its size alone is not: correlation time, and what share of it is white."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...simulator import FloatArray
from .ar1 import Correlated, correlate, filtered
from .iid import Independent
from .kind import DEVIATION, NoiseKind


@dataclass(frozen=True, eq=False)
class Shaped(NoiseKind):
    """Noise of an Ornstein-Uhlenbeck process and white noise, or of white noise alone.

    Its number is the process's standard deviation, K, or that of the white noise where it is alone.
    """

    time: float
    """s, of correlation; 0: there is white noise alone."""
    white_share: float
    """Deviation of the white noise over the process's."""

    names = ("standard_deviation",)

    @property
    def words(self) -> str:  # type: ignore[override]
        """As those of the kind that has this shape."""
        return Correlated.words if self.has_memory else Independent.words

    @property
    def in_full(self) -> str:
        """The same with its shape."""
        if not self.has_memory:
            return self.words
        return f"{self.words}, {self.time:.0f} s, with {self.white_share:.2g} times as much white noise"

    @property
    def has_memory(self) -> bool:  # type: ignore[override]
        """Whether a sample's noise tells about the next one's."""
        return self.time > 0.0

    @property
    def is_normal(self) -> bool:
        """It is."""
        return True

    def deviation(self, numbers: FloatArray) -> float:
        """Of one sample, K."""
        return float(numbers[DEVIATION]) * (float(np.hypot(1.0, self.white_share)) if self.has_memory else 1.0)

    def draw(self, numbers: FloatArray, seconds: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Noise with a memory and without."""
        first, second = numbers[DEVIATION] * rng.standard_normal((2, len(seconds)))
        if not self.has_memory:
            return np.zeros(len(seconds)), first
        return correlate(first, seconds, self.time), self.white_share * second

    def innovations(
        self, residual: FloatArray, seconds: FloatArray, numbers: FloatArray, rng: np.random.Generator
    ) -> FloatArray:
        """How far each is off what the ones before make expected, as if its gap were endless."""
        if not self.has_memory:
            return residual
        deviation = float(numbers[DEVIATION])
        return filtered(residual, seconds, deviation, self.time, self.white_share * deviation)

    def covariance(self, numbers: FloatArray, apart: FloatArray) -> FloatArray:
        """Of the noise with a memory, K^2."""
        if not self.has_memory:
            return np.zeros(apart.shape)
        return np.asarray(numbers[DEVIATION] ** 2 * np.exp(-np.abs(apart) / self.time))

    def white_variance(self, numbers: FloatArray) -> float:
        """Of the noise without, K^2."""
        return float(numbers[DEVIATION] * (self.white_share if self.has_memory else 1.0)) ** 2
