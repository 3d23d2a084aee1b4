"""The simulator as a calibration sees it: theta in, temperatures and heater status at the telemetry's times out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Protocol

import numpy as np
import xarray

from ..scenario import Scenario
from .assembly import assemble, pull_back_assembly
from .inputs import Times, build_drive
from .integrate import Run, SimulationFailure, in_parallel, integrate, pull_back
from .network import Network, build_network
from .sampling import Sampling
from .system import Drive, FloatArray, IntArray, Switch, System


@dataclass(frozen=True)
class Trajectory:
    """What one simulation gives."""

    temperatures: FloatArray
    """[T, N] K, as the sensors would report them (bias included)."""
    status: FloatArray
    """[T, H] 0 or 1 (a share of the step for a heater driven by measurement)."""
    duty_cycle: FloatArray
    """[H] share of the window's time that each heater is on."""
    switches: Switch


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

    def heater_power(self, theta: FloatArray) -> FloatArray:
        """Power [H] W of each heater while it is on, at theta [d]; NaN where the simulator does not know."""

    def simulate(self, theta: FloatArray) -> Trajectory:
        """One simulation at theta [d]."""

    def simulate_many(self, thetas: FloatArray) -> list[Trajectory | None]:
        """Simulations at thetas [S, d], in parallel; None where one failed."""

    def linearise(self, theta: FloatArray) -> tuple[Trajectory, Callable[[FloatArray], FloatArray]]:
        """A simulation and its vector-Jacobian product: cotangent of the temperatures [T, N] -> of theta [d]."""


@dataclass(frozen=True)
class ParameterMap:
    """Which of a network's numbers each parameter sets or scales."""

    names: tuple[str, ...]
    set_positions: IntArray
    set_by: IntArray
    """Parameter that sets the number at each of `set_positions`."""
    scaled_positions: IntArray
    scaled_by: IntArray

    def values(self, written: FloatArray, theta: FloatArray) -> FloatArray:
        """The numbers [V] at theta, from those the scenario writes."""
        values = written.copy()
        values[self.set_positions] = theta[self.set_by]
        np.multiply.at(values, self.scaled_positions, theta[self.scaled_by])
        return values

    def pull_back(self, written: FloatArray, theta: FloatArray, values_bar: FloatArray) -> FloatArray:
        """Cotangent of the parameters at theta from that of the numbers [V]: the adjoint of `values`."""
        count = len(self.names)
        theta_bar: FloatArray = np.bincount(self.set_by, values_bar[self.set_positions], count).astype(float)
        share = values_bar[self.scaled_positions] * written[self.scaled_positions]
        for others in self._other_scales:
            share *= np.where(others >= 0, theta[others], 1.0)
        return theta_bar + np.bincount(self.scaled_by, share, count)

    @cached_property
    def _other_scales(self) -> list[IntArray]:
        """For each scaled number the other parameters that scale it too (-1: none), one array per further parameter."""
        others = [
            [k for i, k in enumerate(self.scaled_by) if self.scaled_positions[i] == position and i != j]
            for j, position in enumerate(self.scaled_positions)
        ]
        most = max(map(len, others), default=0)
        return [np.array([row[m] if m < len(row) else -1 for row in others]) for m in range(most)]


def parameter_map(network: Network, scenario: Scenario) -> ParameterMap:
    """The map of a scenario's parameters; lint has seen that no number is set twice, or both set and scaled."""
    parameters = list(scenario.parameters.values())
    sets = [(network.position(path), k) for k, parameter in enumerate(parameters) for path in parameter.sets]
    scales = [(network.position(path), k) for k, parameter in enumerate(parameters) for path in parameter.scales]
    return ParameterMap(
        tuple(scenario.parameters),
        *np.array(sets, dtype=np.int64).reshape(-1, 2).T.copy(),
        *np.array(scales, dtype=np.int64).reshape(-1, 2).T.copy(),
    )


@dataclass(frozen=True)
class NetworkSimulator:
    """A thermal network on one window.

    theta is the scenario's parameters followed by the initial temperature of every node with a capacity.
    """

    network: Network
    mapping: ParameterMap
    drive: Drive
    sampling: Sampling
    channels: tuple[str, ...]
    channel_states: IntArray
    """[N] state that each channel measures."""
    channel_biases: IntArray
    """[N] positions of the channels' biases in the network's values."""

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of theta's entries."""
        return (*self.mapping.names, *(f"initial.{self.network.nodes[k]}" for k in self.network.diffusive))

    @property
    def heaters(self) -> tuple[str, ...]:
        """Names of the heaters."""
        return self.network.heaters

    def heater_power(self, theta: FloatArray) -> FloatArray:
        """Power [H] W of each heater while it is on, at theta [d]."""
        positions = [self.network.position(f"heaters.{heater}.power") for heater in self.heaters]
        return self.mapping.values(self.network.values, theta)[positions]

    def assemble(self, theta: FloatArray) -> tuple[System, FloatArray]:
        """The canonical form at theta [d], and the scenario's numbers [V]."""
        network = self.network
        values = self.mapping.values(network.values, theta)
        temperatures = theta[len(self.mapping.names) :]
        initial = np.full(len(network.nodes), temperatures.mean())
        initial[network.diffusive] = temperatures
        return assemble(network.terms, network.structure, values, network.thresholds, initial), values

    def simulate(self, theta: FloatArray) -> Trajectory:
        """One simulation at theta [d]."""
        system, values = self.assemble(theta)
        return self._observe(integrate(self.network.structure, system, self.drive), values)

    def simulate_many(self, thetas: FloatArray) -> list[Trajectory | None]:
        """Simulations at thetas [S, d], in parallel; None where one failed."""

        def one(k: int) -> Trajectory | None:
            try:
                return self.simulate(thetas[k])
            except SimulationFailure:
                return None

        return in_parallel(one, len(thetas))

    def linearise(self, theta: FloatArray) -> tuple[Trajectory, Callable[[FloatArray], FloatArray]]:
        """A simulation and its vector-Jacobian product: cotangent of the temperatures [T, N] -> of theta [d]."""
        system, values = self.assemble(theta)
        run = integrate(self.network.structure, system, self.drive)
        return self._observe(run, values), partial(self._cotangent, theta, system, values, run)

    def _cotangent(
        self, theta: FloatArray, system: System, values: FloatArray, run: Run, temperatures_bar: FloatArray
    ) -> FloatArray:
        network = self.network
        states_bar = self.sampling.spread(temperatures_bar, self.channel_states, *run.states.shape)
        bar = pull_back(network.structure, system, self.drive, run, states_bar)
        values_bar = pull_back_assembly(network.terms, values, network.thresholds, bar)
        np.add.at(values_bar, self.channel_biases, temperatures_bar.sum(axis=0))
        parameters_bar = self.mapping.pull_back(network.values, theta, values_bar)
        return np.concatenate([parameters_bar, bar.initial[network.diffusive]])

    def _observe(self, run: Run, values: FloatArray) -> Trajectory:
        temperatures = self.sampling.interpolate(run.states, self.channel_states, values[self.channel_biases])
        index, weight = self.sampling.index, self.sampling.weight
        times = self.drive.times[index] + weight * (self.drive.times[index + 1] - self.drive.times[index])
        _, starts, lengths, _, _, heater_status = run.segments
        status = heater_status[np.searchsorted(starts, times, side="right") - 1]
        return Trajectory(temperatures, status, lengths @ heater_status / lengths.sum(), run.switches)


def network_simulator(
    scenario: Scenario,
    telemetry: xarray.Dataset,
    start: np.datetime64,
    end: np.datetime64,
    samples: Times,
    *,
    period: float,
) -> NetworkSimulator:
    """The simulator of a scenario on the window [start, end], observed at `samples` [T] (UTC)."""
    network = build_network(scenario)
    drive, sampling = build_drive(scenario, network, telemetry, start, end, samples, period=period)
    observed = {name: item for name, item in scenario.observations.items() if item.node is not None}
    return NetworkSimulator(
        network=network,
        mapping=parameter_map(network, scenario),
        drive=drive,
        sampling=sampling,
        channels=tuple(observed),
        channel_states=np.array([network.nodes.index(item.node or "") for item in observed.values()], dtype=np.int64),
        channel_biases=np.array([network.position(f"observations.{name}.bias") for name in observed], dtype=np.int64),
    )


def open_loop(scenario: Scenario) -> Scenario:
    """The same scenario with every heater driven by its measured status."""
    return scenario.model_copy(update={"simulator": scenario.simulator.model_copy(update={"heater_input": "measured"})})
