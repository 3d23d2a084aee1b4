"""The simulator as a calibration sees it: theta in, temperatures and heater status at the telemetry's times out."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..compiled import Program, Row, Spare
from ..scenario import ICE_POINT
from .assembly import ParameterMap, assemble
from .calls import Calls
from .elimination import Elimination
from .integrate import SimulationFailure, copied, cores, in_parallel, switches
from .kernels.forward import FINISHED, TOO_MANY_SWITCHES, Outputs
from .kernels.lanes import WIDTH
from .network import Network
from .sampling import Observation, locate
from .steps import Accuracy
from .system import Drive, FloatArray, IntArray, Structure, Switch, System, packed_bounds, unpack

T = TypeVar("T")

_FEW = 3
"""So many simulations at once are faster than one by one."""
SCATTERED = 256
"""So many switches of a simulation have a scatter of their own; then it comes again."""
_CHUNK = 128
"""At most so many simulations are one call, eight at a time."""
_COLDEST, _HOTTEST = 0.0, 1e6
"""K, beyond which no sensor reads. A node that too much heat is taken from falls below absolute zero, where the law of
radiation cools it without end: its neighbours end at numbers that are finite and mean nothing."""


@dataclass(frozen=True)
class Trajectory:
    """What one simulation gives."""

    temperatures: FloatArray
    """[T, N] K, as the sensors would report them (with their errors)."""
    status: FloatArray
    """[T, H] 0 or 1 (a share of the step for a heater driven by measurement)."""
    duty_cycle: FloatArray
    """[H] share of the window's time that each heater is on."""
    switches: Switch
    error_variance: FloatArray = field(default_factory=lambda: np.empty(0))
    """[r] of the weights of the simulator's `error_basis` at this theta."""
    final: FloatArray = field(default_factory=lambda: np.empty(0))
    """[n] K at the window's end, of the nodes that have an initial temperature; empty: not known."""


class Simulator(Protocol):
    """Anything that turns theta into telemetry. Failed simulations raise SimulationFailure."""

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of theta's entries, [d]."""

    @property
    def channels(self) -> tuple[str, ...]:
        """Temperature channels, [N]."""

    @property
    def heaters(self) -> tuple[str, ...]:
        """[H]."""

    @property
    def error_basis(self) -> FloatArray | None:
        """[T, N, r] K, shapes in which the temperatures may be off, with independent Gaussian weights: of a surrogate.

        None: the simulator stands in for no other.
        """

    def heater_power(self, theta: FloatArray) -> FloatArray:
        """Power [H] W of each heater while it is on, at theta [d]; NaN where the simulator does not know."""

    def simulate(self, theta: FloatArray) -> Trajectory:
        """One simulation at theta [d]."""

    def simulate_many(self, thetas: FloatArray) -> list[Trajectory | None]:
        """Simulations at thetas [S, d], in parallel; None where one failed."""

    def linearise(self, theta: FloatArray) -> tuple[Trajectory, Callable[..., FloatArray]]:
        """A simulation and its vector-Jacobian product: cotangent of the temperatures [T, N] -> of theta [d].

        With an `error_basis`, the product also takes the cotangent [r] of the variances; that of a thermal network
        takes that [E] of the switches' times as `switches_bar`.
        """


@dataclass(frozen=True)
class NetworkSimulator:
    """A thermal network on one window.

    theta is the scenario's parameters followed by the initial temperature of every node with a capacity.
    """

    network: Network
    names: tuple[str, ...]
    """Of the scenario's parameters, and `TIME_ERROR` where time tags may be off."""
    mapping: ParameterMap
    drive: Drive
    observation: Observation
    channels: tuple[str, ...]
    channel_errors: IntArray
    """[3, N] positions of the channels' gains, biases and time offsets in the network's values."""
    scatter: FloatArray = field(default_factory=lambda: np.zeros(0))
    """[H] K, standard deviation of the temperature at which a heater switches; empty: none."""
    error_basis: FloatArray | None = None
    """[T, N, r] K, where it is a small network in the place of a larger one,"""
    error_variance: FloatArray = field(default_factory=lambda: np.empty(0))
    """[r] and the variances of these shapes' weights, at any theta."""
    accuracy: Accuracy | None = None
    """What its steps cost, where that has been looked at."""

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Names of theta's entries."""
        return (*self.names, *(f"initial.{self.network.nodes[k]}" for k in self.network.diffusive))

    @cached_property
    def elimination(self) -> Elimination | None:
        """Of massless states that nothing looks at; None: none is eliminated."""
        return self.network.eliminated({*self.observation.sensors.state.tolist(), *self.network.diffusive.tolist()})

    @property
    def integrated(self) -> Structure:
        """Of the system that is integrated."""
        return self.network.structure if self.elimination is None else self.elimination.structure

    @property
    def looked_at(self) -> Observation:
        """The observation of that system."""
        sensors = self.observation.sensors
        return replace(self.observation, sensors=sensors._replace(state=self._places(sensors.state)))

    def _places(self, states: IntArray) -> IntArray:
        """Where states of the network are in the system that is integrated."""
        return states if self.elimination is None else self.elimination.place[states]

    @property
    def heaters(self) -> tuple[str, ...]:
        """Names of the heaters."""
        return self.network.heaters

    def heater_power(self, theta: FloatArray) -> FloatArray:
        """Power [H] W of each heater, and of those switched with it, while it is on, at theta [d]."""
        numbers = self._assemble(theta)[0]
        on_switch = [(heater, *self.network.switched.get(heater, ())) for heater in self.heaters]
        return np.array(
            [
                sum(numbers[self.network.position(f"heaters.{h}.power")] for h in heater_names)
                for heater_names in on_switch
            ]
        )

    def numbers(self, theta: FloatArray) -> FloatArray:
        """The network's numbers [V] at theta [d]."""
        return self._assemble(theta)[0]

    def system(self, theta: FloatArray) -> System:
        """The canonical form at theta [d]."""
        return unpack(self.network.structure, self._assemble(theta)[1])

    def thresholds(self, theta: FloatArray) -> FloatArray:
        """At which temperatures of their sensors' nodes thermostats switch on, and off, at theta [d]: [2, H] K."""
        network = self.network
        numbers, packed = self._assemble(theta)
        system = unpack(network.structure, packed)
        found = np.stack([system.lower, system.upper])
        for k, node in enumerate(network.watched.tolist()):
            if node in network.heat_states:
                paths = (f"heaters.{network.heaters[k]}.{number}" for number in ("on_below", "off_above"))
                found[:, k] = numbers[[network.position(path) for path in paths]]
        return found

    def simulate(self, theta: FloatArray) -> Trajectory:
        """One simulation at theta [d]. Raises SimulationFailure."""
        with self._memories.borrowed(self._memory, 1, 0, 0) as calls:
            try:
                calls.simulate(np.array(theta))
            except SimulationFailure as failure:
                raise SimulationFailure(f"{failure}{self._crossed(theta)}") from None
            if not _succeeded(calls.outputs, 1)[0]:
                raise SimulationFailure("a temperature is one that no sensor reads")
            return self._trajectory(copied(calls.outputs, 1), 0)

    def _crossed(self, theta: FloatArray) -> str:
        """What is added to a failure where a thermostat switches off below where it switches on."""
        lower, upper = self.thresholds(theta) - ICE_POINT
        found = [
            f": heater '{name}' switches on below {on:.2f} degC and off above {off:.2f} degC"
            for name, on, off in zip(self.network.heaters, lower, upper, strict=True)
            if on >= off
        ]
        return "".join(found[:1])

    def with_heat(self, heat: FloatArray) -> NetworkSimulator:
        """The same with heat [h, 2 K], W, into the network's `heated` nodes in each step (`in_steps`), at any theta."""
        inputs = self.drive.inputs.copy()
        inputs.reshape(-1, inputs.shape[2])[:, inputs.shape[2] - len(heat) :] += heat.T
        return replace(self, drive=replace(self.drive, inputs=inputs))

    def simulate_many(self, thetas: FloatArray, heat: FloatArray | None = None) -> list[Trajectory | None]:
        """Simulations at thetas [S, d], in parallel; None where one failed.

        heat: [S, h, 2 K] W, of each as of `with_heat`, on top.
        """
        return self._simulate(thetas, None, heat)

    def simulate_scattered(
        self, thetas: FloatArray, rng: np.random.Generator, heat: FloatArray | None = None
    ) -> list[Trajectory | None]:
        """The same with thermostats that switch around their thresholds: each switch is off by a draw of its own."""
        if not self.scatter.any():
            return self._simulate(thetas, None, heat)
        drawn = self.scatter * rng.standard_normal((len(thetas), SCATTERED, 1, len(self.scatter)))
        return self.simulate_switching(thetas, np.repeat(drawn, 2, axis=2), heat)

    def simulate_switching(
        self, thetas: FloatArray, thresholds: FloatArray, heat: FloatArray | None = None
    ) -> list[Trajectory | None]:
        """The same with thresholds that are off by [S, E, 2, H] K, lower and upper, at a simulation's first E switches.

        Then these come again.
        """
        if self.network.heat_states:
            thresholds = np.stack([self._in_heat(*pair) for pair in zip(thetas, thresholds, strict=True)])
        return self._simulate(thetas, thresholds, heat)

    def _in_heat(self, theta: FloatArray, off: FloatArray) -> FloatArray:
        """How far thresholds that are off by [E, 2, H] K are so in the heat that is watched where a capacity slopes.

        The heat's slope by the temperature stands in the row of the temperature.
        """
        network, structure = self.network, self.network.structure
        at, system, found = self.thresholds(theta), self.system(theta), off.copy()
        for k, node in enumerate(network.watched.tolist()):
            if node in network.heat_states:
                row = slice(int(structure.linear_start[node]), int(structure.linear_start[node + 1]))
                linear = system.linear[row][structure.linear_column[row] == node].item()
                square = system.quadratic[structure.quadratic_row == node].item()
                found[..., k] = -(linear + square * (2.0 * at[:, k] + off[..., k])) * off[..., k]
        return found

    def score_many(self, thetas: FloatArray, score: Callable[[FloatArray, FloatArray], FloatArray]) -> FloatArray:
        """[S] a score of simulations at thetas [S, d], in parallel, of which nothing else is kept; NaN where one fails.

        score: of the temperatures [s, T, N] K and the status [s, T, H] of some of them, which it may not keep, [s].
        """

        def take(outputs: Outputs, count: int) -> list[float]:
            scores = score(outputs.temperatures[:count], outputs.status[:count])
            return list(np.where(_succeeded(outputs, count), scores, np.nan))

        return np.array(self._run(take, thetas))

    def _simulate(
        self, thetas: FloatArray, scatter: FloatArray | None, heat: FloatArray | None
    ) -> list[Trajectory | None]:
        def take(outputs: Outputs, count: int) -> list[Trajectory | None]:
            kept = copied(outputs, count)
            made = partial(self._trajectory, kept)
            return [made(k) if usable else None for k, usable in enumerate(_succeeded(kept, count).tolist())]

        return self._run(take, thetas, scatter, heat)

    def _run(
        self,
        take: Callable[[Outputs, int], list[T]],
        thetas: FloatArray,
        scatter: FloatArray | None = None,
        heat: FloatArray | None = None,
    ) -> list[T]:
        """What is taken of each simulation; take: of the outputs of so many, in place of which others come later."""
        few = len(thetas) < _FEW
        workers = cores()
        # Of the same size, and as many for each core.
        chunks = workers * math.ceil(len(thetas) / (workers * _CHUNK))
        size = 1 if few else WIDTH * math.ceil(len(thetas) / (WIDTH * chunks))

        def simulate(first: int) -> list[T]:
            part = slice(first, first + size)
            sizes = (0 if part is None else part.shape[1] for part in (scatter, heat))
            with self._memories.borrowed(self._memory, 1 if few else WIDTH, *sizes) as calls:
                count = len(thetas[part])
                calls.simulations[0], calls.thetas[:count] = count, thetas[part]
                if scatter is not None:
                    calls.integration.scatter[:count] = scatter[part]
                if heat is not None:
                    calls.integration.acting[:count] = heat[part]
                calls.run_forward.run()
                found = take(calls.outputs, count)
                outcomes = calls.outputs.outcome[:count].tolist()
            if not few:
                # With very many switches a simulation needs more room than a lane has.
                for k in [k for k, outcome in enumerate(outcomes, first) if outcome == TOO_MANY_SWITCHES]:
                    again = [None if part is None else part[k : k + 1] for part in (scatter, heat)]
                    found[k - first] = self._run(take, thetas[k : k + 1], *again)[0]
            return found

        found = in_parallel(lambda k: simulate(k * size), math.ceil(len(thetas) / size))
        return [theta for chunk in found for theta in chunk]

    def linearise(self, theta: FloatArray) -> tuple[Trajectory, Callable[..., FloatArray]]:
        """A simulation and its vector-Jacobian product.

        From the cotangents of the temperatures [T, N] and, if given, of the switches' times [E] to that of theta [d].
        """
        theta = np.array(theta)
        with self._linearised(theta) as calls:
            trajectory = self._trajectory(copied(calls.outputs, 1), 0)

        def cotangent(
            temperatures_bar: FloatArray,
            error_variance_bar: FloatArray | None = None,
            *,
            switches_bar: FloatArray | None = None,
        ) -> FloatArray:
            with self._linearised(theta) as calls:
                calls.temperatures_bar[:] = temperatures_bar
                calls.switches_bar[: calls.outputs.switches[0]] = 0.0 if switches_bar is None else switches_bar
                calls.run_backward.run()
                return calls.theta_bar.copy()

        return trajectory, cotangent

    def threshold_excess(
        self, theta: FloatArray, switches: Switch
    ) -> tuple[FloatArray, Callable[[FloatArray], FloatArray]]:
        """By how much a thermostat's sensor is above its threshold at given switches [E], K, as the heaters are driven.

        Of a node whose capacity depends on temperature, its heat over the capacity that is written counts, in K.
        Also its vector-Jacobian product: cotangent [E] -> of theta [d]. Raises SimulationFailure.
        """
        theta, structure = np.array(theta), self.integrated
        with self._linearised(theta) as calls:
            states, packed = calls.integration.states.copy(), calls.integration.packed[0].copy()
        # From when a heater may have switched it has half of its power; up to the switch the sensor goes on as before.
        times = self.drive.times
        last = self.drive.known_until[locate(switches.time - 1e-6, times).point, switches.heater]
        ahead = switches.time - times[last]
        back = locate(times[last] - ahead, times).point
        weight = np.divide(ahead, times[last] - times[back], out=np.zeros_like(ahead), where=back < last)
        sensor = structure.sensor[switches.heater]
        lower, upper = packed_bounds(structure)[4:6]
        threshold = np.where(switches.on > 0.5, lower, upper) + switches.heater
        reached = (1.0 + weight) * states[last, sensor] - weight * states[back, sensor]

        def pull_back(excess_bar: FloatArray) -> FloatArray:
            with self._linearised(theta) as calls:
                run = calls.integration
                run.temperatures_bar[:], run.switches_bar[: run.outputs.switches[0]] = 0.0, 0.0
                np.add.at(run.states_bar, (last, sensor), (1.0 + weight) * excess_bar)
                np.subtract.at(run.states_bar, (back, sensor), weight * excess_bar)
                run.adjoint()
                run.states_bar[:] = 0.0
                np.subtract.at(run.packed_bar, threshold, excess_bar)
                for row in calls.backward[1:]:
                    row()
                return calls.theta_bar.copy()

        return reached - packed[threshold], pull_back

    def calls(self) -> Calls:
        """Memory and C calls for one simulation at a time with its derivative."""
        return Calls(self, derivative=True)

    @property
    def rows(self) -> tuple[Row, ...]:
        """Calls of all kernels that simulations and their derivatives need."""
        calls = self.calls()
        with self._memories.borrowed(self._memory, WIDTH, 0, 0) as many:
            return (*calls.forward, *calls.backward, *many.forward, Program([]).row)

    @contextmanager
    def _linearised(self, theta: FloatArray) -> Iterator[Calls]:
        """Memory with the simulation at theta (that very array) and for its derivative."""
        with self._derivatives.borrowed(self.calls) as calls:
            calls.simulate(theta)
            yield calls

    @cached_property
    def _derivatives(self) -> Spare[Calls]:
        return Spare()

    @cached_property
    def _memories(self) -> Spare[Calls]:
        return Spare()

    def _memory(self, lanes: int, scatter: int, acting: int) -> Calls:
        """For simulations without a derivative: so many at once, scattered switches and nodes that are heated."""
        return Calls(self, rooms=1 if lanes == 1 else _CHUNK, lanes=lanes, scatter=scatter, acting=acting)

    def release(self) -> None:
        """Give back the memory that is kept for the next simulations, while none goes on."""
        for kept in ("_derivatives", "_memories"):
            self.__dict__.pop(kept, None)

    def _assemble(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        return assemble(self.mapping, self.network.terms, theta)

    def _trajectory(self, outputs: Outputs, simulation: int) -> Trajectory:
        return Trajectory(
            outputs.temperatures[simulation],
            outputs.status[simulation],
            outputs.duty_cycle[simulation],
            switches(outputs, simulation),
            self.error_variance,
            outputs.final[simulation, self._places(self.network.diffusive)],
        )


def _succeeded(outputs: Outputs, count: int) -> NDArray[np.bool_]:
    """Which of the first so many simulations [count] have finished, at temperatures that there may be."""
    temperatures = outputs.temperatures[:count]
    possible = ((temperatures > _COLDEST) & (temperatures < _HOTTEST)).all(axis=(1, 2))
    return np.asarray((outputs.outcome[:count] == FINISHED) & possible)
