"""The whole machinery on telemetry that the user's own scenario makes, many times over.

Each repeat draws theta from the prior, makes telemetry with it at the scenario's own sample times and gaps, and
calibrates that. A repeat that ends is a file; a later call takes up where an earlier one stopped, and may ask for more.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from time import perf_counter

import numpy as np
import xarray

from ..calibration import calibrate_nuts, least_effective, rough_seconds, warm
from ..emulation import needs_emulator
from ..errors import RunError, ScenarioError
from ..probability import DEVIATION, Priors
from ..problem import Problem, build_problem, heat_in_prior, simulate_telemetry, with_drawn_heat, with_telemetry
from ..progress import SILENT, Progress, about
from ..run import RunDirectory, each, plain, typed
from ..scenario import NutsSettings, load_scenario
from ..simulator import FloatArray, SimulationFailure
from ..telemetry import read
from .comparison import models_of, variant
from .simulation_based import INTERVALS, RankCheck, Repeat, check_ranks, ranks

LOG_DENSITY = "log density"
"""The quantity beside theta's entries whose ranks are looked at: it depends on the telemetry, so it also sees what
leaves every marginal distribution right (Modrák et al. 2023, Bayesian Analysis)."""

_CHAINS, _MOST_DRAWS = 2, 300
_MAX_R_HAT, _MIN_ESS = 1.05, 50.0
_MOST_REDRAWN = 100
_PRIOR_DRAWS = 4000
_REPEATS, _RESULT = "repeats", "validation.json"

Source = tuple[str, str | None, str | None]
"""Scenario file, telemetry in the place of its own, model of the residuals in the place of its own."""


@dataclass(frozen=True)
class Validation:
    """What the repeats came to."""

    folder: Path
    names: tuple[str, ...]
    repeats: tuple[Repeat, ...]
    checks: tuple[RankCheck, ...]

    @property
    def passed(self) -> bool:
        """Whether the ranks of all quantities stay in the band."""
        return all(check.inside for check in self.checks)


def run_repeats(
    run: RunDirectory, source: Source, repeats: int, *, workers: int = 2, progress: Progress = SILENT
) -> None:
    """Run those of so many repeats that are missing in a folder. workers: processes; 1: this one."""
    problem, _ = prepared(*source)
    run.file(_REPEATS).mkdir(exist_ok=True)
    missing = [k for k in range(repeats) if not run.keeps(_name(k))]
    with progress.stage("validating", repeats) as validating:
        validating.at(repeats - len(missing))
        if missing:
            # Once, so that the processes find it compiled.
            warm(problem)
            settings, together = short(problem.scenario.calibration.nuts), min(workers, len(missing))
            time = about(len(missing) * rough_seconds(problem, settings, together))
            validating.say(f"{len(missing)} repeats, each a short calibration, {together} at a time: {time} in all")
        left, started = len(missing), perf_counter()

        def done(number: int, repeat: Repeat) -> None:
            nonlocal left
            run.write_json(_name(number), plain(repeat))
            left -= 1
            time = about((perf_counter() - started) * left / (len(missing) - left))
            validating.at(repeats - left, f"{repeats - left} of {repeats} repeats{f', {time} left' if left else ''}")

        if workers == 1 or left < 2:
            for number in missing:
                done(number, _one(source, number))
        else:
            each(partial(_one, source), missing, workers, done=done, lost=_lost)


def short(settings: NutsSettings) -> NutsSettings:
    """The scenario's sampler with two chains and at most 300 draws each, and gates that so few can pass."""
    return settings.model_copy(
        update={
            "chains": _CHAINS,
            "draws": min(settings.draws, _MOST_DRAWS),
            "max_r_hat": max(settings.max_r_hat, _MAX_R_HAT),
            "min_ess": min(settings.min_ess, _MIN_ESS),
        }
    )


def run_repeat(problem: Problem, telemetry: xarray.Dataset, settings: NutsSettings, seed: Sequence[int]) -> Repeat:
    """One repeat. telemetry: what the problem was built from.

    Thetas that cannot be simulated have no telemetry, and are drawn again: prior and posterior both leave them out.
    Raises RunError where that never ends.
    """
    started = perf_counter()
    rng = np.random.default_rng(seed)
    redrawn = 0
    while True:
        theta = problem.priors.sample(rng, 1)[0]
        with suppress(SimulationFailure):
            heated, sizes = with_drawn_heat(problem, rng)
            telemetry_made = simulate_telemetry(heated, theta, rng)
            break
        redrawn += 1
        if redrawn == _MOST_REDRAWN:
            raise RunError(
                f"none of {_MOST_REDRAWN} draws from the priors can be simulated; check the priors with "
                "'flightcal simulate'"
            )
    made = with_telemetry(problem, telemetry, telemetry_made)
    posterior = calibrate_nuts(made, settings, int(rng.integers(2**32)))
    if posterior.draws.interrupted:
        raise KeyboardInterrupt
    names = ranked_names(problem)
    values = dict(zip(problem.names, theta, strict=True)) | sizes
    of_draws = {name: posterior.theta[..., k] for k, name in enumerate(posterior.names)}
    if LOG_DENSITY in names:
        values[LOG_DENSITY] = made.log_density(made.to_z(theta))
        of_draws[LOG_DENSITY] = posterior.draws.statistics["log_density"]
    truth = np.array([values[name] for name in names])
    draws = np.stack([of_draws[name] for name in names], axis=-1)
    rank, count = ranks(truth, draws, least_effective(draws), rng)
    return Repeat(
        truth=truth,
        rank=rank,
        mean=draws.mean(axis=(0, 1)),
        deviation=draws.std(axis=(0, 1)),
        draws=count,
        gates=tuple(gate.name for gate in posterior.diagnostics.gates if not gate.passed),
        redrawn=redrawn,
        seconds=perf_counter() - started,
    )


def ranked_names(problem: Problem) -> tuple[str, ...]:
    """The quantities whose ranks are looked at.

    With heat its sizes are among them. Not the shape of the noise, which is then taken as the most probable one, nor
    the log density, which is that of the most probable sizes.
    """
    heat = heat_in_prior(problem)
    if heat is None:
        return *problem.names, LOG_DENSITY
    entries = problem.windows[0].residuals.entries
    held = {entry.name for entry in entries if entry.column != DEVIATION}
    return *(name for name in problem.names if name not in held), *heat.names


def judge_repeats(run: RunDirectory, problem: Problem, repeats: int) -> Validation:
    """Read the first `repeats` repeats of a folder, judge them, and write validation.json."""
    names = ranked_names(problem)
    found = tuple(_read(run.file(_name(k))) for k in range(repeats))
    prior = _prior_deviations(problem, names)
    checks = tuple(check_ranks(names, found, prior))
    validation = Validation(run.path, names, found, checks)
    content = {
        "name": problem.scenario.name,
        "passed": validation.passed,
        "repeats": repeats,
        "intervals": INTERVALS,
        "quantities": checks,
        "ranks": [repeat.rank for repeat in found],
        "scores": [(repeat.mean - repeat.truth) / repeat.deviation for repeat in found],
        "contractions": [1.0 - (repeat.deviation / prior) ** 2 for repeat in found],
        "draws": [repeat.draws for repeat in found],
        "gates": [repeat.gates for repeat in found],
        "redrawn": sum(repeat.redrawn for repeat in found),
        "seconds": sum(repeat.seconds for repeat in found),
    }
    run.write_json(_RESULT, plain(content))
    return validation


def _prior_deviations(problem: Problem, names: Sequence[str]) -> FloatArray:
    heat = heat_in_prior(problem)
    priors = problem.priors
    if heat is not None:
        priors = Priors((*priors.names, *heat.priors), (*priors.priors, *heat.priors.values()))
    deviations = priors.sample(np.random.default_rng(0), _PRIOR_DRAWS).std(axis=0)
    known = dict(zip(priors.names, deviations, strict=True))
    return np.array([known.get(name, np.nan) for name in names])


# --- processes ----------------------------------------------------------------------------------------------


@cache
def prepared(scenario_file: str, telemetry: str | None, residuals: str | None) -> tuple[Problem, xarray.Dataset]:
    """The scenario's problem and its telemetry: once in each process."""
    scenario = load_scenario(scenario_file, telemetry=telemetry)
    if residuals is not None:
        if residuals not in models_of(scenario):
            raise RunError(f"--residuals: found {residuals}, expected one of {', '.join(models_of(scenario))}")
        scenario = variant(scenario, residuals)
    data = read(scenario)
    problem = build_problem(scenario, data)
    if needs_emulator(problem):
        raise ScenarioError(
            f"{scenario_file}: simulator: found one without derivatives, expected a thermal network or one with a "
            "gradient: each repeat would need an emulator of its own"
        )
    return problem, data


def _one(source: Source, number: int) -> Repeat:
    problem, data = prepared(*source)
    settings = problem.scenario.calibration
    return run_repeat(problem, data, short(settings.nuts), [settings.seed, number])


def _lost(number: int) -> Repeat:
    raise RunError("a process of the validation was killed; run the same command to take it up again")


# --- files --------------------------------------------------------------------------------------------------


def _name(number: int) -> str:
    return f"{_REPEATS}/{number:04d}.json"


def _read(file: Path) -> Repeat:
    try:
        return typed(Repeat, json.loads(file.read_text(encoding="utf-8")))
    except (ValueError, KeyError, TypeError) as error:
        raise RunError(f"{file}: found a damaged repeat ({error}); delete it and run the same command again") from None
