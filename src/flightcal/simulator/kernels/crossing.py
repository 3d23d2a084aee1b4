"""Where a thermostat switches inside a step: the length at which its sensor meets the threshold.

What is located is the crossing of the *discrete* solution: secant steps on the length of the step, from the crossing of
the cubic through the step's ends, which is nearly there.
"""

from __future__ import annotations

import numpy as np

from ...compiled import inlined
from .lanes import put, take
from .step import EIGHT_THIRDS

WHOLE = 1
"""What a lane does: a step to the grid point, as if no heater switched,"""
LOCATING = 2
"""or a trial of the length at which a heater switches;"""
LOST = 3
"""or it has found that none does where one seemed to."""

LOCATION_ITERATIONS = 60
MOST_LOST = 6
"""Crossings that are met nowhere, of a segment: with more the solution is so wild that its end means nothing."""
CROSSING_TOLERANCE = 1e-11  # K, on the sensor at the switch
LOST_TOLERANCE = 1e-6  # K; a thermostat does not notice its sensor past the threshold for a moment by less


@inlined
def decide(structure, measured, lanes, lane, step):
    """Look at the trial just made. True: the lane makes another from the same state; False: this one is the segment.

    Of the thermostats past their threshold at the trial's end, the one that seems to cross first is located; then it is
    looked whether another was past its own by then, until none is.
    """
    if lanes.phase[lane] == WHOLE:
        lanes.heater[lane] = -1
        tolerance = 0.0
        if lanes.settled[lane] > MOST_LOST:
            return False
    elif not _located(structure, measured, lanes, lane, step):
        return True
    elif lanes.phase[lane] == LOST:
        lanes.phase[lane] = WHOLE
        return True
    else:
        # Strictly earlier than the one that was found, so that the two of a tie do not take turns; where the solution
        # is so wild that it jumps over a threshold, both are past theirs.
        found = _past_threshold(structure, measured, lanes, lane, step.x1, lanes.heater[lane])
        tolerance = max(CROSSING_TOLERANCE, found)
    length = take(lanes.length, 0, lane)
    chosen, first, rate, high = -1, length, 0.0, length
    for k in range(structure.sensor.shape[0]):
        if k == lanes.heater[lane]:
            continue
        past = _past_threshold(structure, measured, lanes, lane, step.x1, k)
        # None is earlier than now: where all are past at once, each would give way to another for ever.
        if past > tolerance and length > 0.0:
            crossing, slope = _estimate(structure, measured, lanes, lane, step, k, past)
            if chosen < 0 or crossing < first:
                chosen, first, rate, high = k, crossing, slope, length
        elif lanes.settled[lane] == 0:
            crossing, slope, peak = _excursion(structure, measured, lanes, lane, step, k, past)
            if slope > 0.0 and (chosen < 0 or crossing < first):
                chosen, first, rate, high = k, crossing, slope, peak
    if chosen < 0:
        return False
    lanes.heater[lane] = chosen
    lanes.low[lane], lanes.high[lane] = 0.0, high
    lanes.rate[lane] = rate
    lanes.iterations[lane] = 0
    put(lanes.length, 0, lane, first)
    lanes.phase[lane] = LOCATING
    return True


@inlined
def _past_threshold(structure, measured, lanes, lane, x, k):
    """How far x is past the threshold of heater k, K; -1 where the heater is driven by its measured status."""
    if not np.isnan(measured[lanes.step[lane], k]):
        return -1.0
    temperature = take(x, structure.sensor[k], lane)
    if take(lanes.status, k, lane) > 0.5:
        return temperature - take(lanes.upper, k, lane)
    return take(lanes.lower, k, lane) - temperature


@inlined
def _estimate(structure, measured, lanes, lane, step, k, past):
    """Where the cubic through the trial's ends crosses the threshold (s), which is nearly there; its slope (K/s)."""
    sensor = structure.sensor[k]
    length = take(lanes.length, 0, lane)
    before = _past_threshold(structure, measured, lanes, lane, lanes.x, k)
    if before >= 0.0:
        return 0.0, 0.0
    end = take(lanes.begin, 0, lane) + length
    last = take(lanes.left, sensor, lane) + take(lanes.ramp, sensor, lane) * end + take(lanes.heating, sensor, lane)
    for p in range(structure.linear_start[sensor], structure.linear_start[sensor + 1]):
        last += take(lanes.A, p, lane) * take(step.x1, structure.linear_column[p], lane)
    for p in range(structure.radiative_start[sensor], structure.radiative_start[sensor + 1]):
        last += take(lanes.N, p, lane) * take(step.x1, structure.radiative_column[p], lane) ** 4
    for p in range(structure.quadratic_row.shape[0]):
        if structure.quadratic_row[p] == sensor:
            last += take(lanes.Q, p, lane) * take(step.x1, structure.quadratic_column[p], lane) ** 2
    towards = length if take(lanes.status, k, lane) > 0.5 else -length
    share, slope = _cubic_crossing(before, past, towards * take(step.f1, sensor, lane), towards * last)
    return share * length, slope / length


@inlined
def _excursion(structure, measured, lanes, lane, step, k, end):
    """Where the cubic of a sensor that is not past its threshold at the trial's end was so before (s).

    Its slope there (K/s; 0: it was not), and where it was farthest past it (s). Both slopes at the trial's ends are
    those of the dense output (see `sampling`).
    """
    sensor, length = structure.sensor[k], take(lanes.length, 0, lane)
    sign = 1.0 if take(lanes.status, k, lane) > 0.5 else -1.0
    first = sign * length * take(step.f1, sensor, lane)
    last = sign * (
        2.0 * take(step.k4, sensor, lane)
        - take(step.k1, sensor, lane)
        + take(step.k2, sensor, lane)
        + EIGHT_THIRDS * take(step.k3, sensor, lane)
    )
    if not (first > 0.0 and last < 0.0) or structure.mass[sensor] == 0.0 or not np.isnan(measured[lanes.step[lane], k]):
        return 0.0, 0.0, 0.0
    before = _past_threshold(structure, measured, lanes, lane, lanes.x, k)
    if before >= 0.0:
        return 0.0, 0.0, 0.0
    rise = end - before
    # The slope first + 2 (3 rise - 2 first - last) s + 3 (first + last - 2 rise) s^2 falls through zero once.
    square, middle = 3.0 * (first + last - 2.0 * rise), 3.0 * rise - 2.0 * first - last
    root = np.sqrt(max(middle * middle - square * first, 0.0))
    peak = first / (root - middle) if middle < 0.0 else (-middle - root) / square
    top = _cubic(before, end, first, last, peak)
    if not (top > LOST_TOLERANCE and 0.0 < peak < 1.0):
        return 0.0, 0.0, 0.0
    share, slope = _cubic_crossing(before, top, first * peak, 0.0)
    return share * peak * length, slope / (peak * length), peak * length


@inlined
def _located(structure, measured, lanes, lane, step):
    """Whether the trial ends where the heater switches; if not, the next trial is set: a safeguarded secant step."""
    trial = take(lanes.length, 0, lane)
    value = _past_threshold(structure, measured, lanes, lane, step.x1, lanes.heater[lane])
    low, high = lanes.low[lane], lanes.high[lane]
    if (
        abs(value) < CROSSING_TOLERANCE
        or high - low < 1e-12 * lanes.duration[lane]
        or lanes.iterations[lane] >= LOCATION_ITERATIONS
    ):
        if value < -LOST_TOLERANCE:
            # The cubic had it past the threshold for a moment, the solution is not.
            lanes.heater[lane], lanes.phase[lane] = -1, LOST
            lanes.settled[lane] += 1
            put(lanes.length, 0, lane, lanes.duration[lane] - take(lanes.begin, 0, lane))
        return True
    if value > 0.0:
        high = trial
    else:
        low = trial
    rate = lanes.rate[lane]
    if lanes.iterations[lane] > 0 and value != lanes.previous_value[lane]:
        rate = (value - lanes.previous_value[lane]) / (trial - lanes.previous[lane])
    lanes.previous[lane], lanes.previous_value[lane] = trial, value
    trial = trial - value / rate if rate > 0.0 else -1.0
    if not (low < trial < high):
        trial = 0.5 * (low + high)
    lanes.low[lane], lanes.high[lane], lanes.rate[lane] = low, high, rate
    lanes.iterations[lane] += 1
    put(lanes.length, 0, lane, trial)
    return False


@inlined
def _cubic(before, end, first, last, share):
    """The cubic from before to end with end slopes first and last, at a share of the way."""
    rest = 1.0 - share
    return (
        before * (1.0 + 2.0 * share) * rest * rest
        + end * share * share * (3.0 - 2.0 * share)
        + first * share * rest * rest
        - last * share * share * rest
    )


@inlined
def _cubic_crossing(before, end, first, last):
    """Where in 0..1 the cubic from before < 0 to end > 0, with end slopes first and last, is zero; its slope there."""
    low, high = 0.0, 1.0
    share = before / (before - end)
    rate = end - before
    for _ in range(20):
        rest = 1.0 - share
        value = _cubic(before, end, first, last, share)
        rate = (
            6.0 * share * rest * (end - before)
            + first * rest * (1.0 - 3.0 * share)
            + last * share * (3.0 * share - 2.0)
        )
        if abs(value) < 1e-9 * (end - before):
            break
        if value > 0.0:
            high = share
        else:
            low = share
        share = share - value / rate if rate > 0.0 else -1.0
        if not (low < share < high):
            share = 0.5 * (low + high)
    return share, rate
