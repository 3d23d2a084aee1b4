"""Log densities and simulations of many points in one batch, and what a check may spend."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from ..external import ExternalSimulator
from ..problem import Problem
from ..simulator import FloatArray, SimulationFailure, Simulator, Trajectory

_BATCH = 512

"""Is told which share (0..1) of a part is done."""


@dataclass(frozen=True)
class Effort:
    """How many simulations the parts of a check may take."""

    draws: int
    """From the prior."""
    base: int
    """Of the Saltelli design, a power of two; 0: sensitivities from the prior's draws."""
    scan: int
    """Points of each one-dimensional scan."""
    locate: bool
    """Whether jumps are located by bisection."""
    searches: int
    """Prior draws from which the mode is sought, or Gauss-Newton steps at most where there are no derivatives."""


THOROUGH = Effort(draws=400, base=256, scan=61, locate=True, searches=4)
"""Where a simulation takes a millisecond."""


def effort_for(problem: Problem, runs: int) -> Effort:
    """What a check of this problem may spend; runs: the budget of a simulator that is not flightcal's own.

    A third of the budget each for the prior's draws, for the scans, and for a mode without derivatives.
    """
    if not isinstance(problem.simulator, ExternalSimulator):
        return THOROUGH
    part, dimension = runs // 3, len(problem.simulated)
    scan = 2 * (max(part // dimension, 5) // 2) + 1
    searches = min(max((part - 2 * dimension) // (2 * dimension + 5), 1), 3)
    return Effort(draws=max(part, 8), base=0, scan=scan, locate=False, searches=searches)


class _Given:
    """A simulator that has made some runs already; all else is the simulator's own."""

    def __init__(self, simulator: Simulator, runs: dict[bytes, Trajectory | None]) -> None:
        self._simulator = simulator
        self._runs = runs

    def __getattr__(self, name: str) -> Any:
        return getattr(self._simulator, name)

    def simulate(self, theta: FloatArray) -> Trajectory:
        """The run at theta [d]."""
        key = theta.tobytes()
        if key not in self._runs:
            return self._simulator.simulate(theta)
        run = self._runs[key]
        if run is None:
            raise SimulationFailure("the simulation at this point failed")
        return run


Runs = list[Trajectory | None]


def densities(problem: Problem, z: FloatArray, runs: Runs | None = None) -> tuple[FloatArray, Runs]:
    """Log densities [S] at z [S, d], -inf where a simulation fails, and the simulations themselves.

    runs: the simulations, where they have been made.
    """
    thetas = problem.to_theta(z)
    runs = problem.simulate_many(thetas) if runs is None else runs
    made = {theta[problem.simulated].tobytes(): run for theta, run in zip(thetas, runs, strict=True)}
    given = replace(problem, simulator=cast(Simulator, _Given(problem.simulator, made)))
    return np.array([given.log_density(row) for row in z]), runs


def log_likelihoods(problem: Problem, z: FloatArray, runs: Runs | None = None) -> tuple[FloatArray, Runs]:
    """As `densities`, without the priors' share."""
    values, runs = densities(problem, z, runs)
    return values - problem.priors.at(z).log_density, runs


def in_batches(count: int) -> list[slice]:
    """Slices of a few hundred."""
    return [slice(first, min(first + _BATCH, count)) for first in range(0, count, _BATCH)]


def signature(run: Trajectory | None, heaters: int) -> tuple[int, ...]:
    """How often each heater switches, its first switch on or off: a run that grazes a threshold changes it.

    (-1,) where the run failed. The order in which different heaters switch is left out: it matters to nothing.
    """
    if run is None:
        return (-1,)
    counted: list[int] = []
    for heater in range(heaters):
        on = run.switches.on[run.switches.heater == heater]
        counted += [len(on), int(on[0]) if len(on) else 0]
    return tuple(counted)


def mean_square(observed: FloatArray, temperatures: FloatArray) -> float:
    """Of the residuals over all valid samples, K^2."""
    return float(np.nanmean((observed - temperatures) ** 2))


def spread_in_z(problem: Problem) -> FloatArray:
    """Standard deviation [d] that each prior has on the unconstrained scale: half the width of its central 68%."""
    tail = 0.5 * math.erfc(1.0 / math.sqrt(2.0))
    lower, upper = (problem.to_z(problem.priors.quantile(p)) for p in (tail, 1.0 - tail))
    spread: FloatArray = 0.5 * (upper - lower)
    return spread
