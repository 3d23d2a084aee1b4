"""The stages of a run that calibrate: compiling, the genetic algorithm, NUTS."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any, Final

import numpy as np
import xarray

from ..problem import Problem, functions_of_heat, rehearsals
from ..progress import about
from ..run import Run, Stage, plain, read_json
from ..scenario import GeneticSettings, NutsSettings, heat_of
from ..simulator import FloatArray, cores
from .diagnostics import Diagnostics
from .methods import calibrate_nuts
from .optimisation import calibrate_genetic, genetic_points
from .posterior import Posterior, posterior_tree, search_record, some_of, thetas_of
from .rough import draws_in_turn, seconds_of_a_gradient

_GRADIENTS = 8
"""Evaluations a draw, of which the bundled examples take 5 to 12."""
_WITH_HEAT = 8.0
"""Times as long a calibration with unmodelled heat takes as such a sampling without: 5 to 30 in the examples."""
_ABSORBED, _WEIGHED = 7e-10, 6e-9
"""s for each sample and function of heat: in each gradient, and, times the functions once more, in their search."""
_SEARCHED, _SOON, _OF_GENERATIONS = 16, 0.5, 0.4
"""Simulations that are timed at least; s within which those of a whole generation are timed instead; and of the most
generations, how many a run of the genetic algorithm takes, until few go on."""
_BESIDE, _BESIDE_WITH_HEAT = 0.5, 4.0
"""s that a calibration of a small network takes beside its sampling."""
POSTERIOR_FILE, DIAGNOSTICS_FILE, GENETIC_FILE = "posterior.nc", "diagnostics.json", "genetic.nc"


@dataclass(frozen=True)
class Sampled:
    """What NUTS left in a run."""

    posterior: xarray.DataTree
    diagnostics: dict[str, Any]
    """Content of diagnostics.json."""

    @property
    def interrupted(self) -> bool:
        """Whether sampling was cut short."""
        return bool(self.posterior.attrs["interrupted"] == "true")


def posterior_draws(posterior: xarray.DataTree, names: tuple[str, ...], count: int, seed: int) -> FloatArray:
    """At most `count` posterior thetas [S, d], chosen at random without repetition."""
    return some_of(thetas_of(posterior, names), count, seed)


def warm(problem: Problem) -> None:
    """Compile and call what later stages call, so that their times are without compilation."""
    median = problem.priors.median()
    if heat_of(problem.scenario) is not None:
        for like in (problem.independent(), *rehearsals(problem)):
            like.warm()
    else:
        problem.warm()
        problem.log_density_and_gradient(problem.to_z(median))
    problem.simulate_many(np.tile(median, (8, 1)))


def rough_seconds(problem: Problem, settings: NutsSettings, together: int = 1) -> float:
    """Seconds that sampling a problem will take, to a factor of three; with unmodelled heat of five.

    together: samplings that share the cores; then it is one's share of the time that all take. A gradient is timed,
    where there is unmodelled heat without it; see `_GRADIENTS` and `_WITH_HEAT`.
    """
    timed = problem if heat_of(problem.scenario) is None else problem.independent()
    gradient = seconds_of_a_gradient(timed, timed.to_z(timed.priors.median()))
    shared = min(settings.chains * together, cores())
    gradients = draws_in_turn(settings, together) * _GRADIENTS
    if timed is problem:
        return gradients * gradient + _BESIDE / min(shared, together)
    numbers, functions = sum(int(window.valid.sum()) for window in problem.windows), functions_of_heat(problem)
    absorbed = numbers * functions * (gradients * _ABSORBED + functions * _WEIGHED / min(shared, together))
    return _WITH_HEAT * gradients * gradient + absorbed + _BESIDE_WITH_HEAT / min(shared, together)


def rough_search_seconds(problem: Problem, settings: GeneticSettings) -> float:
    """Seconds that the genetic algorithm will take, to a factor of two."""
    individuals, rng = settings.runs * settings.population, np.random.default_rng(0)

    def seconds(count: int) -> float:
        """Of a generation, as so many simulations at draws of the priors tell it."""
        thetas = problem.priors.sample(rng, count)
        started = perf_counter()
        problem.rmse(thetas)
        return (perf_counter() - started) / count * individuals

    # What is made only once is no part of a generation: an emulator also fits heaters' duty at its first call.
    seconds(1)
    # The first ones also reserve memory.
    generation = seconds(_SEARCHED)
    if generation < _SOON:
        generation = seconds(individuals)
    return generation * _OF_GENERATIONS * settings.generations


def _search(run: Run, problem: Problem, *, settings: GeneticSettings, seed: int) -> None:
    run.progress.say(f"genetic algorithm: {about(rough_search_seconds(problem, settings))}")
    run.folder.write_netcdf(GENETIC_FILE, calibrate_genetic(problem, settings, seed, progress=run.progress))


def _sample(run: Run, problem: Problem, genetic: xarray.Dataset, *, settings: NutsSettings, seed: int) -> None:
    run.progress.say(f"stochastic update: {about(rough_seconds(problem, settings))}")
    best = genetic_points(problem, genetic)["genetic_best"]
    keep_sample(run, problem, settings, seed, starts=[("the genetic algorithm's best", best)])


def keep_sample(
    run: Run,
    problem: Problem,
    settings: NutsSettings,
    seed: int,
    *,
    starts: Sequence[tuple[str, FloatArray]],
    random_starts: int = 6,
    judge: Callable[[Posterior], Diagnostics] = lambda posterior: posterior.diagnostics,
) -> None:
    """Sample a problem as `calibrate_nuts` does, and write posterior.nc and diagnostics.json. judge: of the posterior.

    Raises KeyboardInterrupt where sampling was interrupted before the first draw.
    """
    posterior = calibrate_nuts(
        problem, settings, seed, starts=starts, random_starts=random_starts, progress=run.progress
    )
    if posterior.draws.interrupted:
        run.progress.say(
            "interrupted: what was drawn so far is kept, scored and reported, and the same command samples anew; "
            "interrupt once more to stop at once"
        )
    run.folder.log(stage=NUTS.name, event="mode", mode_search=search_record(posterior.problem, posterior.modes))
    run.folder.write_netcdf(POSTERIOR_FILE, posterior_tree(posterior.problem, posterior, seed=seed))
    found = judge(posterior)
    content = plain(found) | {"gradient_evaluations": int(posterior.draws.gradients)}
    run.folder.write_json(DIAGNOSTICS_FILE, content)


def _read_sample(run: Run, *_: Any) -> Sampled:
    return Sampled(run.folder.read_tree(POSTERIOR_FILE), read_json(run.folder.file(DIAGNOSTICS_FILE)))


COMPILE: Final = Stage(
    "compile", "compiling (long only once)", (), lambda run, problem: warm(problem), lambda run, problem: None
)
"""Of a problem."""

GENETIC: Final = Stage(
    "genetic", "genetic algorithm", (GENETIC_FILE,), _search, lambda run, problem: run.folder.read_dataset(GENETIC_FILE)
)
"""Of a problem; `calibrate_genetic`."""

NUTS: Final = Stage(
    "nuts",
    "stochastic update (NUTS)",
    (POSTERIOR_FILE, DIAGNOSTICS_FILE),
    _sample,
    _read_sample,
    lambda sampled: not sampled.interrupted,
)
"""Of a problem and what the genetic algorithm gave; `calibrate_nuts`."""
