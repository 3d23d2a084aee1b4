"""Independent normal noise of telemetry that is rounded to steps."""

from __future__ import annotations

import math

import numpy as np
from scipy.stats import truncnorm

from ...compiled import inlined, kernel
from ...simulator import FloatArray
from .iid import Independent
from .kind import DEVIATION, NoiseKind

STEP = 1
"""Place of its other number, the step, K."""
_ROOT_HALF = math.sqrt(0.5)
_ROOT_2_OVER_PI = math.sqrt(2.0 / math.pi)


@kernel
def alone(call):
    """The likelihood, which is the probability of the whole step over the step's width; see `NoiseCall`."""
    valid, residual, residual_bar = call.valid, call.residual, call.residual_bar
    deviation, step = call.numbers[DEVIATION], call.numbers[STEP]
    value, deviation_bar = 0.0, 0.0
    for t in range(residual.shape[0]):
        residual_bar[t] = 0.0
        if not valid[t]:
            continue
        # By symmetry the interval may lie at positive noise, where tails are small numbers with all their digits.
        sign = 1.0 if residual[t] >= 0.0 else -1.0
        lower = (sign * residual[t] - 0.5 * step) / deviation
        upper = (sign * residual[t] + 0.5 * step) / deviation
        # Densities at both ends over the probability between them.
        if lower > 0.0:
            drop = math.exp(-0.5 * (upper - lower) * (upper + lower))
            width = _scaled_tail(lower * _ROOT_HALF) - drop * _scaled_tail(upper * _ROOT_HALF)
            value += math.log(0.5 * width) - 0.5 * lower * lower
            at_lower = _ROOT_2_OVER_PI / width
            at_upper = drop * at_lower
        else:
            width = math.erf(upper * _ROOT_HALF) - math.erf(lower * _ROOT_HALF)
            value += math.log(0.5 * width)
            at_lower = _ROOT_2_OVER_PI * math.exp(-0.5 * lower * lower) / width
            at_upper = _ROOT_2_OVER_PI * math.exp(-0.5 * upper * upper) / width
        value -= math.log(step)
        residual_bar[t] = sign * (at_upper - at_lower) / deviation
        deviation_bar += (lower * at_lower - upper * at_upper) / deviation
    call.value[0] = value
    call.numbers_bar[DEVIATION] += deviation_bar
    return 0


@inlined
def _scaled_tail(x):
    """exp(x^2) erfc(x) for x >= 0; from 5 on by its continued fraction (Abramowitz & Stegun 7.1.14)."""
    if x < 5.0:
        return math.exp(x * x) * math.erfc(x)
    fraction = x
    for k in range(16, 0, -1):
        fraction = x + 0.5 * k / fraction
    return 1.0 / (math.sqrt(math.pi) * fraction)


class Rounded(NoiseKind):
    """Normal noise, then rounding."""

    written = ("iid", "normal", True)
    words = "rounded iid noise"
    names = ("standard_deviation", "quantisation")
    kernel = alone

    def draw(self, numbers: FloatArray, seconds: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Noise with a memory and without."""
        noise = numbers[DEVIATION] * rng.standard_normal(len(seconds))
        return np.zeros(len(seconds)), noise + numbers[STEP] * (rng.random(len(seconds)) - 0.5)

    def innovations(
        self, residual: FloatArray, seconds: FloatArray, numbers: FloatArray, rng: np.random.Generator
    ) -> FloatArray:
        """The noise before rounding, drawn within the step.

        These are the randomised quantile residuals of Dunn & Smyth 1996, J. Comput. Graph. Stat. 5, 236.
        """
        found, valid = residual.copy(), np.isfinite(residual)
        scale, half = numbers[DEVIATION], 0.5 * numbers[STEP]
        low, high = (residual[valid] - half) / scale, (residual[valid] + half) / scale
        found[valid] = scale * truncnorm.rvs(low, high, random_state=rng)
        return found

    def normal_equivalent(self, numbers: FloatArray) -> tuple[NoiseKind, FloatArray]:
        """Rounding is taken for uniform noise."""
        return Independent(), np.array([np.hypot(numbers[DEVIATION], numbers[STEP] / np.sqrt(12.0))])
