"""The stages of an experiment that only a simulator without derivatives has: emulator, check, window emulators."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray

from ..calibration import Diagnostics, Gate, with_gate
from ..problem import Problem, Window
from ..progress import Listener
from ..run import Run, hash_of, plain
from ..simulator import FloatArray
from .active import Learnt, Round, Runs, learn
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
from .held_out import Validation
from .horizon import beginning
from .runs import read_runs
from .simulator_check import LARGEST_DENSITY_ERROR

RUNS_FILE, EMULATOR_FILE, CHECK_FILE = "training_runs.nc", "emulator.json", "emulator_check.json"


@dataclass(frozen=True)
class Emulation:
    """What the later stages need of the emulator."""

    problem: Problem
    """With emulators in the place of its windows' simulators."""
    searched: Problem
    """The same with coarse emulators of all runs, for the genetic algorithm."""
    theta: FloatArray
    """[d] where to start sampling."""
    reached: bool
    """Whether the emulator's error no longer matters."""
    verdict: str
    """Of the last round."""


def emulator_stage(run: Run, key: str, problem: Problem, telemetry: xarray.Dataset, listener: Listener) -> Emulation:
    """Learn the emulators, or take them from their files: runs in training_runs.nc, the rounds in emulator.json."""
    files = _files(run, RUNS_FILE, problem)
    done = run.is_done("emulator", key, (*(file.name for file in files), EMULATOR_FILE))
    listener.stage("emulator", done)
    if not done:
        calibration = problem.scenario.calibration
        left = calibration.emulator.runs - CHECKED * len(problem.windows)
        settings = calibration.emulator.model_copy(update={"runs": left})
        with run.stage("emulator", key):

            def told(round_: Round) -> None:
                listener.learning(str(round_))
                run.log(stage="emulator", event="round", text=str(round_))

            learnt = learn(
                problem,
                run_many,
                _runs_so_far(files, problem),
                settings,
                calibration.seed,
                beginning=partial(beginning, telemetry),
                save=partial(_write, files),
                on_round=told,
            )
            run.write_json(EMULATOR_FILE, _content(learnt))
    content = json.loads(run.file(EMULATOR_FILE).read_text(encoding="utf-8"))
    runs = _runs_so_far(files, problem)
    chosen, tolerances = content["fitted"], content["tolerance"]
    if len(files) == 1:
        chosen, tolerances = [chosen], [tolerances]
    windows = []
    for window, own, positions, tolerance in zip(problem.windows, runs, chosen, tolerances, strict=True):
        fitted = own.take(np.array(positions))
        z = simulated_priors(window).to_z(fitted.theta)
        windows.append(with_emulator(window, fit_emulator(fitted, z, np.array(tolerance))))
    return Emulation(
        problem=in_place(problem, windows),
        searched=through_the_priors(problem, runs),
        theta=np.array(content["theta"]),
        reached=content["reached"],
        verdict=content["rounds"][-1]["verdict"],
    )


def check_emulator(
    run: Run, problem: Problem, emulation: Emulation, draws: FloatArray, diagnostics: Diagnostics
) -> Diagnostics:
    """The diagnostics with two more gates: the rule of the active learning, and the simulator itself at the posterior.

    draws: posterior thetas [S, d]. Writes emulator_check.json and check_runs.nc.
    """
    check, runs = check_on_the_simulator(problem, emulation.problem, draws, problem.scenario.calibration.seed)
    _write(_files(run, "check_runs.nc", problem), runs)
    failed = sum(int((~own.finished).sum()) for own in runs)
    found = {"failed": failed, "density_error": check.density_error, "steps": check.steps}
    run.write_json(CHECK_FILE, plain(check.validation) | plain(found))
    rule = Gate(
        "Emulator's error",
        emulation.reached,
        "no longer matters" if emulation.reached else emulation.verdict,
        "no longer matters",
        ""
        if emulation.reached
        else "Allow more runs (calibration.emulator.runs): the posterior is as wide as it is partly for want of them.",
    )
    for gate in (rule, _held_out(check.validation), _density(check), *_in_step(check)):
        diagnostics = with_gate(diagnostics, gate)
    return diagnostics


def _held_out(validation: Validation) -> Gate:
    covered = validation.channels[-1].coverage[-1]
    return Gate(
        "Emulator against simulator",
        validation.passed,
        f"95% intervals cover {covered:.0%} of {validation.runs} runs at the posterior",
        "as many as they say",
        "" if validation.passed else f"{validation.failures[0]}. Allow more runs (calibration.emulator.runs).",
    )


def _density(check: SimulatorCheck) -> Gate:
    passed = check.density_error <= LARGEST_DENSITY_ERROR
    return Gate(
        "Posterior against simulator",
        passed,
        f"the emulator's log density is off by {check.density_error:.2f} over draws (standard deviation)",
        f"at most {LARGEST_DENSITY_ERROR:g}",
        ""
        if passed
        else "The simulator's own posterior is another one: its means may be off by as many standard deviations. Allow "
        "more runs (calibration.emulator.runs), or narrow the priors.",
    )


def _in_step(check: SimulatorCheck) -> list[Gate]:
    """Whether the heaters whose status is measured switch as it says; none where no status is measured."""
    if not check.steps:
        return []
    worst = max(check.steps, key=lambda item: item.unmatched)
    passed = worst.unmatched < 1.0
    return [
        Gate(
            "Heaters in step",
            passed,
            f"{worst.unmatched:g} switches of '{worst.heater}' without a counterpart ({worst.measured} measured)",
            "none",
            ""
            if passed
            else "At the posterior the simulator's heater goes through other cycles than the telemetry shows: a "
            "local mode, or the model cannot follow the heater. Try another seed, narrower priors or a shorter window.",
        )
    ]


def window_emulator(run: Run, key: str, emulation: Emulation, draws: FloatArray, window: Window) -> Window:
    """A window with an emulator around posterior draws thetas [S, d]; its runs are kept in the run directory."""
    for trained in emulation.problem.windows:
        if trained.name == window.name:
            return trained
    name, seed = window.name, window.scenario.calibration.seed
    key = hash_of(key, name)
    stage, file = f"emulator {name}", run.file(f"training_runs_{name}.nc")
    kept = read_runs(file, empty_runs(window)) if run.is_done(stage, key, (file.name,)) else None
    thetas = emulation.problem.at(window, draws, np.random.default_rng([seed, *name.encode()]))
    emulated, runs, validation = around_draws(window, thetas, seed, kept)
    if kept is None:
        with run.stage(stage, key):
            runs.write(file)
            run.write_json(f"emulator_{name}.json", plain(validation))
    return emulated


def _files(run: Run, name: str, problem: Problem) -> list[Path]:
    """The file of each training window's runs, which has the window's name where there are several."""
    if len(problem.windows) == 1:
        return [run.file(name)]
    return [run.file(f"{Path(name).stem}_{window.name}.nc") for window in problem.windows]


def _write(files: list[Path], runs: Runs) -> None:
    for file, own in zip(files, runs, strict=True):
        own.write(file)


def _runs_so_far(files: list[Path], problem: Problem) -> Runs:
    empty = [empty_runs(window) for window in problem.windows]
    return tuple(read_runs(file, own) if file.exists() else own for file, own in zip(files, empty, strict=True))


def _content(learnt: Learnt) -> dict[str, Any]:
    """What emulator.json says; of several windows `fitted` and `tolerance` are lists, in the windows' order."""
    last, several = learnt.rounds[-1], len(learnt.fits) > 1
    fitted, tolerance = [fit.fitted for fit in learnt.fits], [fit.tolerance for fit in learnt.fits]
    content: dict[str, Any] = plain(
        {
            "runs": last.runs,
            "failed": last.failed,
            "failures": learnt.failures,
            "reached": learnt.reached,
            "theta": learnt.theta,
            "fitted": fitted if several else fitted[0],
            "tolerance": tolerance if several else tolerance[0],
            "rounds": learnt.rounds,
        }
    )
    return content
