"""Normal noise whose shape is known, and its size alone is not: correlation time, and what share of it is white."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...simulator import FloatArray
from .ar1 import Correlated
from .iid import Independent
from .kind import DEVIATION, NoiseKind
from .process import correlate


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
    has_known_shape = True

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

    def time_of(self, numbers: FloatArray) -> float:
        """Correlation time, s."""
        return self.time

    def draw(self, numbers: FloatArray, seconds: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Noise with a memory and without."""
        first, second = numbers[DEVIATION] * rng.standard_normal((2, len(seconds)))
        if not self.has_memory:
            return np.zeros(len(seconds)), first
        return correlate(first, seconds, self.time), self.white_share * second

    def white_variance(self, numbers: FloatArray) -> float:
        """Of the noise without, K^2."""
        return float(numbers[DEVIATION] * (self.white_share if self.has_memory else 1.0)) ** 2


def shape_of(kind: NoiseKind, numbers: FloatArray) -> Shaped:
    """The shape of a kind's normal noise at its numbers [n or more]."""
    if not kind.has_memory:
        return Shaped(0.0, 1.0)
    known = dict(zip(kind.names, numbers.tolist(), strict=False))
    return Shaped(known["correlation_time"], known[kind.white] / known["standard_deviation"] if kind.white else 0.0)
