"""The prior of a discrepancy's weights: spectral densities of Matern processes in time and in orbit phase."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ...compiled import kernel

SIZE, LENGTH, PHASE_SIZE, PHASE_LENGTH = range(4)
"""Places of the numbers: amplitude (K) and lengthscale (s) in time, and in orbit phase (K, orbits)."""


class MaternCall(NamedTuple):
    """The prior of a channel's m weights in a window, and what is known of them."""

    in_time: int
    """How many are of the process in time, the first."""
    counted: int
    """How many `pull_back_spectrum` counts, the first: what windows share is counted in one of them."""
    frequency: Any
    """[m] rad/s of those in time, rad per orbit of those in phase."""
    smoothness: Any
    """[2] of the process in time and in phase, as the next."""
    factor: Any
    """See `discrepancy.matern_factor`."""
    numbers: Any
    """[4]"""
    root: Any
    """[m] prior standard deviations of the weights, filled by `spectrum`, as the next."""
    slope: Any
    """[m] derivatives of the log variances by the log lengthscale."""
    weights: Any
    """[m] expected weights over their prior deviations, read by `pull_back_spectrum`, as the next."""
    shrunk: Any
    """[m] their variances over the prior ones."""
    numbers_bar: Any
    """[4], added to."""


@kernel
def spectrum(call):
    """Fill root and slope; of phase the variances are scaled so that they add up to the amplitude's square."""
    frequency, in_time, smoothness, factor = call.frequency, call.in_time, call.smoothness, call.factor
    numbers, root, slope = call.numbers, call.root, call.slope
    nu, amplitude, length = smoothness[0], numbers[SIZE], numbers[LENGTH]
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
    return 0


@kernel
def pull_back_spectrum(call):
    """The derivatives by amplitudes and lengthscales; that by a log variance is (weight^2 - 1 + shrunk) / 2."""
    in_time, weights, shrunk, slope = call.in_time, call.weights, call.shrunk, call.slope
    numbers, numbers_bar = call.numbers, call.numbers_bar
    for j in range(call.counted):
        by_log_variance = 0.5 * (weights[j] * weights[j] - 1.0 + shrunk[j])
        size, length = (SIZE, LENGTH) if j < in_time else (PHASE_SIZE, PHASE_LENGTH)
        numbers_bar[size] += 2.0 * by_log_variance / numbers[size]
        numbers_bar[length] += by_log_variance * slope[j] / numbers[length]
    return 0
