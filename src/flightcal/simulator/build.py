"""The simulator of a scenario on one window of its telemetry."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import xarray

from ..scenario import Scenario, SimulatorModel, numbers_of, step_tolerance
from .assembly import ParameterMap, assemble
from .balance import balanced
from .drive import Times, drive_on, make_grid, window_inputs
from .network import Network, build_network, sensor_state
from .sampling import Observation, Sensors
from .simulate import NetworkSimulator, Trajectory
from .steps import ROOM, StepErrors, choose_grid, measure, to_try
from .system import FloatArray

_WILD = 1e5  # K
_AT_ONCE, _SETTLES, _LOOSELY = 1.0, 5.0, 0.2
"""1/s, of a node that follows a boundary; s, in which it gets there; and share of its errors that counts, for they move
nothing but its own channel."""


TIME_ERROR = "telemetry.time_error"
"""The entry of theta that is the error of all time tags, s."""


def parameter_map(network: Network, scenario: Scenario, timed: tuple[str, ...] = ()) -> ParameterMap:
    """The map of a scenario's parameters; lint has seen that no number is set twice, or both set and scaled.

    timed: see `network_simulator`.
    """
    entries = [(parameter.sets, parameter.scales) for parameter in scenario.parameters.values()]
    entries += [(timed, ())] if timed else []
    numbers = numbers_of(dict(zip(network.paths, network.values.tolist(), strict=True)), entries)
    return ParameterMap(len(entries), network.values, *numbers.sets.T.copy(), *numbers.scales.T.copy())


def network_simulator(
    scenario: Scenario,
    telemetry: xarray.Dataset,
    start: np.datetime64,
    end: np.datetime64,
    samples: Times,
    *,
    period: float,
    network: Network | None = None,
    heated: Sequence[str] = (),
    timed: tuple[str, ...] = (),
    tried: Callable[[tuple[str, ...]], FloatArray] | None = None,
) -> NetworkSimulator:
    """The simulator of a scenario on the window [start, end], observed at `samples` [T] (UTC).

    network: in place of the one that the scenario's blocks describe (a reduced order model's); heated: see
    `build_network`. timed: paths of the numbers that one more entry of theta, `TIME_ERROR`, sets. tried: thetas [S, d],
    some of which choose the length of the steps (see `steps.to_try`), from the names of theta's entries; by default
    what the scenario writes.
    """
    network = network or build_network(scenario, heated)
    inputs = window_inputs(scenario, network, telemetry, start, end, samples, period=period)
    observed = {name: item for name, item in scenario.observations.items() if item.node is not None}
    paths = scenario.uncertain | {*timed}
    states = [
        network.nodes.index(item.node if item.lag is None else sensor_state(name)) for name, item in observed.items()
    ]
    moved = [item.time_offset != 0.0 or f"observations.{name}.time_offset" in paths for name, item in observed.items()]
    errors = [[f"observations.{name}.{error}" for name in observed] for error in ("gain", "bias", "time_offset")]
    sensors = Sensors(np.array(states, dtype=np.int64), np.array(moved, dtype=np.bool_))
    coarse = make_grid(inputs, scenario.network.step or np.inf)
    simulator = NetworkSimulator(
        network=network,
        names=(*scenario.parameters, *([TIME_ERROR] if timed else [])),
        mapping=parameter_map(network, scenario, timed),
        drive=drive_on(inputs, coarse),
        observation=Observation((samples - start) / np.timedelta64(1, "ns") * 1e-9, sensors),
        channels=tuple(observed),
        channel_errors=np.array([[network.position(path) for path in row] for row in errors], dtype=np.int64),
        scatter=np.array([scenario.network.switches[name].scatter for name in network.heaters]),
    )
    thetas = _as_written(simulator, scenario) if tried is None else tried(simulator.parameters)
    simulator = replace(simulator, network=balanced(simulator, np.median(thetas, axis=0)))
    thetas = thetas[to_try(network.structure, assemble(simulator.mapping, network.terms, thetas)[1])]

    follows = [_follows_telemetry(scenario.network, str(item.node)) for item in observed.values()]

    def compare(grid: FloatArray, halves: FloatArray) -> StepErrors | None:
        looking = replace(simulator, observation=Observation(halves, sensors), scatter=np.zeros(0))
        runs = [replace(looking, drive=drive_on(inputs, points)).simulate_many(thetas) for points in (grid, halves)]
        pairs = [(a, b) for a, b in zip(*runs, strict=True) if a and b and not (_is_wild(a) or _is_wild(b))]
        if not (pairs and observed):
            return None
        switched = [np.concatenate([a.switches.time, b.switches.time]) for a, b in pairs]
        off = np.stack([a.temperatures - b.temperatures for a, b in pairs])
        off[:, :, follows] *= np.where(halves < _SETTLES, 0.0, _LOOSELY)[:, None]
        return StepErrors(off, switched)

    if scenario.network.step is not None:
        found = measure(coarse, compare)
        return simulator if found is None else replace(simulator, accuracy=found[0])
    grid, accuracy = choose_grid(inputs, compare, step_tolerance(scenario))
    return replace(simulator, drive=drive_on(inputs, grid), accuracy=accuracy)


def _is_wild(run: Trajectory) -> bool:
    """Whether a simulation tells nothing of the length of steps, for it diverges."""
    return len(run.temperatures) > 0 and not float(np.abs(run.temperatures).max()) < _WILD


def _follows_telemetry(model: SimulatorModel, node: str) -> bool:
    """Whether a node is at the temperature of a measured boundary within a second."""
    capacity = None if node not in model.nodes else model.nodes[node].capacity
    if capacity is None:
        return False
    links = [
        conductor
        for conductor in model.conductors
        if node in conductor.between and (conductor.conductance or 0.0) > _AT_ONCE * capacity
    ]
    return any(
        isinstance(model.nodes[other].boundary, str)
        for conductor in links
        for other in conductor.between
        if other != node
    )


def _as_written(simulator: NetworkSimulator, scenario: Scenario) -> FloatArray:
    """The one theta [1, d] of what the scenario writes."""
    mapping = simulator.mapping
    theta = np.ones(mapping.parameters)
    theta[mapping.set_by] = mapping.written[mapping.set_positions]
    nodes = [scenario.network.nodes[simulator.network.nodes[k]] for k in simulator.network.diffusive]
    return np.concatenate([theta, [ROOM if node.initial is None else node.initial for node in nodes]])[None]


def open_loop(scenario: Scenario) -> Scenario:
    """The same scenario with every heater driven by its measured status."""
    return scenario.model_copy(update={"simulator": scenario.network.model_copy(update={"heater_input": "measured"})})
