"""Correlated normal noise: an Ornstein-Uhlenbeck process, which on even times is AR(1), with white noise or without.

Its correlation over a gap is exp(-gap / time), on the real times of the samples.
"""

from __future__ import annotations

import math

import numpy as np

from ...compiled import inlined, kernel
from ...simulator import FloatArray
from .kind import DEVIATION, NoiseKind
from .process import correlate

WHITE, TIME = 1, 2
"""Places of its other numbers: the standard deviation of the white noise, K; correlation time, s."""
_LOG_ROOT_2_PI = 0.5 * math.log(2.0 * math.pi)


@kernel
def alone(call):
    """The likelihood; see `NoiseCall`."""
    seconds, valid, residual, numbers = call.seconds, call.valid, call.residual, call.numbers
    residual_bar, rows, columns = call.residual_bar, call.rows, call.columns
    decay, gain, root = rows[0], rows[1], rows[2]
    column, whitened, whitened_bar, column_bar = columns[0], columns[1], columns[2], columns[3]
    log_determinant = filter_gains(seconds, valid, numbers, decay, gain, root)
    for t in range(residual.shape[0]):
        column[t, 0] = residual[t]
    whiten(valid, decay, gain, root, column, whitened, call.value)
    squares, samples = 0.0, 0
    for t in range(residual.shape[0]):
        squares += whitened[t, 0] * whitened[t, 0]
        samples += 1 if valid[t] else 0
        whitened_bar[t, 0] = -whitened[t, 0]
    pull_back_filter(
        seconds, valid, numbers, decay, gain, root,
        column, whitened, whitened_bar, column_bar, call.value, call.numbers_bar,
    )  # fmt: skip
    for t in range(residual.shape[0]):
        residual_bar[t] = column_bar[t, 0] if valid[t] else 0.0
    call.value[0] = -0.5 * (squares + log_determinant) - samples * _LOG_ROOT_2_PI
    return 0


@kernel
def opens(call):
    """What is known of the shapes' weights; see `ShapesCall`. The basis is whitened beside the residuals."""
    noise, basis, gram, moment = call.noise, call.basis, call.gram, call.moment
    valid, residual, rows = noise.valid, noise.residual, noise.rows
    columns, whitened = noise.columns[0], noise.columns[1]
    m = basis.shape[1]
    decay, gain, root = rows[0], rows[1], rows[2]
    log_determinant = filter_gains(noise.seconds, valid, noise.numbers, decay, gain, root)
    for t in range(columns.shape[0]):
        for j in range(m):
            columns[t, j] = basis[t, j]
        columns[t, m] = residual[t]
    whiten(valid, decay, gain, root, columns, whitened, call.state)
    for i in range(m):
        moment[i] = 0.0
        for j in range(i, m):
            gram[i, j] = 0.0
    count, samples = columns.shape[0], 0
    for t in range(count):
        samples += 1 if valid[t] else 0
    # Four samples at a time, for what is added to is larger than a cache; those that are not valid are zero.
    whole = count // 4 * 4
    for t in range(0, whole, 4):
        for i in range(m):
            first, second, third, fourth = whitened[t, i], whitened[t + 1, i], whitened[t + 2, i], whitened[t + 3, i]
            for j in range(i, m):
                gram[i, j] += (
                    first * whitened[t, j]
                    + second * whitened[t + 1, j]
                    + third * whitened[t + 2, j]
                    + fourth * whitened[t + 3, j]
                )
    for t in range(whole, count):
        for i in range(m):
            left = whitened[t, i]
            for j in range(i, m):
                gram[i, j] += left * whitened[t, j]
    squares = 0.0
    for t in range(count):
        last = whitened[t, m]
        squares += last * last
        for i in range(m):
            moment[i] += whitened[t, i] * last
    known = call.known
    call.scale[0] = 1.0
    known[0], known[1], known[2] = log_determinant, squares, samples
    return 0


@kernel
def returns(call):
    """The derivatives; see `ShapesCall`."""
    noise, covariance, inverse, prior, mean = call.noise, call.covariance, call.inverse, call.root, call.mean
    valid, residual_bar, rows, columns = noise.valid, noise.residual_bar, noise.rows, noise.columns
    whitened, whitened_bar, columns_bar = columns[1], columns[2], columns[3]
    m = prior.shape[0]
    for i in range(m):
        for j in range(m):
            covariance[i, j] = 0.0
    # Four at a time; see `opens`. The inverse is a lower triangle, with zeros above.
    whole = m // 4 * 4
    for k in range(0, whole, 4):
        for i in range(k + 4):
            first, second, third, fourth = inverse[k, i], inverse[k + 1, i], inverse[k + 2, i], inverse[k + 3, i]
            for j in range(k + 4):
                covariance[i, j] += (
                    first * inverse[k, j]
                    + second * inverse[k + 1, j]
                    + third * inverse[k + 2, j]
                    + fourth * inverse[k + 3, j]
                )
    for k in range(whole, m):
        for i in range(k + 1):
            left = inverse[k, i]
            for j in range(k + 1):
                covariance[i, j] += left * inverse[k, j]
    for i in range(m):
        for j in range(m):
            covariance[i, j] *= prior[i] * prior[j]
    for t in range(whitened.shape[0]):
        left = whitened[t, m]
        for j in range(m):
            left -= whitened[t, j] * mean[j]
        for j in range(m):
            whitened_bar[t, j] = left * mean[j]
        whitened_bar[t, m] = -left
    whole = whitened.shape[0] // 4 * 4
    for t in range(0, whole, 4):
        for i in range(m):
            first, second, third, fourth = whitened[t, i], whitened[t + 1, i], whitened[t + 2, i], whitened[t + 3, i]
            for j in range(m):
                told = covariance[i, j]
                whitened_bar[t, j] -= first * told
                whitened_bar[t + 1, j] -= second * told
                whitened_bar[t + 2, j] -= third * told
                whitened_bar[t + 3, j] -= fourth * told
    for t in range(whole, whitened.shape[0]):
        for i in range(m):
            one = whitened[t, i]
            for j in range(m):
                whitened_bar[t, j] -= one * covariance[i, j]
    pull_back_filter(
        noise.seconds, valid, noise.numbers, rows[0], rows[1], rows[2],
        columns[0], whitened, whitened_bar, columns_bar, call.state, noise.numbers_bar,
    )  # fmt: skip
    for t in range(whitened.shape[0]):
        residual_bar[t] = columns_bar[t, m] if valid[t] else 0.0
    return 0


@kernel(long=True)
def whitens(call):
    """Columns whitened; see `WhitenCall`."""
    decay, gain, root = call.rows[0], call.rows[1], call.rows[2]
    call.determinant[0] = filter_gains(call.seconds, call.valid, call.numbers, decay, gain, root)
    whiten(call.valid, decay, gain, root, call.columns, call.white, call.state)
    return 0


@kernel(long=True)
def pulls(call):
    """The derivatives by the numbers; see `WhitenCall`."""
    pull_back_filter(
        call.seconds, call.valid, call.numbers, call.rows[0], call.rows[1], call.rows[2],
        call.columns, call.white, call.white_bar, call.columns_bar, call.state, call.numbers_bar,
    )  # fmt: skip
    return 0


@inlined
def filter_gains(seconds, valid, numbers, decay, gain, root):
    """Kalman filter of an Ornstein-Uhlenbeck process in white noise, as far as it does not look at the data.

    Fills, at the valid samples, the correlation since the one before, the gain and the root of the precision of what a
    sample adds to those before it, [T] each. Returns the log determinant of the residuals' covariance.
    """
    process, white, time = numbers[DEVIATION] ** 2, numbers[WHITE] ** 2, numbers[TIME]
    log_determinant, known, before = 0.0, 0.0, -1
    for t in range(seconds.shape[0]):
        if not valid[t]:
            continue
        decay[t] = 0.0
        variance = process
        if before >= 0:
            gap = seconds[t] - seconds[before]
            decay[t] = math.exp(-gap / time)
            variance = decay[t] * decay[t] * known - process * math.expm1(-2.0 * gap / time)
        total = variance + white
        gain[t] = variance / total
        root[t] = 1.0 / math.sqrt(total)
        log_determinant += math.log(total)
        known = variance * white / total
        before = t
    return log_determinant


@inlined
def whiten(valid, decay, gain, root, columns, whitened, state):
    """What each sample of the columns [T, c] adds to those before it, in standard deviations, [T, c]; state: [c]."""
    for c in range(columns.shape[1]):
        state[c] = 0.0
    for t in range(columns.shape[0]):
        if not valid[t]:
            for c in range(columns.shape[1]):
                whitened[t, c] = 0.0
            continue
        for c in range(columns.shape[1]):
            expected = decay[t] * state[c]
            new = columns[t, c] - expected
            whitened[t, c] = root[t] * new
            state[c] = expected + gain[t] * new


@inlined
def pull_back_filter(
    seconds, valid, numbers, decay, gain, root, columns, whitened, whitened_bar, columns_bar, state_bar, numbers_bar
):
    """Transpose of `filter_gains` and `whiten`.

    whitened_bar: [T, c] derivative of a function by what `whiten` gives; -1/2 the log determinant is added to that
    function here. Fills columns_bar [T, c] and adds to numbers_bar [n]; state_bar: [c] of work.
    """
    process, white, time = numbers[DEVIATION] ** 2, numbers[WHITE] ** 2, numbers[TIME]
    process_bar, white_bar, known_bar = 0.0, 0.0, 0.0
    count = columns.shape[1]
    for c in range(count):
        state_bar[c] = 0.0
    t = _previous(valid, columns.shape[0])
    while t >= 0:
        before = _previous(valid, t)
        root_bar, gain_bar, decay_bar = 0.0, 0.0, 0.0
        for c in range(count):
            new = whitened[t, c] / root[t]
            new_bar = root[t] * whitened_bar[t, c] + gain[t] * state_bar[c]
            root_bar += new * whitened_bar[t, c]
            gain_bar += new * state_bar[c]
            expected_bar = state_bar[c] - new_bar
            columns_bar[t, c] = new_bar
            if before >= 0:
                state = columns[before, c] - (1.0 - gain[before]) * whitened[before, c] / root[before]
                decay_bar += state * expected_bar
            state_bar[c] = decay[t] * expected_bar
        precision = root[t] * root[t]
        total_bar = -0.5 * precision - 0.5 * root_bar * root[t] * precision - gain_bar * gain[t] * precision
        variance_bar = gain_bar * precision
        # What is known after the sample: variance white / total.
        variance_bar += known_bar * white * precision
        white_bar += known_bar * gain[t]
        total_bar -= known_bar * gain[t] * white * precision
        variance_bar += total_bar
        white_bar += total_bar
        if before >= 0:
            gap = seconds[t] - seconds[before]
            known = gain[before] * white
            decay_bar += 2.0 * variance_bar * decay[t] * (known - process)
            process_bar -= variance_bar * math.expm1(-2.0 * gap / time)
            numbers_bar[TIME] += decay_bar * decay[t] * gap / (time * time)
            known_bar = variance_bar * decay[t] * decay[t]
        else:
            process_bar += variance_bar
        t = before
    numbers_bar[DEVIATION] += 2.0 * numbers[DEVIATION] * process_bar
    numbers_bar[WHITE] += 2.0 * numbers[WHITE] * white_bar


@inlined
def _previous(valid, t):
    """The last valid sample before t; -1: there is none."""
    t -= 1
    while t >= 0 and not valid[t]:
        t -= 1
    return t


class Correlated(NoiseKind):
    """Correlated normal noise."""

    written = ("ar1", "normal", False)
    words = "AR(1) noise"
    names, white = ("standard_deviation", "white", "correlation_time"), "white"
    has_memory = True
    kernel, opens, returns, whitens, pulls = alone, opens, returns, whitens, pulls

    def draw(self, numbers: FloatArray, seconds: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Noise with a memory and without."""
        process = correlate(numbers[DEVIATION] * rng.standard_normal(len(seconds)), seconds, numbers[TIME])
        if numbers[WHITE] == 0.0:
            return process, np.zeros(len(seconds))
        return process, numbers[WHITE] * rng.standard_normal(len(seconds))
