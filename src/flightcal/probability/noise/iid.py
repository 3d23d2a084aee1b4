"""Independent normal noise, as in the published likelihood: y ~ N(y(theta), sigma^2)."""

from __future__ import annotations

import math

import numpy as np

from ...compiled import kernel
from ...simulator import FloatArray
from .kind import DEVIATION, NoiseKind

_LOG_ROOT_2_PI = 0.5 * math.log(2.0 * math.pi)


@kernel
def alone(call):
    """The likelihood; see `NoiseCall`."""
    valid, residual, residual_bar = call.valid, call.residual, call.residual_bar
    deviation = call.numbers[DEVIATION]
    precision = 1.0 / deviation
    squares, samples = 0.0, 0
    for t in range(residual.shape[0]):
        scaled = residual[t] * precision
        if valid[t]:
            squares += scaled * scaled
            samples += 1
            residual_bar[t] = -scaled * precision
        else:
            residual_bar[t] = 0.0
    call.numbers_bar[DEVIATION] += (squares - samples) * precision
    call.value[0] = -0.5 * squares - samples * (math.log(deviation) + _LOG_ROOT_2_PI)
    return 0


@kernel
def opens(call):
    """What is known of the shapes' weights; see `ShapesCall`. Their products stay as they are."""
    valid, residual, moment, projected = call.noise.valid, call.noise.residual, call.moment, call.projected
    deviation = call.noise.numbers[DEVIATION]
    precision = 1.0 / (deviation * deviation)
    squares, samples = 0.0, 0
    for t in range(residual.shape[0]):
        squares += residual[t] * residual[t]
        samples += 1 if valid[t] else 0
    for j in range(moment.shape[0]):
        moment[j] = projected[j]
    known = call.known
    call.scale[0] = precision
    known[0], known[1], known[2] = 2.0 * samples * math.log(deviation), squares * precision, samples
    return 0


@kernel
def returns(call):
    """The derivatives; see `ShapesCall`."""
    valid, residual, residual_bar = call.noise.valid, call.noise.residual, call.noise.residual_bar
    mean, transposed = call.mean, call.transposed
    m, samples = transposed.shape
    deviation = call.noise.numbers[DEVIATION]
    precision = 1.0 / (deviation * deviation)
    # What the shapes are expected to be, four at a time: so a compiler can take samples together.
    for t in range(samples):
        residual_bar[t] = 0.0
    whole = m // 4 * 4
    for j in range(0, whole, 4):
        first, second, third, fourth = mean[j], mean[j + 1], mean[j + 2], mean[j + 3]
        for t in range(samples):
            residual_bar[t] += (
                transposed[j, t] * first
                + transposed[j + 1, t] * second
                + transposed[j + 2, t] * third
                + transposed[j + 3, t] * fourth
            )
    for j in range(whole, m):
        for t in range(samples):
            residual_bar[t] += transposed[j, t] * mean[j]
    left = 0.0
    for t in range(samples):
        scaled = (residual[t] - residual_bar[t]) * precision if valid[t] else 0.0
        residual_bar[t] = -scaled
        left += scaled * scaled
    numbers_bar = call.noise.numbers_bar
    numbers_bar[DEVIATION] -= call.untold[0] / deviation
    numbers_bar[DEVIATION] += deviation * left
    return 0


@kernel(long=True)
def whitens(call):
    """Columns in deviations; see `WhitenCall`."""
    valid, columns, white = call.valid, call.columns, call.white
    precision, samples = 1.0 / call.numbers[DEVIATION], 0
    for t in range(columns.shape[0]):
        samples += 1 if valid[t] else 0
        for c in range(columns.shape[1]):
            white[t, c] = columns[t, c] * precision if valid[t] else 0.0
    call.determinant[0] = 2.0 * samples * math.log(call.numbers[DEVIATION])
    return 0


@kernel(long=True)
def pulls(call):
    """The derivative by the deviation; see `WhitenCall`."""
    valid, white, white_bar = call.valid, call.white, call.white_bar
    total = 0.0
    for t in range(white.shape[0]):
        total += 1.0 if valid[t] else 0.0
        for c in range(white.shape[1]):
            total += white[t, c] * white_bar[t, c]
    call.numbers_bar[DEVIATION] -= total / call.numbers[DEVIATION]
    return 0


class Independent(NoiseKind):
    """Independent normal noise."""

    written = ("iid", "normal", False)
    words = "iid noise"
    names = ("standard_deviation",)
    kernel, opens, returns, projects = alone, opens, returns, True
    whitens, pulls = whitens, pulls

    @property
    def in_full(self) -> str:
        """What it is called where there is room."""
        return "independent, identically distributed (iid) noise"

    def draw(self, numbers: FloatArray, seconds: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Noise with a memory and without."""
        return np.zeros(len(seconds)), numbers[DEVIATION] * rng.standard_normal(len(seconds))
