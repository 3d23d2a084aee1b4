"""Heat that flows through nodes, to which sizes of unmodelled heat are relative, and what input series bring of it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from ..scenario import Scenario
from .integrate import integrate
from .network import STEFAN_BOLTZMANN
from .simulate import NetworkSimulator
from .system import FloatArray

_LEAST_FLOW = 1e-3
"""W, of a node through which nothing flows."""


def courses(simulator: NetworkSimulator, nodes: Sequence[str], theta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Temperatures [K, h] of nodes in the middle of the steps, at theta [d], and the steps' lengths [K], s.

    Raises SimulationFailure.
    """
    run = integrate(simulator.network.structure, simulator.system(theta), simulator.drive, derivative=False)
    places = [simulator.network.nodes.index(name) for name in nodes]
    return 0.5 * (run.states[1:] + run.states[:-1])[:, places], np.diff(simulator.drive.times)


def flow_through(
    simulator: NetworkSimulator, scenario: Scenario, nodes: Sequence[str], theta: FloatArray
) -> FloatArray:
    """Mean absolute heat [h] W through nodes with a capacity, at theta [d]: half of what all its flows amount to.

    scenario: whose network is simulated. Raises SimulationFailure.
    """
    network, numbers = simulator.network, simulator.numbers(theta)
    structure, system, drive = network.structure, simulator.system(theta), simulator.drive
    run = integrate(structure, system, drive, derivative=False)
    x = 0.5 * (run.states[1:] + run.states[:-1])
    status, steps = run.status[:-1], np.diff(drive.times)
    inputs = drive.inputs.mean(axis=1)
    found = []
    for name in nodes:
        i, row = network.nodes.index(name), network.balance(name)
        capacity = numbers[network.position(f"nodes.{name}.capacity")]
        rest, flows = np.zeros(len(steps)), []
        from_node: dict[int, FloatArray] = defaultdict(lambda: np.zeros(len(steps)))
        for p in np.flatnonzero(structure.forcing_row == row).tolist():
            flow = system.forcing[p] * inputs[:, structure.forcing_column[p]]
            column = network.columns[structure.forcing_column[p]]
            if column == "one" or column.startswith("temperature"):
                rest += flow
            else:
                flows.append(flow)
        for entries, start, columns, power in (
            (system.linear, structure.linear_start, structure.linear_column, 1),
            (system.radiative, structure.radiative_start, structure.radiative_column, 4),
        ):
            for p in range(int(start[row]), int(start[row + 1])):
                j = int(columns[p])
                rest += entries[p] * x[:, i] ** power
                if j != i:
                    from_node[j] += entries[p] * (x[:, j] ** power - x[:, i] ** power)
        for p in np.flatnonzero(structure.quadratic_row == row).tolist():
            j = int(structure.quadratic_column[p])
            rest += system.quadratic[p] * x[:, i] ** 2
            if j != i:
                from_node[j] += system.quadratic[p] * (x[:, j] ** 2 - x[:, i] ** 2)
        flows += from_node.values()
        for p in np.flatnonzero(structure.heating_row == row).tolist():
            flows.append(system.heating[p] * status[:, structure.heating_heater[p]])
        for flow in _from_boundaries(scenario, simulator, name, numbers, x[:, i], inputs):
            flows.append(flow / capacity)
            rest -= flow / capacity
        absolute = np.abs(np.stack([rest, *flows])).sum(axis=0)
        found.append(0.5 * capacity * float(absolute @ steps) / float(steps.sum()))
    return np.maximum(found, _LEAST_FLOW)


def _from_boundaries(
    scenario: Scenario,
    simulator: NetworkSimulator,
    node: str,
    numbers: FloatArray,
    temperature: FloatArray,
    inputs: FloatArray,
) -> list[FloatArray]:
    """Heat [K] W from each node of given temperature into one of `temperature` [K], at inputs [K, q]."""
    model, network = scenario.network, simulator.network
    found = []
    for conductor in model.conductors:
        if node not in conductor.between:
            continue
        other = conductor.between[conductor.between.index(node) - 1]
        given = model.nodes[other].boundary
        if given is None:
            continue
        if isinstance(given, str):
            boundary = inputs[:, network.columns.index(f"temperature.{other}")]
        else:
            boundary = np.full(len(inputs), numbers[network.position(f"nodes.{other}.boundary")])
        if conductor.conductance is not None:
            factor, power = numbers[network.position(f"conductors.{conductor.label}.conductance")], 1
        else:
            factor, power = STEFAN_BOLTZMANN * numbers[network.position(f"conductors.{conductor.label}.radiative")], 4
        if conductor.conductance_slope is not None:
            slope = numbers[network.position(f"conductors.{conductor.label}.conductance_slope")]
            factor = factor * (1.0 + slope * (0.5 * (boundary + temperature) - conductor.written_at))
        found.append(factor * (boundary**power - temperature**power))
    return found


def heat_of_inputs(simulator: NetworkSimulator, nodes: Sequence[str], theta: FloatArray) -> FloatArray:
    """Heat [h, q] W that a unit of each input series brings to nodes with a capacity, at theta [d]."""
    network, numbers = simulator.network, simulator.numbers(theta)
    structure, forcing = network.structure, simulator.system(theta).forcing
    found = np.zeros((len(nodes), len(network.columns)))
    for k, name in enumerate(nodes):
        here = structure.forcing_row == network.balance(name)
        capacity = numbers[network.position(f"nodes.{name}.capacity")]
        np.add.at(found[k], structure.forcing_column[here], capacity * forcing[here])
    return found
