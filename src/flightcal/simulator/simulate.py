"""The simulator as a calibration sees it: theta in, temperatures and heater status at the telemetry's times out."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, Protocol

import numpy as np
import xarray

from ..scenario import Scenario
from .assembly import ParameterMap, assemble, pull_back_assembly
from .forward import FINISHED, TOO_MANY_SWITCHES, Outputs
from .inputs import Times, build_drive
from .integrate import (
    Observation,
    Run,
    SimulationFailure,
    in_parallel,
    integrate_many,
    integrate_packed,
    pull_back_packed,
    switches,
)
from .lanes import WIDTH
from .network import Network, build_network, sensor_state
from .sampling import Sensors, locate, spread
from .system import Drive, FloatArray, IntArray, Switch, System, packed_bounds, unpack

_FEW = 3
"""So many simulations at once are faster than one by one."""
_SCATTERED = 256
"""So many switches of a simulation have a scatter of their own; then it comes again."""
_CHUNK = 128
"""At most so many simulations are one call, eight at a time."""


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


def parameter_map(network: Network, scenario: Scenario) -> ParameterMap:
    """The map of a scenario's parameters; lint has seen that no number is set twice, or both set and scaled."""
    parameters = list(scenario.parameters.values())
    sets = [(network.position(path), k) for k, parameter in enumerate(parameters) for path in parameter.sets]
    scales = [(network.position(path), k) for k, parameter in enumerate(parameters) for path in parameter.scales]
    return ParameterMap(
        len(parameters),
        network.values,
        *np.array(sets, dtype=np.int64).reshape(-1, 2).T.copy(),
        *np.array(scales, dtype=np.int64).reshape(-1, 2).T.copy(),
    )


@dataclass(frozen=True)
class NetworkSimulator:
    """A thermal network on one window.

    theta is the scenario's parameters followed by the initial temperature of every node with a capacity.
    """

    network: Network
    names: tuple[str, ...]
    """Of the scenario's parameters."""
    mapping: ParameterMap
    drive: Drive
    observation: Observation
    channels: tuple[str, ...]
    channel_errors: IntArray
    """[3, N] positions of the channels' gains, biases and time offsets in the network's values."""
    scatter: FloatArray = field(default_factory=lambda: np.zeros(0))
    """[H] K, standard deviation of the temperature at which a heater switches; empty: none."""

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Names of theta's entries."""
        return (*self.names, *(f"initial.{self.network.nodes[k]}" for k in self.network.diffusive))

    @property
    def error_basis(self) -> None:
        """None: it stands in for no other simulator."""
        return None

    @property
    def heaters(self) -> tuple[str, ...]:
        """Names of the heaters."""
        return self.network.heaters

    def heater_power(self, theta: FloatArray) -> FloatArray:
        """Power [H] W of each heater while it is on, at theta [d]."""
        positions = [self.network.position(f"heaters.{heater}.power") for heater in self.heaters]
        return self._assemble(theta)[0][positions]

    def system(self, theta: FloatArray) -> System:
        """The canonical form at theta [d]."""
        return unpack(self.network.structure, self._assemble(theta)[1])

    def simulate(self, theta: FloatArray) -> Trajectory:
        """One simulation at theta [d]."""
        numbers, packed = self._assemble(theta)
        return _trajectory(self._integrate(numbers, packed, derivative=False).outputs, 0)

    def simulate_many(self, thetas: FloatArray) -> list[Trajectory | None]:
        """Simulations at thetas [S, d], in parallel; None where one failed."""
        return self._simulate(thetas, None)

    def simulate_scattered(self, thetas: FloatArray, rng: np.random.Generator) -> list[Trajectory | None]:
        """The same with thermostats that switch around their thresholds: each switch is off by a draw of its own."""
        if not self.scatter.any():
            return self._simulate(thetas, None)
        drawn = rng.standard_normal((len(thetas), _SCATTERED, len(self.scatter)))
        return self._simulate(thetas, self.scatter * drawn)

    def _simulate(self, thetas: FloatArray, scatter: FloatArray | None) -> list[Trajectory | None]:
        def of(part: Any) -> FloatArray | None:
            return None if scatter is None else scatter[part]

        if len(thetas) < _FEW:
            return in_parallel(lambda k: self._simulate_or_none(thetas[k], of(k)), len(thetas))
        size = min(_CHUNK, WIDTH * math.ceil(len(thetas) / (WIDTH * (os.cpu_count() or 1))))
        chunks = [slice(first, first + size) for first in range(0, len(thetas), size)]
        found = in_parallel(lambda k: self._simulate_lanes(thetas[chunks[k]], of(chunks[k])), len(chunks))
        return [trajectory for chunk in found for trajectory in chunk]

    def linearise(self, theta: FloatArray) -> tuple[Trajectory, Callable[..., FloatArray]]:
        """A simulation and its vector-Jacobian product.

        From the cotangents of the temperatures [T, N] and, if given, of the switches' times [E] to that of theta [d].
        """
        numbers, packed = self._assemble(theta)
        run = self._integrate(numbers, packed, derivative=True)
        return _trajectory(run.outputs, 0), partial(self._cotangent, theta, numbers, packed, run)

    def threshold_excess(
        self, theta: FloatArray, switches: Switch
    ) -> tuple[FloatArray, Callable[[FloatArray], FloatArray]]:
        """By how much a thermostat's sensor is above its threshold at given switches [E], K, as the heaters are driven.

        Also its vector-Jacobian product: cotangent [E] -> of theta [d]. Raises SimulationFailure.
        """
        structure = self.network.structure
        numbers, packed = self._assemble(theta)
        run = self._integrate(numbers, packed, derivative=True)
        at = locate(switches.time, self.drive.times)
        sensor = structure.sensor[switches.heater]
        lower, upper = packed_bounds(structure)[3:5]
        threshold = np.where(switches.on > 0.5, lower, upper) + switches.heater
        left, right = run.states[at.point, sensor], run.states[at.point + 1, sensor]

        def pull_back(excess_bar: FloatArray) -> FloatArray:
            states_bar = np.zeros(run.states.shape)
            np.add.at(states_bar, (at.point, sensor), (1.0 - at.weight) * excess_bar)
            np.add.at(states_bar, (at.point + 1, sensor), at.weight * excess_bar)
            packed_bar = pull_back_packed(structure, packed, self.drive, run, states_bar)
            np.subtract.at(packed_bar, threshold, excess_bar)
            return pull_back_assembly(
                self.mapping, self.network.terms, theta, numbers, packed_bar,
                self.channel_errors, np.zeros(self.channel_errors.shape),
            )  # fmt: skip

        return (1.0 - at.weight) * left + at.weight * right - packed[threshold], pull_back

    def _assemble(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        return assemble(self.mapping, self.network.terms, theta)

    def _integrate(
        self, numbers: FloatArray, packed: FloatArray, *, derivative: bool, scatter: FloatArray | None = None
    ) -> Run:
        errors = numbers[self.channel_errors]
        return integrate_packed(
            self.network.structure, packed, self.drive, self.observation, errors,
            derivative=derivative, scatter=scatter,
        )  # fmt: skip

    def _simulate_or_none(self, theta: FloatArray, scatter: FloatArray | None) -> Trajectory | None:
        try:
            return _trajectory(self._integrate(*self._assemble(theta), derivative=False, scatter=scatter).outputs, 0)
        except SimulationFailure:
            return None

    def _simulate_lanes(self, thetas: FloatArray, scatter: FloatArray | None) -> list[Trajectory | None]:
        numbers, packed = self._assemble(thetas)
        errors = np.ascontiguousarray(numbers[:, self.channel_errors])
        outputs = integrate_many(self.network.structure, packed, self.drive, self.observation, errors, scatter)
        return [
            # With very many switches a simulation needs more room than a lane has.
            self._simulate_or_none(theta, None if scatter is None else scatter[k]) if outcome == TOO_MANY_SWITCHES
            else _trajectory(outputs, k) if outcome == FINISHED
            else None
            for k, (theta, outcome) in enumerate(zip(thetas, outputs.outcome.tolist(), strict=True))
        ]  # fmt: skip

    def _cotangent(
        self,
        theta: FloatArray,
        numbers: FloatArray,
        packed: FloatArray,
        run: Run,
        temperatures_bar: FloatArray,
        switches_bar: FloatArray | None = None,
    ) -> FloatArray:
        network, observation, errors = self.network, self.observation, numbers[self.channel_errors]
        states_bar, errors_bar = np.empty(run.states.shape), np.empty(errors.shape)
        spread(
            observation.sampling, observation.sensors, self.drive.times, run.states, errors,
            temperatures_bar, states_bar, errors_bar,
        )  # fmt: skip
        packed_bar = pull_back_packed(network.structure, packed, self.drive, run, states_bar, switches_bar)
        return pull_back_assembly(
            self.mapping, network.terms, theta, numbers, packed_bar, self.channel_errors, errors_bar
        )


def _trajectory(outputs: Outputs, simulation: int) -> Trajectory:
    return Trajectory(
        outputs.temperatures[simulation],
        outputs.status[simulation],
        outputs.duty_cycle[simulation],
        switches(outputs, simulation),
    )


def network_simulator(
    scenario: Scenario,
    telemetry: xarray.Dataset,
    start: np.datetime64,
    end: np.datetime64,
    samples: Times,
    *,
    period: float,
    network: Network | None = None,
) -> NetworkSimulator:
    """The simulator of a scenario on the window [start, end], observed at `samples` [T] (UTC).

    network: in place of the one that the scenario's blocks describe (a reduced order model's).
    """
    network = network or build_network(scenario)
    drive, sampling = build_drive(scenario, network, telemetry, start, end, samples, period=period)
    observed = {name: item for name, item in scenario.observations.items() if item.node is not None}
    paths = {path for parameter in scenario.parameters.values() for path in (*parameter.sets, *parameter.scales)}
    states = [
        network.nodes.index(item.node if item.lag is None else sensor_state(name)) for name, item in observed.items()
    ]
    moved = [item.time_offset != 0.0 or f"observations.{name}.time_offset" in paths for name, item in observed.items()]
    errors = [[f"observations.{name}.{error}" for name in observed] for error in ("gain", "bias", "time_offset")]
    return NetworkSimulator(
        network=network,
        names=tuple(scenario.parameters),
        mapping=parameter_map(network, scenario),
        drive=drive,
        observation=Observation(sampling, Sensors(np.array(states, dtype=np.int64), np.array(moved, dtype=np.bool_))),
        channels=tuple(observed),
        channel_errors=np.array([[network.position(path) for path in row] for row in errors], dtype=np.int64),
        scatter=np.array([scenario.network.heaters[name].scatter for name in network.heaters]),
    )


def open_loop(scenario: Scenario) -> Scenario:
    """The same scenario with every heater driven by its measured status."""
    return scenario.model_copy(update={"simulator": scenario.network.model_copy(update={"heater_input": "measured"})})
