"""Noise of one channel in compiled code: normal, Student's t or rounded, independent or correlated in time.

What is correlated is an Ornstein-Uhlenbeck process on the real times of the samples, which on even times is AR(1):
its correlation over a gap is exp(-gap / time). A channel's residuals [T] stand beside `valid` [T]; what is not valid
is skipped, and the next gap is the longer for it.
"""

from __future__ import annotations

import math

import numpy as np

from ..compiled import inlined

DEVIATION, WHITE, TIME, DEGREES, STEP, TIME_SIZE, TIME_LENGTH, PHASE_SIZE, PHASE_LENGTH = range(9)
"""Columns of the numbers [N, 9] of a residual model: of the noise its standard deviation (K; of Student's t its scale),
that of the white noise added to correlated noise (K), correlation time (s), degrees of freedom and the telemetry's
quantisation step (K); of the discrepancy amplitude (K) and lengthscale (s) in time, and in orbit phase (K, orbits)."""
NUMBERS = 9

INDEPENDENT, CORRELATED, STUDENT, CORRELATED_STUDENT, ROUNDED = range(5)
"""Kinds of noise: those of Student's t come last but one."""

_LOG_ROOT_2_PI = 0.5 * math.log(2.0 * math.pi)
_ROOT_HALF = math.sqrt(0.5)
_ROOT_2_OVER_PI = math.sqrt(2.0 / math.pi)


@inlined
def normal(valid, residual, numbers, residual_bar, numbers_bar):
    """Independent normal noise: fills the derivatives by residuals [T] and numbers [9], returns the log density."""
    precision = 1.0 / numbers[DEVIATION]
    squares, samples = 0.0, 0
    for t in range(residual.shape[0]):
        scaled = residual[t] * precision
        if valid[t]:
            squares += scaled * scaled
            samples += 1
            residual_bar[t] = -scaled * precision
        else:
            residual_bar[t] = 0.0
    numbers_bar[DEVIATION] += (squares - samples) * precision
    return -0.5 * squares - samples * (math.log(numbers[DEVIATION]) + _LOG_ROOT_2_PI)


# --- Student's t ------------------------------------------------------------------------------------------------


@inlined
def student(correlated, seconds, valid, residual, numbers, residual_bar, numbers_bar):
    """Student's t noise; correlated: of the innovations of an Ornstein-Uhlenbeck process, as `normal`."""
    scale, time, degrees = numbers[DEVIATION], numbers[TIME], numbers[DEGREES]
    constant = math.lgamma(0.5 * (degrees + 1.0)) - math.lgamma(0.5 * degrees) - 0.5 * math.log(math.pi * degrees)
    constant_bar = 0.5 * _digamma(0.5 * (degrees + 1.0)) - 0.5 * _digamma(0.5 * degrees) - 0.5 / degrees
    value, before = 0.0, -1
    for t in range(residual.shape[0]):
        residual_bar[t] = 0.0
        if not valid[t]:
            continue
        decay, rest, gap, last = 0.0, 1.0, 0.0, 0.0
        if correlated and before >= 0:
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
        numbers_bar[DEVIATION] += spread_bar * rest
        numbers_bar[DEGREES] += constant_bar - 0.5 * math.log1p(square / degrees) - 0.5 * slope * scaled / degrees
        if decay > 0.0:
            residual_bar[before] -= decay * slope / spread
            decay_bar = -slope / spread * last - spread_bar * scale * decay / rest
            numbers_bar[TIME] += decay_bar * decay * gap / (time * time)
        before = t
    return value


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


# --- rounded telemetry ------------------------------------------------------------------------------------------


@inlined
def rounded(valid, residual, numbers, residual_bar, numbers_bar):
    """Normal noise, then rounding to steps: the probability of the whole step, over the step's width, as `normal`."""
    deviation, step = numbers[DEVIATION], numbers[STEP]
    value = 0.0
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
        numbers_bar[DEVIATION] += (lower * at_lower - upper * at_upper) / deviation
    return value


@inlined
def _scaled_tail(x):
    """exp(x^2) erfc(x) for x >= 0; from 5 on by its continued fraction (Abramowitz & Stegun 7.1.14)."""
    if x < 5.0:
        return math.exp(x * x) * math.erfc(x)
    fraction = x
    for k in range(16, 0, -1):
        fraction = x + 0.5 * k / fraction
    return 1.0 / (math.sqrt(math.pi) * fraction)


# --- correlated normal noise ------------------------------------------------------------------------------------


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
    function here. Fills columns_bar [T, c] and adds to numbers_bar [9]; state_bar: [c] of work.
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


LOG_ROOT_2_PI = np.float64(_LOG_ROOT_2_PI)
