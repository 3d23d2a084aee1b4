"""From theta to the observed temperatures and back, within compiled code: what a compiled log density calls."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..compiled import inlined
from .adjoint import adjoint, adjoint_memory_size
from .assembly import MOST_FACTORS, assemble_compiled, pull_back_compiled
from .forward import COUNTERS, REALS, forward
from .integrate import MOST_SWITCHES_PER_STEP, make_outputs, make_record, step_memory
from .sampling import spread
from .simulate import NetworkSimulator


class Window(NamedTuple):
    """A network on one window, as `NetworkSimulator` has it; only read."""

    mapping: Any
    terms: Any
    structure: Any
    times: Any
    series: Any
    measured: Any
    initially_on: Any
    sampling: Any
    sensors: Any
    channel_errors: Any


class Workspace(NamedTuple):
    """Memory for one simulation at a time and its derivative."""

    theta: Any
    """[1, d] of the simulator."""
    theta_bar: Any
    """[d] its cotangent."""
    temperatures_bar: Any
    """[T, N] cotangent of the temperatures."""
    numbers: Any
    packed: Any
    packed_bar: Any
    extended: Any
    """Numbers, a one and reciprocals, and twice as many for the derivative."""
    errors: Any
    errors_bar: Any
    scatter: Any
    """[1, 0, heater] of thresholds: none."""
    memory: Any
    counters: Any
    reals: Any
    driven: Any
    record: Any
    outputs: Any
    states_bar: Any
    heat_bar: Any
    adjoint_memory: Any
    switches_bar: Any
    """[at least E] cotangent of the switches' times; zero unless a likelihood fills it."""


def make_window(simulator: NetworkSimulator) -> Window:
    """What a compiled simulation reads."""
    drive, observation, network = simulator.drive, simulator.observation, simulator.network
    return Window(
        simulator.mapping,
        network.terms,
        network.structure,
        drive.times,
        drive.series,
        drive.measured,
        drive.initially_on,
        observation.sampling,
        observation.sensors,
        simulator.channel_errors,
    )


def make_workspace(simulator: NetworkSimulator) -> Workspace:
    """Memory for it. Room for the most switches that a simulation may have; what is never touched costs nothing."""
    drive, observation, network = simulator.drive, simulator.observation, simulator.network
    structure, terms = network.structure, network.terms
    numbers, packed = len(network.values), terms.entries + len(structure.mass)
    capacity = MOST_SWITCHES_PER_STEP * len(drive.times)
    memory, steps = step_memory(structure, capacity)
    samples, channels = len(observation.sampling.point), len(observation.sensors.state)
    parameters = len(simulator.parameters)
    return Workspace(
        theta=np.empty((1, parameters)),
        theta_bar=np.empty(parameters),
        temperatures_bar=np.empty((samples, channels)),
        numbers=np.empty((1, numbers)),
        packed=np.empty((1, packed)),
        packed_bar=np.empty(packed),
        extended=np.empty(2 * (numbers + 1 + len(terms.inverse)) + MOST_FACTORS),
        errors=np.empty((1, 3, channels)),
        errors_bar=np.empty((3, channels)),
        scatter=np.zeros((1, 0, len(structure.sensor))),
        memory=memory,
        counters=np.empty((COUNTERS, 1), np.int64),
        reals=np.empty((REALS, 1)),
        driven=np.empty((1, len(structure.sensor)), np.bool_),
        record=make_record(structure, drive, 1, capacity, steps),
        outputs=make_outputs(structure, observation, 1, capacity),
        states_bar=np.empty((len(drive.times), len(structure.mass))),
        heat_bar=np.empty((len(structure.mass), len(drive.times))),
        adjoint_memory=np.empty(adjoint_memory_size(structure)),
        switches_bar=np.zeros(capacity if len(structure.sensor) else 0),
    )


@inlined
def simulate_compiled(window, work):
    """Simulate at work.theta; returns the outcome, and where it is FINISHED work.outputs holds the temperatures."""
    assemble_compiled(window.mapping, window.terms, work.theta, work.extended, work.numbers, work.packed)
    for error in range(window.channel_errors.shape[0]):
        for k in range(window.channel_errors.shape[1]):
            work.errors[0, error, k] = work.numbers[0, window.channel_errors[error, k]]
    work.outputs.noted[0] = 0
    forward(
        window.structure, work.packed, window.times, window.series, window.measured, window.initially_on,
        window.sampling, window.sensors, work.errors, work.scatter,
        work.memory, work.counters, work.reals, work.driven, work.record, work.outputs,
    )  # fmt: skip
    return work.outputs.outcome[0]


@inlined
def linearise_compiled(window, work):
    """Fill work.theta_bar from work.temperatures_bar and switches_bar, for the simulation made last."""
    spread(
        window.sampling, window.sensors, window.times, work.record.states[0], work.errors[0],
        work.temperatures_bar, work.states_bar, work.errors_bar,
    )  # fmt: skip
    adjoint(
        window.structure, work.packed[0], window.times, window.series, work.record,
        work.states_bar, work.switches_bar[: work.outputs.switches[0]],
        work.adjoint_memory, work.heat_bar, work.packed_bar,
    )  # fmt: skip
    pull_back_compiled(
        window.mapping, window.terms, work.theta[0], work.numbers[0], work.packed_bar,
        window.channel_errors, work.errors_bar, work.extended, work.theta_bar,
    )  # fmt: skip
