"""The genetic algorithm of optimisation-based calibration: independent seeded runs on a box.

Real-coded: Latin hypercube start, binary tournament, simulated binary crossover, polynomial mutation, and the
best of parents and offspring survive (Deb & Agrawal 1995; Deb & Goyal 1996). Steps and random numbers are those of
pymoo 0.6.2, to the bit, without the plotting library and the ten packages that it brings.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from typing import Any

import numpy as np
import xarray
from numpy.typing import NDArray
from scipy.spatial.distance import cdist, pdist

from ..errors import FlightcalError
from ..progress import SILENT, Progress
from ..scenario import GeneticSettings
from ..simulator import FloatArray

CROSSOVER_PROBABILITY = 0.9
CROSSOVER_INDEX = 15.0
MUTATION_INDEX = 20.0
"""Deb's usual values; on test valleys no other choice was clearly better. Each variable mutates at 1/d."""

_CROSSED, _EXCHANGED, _MUTATED = 0.5, 0.5, 0.9
"""Shares of the variables of mated parents that are crossed, of those that change places, of the children that may
mutate."""
_HYPERCUBES = 20
"""From which the start is chosen."""
_MATINGS = 100
"""At most, until there are enough children that are new."""
_CLOSE, _SAME = 1e-14, 1e-16
"""Variables that are so close are not crossed; individuals that are so close are the same."""

CONVERGED_AFTER = 100
"""Generations over which a run that has converged has hardly changed."""
IMPROVED, NARROWED = 0.01, 0.1
"""By which share its best cost may fall, and its population become narrower, over these generations."""
_NARROW = 1e-3
"""Of the box, in the root mean square over the variables: a population so narrow may become narrower still."""
CRITERION = (
    f"over {CONVERGED_AFTER} generations its best cost has fallen by less than {IMPROVED:.0%} and its population "
    f"has become narrower by less than {NARROWED:.0%}, or is narrower than {_NARROW:.1%} of the box"
)
"""When a run has converged."""

_FAILED = 1e300
"""What the algorithm sees instead of a cost that is not finite: it loses every tournament."""


def minimise(
    cost: Callable[[FloatArray], FloatArray],
    lower: FloatArray,
    upper: FloatArray,
    settings: GeneticSettings,
    seed: int,
    *,
    progress: Progress = SILENT,
    words: Callable[[float], str] = "cost {:.4g}".format,
) -> xarray.Dataset:
    """Minimise `cost` in the box with `settings.runs` independent runs.

    cost: [S, d] -> [S], called once a generation with the populations of all runs; not finite: a failed simulation.
    lower, upper: [d], finite, lower < upper.
    words: how the best cost so far is told.

    A run ends when it has converged (see `CRITERION`), at the latest after `settings.generations`.

    All runs go on side by side, so that a generation of all is one batch of simulations.

    Returns best [run, parameter]; its cost [run]; generations [run]; converged [run], 0 or 1; history
    [run, generation], the best cost so far, NaN after the run's end. Where a whole run failed, its best is NaN and its
    cost inf. Over the other runs: mean_theta [parameter], the mean of their best, which is published and may lie off
    the ridge of good fits; best_theta, the best of all. Attributes: evaluations and failures (cost not finite), of all
    runs together, how many runs converged, and what that means.
    Raises FlightcalError when no simulation of any run succeeds.
    """
    seeds = np.random.SeedSequence(seed).generate_state(settings.runs)
    going = {number: _evolve(lower, upper, settings, int(generator)) for number, generator in enumerate(seeds)}
    wanted = {number: next(run) for number, run in going.items()}
    ended: dict[int, dict[str, Any]] = {}
    best, generation = np.inf, 0
    with progress.stage("search", settings.generations) as search:
        while wanted:
            generation += 1
            everybody = np.concatenate([*wanted.values()])
            costs = np.asarray(cost(everybody), float) if len(everybody) else np.empty(0)
            ends = np.cumsum([len(individuals) for individuals in wanted.values()])
            for number, run_costs in zip([*wanted], np.split(costs, ends[:-1]), strict=True):
                try:
                    wanted[number] = going[number].send(run_costs)
                except StopIteration as end:
                    ended[number] = end.value
                    del wanted[number]
            best = costs[np.isfinite(costs)].min(initial=best)
            note = f"generation {generation}, {len(ended)} of {settings.runs} runs have ended, {words(best)}"
            search.at(generation if wanted else settings.generations, note)
    return _merge([ended[number] for number in range(settings.runs)])


def has_converged(costs: Sequence[float], widths: Sequence[float]) -> bool:
    """Whether a run has converged (see `CRITERION`). costs: the best so far; widths: of the population, in the box.

    A value for each generation so far.
    """
    if len(costs) <= CONVERGED_AFTER or not math.isfinite(costs[-1 - CONVERGED_AFTER]):
        return False
    improved = costs[-1] < (1.0 - IMPROVED) * costs[-1 - CONVERGED_AFTER]
    narrowed = _NARROW < widths[-1] < (1.0 - NARROWED) * widths[-1 - CONVERGED_AFTER]
    return not improved and not narrowed


def _evolve(
    lower: FloatArray, upper: FloatArray, settings: GeneticSettings, seed: int
) -> Generator[FloatArray, FloatArray, dict[str, Any]]:
    """One run: yields the individuals [S, d] whose costs [S] it is to be sent; its part of what `minimise` returns."""
    rng = np.random.default_rng(seed)
    population, fitness = _latin_hypercube(settings.population, lower, upper, rng), np.empty(0)
    best, best_cost = np.full(len(lower), np.nan), np.inf
    history: list[float] = []
    widths: list[float] = []
    evaluations = failures = converged = 0
    for generation in range(settings.generations):
        individuals = population if generation == 0 else _offspring(population, fitness, lower, upper, rng)
        costs = yield individuals
        # Nothing new can be bred once all individuals are the same; the rest of the history is flat.
        if len(individuals):
            failed = ~np.isfinite(costs)
            evaluations += len(costs)
            failures += int(failed.sum())
            costs = np.where(failed, _FAILED, costs)
            winner = int(np.argmin(costs))
            if not failed[winner] and costs[winner] < best_cost:
                best, best_cost = individuals[winner].copy(), float(costs[winner])
            if generation == 0:
                fitness = costs
            else:
                population, fitness = np.concatenate([population, individuals]), np.append(fitness, costs)
                fittest = np.argsort(fitness, kind="stable")[: settings.population]
                population, fitness = population[fittest], fitness[fittest]
        history.append(best_cost)
        widths.append(math.sqrt(float(np.mean((population.std(axis=0) / (upper - lower)) ** 2))))
        converged = int(has_converged(history, widths))
        if converged:
            break
    return {
        "best": best,
        "cost": best_cost,
        "generations": len(history),
        "converged": converged,
        "history": history,
        "evaluations": evaluations,
        "failures": failures,
    }


def _latin_hypercube(count: int, lower: FloatArray, upper: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Individuals [S, d] in the box: of several Latin hypercubes that whose closest two are farthest apart."""
    best, greatest = np.empty(0), -np.inf
    for _ in range(_HYPERCUBES):
        cells = rng.random((count, len(lower))).argsort(axis=0) + 1
        points = (cells - rng.random(cells.shape)) / count
        distance = float(pdist(points).min(initial=np.inf))
        if distance > greatest:
            best, greatest = points, distance
    return lower + best * (upper - lower)


def _offspring(
    population: FloatArray, fitness: FloatArray, lower: FloatArray, upper: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """As many new individuals as the population [S, d] has, or fewer where too many come out as known ones."""
    offspring = np.empty((0, population.shape[1]))
    for _ in range(_MATINGS):
        missing = len(population) - len(offspring)
        if missing == 0:
            break
        children = _mutated(_crossed(_parents(population, fitness, missing, rng), lower, upper, rng), lower, upper, rng)
        same = cdist(children, children) <= _SAME
        children = children[~np.tril(same, -1).any(axis=1)]
        for known in (population, offspring):
            children = children[~(cdist(children, known) <= _SAME).any(axis=1)]
        offspring = np.concatenate([offspring, children[:missing]])
    return offspring


def _parents(population: FloatArray, fitness: FloatArray, children: int, rng: np.random.Generator) -> FloatArray:
    """Parents [2, matings, d] of so many children: the winners of binary tournaments."""
    matings = math.ceil(children / 2)
    rounds = math.ceil(4 * matings / len(population))
    drawn = np.concatenate([rng.permutation(len(population)) for _ in range(rounds)])[: 4 * matings].reshape(-1, 2)
    first, second = fitness[drawn.T]
    winners = np.where(first < second, *drawn.T)
    for tie in np.flatnonzero(first == second):
        winners[tie] = rng.choice(drawn[tie])
    return population[np.reshape(winners, (matings, 2)).T]


def _crossed(parents: FloatArray, lower: FloatArray, upper: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Children [2 matings, d] by simulated binary crossover within the box; Deb & Agrawal (1995)."""
    _, matings, d = parents.shape
    mated: NDArray[np.bool_] = np.less(rng.random(matings), CROSSOVER_PROBABILITY)
    if not mated.any():
        return parents.reshape(-1, d)
    rng.random(matings)
    crossed = (rng.random((matings, d)) < _CROSSED) & (np.abs(parents[0] - parents[1]) > _CLOSE)
    first, second = parents[0][crossed], parents[1][crossed]
    low, high = np.minimum(first, second), np.maximum(first, second)
    draw, gap, power = rng.random(len(low)), high - low, CROSSOVER_INDEX + 1.0

    def spread(room: FloatArray) -> FloatArray:
        alpha = 2.0 - (1.0 + 2.0 * room / gap) ** -power
        inside = draw <= 1.0 / alpha
        return np.where(inside, draw * alpha, 1.0 / np.where(inside, 1.0, 2.0 - draw * alpha)) ** (1.0 / power)

    room_below = low - np.broadcast_to(lower, (matings, d))[crossed]
    room_above = np.broadcast_to(upper, (matings, d))[crossed] - high
    below, above = 0.5 * (low + high - spread(room_below) * gap), 0.5 * (low + high + spread(room_above) * gap)
    exchanged = rng.random(len(low)) < _EXCHANGED
    children = parents.copy()
    children[0][crossed], children[1][crossed] = np.where(exchanged, (above, below), (below, above))
    children[:, ~mated] = parents[:, ~mated]
    return np.clip(children, lower, upper).reshape(-1, d)


def _mutated(individuals: FloatArray, lower: FloatArray, upper: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Individuals [S, d] after polynomial mutation within the box; Deb & Goyal (1996)."""
    d = individuals.shape[1]
    mutated = rng.random(individuals.shape) < min(0.5, 1.0 / d)
    span = np.broadcast_to(upper - lower, individuals.shape)[mutated]
    below, above = (individuals - lower)[mutated] / span, (upper - individuals)[mutated] / span
    draw, power = rng.random(len(span)), MUTATION_INDEX + 1.0
    left = (2.0 * draw + (1.0 - 2.0 * draw) * (1.0 - below) ** power) ** (1.0 / power) - 1.0
    right = 1.0 - (2.0 * (1.0 - draw) + 2.0 * (draw - 0.5) * (1.0 - above) ** power) ** (1.0 / power)
    changed = individuals.copy()
    changed[mutated] += np.where(draw <= 0.5, left, right) * span
    chosen = rng.random(len(individuals)) <= _MUTATED
    return np.clip(np.where(chosen[:, None], changed, individuals), lower, upper)


def _merge(runs: list[dict[str, Any]]) -> xarray.Dataset:
    longest = max(len(run["history"]) for run in runs)
    runs = [run | {"history": run["history"] + [math.nan] * (longest - len(run["history"]))} for run in runs]
    of_runs = {name: np.array([run[name] for run in runs]) for name in runs[0]}
    best, cost = of_runs["best"], of_runs["cost"]
    succeeded = np.isfinite(cost)
    evaluations, failures = (int(of_runs.pop(name).sum()) for name in ("evaluations", "failures"))
    if not succeeded.any():
        raise FlightcalError(
            f"genetic algorithm: found no finite cost in {evaluations} simulations, expected at least one; "
            "every simulation failed, so the priors allow no working model"
        )
    return xarray.Dataset(
        {
            "best": (("run", "parameter"), best),
            "cost": ("run", cost),
            "generations": ("run", of_runs["generations"]),
            "converged": ("run", of_runs["converged"]),
            "history": (("run", "generation"), of_runs["history"]),
            "mean_theta": ("parameter", best[succeeded].mean(axis=0)),
            "best_theta": ("parameter", best[int(np.argmin(cost))]),
        },
        attrs={
            "evaluations": evaluations,
            "failures": failures,
            "converged_runs": int(of_runs["converged"].sum()),
            "converged_when": CRITERION,
        },
    )
