"""The stages of an experiment that only a simulator without derivatives has: emulator, check, window emulators."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray

from ..calibration import Diagnostics, Gate, with_gate
from ..problem import Problem
from ..progress import Listener
from ..run import Run, hash_of, plain
from ..simulator import FloatArray
from .active import Learnt, Round, learn, noise_level, simulated_priors
from .emulated import (
    CHECKED,
    SimulatorCheck,
    around_draws,
    check_on_the_simulator,
    empty_runs,
    external,
    through_the_priors,
    with_emulator,
)
from .emulator import fit_emulator
from .held_out import Validation
from .horizon import beginnings
from .runs import TrainingRuns, read_runs
from .simulator_check import LARGEST_DENSITY_ERROR

RUNS_FILE, EMULATOR_FILE, CHECK_FILE = "training_runs.nc", "emulator.json", "emulator_check.json"


@dataclass(frozen=True)
class Emulation:
    """What the later stages need of the emulator."""

    problem: Problem
    """The training window's, with the emulator in the simulator's place."""
    searched: Problem
    """The same with a coarse emulator of all runs, for the genetic algorithm."""
    theta: FloatArray
    """[d] where to start sampling."""
    reached: bool
    """Whether the emulator's error no longer matters."""
    verdict: str
    """Of the last round."""


def emulator_stage(run: Run, key: str, problem: Problem, telemetry: xarray.Dataset, listener: Listener) -> Emulation:
    """Learn the emulator, or take it from its files: all runs in training_runs.nc, the rounds in emulator.json."""
    done = run.is_done("emulator", key, (RUNS_FILE, EMULATOR_FILE))
    listener.stage("emulator", done)
    if not done:
        calibration = problem.scenario.calibration
        settings = calibration.emulator.model_copy(update={"runs": calibration.emulator.runs - CHECKED})
        with run.stage("emulator", key):

            def told(round_: Round) -> None:
                listener.learning(str(round_))
                run.log(stage="emulator", event="round", text=str(round_))

            learnt = learn(
                problem,
                external(problem).run_many,
                _runs_so_far(run.file(RUNS_FILE), problem),
                settings,
                calibration.seed,
                beginning=beginnings(problem, telemetry),
                save=lambda runs: runs.write(run.file(RUNS_FILE)),
                on_round=told,
            )
            run.write_json(EMULATOR_FILE, _content(learnt))
    content = json.loads(run.file(EMULATOR_FILE).read_text(encoding="utf-8"))
    runs = read_runs(run.file(RUNS_FILE), empty_runs(problem))
    fitted = runs.take(np.array(content["fitted"]))
    emulator = fit_emulator(fitted, simulated_priors(problem).to_z(fitted.theta), np.array(content["tolerance"]))
    return Emulation(
        problem=with_emulator(problem, emulator),
        searched=through_the_priors(problem, runs, noise_level(problem)),
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
    runs.write(run.file("check_runs.nc"))
    found = {"failed": int((~runs.finished).sum()), "density_error": check.density_error, "steps": check.steps}
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


def window_emulator(run: Run, key: str, emulation: Emulation, draws: FloatArray, problem: Problem) -> Problem:
    """A window's problem with an emulator around posterior draws [S, d]; its runs are kept in the run directory."""
    if problem.window == "train":
        return emulation.problem
    key = hash_of(key, problem.window)
    stage, file = f"emulator {problem.window}", run.file(f"training_runs_{problem.window}.nc")
    kept = read_runs(file, empty_runs(problem)) if run.is_done(stage, key, (file.name,)) else None
    emulated, runs, validation = around_draws(problem, draws, problem.scenario.calibration.seed, kept)
    if kept is None:
        with run.stage(stage, key):
            runs.write(file)
            run.write_json(f"emulator_{problem.window}.json", plain(validation))
    return emulated


def _runs_so_far(file: Path, problem: Problem) -> TrainingRuns:
    nothing = empty_runs(problem)
    return read_runs(file, nothing) if file.exists() else nothing


def _content(learnt: Learnt) -> dict[str, Any]:
    content: dict[str, Any] = plain(
        {
            "runs": len(learnt.runs),
            "failed": int((~learnt.runs.finished).sum()),
            "failures": learnt.failures,
            "reached": learnt.reached,
            "theta": learnt.theta,
            "fitted": learnt.fitted,
            "tolerance": learnt.tolerance,
            "rounds": learnt.rounds,
        }
    )
    return content
