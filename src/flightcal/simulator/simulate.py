"""The simulator as a calibration sees it: theta in, temperatures and heater status at the telemetry's times out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, Protocol

import numpy as np
import xarray

from .._jax import jax, jnp
from ..scenario import Parameter, Scenario
from .inputs import Sampling, Times, build_drive
from .integrate import Run, SimulationFailure, in_parallel, integrate, pull_back
from .network import Network, assemble, build_network
from .system import Drive, FloatArray, Switch, System


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
class NetworkSimulator:
    """A thermal network on one window.

    theta is the scenario's parameters followed by the initial temperature of every node with a capacity.
    """

    network: Network
    mapping: tuple[tuple[str, Parameter], ...]
    drive: Drive
    sampling: Sampling
    channels: tuple[str, ...]
    channel_nodes: tuple[int, ...]

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of theta's entries."""
        initial = self.network.nodes[: self.network.diffusive]
        return (*(name for name, _ in self.mapping), *(f"initial.{node}" for node in initial))

    @property
    def heaters(self) -> tuple[str, ...]:
        """Names of the heaters."""
        return self.network.heaters

    def heater_power(self, theta: FloatArray) -> FloatArray:
        """Power [H] W of each heater while it is on, at theta [d]."""
        positions = [self.network.position(f"heaters.{heater}.power") for heater in self.heaters]
        return np.array(self.values(theta))[positions]

    def values(self, theta: Any) -> Any:
        """The settable numbers [V] at theta (JAX)."""
        values = jnp.asarray(self.network.values)
        for k, (_, parameter) in enumerate(self.mapping):
            for path in parameter.sets:
                values = values.at[self.network.position(path)].set(theta[k])
        for k, (_, parameter) in enumerate(self.mapping):
            for path in parameter.scales:
                values = values.at[self.network.position(path)].mul(theta[k])
        return values

    def assemble(self, theta: Any) -> tuple[System, Any]:
        """The canonical form at theta and the sensors' biases [N] (JAX)."""
        values = self.values(theta)
        system = assemble(self.network, values, theta[len(self.mapping) :], jnp.asarray(self.drive.inputs[0]))
        biases = [values[self.network.position(f"observations.{channel}.bias")] for channel in self.channels]
        return system, jnp.stack(biases) if biases else jnp.zeros(0)

    @cached_property
    def _assemble(self) -> Callable[[Any], tuple[System, Any]]:
        return jax.jit(self.assemble)

    @cached_property
    def _assemble_many(self) -> Callable[[Any], tuple[System, Any]]:
        return jax.jit(jax.vmap(self.assemble))

    @cached_property
    def _pull_back(self) -> Callable[[Any, Any], Any]:
        return jax.jit(lambda theta, bar: jax.vjp(self.assemble, theta)[1](bar)[0])

    def simulate(self, theta: FloatArray) -> Trajectory:
        """One simulation at theta [d]."""
        system, bias = _to_numpy(self._assemble(theta))
        return self._observe(integrate(system, self.drive), bias)

    def simulate_many(self, thetas: FloatArray) -> list[Trajectory | None]:
        """Simulations at thetas [S, d], in parallel; None where one failed."""
        systems, biases = _to_numpy(self._assemble_many(thetas))

        def one(k: int) -> Trajectory | None:
            try:
                return self._observe(integrate(System(*(part[k] for part in systems)), self.drive), biases[k])
            except SimulationFailure:
                return None

        return in_parallel(one, len(thetas))

    def linearise(self, theta: FloatArray) -> tuple[Trajectory, Callable[[FloatArray], FloatArray]]:
        """A simulation and its vector-Jacobian product: cotangent of the temperatures [T, N] -> of theta [d]."""
        system, bias = _to_numpy(self._assemble(theta))
        run = integrate(system, self.drive)
        return self._observe(run, bias), partial(self._cotangent, theta, system, run)

    def _cotangent(self, theta: FloatArray, system: System, run: Run, temperatures_bar: FloatArray) -> FloatArray:
        states_bar = np.zeros_like(run.states)
        at_samples = np.zeros((len(temperatures_bar), states_bar.shape[1]))
        for k, node in enumerate(self.channel_nodes):
            at_samples[:, node] += temperatures_bar[:, k]
        states_bar = self.sampling.spread(at_samples, len(states_bar))
        bar = pull_back(system, self.drive, run, states_bar)
        return np.asarray(self._pull_back(theta, (bar, temperatures_bar.sum(axis=0))))

    def _observe(self, run: Run, bias: FloatArray) -> Trajectory:
        temperatures = self.sampling.interpolate(run.states[:, list(self.channel_nodes)]) + bias
        index, weight = self.sampling.index, self.sampling.weight
        times = self.drive.times[index] + weight * (self.drive.times[index + 1] - self.drive.times[index])
        status = run.status[index]
        for k in np.unique(run.switches.heater):
            mine = run.switches.heater == k
            passed = np.searchsorted(run.switches.time[mine], times, side="right")
            status[:, k] = np.concatenate([run.status[:1, k], run.switches.on[mine]])[passed]
        _, _, lengths, _, _, heater_status = run.segments
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
        mapping=tuple(scenario.parameters.items()),
        drive=drive,
        sampling=sampling,
        channels=tuple(observed),
        channel_nodes=tuple(network.nodes.index(item.node or "") for item in observed.values()),
    )


def open_loop(scenario: Scenario) -> Scenario:
    """The same scenario with every heater driven by its measured status."""
    return scenario.model_copy(update={"simulator": scenario.simulator.model_copy(update={"heater_input": "measured"})})


def shortened(simulator: NetworkSimulator, steps: int) -> NetworkSimulator:
    """The same simulator stopped after its first `steps` grid steps, with the samples that lie there."""
    drive = simulator.drive
    kept = simulator.sampling.index < steps
    return replace(
        simulator,
        drive=replace(
            drive,
            times=drive.times[: steps + 1],
            inputs=drive.inputs[: steps + 1],
            measured=drive.measured[:steps],
        ),
        sampling=Sampling(simulator.sampling.index[kept], simulator.sampling.weight[kept]),
    )


def _to_numpy(tree: Any) -> Any:
    # Copies, because the kernel is compiled for writable arrays and JAX hands out read-only ones.
    return jax.tree.map(np.array, tree)
