"""What the simulator lacks, as a Gaussian process in time, in orbit phase, or both, with its weights integrated out.

In time: the functions of a Hilbert-space approximation of a Matern process (Solin & Sarkka 2020, Statistics and
Computing 30, 419; boundary and number of functions by Riutort-Mayol et al. 2023, ibid. 33, 17). In orbit phase:
harmonics, whose variances are the spectral density of a Matern process at the whole frequencies; by Poisson's summation
that is the Matern process wrapped around the orbit.
Both are a basis [T, m] with a diagonal prior of its weights, so a likelihood costs a pass over the basis and m^3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..compiled import inlined
from ..simulator.system import FloatArray
from .noise import PHASE_LENGTH, PHASE_SIZE, TIME_LENGTH, TIME_SIZE

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


# --- compiled -----------------------------------------------------------------------------------------------


@inlined
def spectrum(frequency, in_time, smoothness, factor, numbers, root, slope):
    """Prior standard deviations of the weights [m], and the derivative of the log variances by the log lengthscale.

    frequency: [m] rad/s in time, in_time of them first; then rad per orbit. smoothness, factor: [2], of the process in
    time and in phase, and `matern_factor`. Of phase the variances are scaled so that they add up to the
    amplitude's square everywhere.
    """
    nu, amplitude, length = smoothness[0], numbers[TIME_SIZE], numbers[TIME_LENGTH]
    for j in range(in_time):
        flat = 2.0 * nu / (length * length)
        density = factor[0] * math.exp(-2.0 * nu * math.log(length) - (nu + 0.5) * math.log(flat + frequency[j] ** 2))
        root[j] = amplitude * math.sqrt(density)
        slope[j] = (2.0 * nu + 1.0) * flat / (flat + frequency[j] ** 2) - 2.0 * nu
    nu, amplitude, length = smoothness[1], numbers[PHASE_SIZE], numbers[PHASE_LENGTH]
    total, mean = 0.0, 0.0
    for j in range(in_time, frequency.shape[0]):
        flat = 2.0 * nu / (length * length)
        # A harmonic's share is that of its frequency and of its negative; cosine and sine have it both.
        density = math.exp(-(nu + 0.5) * math.log1p(frequency[j] ** 2 / flat)) * (1.0 if frequency[j] == 0.0 else 2.0)
        slope[j] = (2.0 * nu + 1.0) * flat / (flat + frequency[j] ** 2)
        root[j] = density
        share = density if frequency[j] == 0.0 else 0.5 * density
        total += share
        mean += share * slope[j]
    for j in range(in_time, frequency.shape[0]):
        root[j] = amplitude * math.sqrt(root[j] / total)
        slope[j] -= mean / total


@inlined
def factorise(gram, scale, root, projected, upper, inverse, scratch, weights):
    """Cholesky factor of 1 + scale root gram root, its inverse, and the weights' mean over `root`.

    gram: [m, m] products of the basis; projected: [m] of the basis with the residuals; scale: of both.
    Fills inverse [m, m], a lower triangle X with X^T X the inverse of what is factorised, and weights [m]: the expected
    weights given the residuals are root x weights, their covariance is root X^T X root.
    Returns the log determinant, and by how much the residuals' square is explained.
    """
    m = root.shape[0]
    for i in range(m):
        left = scale * root[i]
        for j in range(i, m):
            upper[i, j] = left * gram[i, j] * root[j]
        upper[i, i] += 1.0
    log_determinant = 0.0
    for i in range(m):
        # In rows of their own while they are worked on, four others at a time: so a compiler can take entries together.
        for j in range(m):
            scratch[j] = upper[i, j]
            weights[j] = 0.0
        weights[i] = 1.0
        whole = i // 4 * 4
        for k in range(0, whole, 4):
            first, second, third, fourth = upper[k, i], upper[k + 1, i], upper[k + 2, i], upper[k + 3, i]
            for j in range(i, m):
                scratch[j] -= (
                    first * upper[k, j] + second * upper[k + 1, j] + third * upper[k + 2, j] + fourth * upper[k + 3, j]
                )
            for j in range(k + 4):
                weights[j] -= (
                    first * inverse[k, j]
                    + second * inverse[k + 1, j]
                    + third * inverse[k + 2, j]
                    + fourth * inverse[k + 3, j]
                )
        for k in range(whole, i):
            above = upper[k, i]
            for j in range(i, m):
                scratch[j] -= above * upper[k, j]
            for j in range(k + 1):
                weights[j] -= above * inverse[k, j]
        pivot = 1.0 / math.sqrt(scratch[i])
        log_determinant -= 2.0 * math.log(pivot)
        for j in range(i, m):
            upper[i, j] = scratch[j] * pivot
        for j in range(m):
            inverse[i, j] = weights[j] * pivot  # zero above the diagonal
    explained = 0.0
    for j in range(m):
        weights[j] = 0.0
    for i in range(m):
        total = 0.0
        for j in range(i + 1):
            total += inverse[i, j] * (scale * root[j] * projected[j])
        explained += total * total
        for j in range(i + 1):
            weights[j] += inverse[i, j] * total
    # Diagonal of the inverse of what was factorised.
    for j in range(m):
        scratch[j] = 0.0
    for i in range(m):
        for j in range(i + 1):
            scratch[j] += inverse[i, j] * inverse[i, j]
    return log_determinant, explained


@inlined
def pull_back_spectrum(in_time, weights, shrunk, slope, numbers, numbers_bar):
    """Add the derivatives of the log density by amplitudes and lengthscales to numbers_bar [9].

    weights: [m] as `factorise` gives them; shrunk: [m] the diagonal of the inverse. The derivative by a log variance is
    (weight^2 - 1 + shrunk) / 2.
    """
    for j in range(weights.shape[0]):
        by_log_variance = 0.5 * (weights[j] * weights[j] - 1.0 + shrunk[j])
        size, length = (TIME_SIZE, TIME_LENGTH) if j < in_time else (PHASE_SIZE, PHASE_LENGTH)
        numbers_bar[size] += 2.0 * by_log_variance / numbers[size]
        numbers_bar[length] += by_log_variance * slope[j] / numbers[length]


@inlined
def project(basis, start, end, residual, projected):
    """Add to projected [m] the samples from start to end of the basis [T, m] transposed times residuals [T]."""
    m = basis.shape[1]
    whole = start + (end - start) // 4 * 4
    for t in range(start, whole, 4):
        first, second, third, fourth = residual[t], residual[t + 1], residual[t + 2], residual[t + 3]
        for j in range(m):
            projected[j] += (
                basis[t, j] * first + basis[t + 1, j] * second + basis[t + 2, j] * third + basis[t + 3, j] * fourth
            )
    for t in range(whole, end):
        for j in range(m):
            projected[j] += basis[t, j] * residual[t]


@inlined
def combine(transposed, weights, combined):
    """Basis, as [m, T], times weights [m] -> [T]."""
    m, samples = transposed.shape
    for t in range(samples):
        combined[t] = 0.0
    whole = m // 4 * 4
    for j in range(0, whole, 4):
        first, second, third, fourth = weights[j], weights[j + 1], weights[j + 2], weights[j + 3]
        for t in range(samples):
            combined[t] += (
                transposed[j, t] * first
                + transposed[j + 1, t] * second
                + transposed[j + 2, t] * third
                + transposed[j + 3, t] * fourth
            )
    for j in range(whole, m):
        for t in range(samples):
            combined[t] += transposed[j, t] * weights[j]
