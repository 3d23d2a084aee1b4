"""Some samples of a window beside what a model gives for them, whatever simulates it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import xarray
from numpy.typing import NDArray

from ..problem import Window, pinned_heaters
from ..simulator import FloatArray
from .samples import noise_left, noise_of, series_at

INFERRED = "status by temperature of "
"""Begins the names of channels that are no telemetry: how probable it is that a heater is on, by its own sensor."""
_MOST_ROWS = 500
"""Samples of all channels together that are looked at."""
_LEAST_TIMES = 40
_SENSOR = 0.1
"""K, of a sample, beside what the telemetry shows of its noise."""
MODEL, _MINUTES = 0.25, 600.0
"""K and s: deviation and correlation time of what a right model still has in each channel."""
_BUSY = 0.25
"""Share of samples between which a heater switches, from which these tell nothing of its thresholds."""


@dataclass(frozen=True)
class Rows:
    """Which samples are looked at, and how noisy they are."""

    kept: NDArray[np.int64]
    """[t] of the window's times."""
    seconds: FloatArray
    """[t] from the first."""
    noise: FloatArray
    """[N] K."""

    def error(self, of_model: float = MODEL) -> FloatArray:
        """Covariance [N, t, t] of each channel's errors, K^2; of_model: see `MODEL`."""
        apart = np.abs(self.seconds[:, None] - self.seconds)
        lasting = of_model**2 * np.exp(-apart / _MINUTES)
        return np.asarray(lasting + (self.noise**2 + _SENSOR**2)[:, None, None] * np.eye(len(apart)))


@dataclass(frozen=True)
class Thermostat:
    """A heater whose switches show what its own sensor reads at its thresholds."""

    heater: str
    channel: int
    """Of its sensor."""
    on: FloatArray
    """s from the first row, when its status becomes on,"""
    off: FloatArray
    """s, and off."""
    below: float
    """K, at which it should,"""
    above: float
    """K, and at which not."""

    def excess(self, seconds: FloatArray, observed: FloatArray) -> float:
        """K by which telemetry [t, N] is above the thresholds when it switches."""
        valid = np.isfinite(observed[:, self.channel])
        if not valid.any():
            return np.nan
        read = observed[valid, self.channel]
        beyond = [
            float(np.median(np.interp(times, seconds[valid], read))) - level
            for times, level in ((self.on, self.below), (self.off, self.above))
        ]
        return 0.5 * (beyond[0] + beyond[1])


class ComparedWindow:
    """Telemetry of one window, as rows, beside what a model gives for them: what most wrongs of channels need."""

    telemetry: xarray.Dataset
    """That the window is of."""
    rows: Rows
    thermostats: tuple[Thermostat, ...] = ()

    @property
    def window(self) -> Window:
        """That is compared."""
        raise NotImplementedError

    @property
    def modelled(self) -> FloatArray:
        """[R] K at the centre of the prior. Raises SimulationFailure, as `begun` does."""
        raise NotImplementedError

    def begun_of(self, channel: int) -> FloatArray:
        """[R] K for each kelvin that a channel's node is warmer at the beginning. Raises SimulationFailure."""
        raise NotImplementedError

    @property
    def channels(self) -> tuple[str, ...]:
        """Temperature channels [N]."""
        return self.window.simulator.channels

    def are_nodes(self, channels: Iterable[str]) -> bool:
        """Whether channels read nodes, so that a gain or a time offset can be written: an output has none."""
        return all(self.window.scenario.observations[name].node is not None for name in channels)

    @cached_property
    def observed(self) -> FloatArray:
        """[t, N] K; NaN where there is nothing."""
        return self.readings(0.0)

    def readings(self, later: float) -> FloatArray:
        """Telemetry [t, N] K of so many s later."""
        times = self.window.times[self.rows.kept] + np.timedelta64(round(1e3 * later), "ms")
        # Moved telemetry has no other gaps: where it had, what cannot be compared would count as explained.
        bent = np.inf if later else MODEL
        return np.stack([series_at(self.telemetry, name, times, bent) for name in self.channels], axis=1)

    def smoothed(self, later: float, channels: Iterable[str]) -> float:
        """Nats that channels gain by being read so much later, s: what lies between two samples is less noisy."""
        utc = self.window.times[self.rows.kept]
        gained = 0.0
        for name in channels:
            place = self.channels.index(name)
            now, then = (
                noise_left(self.telemetry, name, utc + np.timedelta64(round(1e3 * after), "ms"))
                for after in (0.0, later)
            )
            gained += 0.5 * float(np.sum(self._noise_in_deviations[place] * (now - then)))
        return gained

    @cached_property
    def _noise_in_deviations(self) -> FloatArray:
        """[N, t] expected square of each sample's noise, in deviations of what its neighbours leave open."""
        told = [np.diag(np.linalg.inv(error)) for error in self.rows.error()]
        return np.asarray(self.rows.noise[:, None] ** 2 * np.stack(told))

    @cached_property
    def seconds(self) -> FloatArray:
        """[T] of the window's samples, from the first row."""
        return np.asarray((self.window.times - self.window.times[self.rows.kept[0]]) / np.timedelta64(1, "s"), float)

    def apart(self, channels: Iterable[str]) -> float:
        """s between samples of the one of some channels that is sampled least; 0: there are none."""
        times = self.telemetry["time"].to_numpy()
        known = [times[np.isfinite(self.telemetry[name].to_numpy())] for name in channels if name in self.telemetry]
        return max(
            (float(np.median(np.diff(number)) / np.timedelta64(1, "s")) for number in known if len(number) > 1),
            default=0.0,
        )

    @cached_property
    def as_read(self) -> FloatArray:
        """[R] K, the telemetry as it is; see `flat`."""
        return self._flat(self.observed)

    def flat(self, observed: FloatArray) -> FloatArray:
        """Telemetry [t, N] as rows [R], with how far it is above the thresholds when heaters switch."""
        # Most wrongs leave the telemetry as it is.
        return self.as_read if observed is self.observed else self._flat(observed)

    def _flat(self, observed: FloatArray) -> FloatArray:
        excess = [thermostat.excess(self.rows.seconds, observed) for thermostat in self.thermostats]
        return np.concatenate([observed.T.ravel(), excess])

    def of_channel(self, channel: int, values: FloatArray) -> FloatArray:
        """What [t, k] moves one channel by, as rows [R, k]; thresholds notice the mean."""
        t, count = len(values), len(self.channels)
        found = np.zeros((count * t + len(self.thermostats), values.shape[1]))
        found[channel * t : (channel + 1) * t] = values
        for row, thermostat in enumerate(self.thermostats):
            if thermostat.channel == channel:
                found[count * t + row] = values.mean(axis=0)
        return found

    def misread(self, channel: int, more: FloatArray) -> FloatArray:
        """What a channel that reads so much more, [t] K, moves, as rows [R, 1].

        Its first sample says where its node begins: that is off by as much.
        """
        return self.of_channel(channel, more[:, None]) - more[0] * self.begun[:, [channel]]

    def modelled_of(self, channel: int) -> FloatArray:
        """[t] K, of one channel."""
        t = len(self.rows.kept)
        return self.modelled[channel * t : (channel + 1) * t]

    @cached_property
    def begun(self) -> FloatArray:
        """[R, N] K, of all channels."""
        return np.stack([self.begun_of(channel) for channel in range(len(self.channels))], axis=1)


def rows_of(window: Window) -> Rows:
    """Samples of a window that are looked at, evenly over its time."""
    seconds = (window.times - window.times[0]) / np.timedelta64(1, "s")
    count = max(_LEAST_TIMES, _MOST_ROWS // max(len(window.simulator.channels), 1))
    wanted = np.linspace(seconds[0], seconds[-1], min(count, len(seconds)))
    kept = np.unique(np.abs(seconds[None] - wanted[:, None]).argmin(axis=1))
    noise = np.array([noise_of(column) for column in window.observed.T])
    return Rows(kept, seconds[kept], noise)


def thermostats(window: Window, rows: Rows) -> Iterator[Thermostat]:
    """Heaters of known thresholds whose sensor has a channel, and that switch on and off in a window."""
    held = pinned_heaters(window.scenario)
    for name, k, channel in known_thermostats(window):
        heater, bias = window.scenario.network.switches[name], window.scenario.observations[channel].bias
        valid = np.flatnonzero(np.isfinite(window.status[:, k]))
        turns = np.diff(window.status[valid, k] > 0.5)
        if name in held or not turns.any() or turns.mean() > _BUSY:
            continue
        seconds = (window.times[valid] - window.times[rows.kept[0]]) / np.timedelta64(1, "s")
        middle, on = 0.5 * (seconds[1:] + seconds[:-1])[turns], window.status[valid[1:], k][turns] > 0.5
        if on.any() and not on.all():
            place = window.simulator.channels.index(channel)
            yield Thermostat(name, place, middle[on], middle[~on], heater.on_below + bias, heater.off_above + bias)


def known_thermostats(window: Window) -> Iterator[tuple[str, int, str]]:
    """Heaters of known thresholds whose sensor has a channel: each with its place among them, and that channel."""
    scenario = window.scenario
    if not window.is_network:
        return
    for k, (name, heater) in enumerate(scenario.network.switches.items()):
        watching = [
            channel
            for channel in window.simulator.channels
            if scenario.observations[channel].node == heater.sensor and scenario.observations[channel].gain == 1.0
        ]
        if (heater.measured_by or "").startswith(INFERRED):
            continue
        if watching and not {f"heaters.{name}.on_below", f"heaters.{name}.off_above"} & scenario.uncertain:
            yield name, k, watching[0]
