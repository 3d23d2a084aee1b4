"""A window of a thermal network beside its telemetry: what it simulates there, and what moves that."""

from __future__ import annotations

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
from ..telemetry import spells
from .compared_window import INFERRED, ComparedWindow, Rows, Thermostat, rows_of, thermostats
from .sunlight import Sunlight

HEAT = Heat(pattern=HeatPattern(harmonics=4), slow=HeatSlow(scale=0.02))
"""What a simulator may lack and be right: heat of some percent of what flows through each node."""
_PARTS = 12.0
"""Of an orbit, in each of which the mean heat of such a heater is another one."""
_ANY, _MEAN = 0.5, 0.3
"""Of its power, deviations of the heat of a heater of which nobody knows when it is on: at a time, when on and off are
both half of it from what is expected, and of its mean, that lies anywhere from none to all of it."""
_IN_GAPS, _PIECE = 0.5, 600.0
"""Of its power, deviation of a heater's heat where its status has a gap, and s that a piece of it lasts at most."""
NO_LINK = 1e-9
"""W/K, of nodes that are not linked: by more they might be."""
SHARES = ("absorptivity", "emissivity", "albedo")
"""Numbers that are one at most."""
WIDENED = 10.0
"""Times as wide is a prior that may be wrong."""
_NUDGE = 0.05
"""Of what flows through a node, heat at most by which its effect is measured."""
Moved = tuple[tuple[int, float], ...]
"""Entries of theta, each with a factor."""


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


@dataclass(frozen=True)
class View(ComparedWindow):
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
        return {path: number.unit for path, number in settable(self.window.scenario).items()}

    def _quantile(self, probability: float) -> FloatArray:
        theta = self.problem.priors.quantile(probability)
        for entry, times in self.moved:
            theta[entry] *= times
        return theta

    def centre(self, observed: FloatArray) -> FloatArray:
        """z [d] at the prior's medians; initial temperatures follow the first samples of `observed` [t, N]."""
        theta, moved = self.median, {entry for entry, _ in self.moved}
        since = self.window.first_sample + self.rows.seconds
        for name, prior in initial_priors(self.problem.scenario, self.channels, since, observed).items():
            entry = self.problem.names.index(name) if name in self.problem.names else None
            if entry is not None and entry not in moved and hasattr(prior, "mean"):
                theta[entry] = prior.mean
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
        parts[True] += [self._heat_in_gaps(window, z, k, name) for name, k in self.switch_of.items()]
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
        silent = [name for name, heater in model.switches.items() if (heater.measured_by or "").startswith(INFERRED)]
        return tuple(other for name in silent for other in model.on_switch(name))

    def _doubt(self, window: Window, heater: str) -> FloatArray:
        """[K] how unknown it is whether a heater is on, from 0 to 1."""
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
        # How long it is on changes with the sunlight: it is unknown in each part of an orbit, too.
        part = np.arange(effects.shape[1]) * _PARTS * self.rows.seconds[-1] // (window.period * effects.shape[1])
        slowly = effects @ (part[:, None] == np.unique(part))
        power = self.window.scenario.network.heaters[heater].power
        return power * np.column_stack([_MEAN * effects.sum(axis=1), _MEAN * slowly, _ANY * effects])

    @cached_property
    def switch_of(self) -> dict[str, int]:
        """Of every heater the place of its switch in the status."""
        model = self.window.scenario.network
        return {name: k for k, switch in enumerate(self.network.heaters) for name in model.on_switch(switch)}

    def _heat_in_gaps(self, window: Window, z: FloatArray, switch: int, heater: str) -> FloatArray:
        """[R, k] K of a heater's heat where its status has gaps, each in short pieces. Raises SimulationFailure."""
        block, drive = self.window.scenario.network.heaters[heater], self.network.drive
        gaps = drive.times[spells(np.isnan(drive.measured[:, switch]))]
        if block.node not in self.heat.nodes or not len(gaps):
            return np.empty((self.begun.shape[0], 0))
        edges = [np.linspace(first, last, int(np.ceil((last - first) / _PIECE)) + 1) for first, last in gaps]
        series = np.concatenate([pieces(window, edge) for edge in edges])
        return _IN_GAPS * block.power * self.response(window, z, block.node, series)

    def heat_of(self, window: Window) -> HeatModel:
        """Of a window like this one, at the prior's median."""
        median = self.problem.at(self.window, self.median)
        return heat_model(window.scenario, _usual(window), (window,), median)

    def response(self, window: Window, z: FloatArray, node: str, series: FloatArray) -> FloatArray:
        """[R, k] K for heat of series [k, 2 K] W in each step of a node. Raises SimulationFailure."""
        simulator = window.network
        # So little that temperatures answer linearly, whatever the series is in.
        nudge = _NUDGE * max(self.heat.flow[self.heat.nodes.index(node)], 0.1) / (float(np.abs(series).max()) or 1.0)
        heat = np.zeros((len(series) + 1, len(simulator.network.heated), series.shape[1]))
        heat[1:, simulator.network.heated.index(node)] = nudge * series
        return self.warmed(window, z, heat) / nudge

    def warmed(self, window: Window, z: FloatArray, heat: FloatArray) -> FloatArray:
        """[R, k] K by which heat [1 + k, h, 2 K] W in each step warms more than the first. Raises SimulationFailure."""
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
    grid = window.network.drive.times
    place = np.searchsorted(edges, 0.5 * (grid[1:] + grid[:-1]), side="right") - 1
    return np.repeat((place == np.arange(len(edges) - 1)[:, None]).astype(float), 2, axis=1)


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
