"""The stages of an experiment that only a simulator without derivatives has: emulator, check, window emulators."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray

from ..calibration import (
    EMULATED_DENSITY,
    EMULATOR_ERROR,
    HELD_OUT,
    NUTS,
    Diagnostics,
    Gate,
    gate,
    keep_sample,
    with_gate,
)
from ..errors import ScenarioError
from ..problem import Problem, Window
from ..run import Run, Stage, plain, read_json
from ..scenario import EmulatorSettings, NutsSettings, not_normal
from ..simulator import FloatArray, Trajectory
from .active import Belief, Learnt, learn
from .design import Runs, start_runs
from .emulated import (
    CHECKED,
    SimulatorCheck,
    around_draws,
    check_on_the_simulator,
    empty_runs,
    in_place,
    run_many,
    through_the_priors,
)
from .emulator import fit_emulator, simulated_priors, with_emulator
from .held_out import HeldOutScores
from .horizon import beginning
from .runs import read_runs
from .simulator_check import LARGEST_DENSITY_ERROR

RUNS_FILE, EMULATOR_FILE, CHECK_FILE = "training_runs.nc", "emulator.json", "emulator_check.json"
_ROUNDS_FILE = "emulator_rounds.json"
"""Draws of each round, so that an interrupted learning takes them up."""


@dataclass(frozen=True)
class Emulation:
    """What the later stages need of the emulator."""

    problem: Problem
    """With emulators in the place of its windows' simulators."""
    searched: Problem
    """The same with coarse emulators of all runs, for the genetic algorithm."""
    start: tuple[FloatArray, list[tuple[Trajectory, ...] | None]]
    """Thetas [S, d] through the priors and the simulator's own runs there, of each window; None where one failed."""
    theta: FloatArray
    """[d] where to start sampling."""
    reached: bool
    """Whether the emulator's error no longer matters."""
    verdict: str
    """Of the last round."""
    followed: int
    """Samples of the windows, from their beginnings, that an emulator followed before the last round's runs."""


def emulator_stage(problem: Problem) -> Stage[Emulation]:
    """The stage that learns emulators of a problem's windows: their runs in training_runs.nc, rounds in emulator.json.

    It takes in the problem and its telemetry. Raises ScenarioError where no emulator can stand in.
    """
    if not all(window.residuals.is_normal for window in problem.windows):
        raise ScenarioError(
            f"noise: found {' and '.join(not_normal(problem.scenario))} noise, expected normal noise: the simulator's "
            "server offers no gradient, and only with normal noise can an emulator's error be integrated out"
        )
    files = (*_names(RUNS_FILE, problem), _ROUNDS_FILE, EMULATOR_FILE)
    return Stage("emulator", "learning an emulator", files, _learn, _read_learnt)


def _learn(run: Run, problem: Problem, telemetry: xarray.Dataset, *, settings: EmulatorSettings, seed: int) -> None:
    files = _names(RUNS_FILE, problem)
    learnt = learn(
        problem,
        run_many,
        _runs_so_far(run, files, problem),
        settings.model_copy(update={"runs": settings.runs - CHECKED * len(problem.windows)}),
        seed,
        beginning=partial(beginning, telemetry),
        beliefs=_beliefs_so_far(run),
        save=partial(_write, run, files),
        save_beliefs=lambda beliefs: run.folder.write_json(_ROUNDS_FILE, plain(beliefs)),
        progress=run.progress,
    )
    run.folder.write_json(EMULATOR_FILE, _content(learnt))


def _read_learnt(run: Run, problem: Problem, telemetry: xarray.Dataset) -> Emulation:
    content = read_json(run.folder.file(EMULATOR_FILE))
    files = _names(RUNS_FILE, problem)
    runs = _runs_so_far(run, files, problem)
    windows = []
    for window, training, positions, tolerance in zip(
        problem.windows, runs, content["fitted"], content["tolerance"], strict=True
    ):
        fitted = training.take(np.array(positions))
        emulator = fit_emulator(fitted, simulated_priors(window), np.array(tolerance))
        windows.append(with_emulator(window, emulator))
    return Emulation(
        problem=in_place(problem, windows),
        searched=through_the_priors(problem, runs),
        start=start_runs(problem, runs),
        theta=np.array(content["theta"]),
        reached=content["reached"],
        verdict=content["rounds"][-1]["verdict"],
        followed=content["rounds"][-2:][0]["samples"],
    )


def _sample(
    run: Run, problem: Problem, genetic: xarray.Dataset, emulation: Emulation, *, settings: NutsSettings, seed: int
) -> None:
    keep_sample(
        run,
        emulation.problem,
        settings,
        seed,
        starts=[("active learning", emulation.theta)],
        random_starts=0,
        judge=lambda posterior: check_emulator(run, problem, emulation, posterior.flat, posterior.diagnostics),
    )


NUTS_THROUGH_EMULATOR: Final = replace(NUTS, files=(*NUTS.files, CHECK_FILE), make=_sample)
"""Of a problem, what the genetic algorithm gave, and the emulator."""


def check_emulator(
    run: Run, problem: Problem, emulation: Emulation, draws: FloatArray, diagnostics: Diagnostics
) -> Diagnostics:
    """The diagnostics with two more gates: the rule of the active learning, and the simulator itself at the posterior.

    draws: posterior thetas [S, d]. Writes emulator_check.json and check_runs.nc.
    """
    check, runs = check_on_the_simulator(problem, emulation.problem, draws, problem.scenario.calibration.seed)
    _write(run, _names("check_runs.nc", problem), runs)
    failed = sum(int((~training.finished).sum()) for training in runs)
    found = {"failed": failed, "density_error": check.density_error, "steps": check.steps}
    run.folder.write_json(CHECK_FILE, plain(check.validation) | plain(found))
    for judged in (_rule(problem, emulation), _held_out(check.validation), _density(check), *_in_step(check)):
        diagnostics = with_gate(diagnostics, judged)
    return diagnostics


def _rule(problem: Problem, emulation: Emulation) -> Gate:
    allowed = f"calibration.emulator.runs, now {problem.scenario.calibration.emulator.runs}"
    whole = sum(len(window.times) for window in problem.windows)
    advice = f"Allow more runs ({allowed}): the posterior is as wide as it is partly for want of them."
    if emulation.followed < whole:
        advice = (
            f"Train on a shorter window, narrow the priors, or allow more runs ({allowed}): the emulator followed the "
            f"simulator over the first {emulation.followed} of {whole} samples, as where a thermostat gets out of step."
        )
    found = "no longer matters" if emulation.reached else emulation.verdict
    return gate(EMULATOR_ERROR, emulation.reached, found, "no longer matters", advice)


def _held_out(validation: HeldOutScores) -> Gate:
    covered = validation.channels[-1].coverage[-1]
    return gate(
        HELD_OUT,
        validation.passed,
        f"95% intervals cover {covered:.0%} of {validation.runs} runs at the posterior",
        "as many as they say",
        f"{next(iter(validation.failures), '')}. Allow more runs (calibration.emulator.runs).",
    )


def _density(check: SimulatorCheck) -> Gate:
    return gate(
        EMULATED_DENSITY,
        check.density_error <= LARGEST_DENSITY_ERROR,
        f"the emulator's log density is off by {check.density_error:.2f} over draws (standard deviation)",
        f"at most {LARGEST_DENSITY_ERROR:g}",
        "The simulator's own posterior is another one: its means may be off by as many standard deviations. Allow "
        "more runs (calibration.emulator.runs), or narrow the priors.",
    )


def _in_step(check: SimulatorCheck) -> list[Gate]:
    """Whether the heaters whose status is measured switch as it says; none where no status is measured."""
    if not check.steps:
        return []
    worst = max(check.steps, key=lambda item: item.unmatched)
    return [
        gate(
            "Heaters in step",
            worst.unmatched < 1.0,
            f"{worst.unmatched:g} switches of '{worst.heater}' without a counterpart ({worst.measured} measured)",
            "none",
            "At the posterior the simulator's heater goes through other cycles than the telemetry shows: a "
            "local mode, or the model cannot follow the heater. Try another seed, narrower priors or a shorter window.",
        )
    ]


def window_emulator(run: Run, emulation: Emulation, draws: FloatArray, window: Window) -> Window:
    """A window with an emulator around posterior draws thetas [S, d]; its runs are kept in the run's folder."""
    for trained in emulation.problem.windows:
        if trained.name == window.name:
            return trained
    name, seed = window.name, window.scenario.calibration.seed
    thetas = emulation.problem.at(window, draws, np.random.default_rng([seed, *name.encode()]))
    runs_file, found_file = f"training_runs_{name}.nc", f"emulator_{name}.json"

    def make(run: Run, *_: Any) -> None:
        runs, validation = around_draws(window, thetas, seed)[1:]
        run.folder.write_netcdf(runs_file, runs.dataset())
        run.folder.write_json(found_file, plain(validation))

    def read(run: Run, *_: Any) -> Window:
        return around_draws(window, thetas, seed, read_runs(run.folder.file(runs_file), empty_runs(window)))[0]

    stage = Stage(f"emulator {name}", "", (runs_file, found_file), make, read)
    return run.stage(stage, emulation, draws, window.scenario.windows[name])


def _names(name: str, problem: Problem) -> list[str]:
    """The file of each training window's runs, which has the window's name where there are several."""
    if len(problem.windows) == 1:
        return [name]
    return [f"{Path(name).stem}_{window.name}.nc" for window in problem.windows]


def _write(run: Run, files: list[str], runs: Runs) -> None:
    for file, training in zip(files, runs, strict=True):
        run.folder.write_netcdf(file, training.dataset())


def _runs_so_far(run: Run, files: list[str], problem: Problem) -> Runs:
    empty, folder = [empty_runs(window) for window in problem.windows], run.folder
    pairs = zip(files, empty, strict=True)
    return tuple(read_runs(folder.file(file), training) if folder.keeps(file) else training for file, training in pairs)


def _beliefs_so_far(run: Run) -> list[Belief]:
    if not run.folder.keeps(_ROUNDS_FILE):
        return []
    kept = read_json(run.folder.file(_ROUNDS_FILE))
    return [Belief(**{**belief, "z": np.array(belief["z"])}) for belief in kept]


def _content(learnt: Learnt) -> dict[str, Any]:
    """What emulator.json says; `fitted` and `tolerance` are those of each window."""
    last = learnt.rounds[-1]
    content: dict[str, Any] = plain(
        {
            "runs": last.runs,
            "failed": last.failed,
            "failures": learnt.failures,
            "reached": learnt.reached,
            "theta": learnt.theta,
            "fitted": [fit.fitted for fit in learnt.fits],
            "tolerance": [fit.tolerance for fit in learnt.fits],
            "rounds": learnt.rounds,
        }
    )
    return content
