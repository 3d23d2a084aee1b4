"""How long sampling takes, roughly: what a gradient takes, and how many draws are made one after another."""

from __future__ import annotations

from time import perf_counter

from ..problem import Problem
from ..scenario import NutsSettings
from ..simulator import FloatArray, cores

_TIMED = 5


def seconds_of_a_gradient(problem: Problem, z: FloatArray) -> float:
    """Of a log density with its gradient at z [d], compiled before it is timed."""
    problem.log_density_and_gradient(z)
    started = perf_counter()
    for _ in range(_TIMED):
        problem.log_density_and_gradient(z)
    return (perf_counter() - started) / _TIMED


def draws_in_turn(settings: NutsSettings, together: int = 1) -> float:
    """Draws, warm-up included, that each core makes; of samplings that share the cores, one's share of these."""
    chains = settings.chains * together
    return -(-chains // min(chains, cores())) / together * (settings.warmup + settings.draws)
