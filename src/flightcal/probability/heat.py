"""Heat that no block of the scenario describes: a pattern in orbit phase, gains, and what drifts slowly around these.

A latent force model (Alvarez, Luengo & Lawrence 2009, AISTATS; Hartikainen & Sarkka 2011, UAI): the heat is a sum of
known functions of time with normal weights, to which temperatures respond nearly linearly; so the weights are
integrated out (`weighing`). Here are the functions.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..simulator import FloatArray, IntArray
from .kernels.heat import LOG_MOST_GROWTH

_FALL = 3.0
"""Harmonic from which on prior deviations fall."""


def waves(phase: FloatArray, harmonics: int) -> FloatArray:
    """A constant, and cosine and sine of each harmonic of phases [T], in orbits: [1 + 2 harmonics, T]."""
    angle = 2.0 * np.pi * np.outer(np.arange(1, harmonics + 1), phase)
    both = np.stack([np.cos(angle), np.sin(angle)], axis=1).reshape(-1, len(phase))
    return np.concatenate([np.ones((1, len(phase))), both])


def pattern(phase: FloatArray, harmonics: int) -> FloatArray:
    """The same times their prior deviations, which fall as 1 / sqrt(1 + (k/3)^2)."""
    order = np.concatenate([[0], np.repeat(np.arange(1, harmonics + 1), 2)])
    return np.asarray(waves(phase, harmonics) / np.sqrt(1.0 + (order / _FALL) ** 2)[:, None])


@dataclass(frozen=True)
class Profile:
    """Heat as a smooth function of a driver: a Matern process (smoothness 3/2) at knots, linear in between.

    Where training had no samples it goes back to its prior, within a correlation length.
    """

    knots: FloatArray
    """[Q] of the driver, over its range and beyond, in its SI unit."""
    length: float
    """Of correlation, in the same."""
    range: tuple[float, float]
    """That the driver has."""

    @cached_property
    def root(self) -> FloatArray:
        """[Q, Q] values at the knots for a weight of one: Cholesky factor of their covariance."""
        apart = np.sqrt(3.0) * np.abs(np.subtract.outer(self.knots, self.knots)) / self.length
        return cholesky((1.0 + apart) * np.exp(-apart))

    def at(self, values: FloatArray) -> FloatArray:
        """What each of the weights does, [Q, T], at values of the driver [T]."""
        return np.asarray(self.root.T @ hats(values, self.knots))


def hats(seconds: FloatArray, knots: FloatArray) -> FloatArray:
    """Functions [Q, T] that are one at a knot (s), zero at the others, and linear in between; constant beyond."""
    return np.stack([np.interp(seconds, knots, unit) for unit in np.eye(len(knots))])


def fading(first: FloatArray, second: FloatArray, time: float) -> FloatArray:
    """Covariance of an Ornstein-Uhlenbeck process of variance one between times (s): [len(first), len(second)]."""
    return np.asarray(np.exp(-np.abs(np.subtract.outer(first, second)) / time))


def cholesky(covariance: FloatArray) -> FloatArray:
    """Its factor, though rounding may have left it no longer positive."""
    return np.asarray(np.linalg.cholesky(covariance + 1e-9 * np.eye(len(covariance))), float)


@dataclass(frozen=True)
class Sizes:
    """Of noise and heat, where these are known."""

    deviations: FloatArray
    """[N] K, of each channel's noise."""
    roots: FloatArray
    """[m] prior deviations of the weights."""


@dataclass(frozen=True)
class Follows:
    """How the response to each of m weights grows as c entries of theta move: by exp(slope (x - at)).

    The same heat does more in a smaller capacity. x: the entry, or its logarithm.
    """

    names: tuple[str, ...]
    """[c] entries of theta."""
    logarithmic: NDArray[np.bool_]
    """[c] whether x is the logarithm."""
    at: FloatArray
    """[c] x where the response was looked at."""
    slope: FloatArray
    """[m, c]"""
    centre: FloatArray
    """[m] weights whose heat the window's simulations already have."""

    def growth(self, entries: FloatArray) -> FloatArray:
        """Of the responses [S, m] at entries [S, c]; at most `LOG_MOST_GROWTH` in its logarithm."""
        x = np.where(self.logarithmic, np.log(np.where(self.logarithmic, entries, 1.0)), entries)
        return np.asarray(np.exp(np.clip((x - self.at) @ self.slope.T, -LOG_MOST_GROWTH, LOG_MOST_GROWTH)))


@dataclass(frozen=True)
class WindowHeat:
    """What m weights of heat do to a window's temperatures, around the point where that was looked at."""

    response: FloatArray
    """[T, N, m] K for a weight of one."""
    group: IntArray
    """[m] whose scale each weight has, of `scales`."""
    scales: tuple[str, ...]
    """[g] the prior deviations' names in theta; "": it is one."""
    centre: FloatArray
    """[T, N] K: the response to the weights whose heat the window's simulations already have."""
    sizes: Sizes | None = None
    """None: they are entries of theta."""
    follows: Follows | None = None
    """How the response depends on theta; None: it is the same everywhere."""

    @property
    def entries(self) -> tuple[str, ...]:
        """[g + c] of theta, of scales and of what the response follows, that the likelihood reads; "": none."""
        return (*self.scales, *(() if self.follows is None else self.follows.names))


@dataclass(frozen=True)
class Slow:
    """Heat that drifts: an Ornstein-Uhlenbeck process at knots, linear in between."""

    knots: FloatArray
    """[Q] s."""
    time: float
    """s, of correlation."""
    plain: bool = False
    """Weights are the values at the knots, instead of N(0, 1)."""

    @cached_property
    def root(self) -> FloatArray:
        """[Q, Q] values at the knots for a weight of one: Cholesky factor of their covariance."""
        if self.plain:
            return np.eye(len(self.knots))
        return cholesky(fading(self.knots, self.knots, self.time))

    def at(self, seconds: FloatArray) -> FloatArray:
        """What each of the weights does, [Q, T], at times (s)."""
        return np.asarray(self.root.T @ hats(seconds, self.knots))

    def beyond(self, knots: FloatArray) -> tuple[FloatArray, FloatArray]:
        """At other knots [R]: the values expected for a weight of one [R, Q], and a factor of what is not [R, R]."""
        across, rest = fading(knots, self.knots, self.time), fading(knots, knots, self.time)
        expected: FloatArray = np.asarray(np.linalg.solve(self.root, across.T).T, float)
        return expected, cholesky(rest - expected @ expected.T)
