"""Outputs at the telemetry's own times, from inside the steps.

A segment of length h from x0 to x1 is continued as the cubic through the values and the derivatives at its ends:

    x(s) = x0 + s^2 (3 - 2 s) (x1 - x0) + s (1 - s)^2 h f1 - s^2 (1 - s) h v       0 <= s <= 1
    h v = 2 k4 - k1 + k2 + 8/3 k3

with the stages of `step`. v is the derivative at the segment's end as stage 4 has it: its error is of the order of the
step's, it needs no evaluation, and a small node behind a large conductance does not amplify it.

Right after a heater has switched f1 is wrong where there are massless nodes, until these are in balance again. In such
a segment (5 k1 - k2) takes the place of h f1, right to second order: what the stages say does not depend on that. A
massless node's own continuation

    x(s) = x0 + s (5 - 3 s) k1 - s (1 - s) k2 + s^2 k3 + s^2 (3 - 2 s) k4

meets the conditions of order two for the algebraic part of an equation of index one (Hairer and Wanner 1996, VI.4)
for every s.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ...compiled import inlined
from ...scenario import ICE_POINT
from .lanes import take
from .step import EIGHT_THIRDS

GAIN, BIAS, TIME_OFFSET = range(3)
"""Of the errors; K, and s."""
BEYOND = 60.0
"""s for which temperatures go on in a straight line beyond the window's ends; then they stay."""


class Looks(NamedTuple):
    """Where and when the states are looked at, and what the sensors, with errors [S, 3, N], say (see `Sensors`)."""

    time: Any
    """[T] s from the window's start, not decreasing."""
    state: Any
    """[N] that each channel measures."""
    moved: Any
    """[N] whether the channel has a time offset."""
    still: int
    """1: none has."""
    settled: int
    """1: all nodes have a capacity."""
    errors: Any
    """[S, 3, N]"""
    next: Any
    """[lane, N+1] workspace: the sample that comes next, of each channel with an offset, and of all others."""
    cubic: Any
    """[4, N] workspace: the coefficients of each channel's cubic in a segment, or the cotangents of these."""


@inlined
def in_balance(looks, heater, lane, segment):
    """Whether massless nodes are in balance where a segment begins, for no heater switches there.

    heater: [lane, segment, H] status.
    """
    balanced = looks.settled == 1 or segment > 0
    if looks.settled == 0 and segment > 0:
        for k in range(heater.shape[2]):
            balanced = balanced and heater[lane, segment, k] == heater[lane, segment - 1, k]
    return balanced


@inlined
def _is_still(looks, errors):
    """Whether all samples are of the times of their tags."""
    still = True
    for c in range(looks.state.shape[0]):
        still = still and (not looks.moved[c] or errors[TIME_OFFSET, c] == 0.0)
    return still


@inlined
def observe_segment(
    structure, looks, errors, x0, status, step, lane, start, end, length, is_last, balanced, temperatures, at_samples
):
    """Fill what is looked at in [start, end) of temperatures [T, N] and status at_samples [T, H].

    is_last: whether channels with a time offset look beyond the end, too; balanced: whether massless nodes are in
    balance at the segment's start.
    """
    pointers, cubic, T = looks.next[lane], looks.cubic, looks.time.shape[0]
    channels, heaters = looks.state.shape[0], at_samples.shape[1]
    rate = 1.0 / length
    still = _is_still(looks, errors)
    t = pointers[channels]
    known = False
    if t < T and looks.time[t] < end:
        _set_cubic(structure, looks, errors, x0, step, lane, length, balanced)
        known = True
    while t < T and looks.time[t] < end:
        share = max((looks.time[t] - start) * rate, 0.0)
        if still:
            for c in range(channels):
                temperatures[t, c] = cubic[0, c] + share * (cubic[1, c] + share * (cubic[2, c] + share * cubic[3, c]))
        else:
            for c in range(channels):
                if not looks.moved[c]:
                    temperatures[t, c] = _at(cubic, c, share)
        for k in range(heaters):
            at_samples[t, k] = take(status, k, lane)
        t += 1
    pointers[channels] = t
    if not still:
        for c in range(channels):
            if looks.moved[c]:
                t = pointers[c]
                while t < T and (is_last or looks.time[t] + errors[TIME_OFFSET, c] < end):
                    if not known:
                        _set_cubic(structure, looks, errors, x0, step, lane, length, balanced)
                        known = True
                    share = _within(looks.time[t] + errors[TIME_OFFSET, c] - start, length) * rate
                    temperatures[t, c] = _at(cubic, c, share)
                    t += 1
                pointers[c] = t


@inlined
def observe_end(looks, errors, x, status, lane, temperatures, at_samples):
    """Fill what is looked at at the window's end, and after it, where all stays as it is."""
    pointers, T = looks.next[lane], looks.time.shape[0]
    channels = looks.state.shape[0]
    still = _is_still(looks, errors)
    for t in range(pointers[channels], T):
        for c in range(channels):
            if still or not looks.moved[c]:
                temperatures[t, c] = _reading(errors, c, take(x, looks.state[c], lane))
        for k in range(at_samples.shape[1]):
            at_samples[t, k] = take(status, k, lane)
    for c in range(channels):
        if looks.moved[c] and not still:
            for t in range(pointers[c], T):
                temperatures[t, c] = _reading(errors, c, take(x, looks.state[c], lane))


class Observed(NamedTuple):
    """Cotangents that the samples in a segment give: of its states and stages, each [n], and of its ends."""

    x0: Any
    f1: Any
    k1: Any
    k2: Any
    k3: Any
    k4: Any
    start: Any
    """[1] of the segment's start, its length as it is."""
    length: Any
    """[1] of its length, its start as it is."""


@inlined
def observe_end_back(looks, errors, end, is_last, temperatures, temperatures_bar, x_bar, errors_bar):
    """The derivative of `observe_end` backwards; sets the pointers to the last samples before the end.

    is_last: as of `observe_segment`, of the last segment.
    """
    pointers, channels = looks.next[0], looks.state.shape[0]
    before = looks.time.shape[0] - 1
    while before >= 0 and looks.time[before] >= end:
        before -= 1
    pointers[channels] = before
    for c in range(channels):
        i, t = looks.state[c], looks.time.shape[0] - 1
        while t >= 0 and (
            not is_last and looks.time[t] + errors[TIME_OFFSET, c] >= end if looks.moved[c] else t > before
        ):
            errors_bar[GAIN, c] += temperatures_bar[t, c] * temperatures[t, c]
            errors_bar[BIAS, c] += temperatures_bar[t, c]
            x_bar[i] += errors[GAIN, c] * temperatures_bar[t, c]
            t -= 1
        pointers[c] = t


@inlined
def observe_segment_back(
    structure, looks, errors, x0, step, start, length, first_one, cut, balanced, bars,
    temperatures, temperatures_bar, errors_bar,
):  # fmt: skip
    """The derivative of `observe_segment` backwards into `bars`; whether any sample lies in the segment.

    cut: whether an end of the segment is where a heater switches, so that the segment's start and length move;
    balanced: as of `observe_segment`.
    """
    pointers, cubic, channels = looks.next[0], looks.cubic, looks.state.shape[0]
    rate = 1.0 / length
    last = pointers[channels]
    t = last
    while t >= 0 and (first_one or looks.time[t] >= start):
        t -= 1
    pointers[channels] = t
    found = t < last
    if not looks.still:
        for c in range(channels):
            if looks.moved[c] and pointers[c] >= 0:
                found = found or first_one or looks.time[pointers[c]] + errors[TIME_OFFSET, c] >= start
    if not found:
        return False
    for i in range(structure.mass.shape[0]):
        bars.x0[i], bars.f1[i] = 0.0, 0.0
        bars.k1[i], bars.k2[i], bars.k3[i], bars.k4[i] = 0.0, 0.0, 0.0, 0.0
    bars.start[0], bars.length[0] = 0.0, 0.0
    if cut or not looks.still:
        # How the readings change with the samples' places in the segment.
        _set_cubic(structure, looks, errors, x0, step, 0, length, balanced)
        for sample in range(t + 1, last + 1):
            share = max((looks.time[sample] - start) * rate, 0.0)
            total = 0.0
            for c in range(channels):
                if not looks.moved[c]:
                    total += temperatures_bar[sample, c] * _slope(cubic, c, share)
            bars.start[0] -= total * rate
            bars.length[0] -= total * rate * share
    if not looks.still:
        for c in range(channels):
            if looks.moved[c]:
                sample = pointers[c]
                while sample >= 0 and (first_one or looks.time[sample] + errors[TIME_OFFSET, c] >= start):
                    passed = looks.time[sample] + errors[TIME_OFFSET, c] - start
                    near = _within(passed, length)
                    share = near * rate
                    slope = temperatures_bar[sample, c] * _slope(cubic, c, min(max(share, 0.0), 1.0)) * rate
                    if passed == near:
                        bars.start[0] -= slope
                        bars.length[0] -= slope * share
                        errors_bar[TIME_OFFSET, c] += slope
                    else:
                        # It stays at what it is a fixed time before the start, or after the end.
                        bars.length[0] -= slope * (share if passed < 0.0 else share - 1.0)
                    sample -= 1
    for c in range(channels):
        cubic[0, c], cubic[1, c], cubic[2, c], cubic[3, c] = 0.0, 0.0, 0.0, 0.0
    for sample in range(t + 1, last + 1):
        share = max((looks.time[sample] - start) * rate, 0.0)
        square, cube = share * share, share * share * share
        if looks.still:
            for c in range(channels):
                y = temperatures_bar[sample, c]
                cubic[0, c] += y
                cubic[1, c] += y * share
                cubic[2, c] += y * square
                cubic[3, c] += y * cube
                errors_bar[GAIN, c] += y * temperatures[sample, c]
                errors_bar[BIAS, c] += y
        else:
            for c in range(channels):
                if not looks.moved[c]:
                    _add(cubic, c, share, temperatures[sample, c], temperatures_bar[sample, c], errors_bar)
    if not looks.still:
        for c in range(channels):
            if looks.moved[c]:
                sample = pointers[c]
                while sample >= 0 and (first_one or looks.time[sample] + errors[TIME_OFFSET, c] >= start):
                    share = _within(looks.time[sample] + errors[TIME_OFFSET, c] - start, length) * rate
                    _add(cubic, c, share, temperatures[sample, c], temperatures_bar[sample, c], errors_bar)
                    sample -= 1
                pointers[c] = sample
    _set_cubic_back(structure, looks, errors, step, length, balanced, bars)
    return True


@inlined
def finish_errors(errors, errors_bar):
    """From sums of cotangents times readings to the derivative by the gains, which go with the temperatures."""
    for c in range(errors.shape[1]):
        errors_bar[GAIN, c] -= (errors[BIAS, c] + ICE_POINT) * errors_bar[BIAS, c]
        errors_bar[GAIN, c] /= errors[GAIN, c]


@inlined
def _set_cubic(structure, looks, errors, x0, step, lane, length, balanced):
    """The coefficients of each channel's reading by powers of the share of the segment that has passed."""
    cubic = looks.cubic
    for c in range(looks.state.shape[0]):
        i = looks.state[c]
        k1, k2, k3, k4 = take(step.k1, i, lane), take(step.k2, i, lane), take(step.k3, i, lane), take(step.k4, i, lane)
        gain = errors[GAIN, c]
        cubic[0, c] = _reading(errors, c, take(x0, i, lane))
        if structure.mass[i] > 0.0:
            rise = 2.0 * k1 + k3 + k4
            begun = length * take(step.f1, i, lane) if balanced else 5.0 * k1 - k2
            ended = 2.0 * k4 - k1 + k2 + EIGHT_THIRDS * k3
            cubic[1, c] = gain * begun
            cubic[2, c] = gain * (3.0 * rise - 2.0 * begun - ended)
            cubic[3, c] = gain * (begun + ended - 2.0 * rise)
        else:
            cubic[1, c] = gain * (5.0 * k1 - k2)
            cubic[2, c] = gain * (k2 + k3 + 3.0 * k4 - 3.0 * k1)
            cubic[3, c] = gain * (-2.0 * k4)


@inlined
def _set_cubic_back(structure, looks, errors, step, length, balanced, bars):
    """The derivative of `_set_cubic` backwards, from the cotangents in `looks.cubic`."""
    cubic = looks.cubic
    for c in range(looks.state.shape[0]):
        i, gain = looks.state[c], errors[GAIN, c]
        first, square, cube = gain * cubic[1, c], gain * cubic[2, c], gain * cubic[3, c]
        bars.x0[i] += gain * cubic[0, c]
        if structure.mass[i] > 0.0:
            rise, begun, ended = 3.0 * square - 2.0 * cube, first - 2.0 * square + cube, cube - square
            bars.k1[i] += 2.0 * rise - ended
            bars.k2[i] += ended
            bars.k3[i] += rise + EIGHT_THIRDS * ended
            bars.k4[i] += rise + 2.0 * ended
            if balanced:
                bars.f1[i] += length * begun
                bars.length[0] += step.f1[i] * begun
            else:
                bars.k1[i] += 5.0 * begun
                bars.k2[i] -= begun
        else:
            bars.k1[i] += 5.0 * first - 3.0 * square
            bars.k2[i] += square - first
            bars.k3[i] += square
            bars.k4[i] += 3.0 * square - 2.0 * cube


@inlined
def _within(passed, length):
    """Seconds since a segment's start, no farther than `BEYOND` its ends."""
    return min(max(passed, -BEYOND), length + BEYOND)


@inlined
def _square(share):
    """The square of a share of a segment; outside of the segment it goes on in a straight line."""
    return 0.0 if share < 0.0 else share * share if share <= 1.0 else 2.0 * share - 1.0


@inlined
def _cube(share):
    """The cube, likewise."""
    return 0.0 if share < 0.0 else share * share * share if share <= 1.0 else 3.0 * share - 2.0


@inlined
def _at(cubic, c, share):
    return cubic[0, c] + share * cubic[1, c] + _square(share) * cubic[2, c] + _cube(share) * cubic[3, c]


@inlined
def _slope(cubic, c, share):
    return cubic[1, c] + share * (2.0 * cubic[2, c] + 3.0 * share * cubic[3, c])


@inlined
def _add(cubic, c, share, reading, cotangent, errors_bar):
    """The derivative of `_at` backwards, into the cotangents of the coefficients."""
    cubic[0, c] += cotangent
    cubic[1, c] += cotangent * share
    cubic[2, c] += cotangent * _square(share)
    cubic[3, c] += cotangent * _cube(share)
    errors_bar[GAIN, c] += cotangent * reading
    errors_bar[BIAS, c] += cotangent


@inlined
def _reading(errors, c, temperature):
    return errors[GAIN, c] * temperature + (1.0 - errors[GAIN, c]) * ICE_POINT + errors[BIAS, c]
