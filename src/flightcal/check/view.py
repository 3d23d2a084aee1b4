"""One window of a scenario and its telemetry, as what is compared: some samples, a simulation and what moves it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import xarray
from numpy.typing import NDArray

from ..environment import seconds_later
from ..probability import CENTRAL
from ..problem import HeatModel, Problem, Window, heat_model, initial_priors, responses, unit_heats
from ..scenario import Heat, HeatPattern, HeatSlow, settable
from ..simulator import FloatArray, NetworkSimulator, SimulationFailure
from .samples import noise_left, noise_of, series_at
from .sunlight import Sunlight

HEAT = Heat(pattern=HeatPattern(harmonics=4), slow=HeatSlow(scale=0.02))
"""What a simulator may lack and be right: heat of some percent of what flows through each node."""
INFERRED = "status by temperature of "
"""Begins the names of channels that are no telemetry: how probable it is that a heater is on, by its own sensor."""
_ANY, _MEAN = 0.5, 0.3
"""Of its power, deviations of the heat of a heater of which nobody knows when it is on: at a time, when on and off are
both half of it from what is expected, and of its mean, that lies anywhere from none to all of it."""
_IN_GAPS = 0.5
"""Of its power, deviation of a heater's heat where its status has a gap."""
NO_LINK = 1e-9
"""W/K, of nodes that are not linked: by more they might be."""
SHARES = ("absorptivity", "emissivity", "albedo")
"""Numbers that are one at most."""
WIDENED = 10.0
"""Times as wide is a prior that may be wrong."""
_MOST_ROWS = 500
"""Samples of all channels together that are looked at."""
_LEAST_TIMES = 40
_SENSOR = 0.1
"""K, of a sample, beside what the telemetry shows of its noise."""
MODEL, _MINUTES = 0.25, 600.0
"""K and s: deviation and correlation time of what a right model still has in each channel."""
_NUDGE = 0.05
"""Of what flows through a node, heat at most by which its effect is measured."""
_BUSY = 0.25
"""Share of samples between which a heater switches, from which these tell nothing of its thresholds."""
Moved = tuple[tuple[int, float], ...]
"""Entries of theta, each with a factor."""


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


@dataclass(frozen=True)
class Memory:
    """A channel that reads its node's temperature of a while, not of a moment."""

    channel: int
    weights: FloatArray
    """[t, T] of the window's times in what is read at each row."""


@dataclass(frozen=True)
class Point:
    """A simulation and what moves it, on rows [R]: [N t], channel by channel, and one for each thermostat."""

    z: FloatArray
    """[d]"""
    simulated: FloatArray
    """[T, N] K, at the window's samples."""
    temperatures: FloatArray
    """[R] K, as they are read."""
    effects: FloatArray
    """[R, d] K of a deviation of each prior."""
    heat: FloatArray
    """[R, m] K of a deviation of each unmodelled heat."""
    jitter: FloatArray
    """[R, s] K of a deviation of each switch's time."""


class Comparison:
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
            (float(np.median(np.diff(own)) / np.timedelta64(1, "s")) for own in known if len(own) > 1), default=0.0
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
        excess = [own.excess(self.rows.seconds, observed) for own in self.thermostats]
        return np.concatenate([observed.T.ravel(), excess])

    def of_channel(self, channel: int, values: FloatArray) -> FloatArray:
        """What [t, k] moves one channel by, as rows [R, k]; thresholds notice the mean."""
        t, count = len(values), len(self.channels)
        found = np.zeros((count * t + len(self.thermostats), values.shape[1]))
        found[channel * t : (channel + 1) * t] = values
        for row, own in enumerate(self.thermostats):
            if own.channel == channel:
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


@dataclass(frozen=True)
class View(Comparison):
    """One window of a scenario, and its telemetry as rows."""

    problem: Problem
    """Of that window alone, driven by measured status where there is one."""
    telemetry: xarray.Dataset
    rows: Rows
    heat: HeatModel
    thermostats: tuple[Thermostat, ...] = ()
    widened: int | None = None
    """The entry whose prior is wider than written."""
    moved: Moved = ()
    """Entries whose priors are for so many times the values that are written."""
    memory: Memory | None = None
    """Of one channel."""

    @property
    def window(self) -> Window:
        """That of the problem."""
        return self.problem.windows[0]

    @property
    def network(self) -> NetworkSimulator:
        """What simulates the window."""
        assert self.window.network is not None
        return self.window.network

    def utc(self, seconds: FloatArray) -> NDArray[np.datetime64]:
        """Times at seconds from the window's start."""
        return seconds_later(self.window.start, seconds)

    def simulated_by(self, **changes: Any) -> Window:
        """The window with changes of its simulator."""
        return replace(self.window, simulator=replace(self.network, **changes))

    def with_numbers(self, written: FloatArray) -> Window:
        """The window with other numbers [P] written in its scenario."""
        return self.window.with_written(written)

    def with_inputs(self, inputs: FloatArray) -> Window:
        """The window with other inputs [K, 2, q]."""
        return self.simulated_by(drive=replace(self.network.drive, inputs=inputs))

    def exchanged(self, ones: list[int], others: list[int]) -> Window:
        """The window with some columns of its inputs in the place of others, and these in theirs."""
        inputs = self.network.drive.inputs.copy()
        inputs[:, :, ones + others] = inputs[:, :, others + ones]
        return self.with_inputs(inputs)

    @cached_property
    def sunlight(self) -> Sunlight:
        """Of the window."""
        return Sunlight(self.window.scenario, self.window.start, float(self.network.drive.times[-1]))

    @cached_property
    def spread(self) -> FloatArray:
        """[d] deviations of z; see `Priors.spread`."""
        spread = self.problem.priors.spread()
        if self.widened is not None:
            spread[self.widened] *= WIDENED
        if self.moved:
            lower, upper = (self.problem.to_z(self._quantile(p)) for p in CENTRAL)
            for entry, _ in self.moved:
                spread[entry] = 0.5 * (upper - lower)[entry]
        return spread

    @property
    def median(self) -> FloatArray:
        """theta [d] of the priors."""
        return self._quantile(0.5)

    @cached_property
    def numbers(self) -> FloatArray:
        """[V] of the simulator, at the priors' medians."""
        return self.network.numbers(self.problem.at(self.window, self.median)[self.window.simulated])

    @cached_property
    def units(self) -> dict[str, str]:
        """SI units of the scenario's numbers by their paths; empty for what has no dimension."""
        return {path: own.unit for path, own in settable(self.window.scenario).items()}

    def _quantile(self, probability: float) -> FloatArray:
        theta = self.problem.priors.quantile(probability)
        for entry, times in self.moved:
            theta[entry] *= times
        return theta

    def centre(self, observed: FloatArray) -> FloatArray:
        """z [d] at the prior's medians; initial temperatures follow the first samples of `observed` [t, N]."""
        theta = self.median
        since = self.window.first_sample + self.rows.seconds
        for name, prior in initial_priors(self.problem.scenario, self.channels, since, observed).items():
            if name in self.problem.names and hasattr(prior, "mean"):
                theta[self.problem.names.index(name)] = prior.mean
        return self.problem.to_z(theta)

    @cached_property
    def middle(self) -> FloatArray:
        """[d] that of the telemetry as it is."""
        return self.centre(self.observed)

    @cached_property
    def modelled(self) -> FloatArray:
        """[R] K there. Raises SimulationFailure, as `begun` does."""
        return self.temperatures(self.window, self.middle)

    def begun_of(self, channel: int) -> FloatArray:
        """[R] K for each kelvin that a channel's node is warmer at the beginning. Raises SimulationFailure."""
        return self._warmer(self.channels[channel]) - self.modelled

    def _warmer(self, channel: str) -> FloatArray:
        """[R] K with a channel's node a kelvin warmer at the beginning, where that is an entry."""
        name = f"initial.{self.window.scenario.observations[channel].node}"
        theta = self.problem.to_theta(self.middle)
        if name in self.problem.names:
            theta[self.problem.names.index(name)] += 1.0
        return self.temperatures(self.window, self.problem.to_z(theta))

    def temperatures(self, window: Window, z: FloatArray) -> FloatArray:
        """[R] K of a window like this one. Raises SimulationFailure."""
        return self.read(self.simulated(window, z))

    def simulated(self, window: Window, z: FloatArray) -> FloatArray:
        """[T, N] K of a window like this one. Raises SimulationFailure."""
        return window.simulate(self.problem.at(self.window, self.problem.to_theta(z))).temperatures

    def point(self, window: Window, z: FloatArray, like: Point | None = None) -> Point:
        """A simulation and what moves it; like: whose response to heat is near enough. Raises SimulationFailure."""
        beside = replace(self.problem, windows=(window,))
        flat = self._rows(beside.jacobians(z)[0]) * self.spread
        simulated = self.simulated(window, z)
        temperatures = self.read(simulated)
        if like is not None:
            return Point(z, simulated, temperatures, flat, like.heat, like.jitter)
        units = unit_heats(self.heat, window)
        inside = self.problem.at(self.window, self.problem.to_theta(z))
        found = responses(window, inside, self.heat, units, self._rows)
        parts: dict[bool, list[FloatArray]] = {True: [np.empty((flat.shape[0], 0))], False: []}
        for group, response in zip(self.heat.groups, found, strict=True):
            parts[group.part in ("switches", "changes")].append(group.size * response)
        heaters = window.scenario.network.heaters
        parts[True] += [self.unknown_heat(window, z, name, heaters[name].node) for name in self.unknown]
        parts[True] += [self._heat_in_gaps(window, z, k, own) for own, k in self.switch_of.items()]
        heat, jitter = (np.concatenate(parts[switches], axis=1) for switches in (False, True))
        return Point(z, simulated, temperatures, flat, heat, jitter)

    @cached_property
    def unknown(self) -> tuple[str, ...]:
        """Heaters of which nobody knows when they are on, or not always."""
        return tuple(name for name in self.inferred if self._doubt(self.window, name).any())

    @cached_property
    def inferred(self) -> tuple[str, ...]:
        """Heaters without a measured status."""
        model = self.window.scenario.network
        silent = [name for name, own in model.switches.items() if (own.measured_by or "").startswith(INFERRED)]
        return tuple(other for name in silent for other in model.on_switch(name))

    def _doubt(self, window: Window, heater: str) -> FloatArray:
        """[K] how unknown it is whether a heater is on, from 0 to 1."""
        assert window.network is not None
        on = np.nan_to_num(window.network.drive.measured[:, self.switch_of[heater]])
        return np.asarray(2.0 * np.sqrt(on * (1.0 - on)))

    def unknown_heat(self, window: Window, z: FloatArray, heater: str, node: str) -> FloatArray:
        """[R, k] K in a node of the heat of a heater of `unknown`. Raises SimulationFailure."""
        return self.any_heat(window, z, heater, node, self._doubt(window, heater))

    def any_heat(self, window: Window, z: FloatArray, heater: str, node: str, share: FloatArray) -> FloatArray:
        """[R, k] K in a node of a heater that may be on at any time: in the mean, and from row to row.

        share: [K] of its heat that may. Raises SimulationFailure.
        """
        each = pieces(window, self.rows.seconds) * np.repeat(share, 2)
        each = each[each.any(axis=1)]
        if node not in self.heat.nodes or not len(each):
            return np.empty((self.begun.shape[0], 0))
        effects = self.response(window, z, node, each)
        power = self.window.scenario.network.heaters[heater].power
        return power * np.column_stack([_MEAN * effects.sum(axis=1), _ANY * effects])

    @cached_property
    def switch_of(self) -> dict[str, int]:
        """Of every heater the place of its switch in the status."""
        model = self.window.scenario.network
        return {name: k for k, switch in enumerate(self.network.heaters) for name in model.on_switch(switch)}

    def _heat_in_gaps(self, window: Window, z: FloatArray, switch: int, heater: str) -> FloatArray:
        """[R, k] K of a heater's heat where its status has gaps, each in short pieces. Raises SimulationFailure."""
        own, drive = self.window.scenario.network.heaters[heater], self.network.drive
        unknown = np.isnan(drive.measured[:, switch]).astype(int)
        gaps = drive.times[np.flatnonzero(np.diff(unknown, prepend=0, append=0))].reshape(-1, 2)
        if own.node not in self.heat.nodes or not len(gaps):
            return np.empty((self.begun.shape[0], 0))
        edges = [np.linspace(first, last, int(np.ceil((last - first) / _MINUTES)) + 1) for first, last in gaps]
        series = np.concatenate([pieces(window, own) for own in edges])
        return _IN_GAPS * own.power * self.response(window, z, own.node, series)

    def heat_of(self, window: Window) -> HeatModel:
        """Of a window like this one, at the prior's median."""
        median = self.problem.at(self.window, self.median)
        return heat_model(window.scenario, _usual(window), (window,), median)

    def response(self, window: Window, z: FloatArray, node: str, series: FloatArray) -> FloatArray:
        """[R, k] K for heat of series [k, 2 K] W in each step of a node. Raises SimulationFailure."""
        simulator = window.network
        assert simulator is not None
        # So little that temperatures answer linearly, whatever the series is in.
        nudge = _NUDGE * max(self.heat.flow[self.heat.nodes.index(node)], 0.1) / (float(np.abs(series).max()) or 1.0)
        heat = np.zeros((len(series) + 1, len(simulator.network.heated), series.shape[1]))
        heat[1:, simulator.network.heated.index(node)] = nudge * series
        return self.warmed(window, z, heat) / nudge

    def warmed(self, window: Window, z: FloatArray, heat: FloatArray) -> FloatArray:
        """[R, k] K by which heat [1 + k, h, 2 K] W in each step warms more than the first. Raises SimulationFailure."""
        assert window.network is not None
        inside = self.problem.at(self.window, self.problem.to_theta(z))[self.window.simulated]
        runs = window.network.simulate_many(np.tile(inside, (len(heat), 1)), heat)
        if any(run is None for run in runs):
            raise SimulationFailure("a simulation with other heat fails")
        first, *others = (self.read(run.temperatures) for run in runs if run is not None)
        return np.asarray((np.stack(others) - first).T)

    def read(self, temperatures: FloatArray) -> FloatArray:
        """[R] K of temperatures [T, N] of the window."""
        return self._rows(temperatures[..., None])[:, 0]

    def _rows(self, values: FloatArray) -> FloatArray:
        """[R, k] of [T, N, k]; nothing moves what thermostats read at their thresholds."""
        read = values[self.rows.kept]
        if self.memory is not None:
            read[:, self.memory.channel] = self.memory.weights @ values[:, self.memory.channel]
        flat = np.moveaxis(read, 1, 0).reshape(read.shape[0] * read.shape[1], values.shape[2])
        return np.concatenate([flat, np.zeros((len(self.thermostats), values.shape[2]))])


def pieces(window: Window, edges: FloatArray) -> FloatArray:
    """Series [k, 2 K] that are 1 in the steps of a window between two edges [k + 1], s from its start, and else 0."""
    assert window.network is not None
    grid = window.network.drive.times
    place = np.searchsorted(edges, 0.5 * (grid[1:] + grid[:-1]), side="right") - 1
    return np.repeat((place == np.arange(len(edges) - 1)[:, None]).astype(float), 2, axis=1)


def rows_of(window: Window) -> Rows:
    """Samples of a window that are looked at, evenly over its time."""
    seconds = (window.times - window.times[0]) / np.timedelta64(1, "s")
    count = max(_LEAST_TIMES, _MOST_ROWS // max(len(window.simulator.channels), 1))
    wanted = np.linspace(seconds[0], seconds[-1], min(count, len(seconds)))
    kept = np.unique(np.abs(seconds[None] - wanted[:, None]).argmin(axis=1))
    noise = np.array([noise_of(column) for column in window.observed.T])
    return Rows(kept, seconds[kept], noise)


def _usual(window: Window) -> Heat:
    """Heat that a window's simulator may lack and be right."""
    heat = window.scenario.heat
    return heat if isinstance(heat, Heat) else HEAT


def view_of(problem: Problem, telemetry: xarray.Dataset) -> View:
    """Of a problem of one window, and the telemetry it was built from."""
    (window,) = problem.windows
    median = problem.at(window, problem.priors.median())
    rows = rows_of(window)
    heat = heat_model(window.scenario, _usual(window), (window,), median)
    return View(problem, telemetry, rows, heat, tuple(thermostats(window, rows)))


def thermostats(window: Window, rows: Rows) -> Iterator[Thermostat]:
    """Heaters of known thresholds whose sensor has a channel, and that switch on and off in a window."""
    for name, k, channel in known_thermostats(window):
        heater, bias = window.scenario.network.switches[name], window.scenario.observations[channel].bias
        valid = np.flatnonzero(np.isfinite(window.status[:, k]))
        turns = np.diff(window.status[valid, k] > 0.5)
        if not turns.any() or turns.mean() > _BUSY:
            continue
        seconds = (window.times[valid] - window.times[rows.kept[0]]) / np.timedelta64(1, "s")
        middle, on = 0.5 * (seconds[1:] + seconds[:-1])[turns], window.status[valid[1:], k][turns] > 0.5
        if on.any() and not on.all():
            place = window.simulator.channels.index(channel)
            yield Thermostat(name, place, middle[on], middle[~on], heater.on_below + bias, heater.off_above + bias)


def known_thermostats(window: Window) -> Iterator[tuple[str, int, str]]:
    """Heaters of known thresholds whose sensor has a channel: each with its place among them, and that channel."""
    scenario = window.scenario
    if window.network is None:
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
