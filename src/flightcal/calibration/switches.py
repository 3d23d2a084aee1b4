"""When heaters switched whose status is not measured: as makes the telemetry most probable, next to a point.

How temperatures respond to the power of a heater in each short time is linear there. So is it to parameters and to
unmodelled heat, which are integrated out: the log density is quadratic in the states, on or off, of all times. The
states of a span are exchanged as long as that makes it larger. A heater goes on only where its sensor is about as cold
as its threshold, and off where it is about as warm.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..problem import HeatModel, Held, Units, Window, heater_watts, responses, with_other
from ..simulator import FloatArray, sensor_temperatures
from ..telemetry import quiet_noise, spells

_MOST_TIMES = 400
"""Short times in a window: as many as samples, or so many."""
_SWITCH = 3.0
"""By which the log density has to grow for a switch more: it is about when that is, and one that is not needed."""
_EXCHANGES = 100
_WITHIN = 2.0
"""Short times, or intervals of the telemetry, within which a switch is where it has been found."""
_NEAR, _FARTHEST = 0.2, 0.45
"""Of the distance of a thermostat's thresholds: so near to one a sensor may have reached it, and no farther,"""
_NOISES = 3.0
"""or within so many deviations of its noise."""

Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class HeaterTimes:
    """One heater in one window, time by time."""

    heater: int
    edges: FloatArray
    """[B + 1] s from the window's start, of the short times."""
    on: Bools
    """[B] what it does now."""
    instead: tuple[Bools, ...]
    """[B] each, what its sensor says that it may have done."""
    may_go_on: Bools
    """[B + 1] whether it may go on at each edge,"""
    may_go_off: Bools
    """[B + 1] and off."""
    response: FloatArray
    """[T, N, B] K, to its power in each time."""
    interval: float
    """s, between samples."""


def heater_times(window: Window, held: Held, theta: FloatArray, model: HeatModel) -> list[HeaterTimes]:
    """Of each heater of a window whose status is not measured, next to theta [q].

    window: in open loop, as its heaters are held, with its heat. Raises SimulationFailure.
    """
    drive = window.network.drive
    count = int(np.clip(round(drive.times[-1] / window.interval), 1, _MOST_TIMES))
    edges = np.linspace(0.0, float(drive.times[-1]), count + 1)
    inside = theta[window.simulated]
    system = window.network.system(inside)
    sensors = sensor_temperatures(window.network.network.structure, system, drive, edges)
    left = window.observed - window.simulate(theta).temperatures
    powers, found = window.network.heater_power(inside), []
    for heater in window.unmeasured:
        name = window.network.heaters[heater]
        watts = heater_watts(model, window, name)
        if not watts.sum() > 0.0:
            continue
        # Whatever a heater has beside what the scenario writes, it has in the same nodes.
        parts = [np.diff(np.clip(drive.times, *span)) / np.diff(drive.times) for span in pairwise(edges)]
        series = powers[heater] * np.repeat(np.stack(parts), 2, axis=1)
        share = np.tile(watts / watts.sum(), (count, 1))
        (response,) = responses(window, theta, model, [Units(share, series)])
        middle = 0.5 * (edges[1:] + edges[:-1])
        on = np.zeros(count, bool)
        for begin, end, which in held.on:
            if which == heater:
                on |= (middle > begin) & (middle < end)
        read, near = _read(window, left, name, edges)
        lower, upper = float(system.lower[heater]), float(system.upper[heater])
        reads = sensors[:, heater] + read
        # It is looked at from time to time, and in between it may go as far as from one time to the next.
        near = max(_NEAR * (upper - lower), near) + float(np.median(np.abs(np.diff(reads))))
        near = min(near, _FARTHEST * (upper - lower)) if np.isfinite(near) else near
        cold, warm = reads <= lower + near, reads >= upper - near
        instead = tuple(by_sensor(reads, lower, upper, near, first) for first in (False, True))
        found.append(HeaterTimes(heater, edges, on, instead, _around(cold), _around(warm), response, window.interval))
    return found


def _read(window: Window, left: FloatArray, heater: str, times: FloatArray) -> tuple[FloatArray, float]:
    """What telemetry of a heater's sensor adds to its simulation [B + 1] K at these times, and what is near then, K.

    left: [T, N] K, telemetry minus simulation. A sensor without telemetry is nowhere known to be far.
    """
    sensor, channels = window.scenario.network.switches[heater].sensor, window.simulator.channels
    of_sensor = [k for k, channel in enumerate(channels) if window.scenario.observations[channel].node == sensor]
    known = np.flatnonzero(np.isfinite(left[:, of_sensor[0]])) if of_sensor else np.empty(0, np.int64)
    if not len(known):
        return np.zeros(len(times)), np.inf
    noise = quiet_noise(window.observed[known, of_sensor[0]])
    return np.interp(times, window.network.observation.times[known], left[known, of_sensor[0]]), _NOISES * noise


def by_sensor(reads: FloatArray, lower: float, upper: float, near: float, first: bool) -> Bools:
    """States [B] between the times at which a sensor reads so much [B + 1] K.

    A heater goes on where its sensor passes the lower threshold, or turns `near` K before it: then the heater has
    turned it. first: whether it is on at first where the sensor is between its thresholds.
    """
    lowest, highest = (np.concatenate([[False], turns, [False]]) for turns in _turns(reads))
    goes_on = (reads <= lower) | (lowest & (reads <= lower + near))
    goes_off = (reads >= upper) | (highest & (reads >= upper - near))
    on, found = first, np.zeros(len(reads) - 1, bool)
    for k in range(len(found)):
        on = not goes_off[k] if on else bool(goes_on[k])
        found[k] = on
    return found


def _turns(reads: FloatArray) -> tuple[Bools, Bools]:
    """[B - 1] where a sensor turns, upwards and downwards."""
    before, here, after = reads[:-2], reads[1:-1], reads[2:]
    return (here < before) & (here <= after), (here > before) & (here >= after)


def _around(here: Bools) -> Bools:
    """Here, and next to it."""
    wide = np.pad(here, 1)
    return here | wide[:-2] | wide[2:]


def with_states(held: Held, heater_times: HeaterTimes, on: Bools, *, keeps: bool = False) -> Held:
    """What heaters do, where one is on in these times [B].

    keeps: whether what does not change is known as well as before.
    """
    if (on == heater_times.on).all():
        return held
    changes = spells(on).ravel()
    # What does not change keeps the moment that it has.
    known = np.array(
        sorted({time for begin, end, which in held.on if which == heater_times.heater for time in (begin, end)})
    )
    times = heater_times.edges[changes]
    if len(known) and len(times):
        nearest = known[np.abs(known[:, None] - times).argmin(axis=0)]
        times = np.where(
            np.abs(nearest - times) <= 0.5 * (heater_times.edges[1] - heater_times.edges[0]) + 1e-9, nearest, times
        )
    spans = list(zip(times[::2].tolist(), times[1::2].tolist(), strict=True))
    within = dict.fromkeys(times.tolist(), _WITHIN * max(float(heater_times.edges[1]), heater_times.interval))
    if keeps:
        within |= {time: before for time, which, before in held.switches if which == heater_times.heater}
    return with_other(held, heater_times.heater, spans, within)


def with_shifts(held: Held, longer: FloatArray, heaters: Collection[int], least: float) -> Held:
    """What heaters do, where those named are on so many seconds [E] longer for each switch: earlier, or until later.

    Each switch is then known twice as well, within `least` s at best.
    """
    begins = {(time, heater) for time, _, heater in held.on}
    moments = {}
    for (time, heater, within), more in zip(held.switches, longer, strict=True):
        shift = float(np.clip(more, -0.5 * within, 0.5 * within)) if heater in heaters else 0.0
        moments[time, heater] = time - shift if (time, heater) in begins else time + shift
    for heater in heaters:
        known = {
            moments[time, heater]: max(0.5 * within, min(within, least))
            for time, which, within in held.switches
            if which == heater
        }
        spans = [
            (moments.get((begin, heater), begin), moments.get((end, heater), end))
            for begin, end, which in held.on
            if which == heater
        ]
        edges = np.array(spans).ravel()
        if len(edges) and bool((np.diff(edges) > 0.0).all()):
            held = with_other(held, heater, spans, known)
    return held


def exchanged(times: Sequence[HeaterTimes], slope: FloatArray, curvature: FloatArray) -> list[Bools]:
    """States [B] of each heater that make the log density largest, one exchange after the other.

    slope: [b] of the log density, for power added in each time of all heaters; curvature: [b, b] of minus it.
    """
    states, slope = [heater_times.on.copy() for heater_times in times], slope.copy()
    ends = np.cumsum([0, *(len(heater_times.on) for heater_times in times)])
    for k, heater_times in enumerate(times):
        here = slice(ends[k], ends[k + 1])
        for instead in heater_times.instead:
            added = instead.astype(float) - states[k]
            more = np.count_nonzero(np.diff(instead)) - np.count_nonzero(np.diff(states[k]))
            gain = added @ slope[here] - 0.5 * added @ curvature[here, here] @ added - _SWITCH * more
            if gain > 0.0:
                slope -= curvature[:, here] @ added
                states[k] = instead.copy()
    for _ in range(_EXCHANGES):
        best, chosen = 0.0, None
        for k, (heater_times, on) in enumerate(zip(times, states, strict=True)):
            here = slice(ends[k], ends[k + 1])
            gain = _gain(on, slope[here], curvature[here, here]) - _SWITCH * _more_switches(heater_times, on)
            place = np.unravel_index(np.argmax(gain), gain.shape)
            if gain[place] > best + 1e-9:
                best, chosen = float(gain[place]), (k, slice(int(place[0]), int(place[1])))
        if chosen is None:
            break
        k, span = chosen
        added = np.where(states[k][span], -1.0, 1.0)
        slope -= curvature[:, ends[k] + span.start : ends[k] + span.stop] @ added
        states[k][span] ^= True
    return states


def _gain(on: Bools, slope: FloatArray, curvature: FloatArray) -> FloatArray:
    """[B + 1, B + 1] of the log density, of an exchange of all states from one edge to another later one."""
    sign = np.where(on, -1.0, 1.0)
    linear = np.concatenate([[0.0], np.cumsum(sign * slope)])
    square = np.zeros((len(on) + 1, len(on) + 1))
    square[1:, 1:] = np.cumsum(np.cumsum(sign[:, None] * curvature * sign, axis=0), axis=1)
    of_span = np.add.outer(np.diag(square), np.diag(square)) - square - square.T
    gain = linear - linear[:, None] - 0.5 * of_span
    return np.where(np.triu(np.ones(gain.shape, bool), 1), gain, -np.inf)


def _more_switches(heater_times: HeaterTimes, on: Bools) -> FloatArray:
    """[B + 1, B + 1] how many switches an exchange from one edge to another adds; infinite: the heater may not."""
    alike = on[1:] == on[:-1]
    inner = slice(1, len(on))
    begins, ends = np.zeros(len(on) + 1), np.zeros(len(on) + 1)
    # Where both sides are alike there is a switch then, to what the one side was not; else it is gone.
    may_begin = np.where(on[1:], heater_times.may_go_off[inner], heater_times.may_go_on[inner])
    may_end = np.where(on[1:], heater_times.may_go_on[inner], heater_times.may_go_off[inner])
    begins[inner] = np.where(alike, np.where(may_begin, 1.0, np.inf), -1.0)
    ends[inner] = np.where(alike, np.where(may_end, 1.0, np.inf), -1.0)
    # Switches in between become those to the other state.
    turned = np.zeros(len(on) + 1, int)
    turned[inner] = ~alike & ~np.where(on[1:], heater_times.may_go_off[inner], heater_times.may_go_on[inner])
    before = np.cumsum(turned)
    between = before - turned - before[:, None]
    return np.where(between > 0, np.inf, np.add.outer(begins, ends))
