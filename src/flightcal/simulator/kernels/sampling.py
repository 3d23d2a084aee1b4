"""Outputs at the telemetry's own times, from inside the steps.

A segment of length h from x0 to x1 is continued as the cubic through the values and the derivatives at its ends:

    x(s) = x0 + s^2 (3 - 2 s) (x1 - x0) + s (1 - s)^2 h f1 - s^2 (1 - s) h v       0 <= s <= 1
    h v = 2 k4 - k1 + k2 + 8/3 k3

with the stages of `step`. v is the derivative at the segment's end as stage 4 has it: its error is of the order of the
step's, it needs no evaluation, and a small node behind a large conductance does not amplify it.

In a network with massless nodes (5 k1 - k2) takes the place of h f1, right to second order: f1 is wrong for a moment
after a heater has switched, until the massless nodes are in balance again, and what the stages say of the others does
not depend on that. A massless node's own continuation

    x(s) = x0 + s (5 - 3 s) k1 - s (1 - s) k2 + s^2 k3 + s^2 (3 - 2 s) k4

meets the conditions of order two for the algebraic part of an equation of index one (Hairer and Wanner 1996, VI.4)
for every s.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ...compiled import inlined
from .lanes import take
from .step import EIGHT_THIRDS

GAIN, BIAS, TIME_OFFSET = range(3)
"""Of the errors; K, and s."""
ICE_POINT = 273.15  # K


class Looks(NamedTuple):
    """Where and when the states are looked at, and what the sensors, with errors [S, 3, N], say (see `Sensors`)."""

    time: Any
    """[T] s from the window's start, not decreasing."""
    state: Any
    """[N] that each channel measures."""
    moved: Any
    """[N] whether the channel has a time offset."""
    settled: int
    """1: all nodes have a capacity."""
    errors: Any
    """[S, 3, N]"""
    next: Any
    """[lane, N+1] workspace: the sample that comes next, of each channel, and of the heaters' status."""


@inlined
def observe_segment(structure, looks, errors, x0, status, step, lane, start, end, length, temperatures, at_samples):
    """Fill what is looked at in [start, end) of temperatures [T, N] and status at_samples [T, H]."""
    pointers, T = looks.next[lane], looks.time.shape[0]
    channels, heaters = looks.state.shape[0], at_samples.shape[1]
    t = pointers[channels]
    while t < T and looks.time[t] < end:
        share = max((looks.time[t] - start) / length, 0.0)
        weights = _weights(share)
        for c in range(channels):
            if not looks.moved[c]:
                i = looks.state[c]
                x = take(x0, i, lane) + _rise(structure, looks.settled, step, i, lane, length, weights)
                temperatures[t, c] = _reading(errors, c, x)
        for k in range(heaters):
            at_samples[t, k] = take(status, k, lane)
        t += 1
    pointers[channels] = t
    for c in range(channels):
        if looks.moved[c]:
            i, t = looks.state[c], pointers[c]
            while t < T and looks.time[t] + errors[TIME_OFFSET, c] < end:
                share = max((looks.time[t] + errors[TIME_OFFSET, c] - start) / length, 0.0)
                weights = _weights(share)
                x = take(x0, i, lane) + _rise(structure, looks.settled, step, i, lane, length, weights)
                temperatures[t, c] = _reading(errors, c, x)
                t += 1
            pointers[c] = t


@inlined
def observe_end(looks, errors, x, status, lane, temperatures, at_samples):
    """Fill what is looked at at the window's end, and after it, where all stays as it is."""
    pointers, T = looks.next[lane], looks.time.shape[0]
    channels = looks.state.shape[0]
    for t in range(pointers[channels], T):
        for c in range(channels):
            if not looks.moved[c]:
                temperatures[t, c] = _reading(errors, c, take(x, looks.state[c], lane))
        for k in range(at_samples.shape[1]):
            at_samples[t, k] = take(status, k, lane)
    for c in range(channels):
        if looks.moved[c]:
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
def observe_end_back(looks, errors, end, temperatures, temperatures_bar, x_bar, errors_bar):
    """The derivative of `observe_end` backwards; sets the pointers to the last samples before the end."""
    pointers, channels = looks.next[0], looks.state.shape[0]
    before = looks.time.shape[0] - 1
    while before >= 0 and looks.time[before] >= end:
        before -= 1
    pointers[channels] = before
    for c in range(channels):
        i, t = looks.state[c], looks.time.shape[0] - 1
        while t >= 0 and (looks.time[t] + errors[TIME_OFFSET, c] >= end if looks.moved[c] else t > before):
            x_bar[i] += _reading_back(errors, c, temperatures[t, c], temperatures_bar[t, c], errors_bar)
            t -= 1
        pointers[c] = t


@inlined
def observe_segment_back(
    structure, looks, errors, step, start, length, first_one, cut, bars, temperatures, temperatures_bar, errors_bar
):
    """The derivative of `observe_segment` backwards into `bars`; whether any sample lies in the segment.

    cut: whether an end of the segment is where a heater switches, so that the segment's start and length move.
    """
    pointers, channels = looks.next[0], looks.state.shape[0]
    rate = 1.0 / length
    found = False
    t = pointers[channels]
    while t >= 0 and (first_one or looks.time[t] >= start):
        if not found:
            _clear(structure, bars)
            found = True
        share = max((looks.time[t] - start) * rate, 0.0)
        weights = _weights(share)
        for c in range(channels):
            if not looks.moved[c]:
                y = _reading_back(errors, c, temperatures[t, c], temperatures_bar[t, c], errors_bar)
                _rise_back(structure, looks.settled, step, looks.state[c], length, weights, y, bars)
                if cut:
                    slope = y * rate * _slope(structure, looks.settled, step, looks.state[c], length, share)
                    _moved(looks.settled, step, looks.state[c], weights, y, slope, share, bars)
        t -= 1
    pointers[channels] = t
    for c in range(channels):
        if looks.moved[c]:
            t = pointers[c]
            while t >= 0 and (first_one or looks.time[t] + errors[TIME_OFFSET, c] >= start):
                if not found:
                    _clear(structure, bars)
                    found = True
                share = (looks.time[t] + errors[TIME_OFFSET, c] - start) * rate
                y = _reading_back(errors, c, temperatures[t, c], temperatures_bar[t, c], errors_bar)
                weights = _weights(max(share, 0.0))
                _rise_back(structure, looks.settled, step, looks.state[c], length, weights, y, bars)
                slope = 0.0
                if share > 0.0:
                    slope = y * rate * _slope(structure, looks.settled, step, looks.state[c], length, share)
                    errors_bar[TIME_OFFSET, c] += slope
                _moved(looks.settled, step, looks.state[c], weights, y, slope, max(share, 0.0), bars)
                t -= 1
            pointers[c] = t
    return found


@inlined
def _clear(structure, bars):
    for i in range(structure.mass.shape[0]):
        bars.x0[i], bars.f1[i] = 0.0, 0.0
        bars.k1[i], bars.k2[i], bars.k3[i], bars.k4[i] = 0.0, 0.0, 0.0, 0.0
    bars.start[0], bars.length[0] = 0.0, 0.0


@inlined
def _weights(share):
    """Of x1 - x0, h f1 and h v at a share of the segment, and of k1, k2 and k3 for a massless node."""
    rest = 1.0 - share
    value = share * share * (3.0 - 2.0 * share)
    return value, share * rest * rest, -share * share * rest, share * (5.0 - 3.0 * share), -share * rest, share * share


@inlined
def _rise(structure, settled, step, i, lane, length, weights):
    """What such weights make of state i, K."""
    k1, k2, k3, k4 = take(step.k1, i, lane), take(step.k2, i, lane), take(step.k3, i, lane), take(step.k4, i, lane)
    value, first, last, of_k1, of_k2, of_k3 = weights
    if structure.mass[i] > 0.0:
        ended = 2.0 * k4 - k1 + k2 + EIGHT_THIRDS * k3
        begun = length * take(step.f1, i, lane) if settled else 5.0 * k1 - k2
        return value * (2.0 * k1 + k3 + k4) + first * begun + last * ended
    return of_k1 * k1 + of_k2 * k2 + of_k3 * k3 + value * k4


@inlined
def _slope(structure, settled, step, i, length, share):
    """The derivative of state i by the share, K."""
    rest = 1.0 - share
    of_value, of_first, of_last = 6.0 * share * rest, rest * (1.0 - 3.0 * share), share * (3.0 * share - 2.0)
    weights = of_value, of_first, of_last, 5.0 - 6.0 * share, 2.0 * share - 1.0, 2.0 * share
    return _rise(structure, settled, step, i, 0, length, weights)


@inlined
def _rise_back(structure, settled, step, i, length, weights, cotangent, bars):
    """The derivative of x0 and `_rise` backwards."""
    value, first, last, of_k1, of_k2, of_k3 = weights
    bars.x0[i] += cotangent
    if settled:
        bars.k1[i] += cotangent * (2.0 * value - last)
        bars.k2[i] += cotangent * last
        bars.k3[i] += cotangent * (value + EIGHT_THIRDS * last)
        bars.k4[i] += cotangent * (value + 2.0 * last)
        bars.f1[i] += cotangent * (first * length)
    elif structure.mass[i] > 0.0:
        bars.k1[i] += cotangent * (2.0 * value - last + 5.0 * first)
        bars.k2[i] += cotangent * (last - first)
        bars.k3[i] += cotangent * (value + EIGHT_THIRDS * last)
        bars.k4[i] += cotangent * (value + 2.0 * last)
    else:
        bars.k1[i] += cotangent * of_k1
        bars.k2[i] += cotangent * of_k2
        bars.k3[i] += cotangent * of_k3
        bars.k4[i] += cotangent * value


@inlined
def _moved(settled, step, i, weights, cotangent, slope, share, bars):
    """The derivative by the segment's ends, from that of the sample's time, `slope` (per s), times the cotangent."""
    bars.start[0] -= slope
    bars.length[0] -= slope * share
    if settled:
        bars.length[0] += cotangent * weights[1] * step.f1[i]


@inlined
def _reading(errors, c, temperature):
    return errors[GAIN, c] * temperature + (1.0 - errors[GAIN, c]) * ICE_POINT + errors[BIAS, c]


@inlined
def _reading_back(errors, c, reading, cotangent, errors_bar):
    """The derivative of `_reading` backwards: that of the temperature; see `finish_errors`."""
    errors_bar[GAIN, c] += cotangent * reading
    errors_bar[BIAS, c] += cotangent
    return errors[GAIN, c] * cotangent


@inlined
def finish_errors(errors, errors_bar):
    """From sums of cotangents times readings to the derivative by the gains, which go with the temperatures."""
    for c in range(errors.shape[1]):
        errors_bar[GAIN, c] -= (errors[BIAS, c] + ICE_POINT) * errors_bar[BIAS, c]
        errors_bar[GAIN, c] /= errors[GAIN, c]
