"""The prior of a discrepancy's weights: the spectral density of a Matern process in orbit phase."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ...compiled import kernel

SIZE, LENGTH = range(2)
"""Places of the numbers: amplitude, K, and lengthscale, orbits."""


class MaternCall(NamedTuple):
    """The prior of a channel's m weights in a window, and what is known of them."""

    counted: int
    """How many `pull_back_spectrum` counts, the first: what windows share is counted in one of them."""
    frequency: Any
    """[m] rad per orbit."""
    smoothness: float
    numbers: Any
    """[2]"""
    root: Any
    """[m] prior standard deviations of the weights, filled by `spectrum`, as the next."""
    slope: Any
    """[m] derivatives of the log variances by the log lengthscale."""
    weights: Any
    """[m] expected weights over their prior deviations, read by `pull_back_spectrum`, as the next."""
    shrunk: Any
    """[m] their variances over the prior ones."""
    numbers_bar: Any
    """[2], added to."""


@kernel
def spectrum(call):
    """Fill root and slope; the variances are scaled so that they add up to the amplitude's square."""
    frequency, nu, root, slope = call.frequency, call.smoothness, call.root, call.slope
    amplitude, length = call.numbers[SIZE], call.numbers[LENGTH]
    flat = 2.0 * nu / (length * length)
    total, mean = 0.0, 0.0
    for j in range(frequency.shape[0]):
        # A harmonic's share is that of its frequency and of its negative; cosine and sine have it both.
        density = math.exp(-(nu + 0.5) * math.log1p(frequency[j] ** 2 / flat)) * (1.0 if frequency[j] == 0.0 else 2.0)
        slope[j] = (2.0 * nu + 1.0) * flat / (flat + frequency[j] ** 2)
        root[j] = density
        share = density if frequency[j] == 0.0 else 0.5 * density
        total += share
        mean += share * slope[j]
    for j in range(frequency.shape[0]):
        root[j] = amplitude * math.sqrt(root[j] / total)
        slope[j] -= mean / total
    return 0


@kernel
def pull_back_spectrum(call):
    """The derivatives by amplitude and lengthscale; that by a log variance is (weight^2 - 1 + shrunk) / 2."""
    weights, shrunk, slope, numbers, numbers_bar = call.weights, call.shrunk, call.slope, call.numbers, call.numbers_bar
    for j in range(call.counted):
        by_log_variance = 0.5 * (weights[j] * weights[j] - 1.0 + shrunk[j])
        numbers_bar[SIZE] += 2.0 * by_log_variance / numbers[SIZE]
        numbers_bar[LENGTH] += by_log_variance * slope[j] / numbers[LENGTH]
    return 0
