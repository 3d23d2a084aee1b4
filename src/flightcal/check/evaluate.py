"""Log densities and simulations of many points in one batch, and what a check may spend."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..problem import Problem, Runs
from ..scenario import ExternalModel
from ..simulator import FloatArray

_BATCH = 512
_PARTS = 3
"""Of a budget: for the prior's draws, for the scans and for the mode."""

ManyRuns = list[Runs | None]
"""Of each window at many points; None where a simulation failed."""


@dataclass(frozen=True)
class Effort:
    """How many simulations the parts of a check may take."""

    draws: int
    """From the prior."""
    base: int
    """Of the Saltelli design, a power of two; 0: sensitivities from the prior's draws, and jumps are not located."""
    scan: int
    """Points of each one-dimensional scan."""
    searches: int
    """Prior draws from which the mode is sought, or Gauss-Newton steps at most where there are no derivatives."""


@dataclass(frozen=True)
class PriorRuns:
    """Simulations of a problem at draws of its prior: made when they are first wanted, for all that want them."""

    problem: Problem
    draws: int = 100
    made: tuple[FloatArray, ManyRuns] | None = None
    """`thetas` and `runs`, where others have made them."""

    @cached_property
    def thetas(self) -> FloatArray:
        """[S, d]"""
        if self.made is not None:
            return self.made[0]
        seed = self.problem.scenario.calibration.seed
        return np.asarray(self.problem.priors.sample(np.random.default_rng(seed), self.draws))

    @cached_property
    def runs(self) -> ManyRuns:
        """[S]"""
        return self.problem.simulate_many(self.thetas) if self.made is None else self.made[1]


THOROUGH = Effort(draws=400, base=256, scan=61, searches=4)
"""Where a simulation takes a millisecond."""


def effort_for(problem: Problem, runs: int) -> Effort:
    """What a check of this problem may spend; runs: the budget of a simulator that is not flightcal's own.

    A third of the budget each for the prior's draws, for the scans, and for a mode without derivatives.
    """
    if not isinstance(problem.scenario.simulator, ExternalModel):
        return THOROUGH
    part, count = runs // _PARTS, len(problem.windows)
    scan = 2 * (max(part // (len(problem.simulated) * count), 5) // 2) + 1
    searches = min(max((part + 5 * count) // runs_of_a_search(problem) - 1, 1), 3)
    return Effort(draws=max(part // count, 8), base=0, scan=scan, searches=searches)


def runs_for_draws(draws: int, windows: int) -> int:
    """The least budget of runs with which so many draws of the prior are simulated in each window."""
    return _PARTS * windows * draws


def runs_of_a_search(problem: Problem) -> int:
    """Runs of the simulator that a Gauss-Newton step by differences takes, and what is tried along it."""
    return sum(2 * len(window.simulated) + 5 for window in problem.windows)


def densities(problem: Problem, z: FloatArray, runs: ManyRuns | None = None) -> tuple[FloatArray, ManyRuns]:
    """Log densities [S] at z [S, d], -inf where a simulation fails, and the simulations themselves.

    runs: the simulations, where they have been made.
    """
    runs = problem.simulate_many(problem.to_theta(z)) if runs is None else runs
    values = [
        -np.inf if trajectories is None else problem.log_density(row, trajectories)
        for row, trajectories in zip(z, runs, strict=True)
    ]
    return np.array(values), runs


def log_likelihoods(problem: Problem, z: FloatArray, runs: ManyRuns | None = None) -> tuple[FloatArray, ManyRuns]:
    """As `densities`, without the priors' share."""
    values, runs = densities(problem, z, runs)
    return values - problem.priors.at(z).log_density, runs


def in_batches(count: int) -> list[slice]:
    """Slices of a few hundred."""
    return [slice(first, min(first + _BATCH, count)) for first in range(0, count, _BATCH)]


def signature(runs: Runs | None, heaters: int) -> tuple[int, ...]:
    """How often each heater switches, its first switch on or off: a run that grazes a threshold changes it.

    (-1,) where a run failed. The order in which different heaters switch is left out: it matters to nothing.
    """
    if runs is None:
        return (-1,)
    counted: list[int] = []
    for run in runs:
        for heater in range(heaters):
            on = run.switches.on[run.switches.heater == heater]
            counted += [len(on), int(on[0]) if len(on) else 0]
    return tuple(counted)
