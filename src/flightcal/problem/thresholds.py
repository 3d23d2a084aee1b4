"""At which temperatures the sensors of thermostats were when measured switches show that heaters went on and off.

A heater goes on when its sensor first falls to the threshold. So the threshold is the lowest temperature since the last
switch, at the time of the switch: it lies between two samples, and where in between a draw of unmodelled heat has found
from the temperatures. While the heater stays off the threshold is below all of it. The sensor's bias, the control cycle
and minimum times are part of what the threshold is found to be, and what differs from switch to switch is scatter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from ..simulator import FloatArray, IntArray, NetworkSimulator, Observation, Sensors
from .pinned import pinned_heaters
from .window import Window

_FINE = 10.0
"""s, how far apart the sensors' temperatures are looked at."""
_SLOPE = 120.0
"""s before a switch, over which a sensor's slope is taken."""
SCATTERS = np.geomspace(0.01, 0.6, 8)
"""K, deviations from switch to switch that are looked at,"""
_USUAL_SCATTER = 0.15
"""K, the scale of their prior where no channel shows the sensor,"""
_FREEDOM = 3.0
"""and its degrees of freedom: half of Student's t, for software may do more than read a sensor."""
_PARTLY, _MIDDLE = 0.1, 0.2
"""Share of time on, and off, from which a heater is between its thresholds; K, by how much their middle is known then.
"""
_LEAST = 1e-12
"""Density of a switch that no threshold explains."""
_SIGNS = (1.0, -1.0)
"""Of going on, and of going off, which upside down is the same."""


@dataclass(frozen=True)
class Passages:
    """Temperatures of a heater's sensor of S draws in a window; NaN where a simulation failed."""

    reached: tuple[FloatArray, FloatArray]
    """[S, E] K when it went on, and when it went off; or the most that it was beyond without doing so."""
    happened: tuple[NDArray[np.bool_], NDArray[np.bool_]]
    """[E] whether it did."""
    middle: FloatArray
    """[S] K on average, where it switches more often than its status shows; NaN where it does not."""

    def of(self, rows: IntArray) -> Passages:
        """Of some of the draws."""
        on, off = (values[rows] for values in self.reached)
        return replace(self, reached=(on, off), middle=self.middle[rows])

    @staticmethod
    def joined(parts: Sequence[Passages]) -> Passages:
        """Of the draws of all parts."""
        on, off = (np.concatenate(arrays) for arrays in zip(*(part.reached for part in parts), strict=True))
        return replace(parts[0], reached=(on, off), middle=np.concatenate([part.middle for part in parts]))

    @property
    def cycles(self) -> bool:
        """Whether all that is known is the middle of its thresholds."""
        return bool(np.isfinite(self.middle).any())

    def log_likelihood(self, side: int, thresholds: FloatArray) -> FloatArray:
        """Of thresholds [S, o] K to go on (side 0) or off (1), and of `SCATTERS` [c]: [S, o, c]."""
        scatter, sign = SCATTERS, _SIGNS[side]
        total = np.zeros((*thresholds.shape, len(scatter)))
        for reached, happened in zip(self.reached[side].T, self.happened[side], strict=True):
            off = (sign * (reached[:, None] - thresholds))[..., None] / scatter
            with np.errstate(invalid="ignore"):
                at_it = np.logaddexp(-0.5 * off**2 - np.log(scatter), np.log(_LEAST)) if happened else log_ndtr(off)
            total += np.nan_to_num(at_it)
        return total

    def log_of_middle(self, middles: FloatArray) -> FloatArray:
        """Of middles [S, o] K of the two thresholds: a sensor is there on average while its heater cycles."""
        return np.nan_to_num(-0.5 * ((self.middle[:, None] - middles) / _MIDDLE) ** 2)


@dataclass(frozen=True)
class _Switches:
    """Of one heater in one direction: times (s) of each switch, and of stretches without one."""

    since: FloatArray
    """[E] when it last switched the other way,"""
    before: FloatArray
    """[E] the last sample before it switched,"""
    at: FloatArray
    """[S, E] and when it did, of each draw; infinite: it has not switched."""


def passages(window: Window, thetas: FloatArray, heat: FloatArray | None, shifts: FloatArray) -> list[Passages]:
    """Of each heater of a window in open loop, at S draws of theta [S, q] and heat [S, h, 2 K].

    shifts: [S, E] s by which each switch of its `switching` made a heater's time on longer than midway does.
    """
    simulator = _looking(window.network)
    runs = simulator.simulate_many(thetas[:, window.simulated], heat)
    seconds, held = simulator.observation.times, pinned_heaters(window.scenario)
    nothing = np.full((len(seconds), len(simulator.heaters)), np.nan)
    sensors = np.stack([nothing if run is None else run.temperatures for run in runs])
    found = []
    for heater, name in enumerate(simulator.heaters):
        of_heater, middle = sensors[:, :, heater], np.full(len(runs), np.nan)
        if name in held:
            cycling = _cycling(simulator, heater, seconds)
            if cycling.any():
                middle = of_heater[:, cycling].mean(axis=1)
            none = np.zeros((len(runs), 0))
            found.append(Passages((none, none), (np.zeros(0, bool),) * 2, middle))
            continue
        sides = [_switches(window, heater, shifts, on=on) for on in (True, False)]
        on, off = (_reached(seconds, of_heater, switches, sign) for switches, sign in zip(sides, _SIGNS, strict=True))
        found.append(Passages((on[0], off[0]), (on[1], off[1]), middle))
    return found


def log_prior_of_scatter(window: Window, theta: FloatArray) -> FloatArray:
    """[H, c] of `SCATTERS` at theta [q], which are even steps of the logarithm.

    The software reads a thermistor like the one that sends telemetry: by how much a reading of each heater's sensor is
    off another is what telemetry of its node shows.
    """
    spread = -0.5 * (_FREEDOM + 1.0) * np.log1p((SCATTERS / usual_scatter(window, theta)[:, None]) ** 2 / _FREEDOM)
    return np.asarray(spread + np.log(SCATTERS))


def usual_scatter(window: Window, theta: FloatArray) -> FloatArray:
    """[H] K, the scale of that prior."""
    numbers, kinds = window.numbers(theta), window.residuals.terms.kinds
    white = {
        window.scenario.observations[channel].node: np.sqrt(kind.white_variance(of_channel))
        for channel, kind, of_channel in zip(window.simulator.channels, kinds, numbers, strict=True)
    }
    found = [white.get(block.sensor) or _USUAL_SCATTER for block in window.scenario.network.switches.values()]
    return np.array(found)


def _looking(simulator: NetworkSimulator) -> NetworkSimulator:
    """The simulator as its thermostats' sensors see it: what channels' errors are is nothing to them."""
    errors, mapping = simulator.channel_errors, simulator.mapping
    written = mapping.written.copy()
    written[errors] = np.array([[1.0], [0.0], [0.0]])
    is_set, is_scaled = (~np.isin(positions, errors) for positions in (mapping.set_positions, mapping.scaled_positions))
    sensors = simulator.network.watched
    times = np.arange(0.0, simulator.drive.times[-1], _FINE)
    return replace(
        simulator,
        mapping=mapping._replace(
            written=written,
            set_positions=mapping.set_positions[is_set],
            set_by=mapping.set_by[is_set],
            scaled_positions=mapping.scaled_positions[is_scaled],
            scaled_by=mapping.scaled_by[is_scaled],
        ),
        observation=Observation(times, Sensors(sensors, np.zeros(len(sensors), np.bool_))),
        channel_errors=np.repeat(errors[:, :1], len(sensors), axis=1),
        channels=simulator.heaters,
    )


def _cycling(simulator: NetworkSimulator, heater: int, seconds: FloatArray) -> NDArray[np.bool_]:
    """[T] whether a heater is on for a share of the time, at seconds [T]."""
    drive = simulator.drive
    steps = np.clip(np.searchsorted(drive.times, seconds, side="right") - 1, 0, len(drive.measured) - 1)
    share = drive.measured[steps, heater]
    return np.asarray((share > _PARTLY) & (share < 1.0 - _PARTLY))


def _switches(window: Window, heater: int, shifts: FloatArray, *, on: bool) -> _Switches:
    """Of the telemetry of a window, of a heater that goes on, or off; shifts: see `passages`."""
    status = window.status[:, heater]
    start = window.times[0]
    known = np.flatnonzero(np.isfinite(status))
    offset = window.first_sample
    seconds = (window.times[known] - start) / np.timedelta64(1, "ns") * 1e-9 + offset
    states = status[known] > 0.5
    usual = 1.5 * float(np.median(np.diff(seconds))) if len(seconds) > 1 else 0.0
    since: float | None = None
    rows: list[tuple[float, float, float]] = []
    for k in range(len(seconds)):
        if k == 0 or seconds[k] - seconds[k - 1] > usual:
            since = None if states[k] == on else seconds[k]
        elif states[k] != states[k - 1]:
            if states[k] == on:
                if since is not None:
                    rows.append((since, seconds[k - 1], seconds[k]))
                since = None
            else:
                since = seconds[k]
    if since is not None:
        rows.append((since, seconds[-1], np.inf))
    begin, before, after = np.array(rows, float).reshape(-1, 3).T
    at = np.tile(after, (len(shifts), 1))
    for e in np.flatnonzero(np.isfinite(after)):
        at[:, e] = np.clip(_when(window, heater, 0.5 * (before[e] + after[e]), shifts, on), before[e], after[e])
    return _Switches(begin, before, at)


def _when(window: Window, heater: int, middle: float, shifts: FloatArray, on: bool) -> FloatArray:
    """[S] s of a switch that telemetry places around `middle`."""
    assert window.switching is not None
    name = window.simulator.heaters[heater]
    for time, of, shift in zip(window.switching.time, window.switching.heater, shifts.T, strict=False):
        if of == name and np.isclose(time, middle):
            return np.asarray(middle - shift if on else middle + shift)
    return np.full(len(shifts), middle)


def _reached(
    seconds: FloatArray, sensor: FloatArray, found: _Switches, sign: float
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """[S, E] K of sensors [S, T] at switches or in stretches without, and [E] which they are.

    Those of which nothing is known before are left out.
    """
    temperatures, happened = [], []
    for e, (since, before) in enumerate(zip(found.since, found.before, strict=True)):
        first, last = np.searchsorted(seconds, [since, before])
        if last <= first:
            continue
        beyond = sign * sensor[:, first:last]
        high, at = beyond.min(axis=1), found.at[:, e]
        happened.append(bool(np.isfinite(at).all()))
        if happened[-1]:
            # As if the heater had not switched: what follows the last sample is its doing.
            back = max(0, last - first - round(_SLOPE / _FINE) - 1)
            slope = (beyond[:, -1] - beyond[:, back]) / max(last - first - 1 - back, 1) / _FINE
            high = np.minimum(high, beyond[:, -1] + slope * (at - seconds[last - 1]))
        temperatures.append(sign * high)
    columns = np.stack(temperatures, axis=1) if temperatures else np.zeros((len(sensor), 0))
    return columns, np.array(happened, bool)
