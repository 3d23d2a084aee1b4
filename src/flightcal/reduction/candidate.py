"""A reduced model beside the full network: simulated as its runs were, from where they began."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray

from ..simulator import FloatArray, NetworkSimulator, SimulationFailure, network_simulator
from .file import Task
from .full_order import FullRuns
from .reduced_model import ReducedModel
from .reduced_scenario import network_for, reduced_scenario


@dataclass(frozen=True)
class Errors:
    """A reduced model against the full network, in one window."""

    window: str
    temperatures: FloatArray
    """[S, T, N] K, reduced minus full."""
    duty: FloatArray
    """[S, H] reduced minus full."""
    failed: int
    """Simulations of the reduced model that failed; they are not among S."""


def simulator_on(
    task: Task, model: ReducedModel, runs: FullRuns, longest_step: float | None = None
) -> NetworkSimulator:
    """The model on the window of the full network's runs; its parameters and channels are the full network's.

    longest_step: s, where the task has none; by default the steps are chosen.
    """
    scenario = reduced_scenario(runs.scenario, model, task.reduction.step or longest_step)
    return network_simulator(
        scenario, xarray.Dataset(), runs.start, runs.end, runs.times,
        period=task.period, network=network_for(model, scenario),
    )  # fmt: skip


def theta_of(model: ReducedModel, runs: FullRuns, k: int) -> FloatArray:
    """The model's theta for the k-th run: its parameters, and the temperatures of the states where it begins."""
    return np.concatenate([runs.parameters[k], runs.temperatures[k, 0, [runs.nodes.index(n) for n in model.states]]])


def errors_of(
    task: Task,
    model: ReducedModel,
    runs: Sequence[FullRuns],
    draws: int | None = None,
    longest_step: float | None = None,
) -> list[Errors]:
    """The errors in each window; draws: of only so many runs in each; longest_step: see `simulator_on`."""
    return [_errors(simulator_on(task, model, full_runs, longest_step), model, full_runs, draws) for full_runs in runs]


def _errors(simulator: NetworkSimulator, model: ReducedModel, runs: FullRuns, draws: int | None) -> Errors:
    temperatures, duty, failed = [], [], 0
    for k in range(len(runs.parameters))[:draws]:
        started = replace(simulator, drive=replace(simulator.drive, initially_on=runs.status[k, 0]))
        try:
            trajectory = started.simulate(theta_of(model, runs, k))
        except SimulationFailure:
            failed += 1
            continue
        temperatures.append(trajectory.temperatures - runs.observed[k])
        duty.append(trajectory.duty_cycle - runs.duty[k])
    shape = (len(runs.times), len(simulator.channels))
    return Errors(
        runs.window,
        np.array(temperatures).reshape(-1, *shape),
        np.array(duty).reshape(-1, len(simulator.heaters)),
        failed,
    )
