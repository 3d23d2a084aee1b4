"""Student's t noise, for outliers: independent, or of the innovations of an Ornstein-Uhlenbeck process."""

from __future__ import annotations

import math

import numpy as np

from ...compiled import inlined, kernel
from ...simulator import FloatArray
from .ar1 import TIME, Correlated
from .iid import Independent
from .kind import DEVIATION, NoiseKind
from .process import correlate

DEGREES = 1
"""Place of its second number, the degrees of freedom; the third is that of correlated normal noise, `TIME`, or zero."""


@kernel
def alone(call):
    """The likelihood, where there is a correlation time that of the innovations; see `NoiseCall`."""
    seconds, valid, residual, residual_bar = call.seconds, call.valid, call.residual, call.residual_bar
    scale, degrees, time = call.numbers[DEVIATION], call.numbers[DEGREES], call.numbers[TIME]
    constant = math.lgamma(0.5 * (degrees + 1.0)) - math.lgamma(0.5 * degrees) - 0.5 * math.log(math.pi * degrees)
    constant_bar = 0.5 * _digamma(0.5 * (degrees + 1.0)) - 0.5 * _digamma(0.5 * degrees) - 0.5 / degrees
    value, before = 0.0, -1
    scale_bar, time_bar, degrees_bar = 0.0, 0.0, 0.0
    for t in range(residual.shape[0]):
        residual_bar[t] = 0.0
        if not valid[t]:
            continue
        decay, rest, gap, last = 0.0, 1.0, 0.0, 0.0
        if time > 0.0 and before >= 0:
            gap, last = seconds[t] - seconds[before], residual[before]
            decay = math.exp(-gap / time)
            rest = math.sqrt(-math.expm1(-2.0 * gap / time))
        spread = scale * rest
        scaled = (residual[t] - decay * last) / spread
        square = scaled * scaled
        value += constant - math.log(spread) - 0.5 * (degrees + 1.0) * math.log1p(square / degrees)
        slope = -(degrees + 1.0) * scaled / (degrees + square)
        residual_bar[t] += slope / spread
        spread_bar = -(1.0 + scaled * slope) / spread
        scale_bar += spread_bar * rest
        degrees_bar += constant_bar - 0.5 * math.log1p(square / degrees) - 0.5 * slope * scaled / degrees
        if decay > 0.0:
            residual_bar[before] -= decay * slope / spread
            decay_bar = -slope / spread * last - spread_bar * scale * decay / rest
            time_bar += decay_bar * decay * gap / (time * time)
        before = t
    call.value[0] = value
    call.numbers_bar[DEVIATION] += scale_bar
    call.numbers_bar[DEGREES] += degrees_bar
    call.numbers_bar[TIME] += time_bar
    return 0


@inlined
def _digamma(x):
    """Derivative of log gamma for x > 0: recurrence to 6, then the asymptotic series (Abramowitz & Stegun 6.3.18)."""
    total = 0.0
    while x < 6.0:
        total -= 1.0 / x
        x += 1.0
    r = 1.0 / (x * x)
    series = r * (1 / 12 - r * (1 / 120 - r * (1 / 252 - r * (1 / 240 - r * (1 / 132 - r * (691 / 32760 - r / 12))))))
    return total + math.log(x) - 0.5 / x - series


class Student(NoiseKind):
    """Independent Student's t noise."""

    written = ("iid", "student_t", False)
    words = "independent Student-t noise"
    names = ("standard_deviation", "degrees_of_freedom")
    kernel = alone

    def draw(self, numbers: FloatArray, seconds: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Noise with a memory and without."""
        return np.zeros(len(seconds)), _drawn(numbers, len(seconds), rng)

    def normal_equivalent(self, numbers: FloatArray) -> tuple[NoiseKind, FloatArray]:
        """Of (nu + 1) / (nu + 3) of a normal's information (Lange et al. 1989, J. Am. Stat. Assoc. 84, 881)."""
        return Independent(), np.array([_normal_deviation(numbers)])


class CorrelatedStudent(NoiseKind):
    """An Ornstein-Uhlenbeck process with Student's t innovations."""

    written = ("ar1", "student_t", False)
    words = "AR(1) noise with Student-t innovations"
    names = ("standard_deviation", "degrees_of_freedom", "correlation_time")
    has_memory = True
    kernel = alone

    def draw(self, numbers: FloatArray, seconds: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Noise with a memory and without."""
        return correlate(_drawn(numbers, len(seconds), rng), seconds, numbers[TIME]), np.zeros(len(seconds))

    def normal_equivalent(self, numbers: FloatArray) -> tuple[NoiseKind, FloatArray]:
        """As of the independent one."""
        return Correlated(), np.array([_normal_deviation(numbers), 0.0, numbers[TIME]])


def _drawn(numbers: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
    return np.asarray(numbers[DEVIATION] * rng.standard_t(numbers[DEGREES], count))


def _normal_deviation(numbers: FloatArray) -> float:
    """Of a normal with the same information, K."""
    return float(numbers[DEVIATION] * np.sqrt((numbers[DEGREES] + 3.0) / (numbers[DEGREES] + 1.0)))
