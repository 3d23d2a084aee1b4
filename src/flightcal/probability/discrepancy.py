"""What the simulator lacks, as a Gaussian process in time, in orbit phase, or both, with its weights integrated out.

In time: the functions of a Hilbert-space approximation of a Matern process (Solin & Sarkka 2020, Statistics and
Computing 30, 419; boundary and number of functions by Riutort-Mayol et al. 2023, ibid. 33, 17). In orbit phase:
harmonics, whose variances are the spectral density of a Matern process at the whole frequencies; by Poisson's summation
that is the Matern process wrapped around the orbit.
Both are a basis [T, m] with a diagonal prior of its weights, so a likelihood costs a pass over the basis and m^3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ..compiled import Row
from ..simulator import FloatArray
from .kernels.matern import MaternCall, pull_back_spectrum, spectrum

_BOUNDARY = {1.5: 4.5, 2.5: 4.1}
"""Smoothness of a Matern process -> the domain's half-width in lengthscales that its approximation needs."""
_FUNCTIONS = {1.5: 3.42, 2.5: 2.65}
"""The same -> functions for each half-width over the shortest lengthscale (both: Riutort-Mayol et al., sec. 4.2)."""
_LEAST_BOUNDARY = 1.2
_LONGEST_SHARE = 0.25
"""Of a window: the longest lengthscale in time, where a scenario does not say; slower errors look like parameters."""


@dataclass(frozen=True)
class TimeBasis:
    """Functions of time: sqrt(1/L) sin(w_j (t - centre + L)) on [centre - L, centre + L], with w_j = pi j / 2 L."""

    centre: float
    """s."""
    half_width: float
    """L, s."""
    count: int

    @property
    def frequencies(self) -> FloatArray:
        """[m] rad/s."""
        return np.asarray(0.5 * np.pi * np.arange(1, self.count + 1) / self.half_width)

    def at(self, seconds: FloatArray, derivative: int = 0) -> FloatArray:
        """The functions [T, m] at `seconds` [T], or their derivatives of an order by time."""
        angle = np.outer(seconds - self.centre + self.half_width, self.frequencies)
        wave: FloatArray = self.frequencies**derivative * np.sin(angle + 0.5 * np.pi * derivative)
        return np.asarray(wave / math.sqrt(self.half_width))


@dataclass(frozen=True)
class PhaseBasis:
    """Functions of orbit phase: a constant, and cosine and sine of each harmonic."""

    harmonics: int

    @property
    def frequencies(self) -> FloatArray:
        """[m] rad per orbit."""
        order = np.arange(1, self.harmonics + 1)
        return 2.0 * np.pi * np.concatenate([[0], order, order])

    def at(self, phase: FloatArray) -> FloatArray:
        """The functions [T, m] at phases [T], in orbits."""
        angle = 2.0 * np.pi * np.outer(phase, np.arange(1, self.harmonics + 1))
        return np.concatenate([np.ones((len(phase), 1)), np.cos(angle), np.sin(angle)], axis=1)


def time_basis(first: float, last: float, longest: float, smoothness: float, count: int) -> TimeBasis:
    """The basis for samples from `first` to `last` (s) and lengthscales of up to `longest` (s)."""
    half = 0.5 * (last - first)
    factor = max(_LEAST_BOUNDARY, _BOUNDARY[smoothness] * longest / half)
    return TimeBasis(0.5 * (first + last), factor * half, count)


def shortest_lengthscale(basis: TimeBasis, smoothness: float) -> float:
    """The shortest lengthscale (s) that the basis has functions enough for."""
    return _FUNCTIONS[smoothness] * basis.half_width / basis.count


def functions_for(basis: TimeBasis, smoothness: float, shortest: float) -> int:
    """How many functions a lengthscale (s) needs on the basis's domain."""
    return math.ceil(_FUNCTIONS[smoothness] * basis.half_width / shortest - 1e-9)


def longest_lengthscale(first: float, last: float) -> float:
    """The longest lengthscale (s) where a scenario does not say."""
    return _LONGEST_SHARE * (last - first)


def matern_factor(smoothness: float) -> float:
    """c in the spectral density c amplitude^2 l^(-2 nu) (2 nu / l^2 + w^2)^(-nu - 1/2) of a Matern process.

    Rasmussen & Williams (2006), eq. 4.15 in one dimension, with angular frequency.
    """
    return (
        2.0 * math.sqrt(math.pi) * math.gamma(smoothness + 0.5) * (2.0 * smoothness) ** smoothness
        / math.gamma(smoothness)
    )  # fmt: skip


@dataclass(frozen=True)
class MaternPrior:
    """The prior of the weights of both: independent normal ones, by the processes' spectral densities."""

    in_time: int
    """How many are of the process in time, the first."""
    frequency: FloatArray
    """[m] rad/s of those in time, rad per orbit of those in phase."""
    smoothness: FloatArray
    """[2] of the process in time and in phase."""

    def deviations(self, numbers: FloatArray) -> FloatArray:
        """Standard deviations [m] of the weights; numbers: [4] amplitudes and lengthscales, see `kernels.matern`."""
        root, *others = np.zeros((4, len(self.frequency)))
        fills, _ = self.rows(numbers, np.empty(4), root, *others, counted=0)
        fills()
        return root

    def first(self, count: int) -> MaternPrior:
        """That of the first weights alone."""
        return replace(self, in_time=min(self.in_time, count), frequency=self.frequency[:count])

    def rows(
        self,
        numbers: FloatArray,
        numbers_bar: FloatArray,
        root: FloatArray,
        slope: FloatArray,
        weights: FloatArray,
        shrunk: FloatArray,
        *,
        counted: int,
    ) -> tuple[Row, Row]:
        """What fills the weights' prior, and what takes their posterior to the derivatives; see `MaternCall`."""
        factor = np.array([matern_factor(nu) for nu in self.smoothness])
        call = MaternCall(
            self.in_time, counted, self.frequency, self.smoothness, factor, numbers, root, slope, weights, shrunk,
            numbers_bar,
        )  # fmt: skip
        return spectrum.row(call), pull_back_spectrum.row(call)
