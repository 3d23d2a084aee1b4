"""A reduced model as it is judged: how it is simulated on a window, and where it starts from."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..scenario import Scenario
from ..simulator import FloatArray, NetworkSimulator, SimulationFailure, Times
from .full_order import FullRuns

Build = Callable[[Scenario, np.datetime64, np.datetime64, Times], NetworkSimulator]


@dataclass(frozen=True)
class Candidate:
    """A reduced model of one size. Its parameters and channels are those of the full network."""

    build: Build
    """(Scenario with the window's timeline, start, end, times) -> simulator."""
    restriction: FloatArray
    """[k, n]: its initial temperatures from those of all nodes of the full network."""
    states: int
    """With heat stored."""
    massless: int


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


def errors_of(candidate: Candidate, runs: Sequence[FullRuns], draws: int | None = None) -> list[Errors]:
    """The errors in each window; draws: of only so many runs in each."""
    return [_errors(candidate, run, draws) for run in runs]


def _errors(candidate: Candidate, run: FullRuns, draws: int | None) -> Errors:
    simulator = candidate.build(run.scenario, run.start, run.end, run.times)
    temperatures, duty, failed = [], [], 0
    count = len(run.parameters) if draws is None else min(draws, len(run.parameters))
    for k in range(count):
        theta = np.concatenate([run.parameters[k], candidate.restriction @ run.temperatures[k, 0]])
        started = replace(simulator, drive=replace(simulator.drive, initially_on=run.status[k, 0]))
        try:
            trajectory = started.simulate(theta)
        except SimulationFailure:
            failed += 1
            continue
        temperatures.append(trajectory.temperatures - run.observed[k])
        duty.append(trajectory.duty_cycle - run.duty[k])
    shape = (0, len(run.times), len(simulator.channels))
    return Errors(
        run.window,
        np.array(temperatures).reshape(-1, *shape[1:]),
        np.array(duty).reshape(-1, len(simulator.heaters)),
        failed,
    )
