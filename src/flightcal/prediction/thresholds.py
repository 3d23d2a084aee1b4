"""At which temperatures thermostats truly switch, as their measured switches show: draw by draw of a posterior.

A heater goes on when its sensor first falls to the threshold. So the threshold is the lowest temperature since the last
switch, at the time of the switch: it lies between two samples, and where in between a draw of unmodelled heat has found
from the temperatures. While the heater stays off the threshold is below all of it. The sensor's bias, the control cycle
and minimum times are part of what the threshold is found to be, and what differs from switch to switch is scatter.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from ..problem import Window, pinned_heaters
from ..simulator import FloatArray, NetworkSimulator, Observation, Sensors

_FINE = 10.0
"""s, how far apart the sensors' temperatures are looked at."""
_SLOPE = 120.0
"""s before a switch, over which a sensor's slope is taken."""
_PRIOR = 0.5
"""K, deviation of a threshold from that of its draw of theta, as the prior has it,"""
_OFFSETS = np.linspace(-1.5, 1.5, 76)
"""K, and those that are looked at."""
_SCATTERS = np.geomspace(0.01, 0.6, 8)
"""K, as are these,"""
_USUAL_SCATTER = 0.15
"""K, the scale of their prior where no channel shows the sensor,"""
_FREEDOM = 3.0
"""and its degrees of freedom: half of Student's t, for software may do more than read a sensor."""
_PARTLY, _MIDDLE = 0.1, 0.2
"""Share of time on, and off, from which a heater is between its thresholds; K, by how much their middle is known then.
"""
_LEAST = 1e-12
"""Density of a switch that no threshold explains."""


@dataclass(frozen=True)
class Thresholds:
    """By how much thresholds are off those of S draws of theta, K: to go on, and to go off."""

    offsets: FloatArray
    """[S, 2, H]"""
    scatter: FloatArray
    """[S, 2, H] standard deviation from switch to switch."""

    @property
    def told(self) -> tuple[FloatArray, FloatArray]:
        """[2, H] mean offsets, and how far off zero on that side 95% of them are at least.

        Where a sensor changes by kelvins between two samples, nobody knows at which temperature its heater switches.
        """
        mean, (low, high) = self.offsets.mean(axis=0), np.quantile(self.offsets, (0.05, 0.95), axis=0)
        return mean, np.where(mean > 0.0, np.maximum(low, 0.0), np.minimum(high, 0.0))


@dataclass(frozen=True)
class _Switches:
    """Of one heater in one direction: times (s) of each switch, and of stretches without one."""

    since: FloatArray
    """[E] when it last switched the other way,"""
    before: FloatArray
    """[E] the last sample before it switched,"""
    at: FloatArray
    """[S, E] and when it did, of each draw; infinite: it has not switched."""


def draw_thresholds(
    windows: tuple[Window, ...],
    thetas: list[FloatArray],
    heats: list[FloatArray],
    shifts: list[FloatArray],
    rng: np.random.Generator,
) -> Thresholds | None:
    """Thresholds given measured switches, one draw for each of S draws of theta [S, q] and heat [S, h, 2 K] of windows.

    shifts: [S, E] s by which each switch of a window's `switching` made a heater's time on longer than midway does.
    None: heaters are not driven by their measured status, or there are none.
    """
    heaters = len(windows[0].simulator.heaters)
    if not heaters or any(window.switching is None for window in windows):
        return None
    draws = len(thetas[0])
    logs = np.zeros((2, heaters, draws, len(_OFFSETS), len(_SCATTERS)))
    for window, theta, heat, shift in zip(windows, thetas, heats, shifts, strict=True):
        simulator = window.network
        assert simulator is not None
        looking = _looking(simulator)
        runs = looking.simulate_many(theta[:, window.simulated], heat)
        seconds = looking.observation.times
        thresholds = [looking.thresholds(own) for own in theta[:, window.simulated]]
        held = pinned_heaters(window.scenario)
        for heater, name in enumerate(simulator.heaters):
            if name in held:
                cycling = _cycling(simulator, heater, seconds)
                for s, run in enumerate(runs):
                    if run is not None:
                        beyond = run.temperatures[cycling, heater] - thresholds[s][:, heater].mean()
                        logs[:, heater, s] += _log_of_middle(beyond)
                continue
            # Seen upside down, going off is going on.
            for side, sign in enumerate((1.0, -1.0)):
                found = _switches(window, heater, shift, on=side == 0)
                for s, run in enumerate(runs):
                    if run is not None:
                        sensor = sign * (run.temperatures[:, heater] - thresholds[s][side, heater])
                        logs[side, heater, s] += _log_likelihood(seconds, sensor, found, s, sign)
    prior = -0.5 * (_OFFSETS / _PRIOR) ** 2
    usual = _usual_scatter(windows[0], np.median(thetas[0], axis=0))
    # Of the logarithm, for scatters are looked at in even steps of it.
    spread = -0.5 * (_FREEDOM + 1.0) * np.log1p((_SCATTERS / usual[:, None]) ** 2 / _FREEDOM) + np.log(_SCATTERS)
    logs += prior[:, None] + spread[:, None, None, :]
    chances = np.exp(logs - logs.max(axis=(3, 4), keepdims=True)).reshape(2, heaters, draws, -1)
    bounds = np.cumsum(chances, axis=3)
    chosen = (bounds < rng.random((2, heaters, draws, 1)) * bounds[..., -1:]).sum(axis=3)
    place, which = np.divmod(chosen, len(_SCATTERS))
    width = _OFFSETS[1] - _OFFSETS[0]
    offsets = _OFFSETS[place] + width * (rng.random(place.shape) - 0.5)
    return Thresholds(np.moveaxis(offsets, 2, 0), np.moveaxis(_SCATTERS[which], 2, 0))


def _usual_scatter(window: Window, theta: FloatArray) -> FloatArray:
    """[H] K, by how much a reading of each heater's sensor is off another, as telemetry of its node shows at theta [q].

    The software reads a thermistor like the one that sends telemetry.
    """
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
    is_set, is_scaled = (~np.isin(own, errors) for own in (mapping.set_positions, mapping.scaled_positions))
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


def _log_of_middle(beyond: FloatArray) -> FloatArray:
    """Of offsets [o, 1], whatever the scatter, of a sensor that is so many K [T] above the middle of its thresholds.

    Where a heater switches more often than its status is sampled, a drawn sensor is there on average.
    """
    if not len(beyond):
        return np.zeros((len(_OFFSETS), 1))
    return np.asarray(-0.5 * ((beyond.mean() - _OFFSETS) / _MIDDLE) ** 2)[:, None]


def _switches(window: Window, heater: int, shifts: FloatArray, *, on: bool) -> _Switches:
    """Of the telemetry of a window, of a heater that goes on, or off; shifts: see `draw_thresholds`."""
    status = window.status[:, heater]
    assert window.network is not None
    start = window.times[0]
    known = np.flatnonzero(np.isfinite(status))
    offset = window.first_sample
    seconds = (window.times[known] - start) / np.timedelta64(1, "ns") * 1e-9 + offset
    states = status[known] > 0.5
    usual = 1.5 * float(np.median(np.diff(seconds))) if len(seconds) > 1 else 0.0
    since, rows = None, []
    for k in range(1, len(seconds)):
        if seconds[k] - seconds[k - 1] > usual:
            since = None
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


def _log_likelihood(seconds: FloatArray, sensor: FloatArray, found: _Switches, draw: int, sign: float) -> FloatArray:
    """Of offsets and scatters [o, c]: of the switches of a sensor that falls to its threshold, K above that of theta.

    sign: -1: offsets of one that rises to it.
    """
    total = np.zeros((len(_OFFSETS), len(_SCATTERS)))
    for since, before, at in zip(found.since, found.before, found.at[draw], strict=True):
        first, last = np.searchsorted(seconds, [since, before])
        if last <= first:
            continue
        high = sensor[first:last].min()
        if not np.isfinite(at):
            total += log_ndtr((high - sign * _OFFSETS[:, None]) / _SCATTERS)
            continue
        # As if the heater had not switched: what follows the last sample is its doing.
        back = max(first, last - round(_SLOPE / _FINE) - 1)
        slope = (sensor[last - 1] - sensor[back]) / max(last - 1 - back, 1) / _FINE
        reached = min(high, sensor[last - 1] + slope * (at - seconds[last - 1]))
        off = (reached - sign * _OFFSETS[:, None]) / _SCATTERS
        total += np.logaddexp(-0.5 * off**2 - np.log(_SCATTERS), np.log(_LEAST))
    return total


def scattered(thresholds: Thresholds, switches: int, rng: np.random.Generator | None) -> FloatArray:
    """What is added to thresholds at each switch, [S, E, 2, H] K; rng: None: no scatter."""
    offsets = thresholds.offsets[:, None]
    if rng is None:
        return offsets
    drawn = rng.standard_normal((len(thresholds.offsets), switches, *thresholds.offsets.shape[1:]))
    return np.asarray(offsets + thresholds.scatter[:, None] * drawn)
