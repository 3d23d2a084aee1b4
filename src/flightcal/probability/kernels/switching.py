"""How probable the telemetered status of heaters is, given the times at which simulated thermostats switch.

Status samples: on board, switch j happens at s_j + e_j with independent e_j ~ N(0, tau^2), in the order in which it was
simulated: none happens before the one before it. A sample says truly whether the heater is on, but for a share of
errors. How many switches have happened by the samples' times is then a Markov chain, whose likelihood, summed over all
ways to match what was simulated with what was measured, is smooth in all s_j and in tau.

Duty cycles: the share of a stretch of time in which the heater is on is normal around the simulated one.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ...compiled import inlined, kernel

_REACH = 8.0
"""So many standard deviations from its time a switch has surely happened, or surely not (6e-16)."""
BAND = 32
"""At most so many switches of a heater may be less sure at one time; with more there is no density."""
_ROOT_HALF = math.sqrt(0.5)
_ROOT_2_PI = math.sqrt(2.0 * math.pi)


class StatusSamples(NamedTuple):
    """Samples of heaters' status, channel after channel."""

    heater: Any
    """[C] of each channel."""
    setting: Any
    """[C] place of its timing error tau (s) among the settings; its error rate is the next."""
    first: Any
    """[C+1] its samples among those below."""
    time: Any
    """[I] s from the window's start, ascending in a channel."""
    on: Any
    """[I] 1: on, 0: off."""


class DutyCycles(NamedTuple):
    """Duty cycles measured over stretches of time, each of one or more spans in which the status is known."""

    heater: Any
    """[D]"""
    setting: Any
    """[D] place of its standard deviation among the settings."""
    first: Any
    """[D+1] its spans among those below."""
    begin: Any
    """[J] s from the window's start."""
    end: Any
    measured: Any
    """[D] 0..1, over all of its spans."""


class StatusData(NamedTuple):
    """What is known of the heaters' status in a window."""

    samples: StatusSamples
    duties: DutyCycles


_NONE, _NOTHING = np.empty(0, np.int64), np.empty(0)
NO_STATUS = StatusData(
    StatusSamples(_NONE, _NONE, np.zeros(1, np.int64), _NOTHING, _NOTHING),
    DutyCycles(_NONE, _NONE, np.zeros(1, np.int64), _NOTHING, _NOTHING, _NOTHING),
)


class StatusWork(NamedTuple):
    """Memory for one evaluation."""

    settings: Any
    """[P]"""
    settings_bar: Any
    places: Any
    """[at least E] switches of one heater among all."""
    lowest: Any
    """[I] fewest switches that may have happened by each sample of a channel."""
    total: Any
    """[I] probability of each sample, given those before it."""
    weight: Any
    """[I, BAND] probability of each number of switches, from the lowest on, given the samples so far."""
    band: Any
    """[3, BAND]"""


def status_work(data: StatusData, settings: int, switches: int) -> StatusWork:
    """Memory for so many settings and at most so many switches."""
    samples = int(np.diff(data.samples.first).max(initial=0))
    return StatusWork(
        np.empty(settings), np.empty(settings), np.empty(switches, np.int64), np.empty(samples, np.int64),
        np.empty(samples), np.empty((samples, BAND)), np.empty((3, BAND)),
    )  # fmt: skip


class StatusCall(NamedTuple):
    """What is known of the heaters, and a simulation."""

    data: StatusData
    work: StatusWork
    """With the settings, and filled: the derivative by them."""
    switches: Any
    """[1] how many are simulated, of at least that many below, in order of time."""
    time: Any
    heater: Any
    on: Any
    status: Any
    """[T, H] simulated, for a heater that never switches."""
    times_bar: Any
    """[at least E], filled."""
    value: Any
    """[1], filled: the log likelihood."""


@kernel
def switching(call):
    """The log likelihood and its derivatives."""
    data, work, count, status = call.data, call.work, call.switches[0], call.status
    times, heaters, ons, times_bar = call.time[:count], call.heater[:count], call.on[:count], call.times_bar[:count]
    for k in range(work.settings_bar.shape[0]):
        work.settings_bar[k] = 0.0
    for e in range(count):
        times_bar[e] = 0.0
    value = 0.0
    for c in range(data.samples.heater.shape[0]):
        own = _switches_of(data.samples.heater[c], heaters, work.places)
        initial = _initial(data.samples.heater[c], own, ons, status, work.places)
        value += _chain(data.samples, c, own, initial, times, work, times_bar)
    for d in range(data.duties.heater.shape[0]):
        own = _switches_of(data.duties.heater[d], heaters, work.places)
        initial = _initial(data.duties.heater[d], own, ons, status, work.places)
        value += _duty(data.duties, d, own, initial, times, work, times_bar)
    call.value[0] = value
    return 0


@inlined
def _switches_of(heater, heaters, places):
    """Fill `places` with those of a heater's switches among all; their number."""
    count = 0
    for e in range(heaters.shape[0]):
        if heaters[e] == heater:
            places[count] = e
            count += 1
    return count


@inlined
def _initial(heater, count, ons, status, places):
    """1 where the heater is on before its first switch, else 0."""
    if count > 0:
        return 1.0 - ons[places[0]]
    return 1.0 if status[0, heater] > 0.5 else 0.0


@inlined
def _later(z):
    """Probability that a switch happens later than z standard deviations after its time."""
    return 0.0 if z >= _REACH else (1.0 if z <= -_REACH else 0.5 * math.erfc(z * _ROOT_HALF))


@inlined
def _density(z):
    return 0.0 if abs(z) >= _REACH else math.exp(-0.5 * z * z) / _ROOT_2_PI


@inlined
def _between(before, after):
    """Probability that a switch happens between so many standard deviations before and after its time."""
    return _later(before) - _later(after) if before > 0.0 else _later(-after) - _later(-before)


@inlined
def _chain(samples, c, count, initial, times, work, times_bar):
    """Forwards over the samples of channel c and back (Rabiner 1989); `count` switches at times[work.places].

    In state m, m switches have happened and switch m is the next. Between samples at a and b it happens with
    probability 1 - S_m(b) / S_m(a), S the chance to be later; one after it has happened too with probability 1 - S(b),
    for then its own time plays no part before b. So `carry`, what has come past m - 1 since a, goes on from m to m + 1.
    """
    first, number = samples.first[c], samples.first[c + 1] - samples.first[c]
    place = samples.setting[c]
    tau, error = work.settings[place], work.settings[place + 1]
    lowest, total, weight = work.lowest, work.total, work.weight
    carries, beta, beta_before = work.band[0], work.band[1], work.band[2]
    inverse = 1.0 / tau
    value = 0.0
    low, high = 0, 0
    for i in range(number):
        at = samples.time[first + i]
        before = samples.time[first + i - 1] if i > 0 else 0.0
        low_before, high_before = low, high
        while low < count and at - times[work.places[low]] >= _REACH * tau:
            low += 1
        while high < count and at - times[work.places[high]] > -_REACH * tau:
            high += 1
        lowest[i] = low
        if i == 0:
            low_before = low
        if high - low_before >= BAND:
            return -np.inf
        total[i] = 0.0
        carry = 1.0 if i == 0 else 0.0
        for m in range(low_before, high + 1):
            here = weight[i - 1, m - low_before] if i > 0 and m <= high_before else 0.0
            stay, go, later = here, 0.0, 1.0
            if m < count:
                z = (at - times[work.places[m]]) * inverse
                later = _later(z)
                if here > 0.0:
                    z_before = (before - times[work.places[m]]) * inverse
                    chance = here / _later(z_before)
                    stay, go = chance * later, chance * _between(z_before, z)
            if m >= low:
                on = initial if m % 2 == 0 else 1.0 - initial
                right = (samples.on[first + i] > 0.5) == (on > 0.5)
                weight[i, m - low] = (stay + carry * later) * (1.0 - error if right else error)
                total[i] += weight[i, m - low]
            carry = go + carry * (1.0 - later if m < count else 0.0)
        value += math.log(total[i])
        for k in range(high - low + 1):
            weight[i, k] /= total[i]

    # Backwards: beta [m - low] is the derivative of the value by weight[i, m - low] before it is divided by their sum.
    tau_bar, error_bar = 0.0, 0.0
    for k in range(BAND):
        beta[k] = 1.0
    for back in range(number):
        i = number - 1 - back
        at = samples.time[first + i]
        before = samples.time[first + i - 1] if i > 0 else 0.0
        low = lowest[i]
        low_before = lowest[i - 1] if i > 0 else low
        high_before = high
        if i > 0:  # of the sample before
            while high_before > low_before and before - times[work.places[high_before - 1]] <= -_REACH * tau:
                high_before -= 1
        carry = 1.0 if i == 0 else 0.0
        for m in range(low_before, high + 1):
            carries[m - low_before] = carry
            here = weight[i - 1, m - low_before] if i > 0 and m <= high_before else 0.0
            if m < count:
                z = (at - times[work.places[m]]) * inverse
                go = 0.0
                if here > 0.0:
                    z_before = (before - times[work.places[m]]) * inverse
                    go = here / _later(z_before) * _between(z_before, z)
                carry = go + carry * (1.0 - _later(z))
        carry_bar = 0.0
        for down in range(high - low_before + 1):
            m = high - down
            here = weight[i - 1, m - low_before] if i > 0 and m <= high_before else 0.0
            new_bar = 0.0
            if m >= low:
                on = initial if m % 2 == 0 else 1.0 - initial
                right = (samples.on[first + i] > 0.5) == (on > 0.5)
                chance = 1.0 - error if right else error
                new_bar = chance * beta[m - low] / total[i]
                probability = weight[i, m - low] * beta[m - low] / chance
                error_bar += -probability if right else probability
            later, share, gone = 1.0, 1.0, 0.0
            if m < count:
                z = (at - times[work.places[m]]) * inverse
                later = _later(z)
                difference = new_bar - carry_bar
                slope = difference * carries[m - low_before] * _density(z) * inverse
                slope_z = slope * z
                if i > 0 and m <= high_before:
                    z_before = (before - times[work.places[m]]) * inverse
                    later_before = _later(z_before)
                    share, gone = later / later_before, _between(z_before, z) / later_before
                    chance = difference * here / later_before * inverse
                    after, ago = chance * _density(z), chance * share * _density(z_before)
                    slope += after - ago
                    slope_z += after * z - ago * z_before
                times_bar[work.places[m]] += slope
                tau_bar += slope_z
            beta_before[m - low_before] = new_bar * share + carry_bar * gone
            carry_bar = new_bar * later + carry_bar * (1.0 - later)
        for k in range(high - low_before + 1):
            beta[k] = beta_before[k]
        high = high_before
    work.settings_bar[place] += tau_bar
    work.settings_bar[place + 1] += error_bar
    return value


@inlined
def _duty(duties, d, count, initial, times, work, times_bar):
    """Of duty cycle d, a normal one."""
    known, simulated = 0.0, 0.0
    for span in range(duties.first[d], duties.first[d + 1]):
        begin, end = duties.begin[span], duties.end[span]
        known += end - begin
        simulated += initial * (end - begin)
        sign = 1.0 - 2.0 * initial
        for k in range(count):
            simulated += sign * max(0.0, end - max(begin, times[work.places[k]]))
            sign = -sign
    place = duties.setting[d]
    deviation = work.settings[place]
    scaled = (duties.measured[d] - simulated / known) / deviation
    by_time = scaled / (deviation * known)
    for span in range(duties.first[d], duties.first[d + 1]):
        sign = 1.0 - 2.0 * initial
        for k in range(count):
            if duties.begin[span] <= times[work.places[k]] < duties.end[span]:
                times_bar[work.places[k]] -= sign * by_time
            sign = -sign
    work.settings_bar[place] += (scaled * scaled - 1.0) / deviation
    return -0.5 * scaled * scaled - math.log(deviation * _ROOT_2_PI)
