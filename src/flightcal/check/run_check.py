"""A scenario checked, whole: everything that can be said of it before it is sampled, in a run's folder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from ..calibration import with_found_states
from ..emulation import needs_emulator
from ..errors import FlightcalError
from ..problem import Problem, as_sampled
from ..progress import SILENT, Progress
from ..report import Finding, read_run
from ..run import Run, Stage, plain, read_json, read_provenance, typed
from .centre import find_centre
from .evaluate import THOROUGH, Effort, PriorRuns, runs_of_a_search
from .findings import Checked, findings_of, verdict_of
from .heat import beside_heat
from .identifiability import identifiability
from .page import render
from .prior_predictive import prior_predictive
from .profile import profile
from .sensitivity import sensitivity
from .smoothness import smoothness
from .suspicion import Suspects

_JSON, _PAGE = "check.json", "check.html"


@dataclass(frozen=True)
class CheckSummary:
    """What a caller needs to know of a finished check."""

    passed: bool
    verdict: str
    findings: tuple[Finding, ...]
    page: Path


def _make(
    run: Run,
    problem: Problem,
    parameters: list[dict[str, Any]],
    suspected: Suspects,
    prior_runs: PriorRuns,
    *,
    effort: Effort,
    profiles: Sequence[str],
    seed: int,
) -> None:
    run.folder.write_json("priors.json", parameters)
    infos = tuple(read_run(run.path).parameters)
    checked = check(problem, effort, infos, profiles, suspected, prior_runs, run.progress)
    with run.progress.stage("writing"):
        _write(run, problem, checked)


def _read(run: Run, *_: Any) -> CheckSummary:
    content = read_json(run.folder.file(_JSON))
    findings = tuple(typed(Finding, item) for item in content["findings"])
    return CheckSummary(content["passed"], content["verdict"], findings, run.folder.file(_PAGE))


CHECK: Final = Stage("check", "", (_JSON, _PAGE), _make, _read)
"""Of a problem, the records of its parameters, its suspects and its prior runs. Effort, profiles: see `check`."""


def check(
    problem: Problem,
    effort: Effort,
    infos: tuple[Any, ...],
    profiles: Sequence[str] = (),
    suspected: Suspects | None = None,
    made: PriorRuns | None = None,
    progress: Progress = SILENT,
) -> Checked:
    """Everything that is checked of a problem; infos: how its parameters are shown (`report.run_files`).

    suspected: what `suspects` found; None: it was not asked. made: as many as `effort` says; None: none yet.
    """
    seed = problem.scenario.calibration.seed
    with progress.stage("prior predictive"):
        made = made or PriorRuns(problem, effort.draws)
        prior_runs = made.thetas, made.runs
    if all(run is None for run in made.runs):
        raise FlightcalError(f"none of {made.draws} simulations at prior draws finishes; see 'flightcal simulate'")
    sampled = as_sampled(problem)
    with progress.stage("search of the mode") as searching:
        centre = find_centre(sampled, prior_runs, effort.searches, seed, searching)
        driven = with_found_states(problem, problem.to_theta(centre.z))
        if driven is not None:
            sampled = driven
            centre = find_centre(sampled, prior_runs, effort.searches, seed, searching)
    found = identifiability(sampled, centre.z, centre.hessian)
    with progress.stage("unmodelled heat"):
        heat = beside_heat(problem, centre.z)
    with progress.stage("sensitivity", 1.0) as measuring:
        indices = sensitivity(problem, centre.z, effort, seed, prior_runs, measuring)
    with progress.stage("scans and gradient") as scanning:
        smooth = smoothness(sampled, centre, effort, seed, gradient=not needs_emulator(problem), progress=scanning)
    profiled = []
    for name in profiles:
        with progress.stage(f"profile of {name}", 1.0) as profiling:
            profiled.append(profile(sampled, centre, name, profiling))
    return Checked(
        infos=infos,
        suspects=suspected or Suspects(),
        centre=centre,
        identifiability=found,
        heat=heat,
        predictive=prior_predictive(problem, prior_runs, centre, seed),
        sensitivity=indices,
        smoothness=smooth,
        profiles=tuple(profiled),
        starts={window.label: window.start for window in problem.windows},
        budget=_budget(problem, effort),
    )


def _budget(problem: Problem, effort: Effort) -> str:
    """What was spent, in words."""
    dimension, windows = len(problem.simulated), len(problem.windows)
    if effort is THOROUGH:
        runs = windows * (effort.draws + effort.base * (dimension + 2) + effort.scan * len(problem.names))
        return f"about {runs} simulations besides the search of the mode, seed {problem.scenario.calibration.seed}"
    most = windows * (effort.draws + effort.scan * dimension) + (effort.searches + 1) * runs_of_a_search(problem)
    return f"at most {most} runs of the simulator, seed {problem.scenario.calibration.seed}"


def _write(run: Run, problem: Problem, checked: Checked) -> None:
    findings = findings_of(checked)
    passed, verdict = verdict_of(findings)
    centre = checked.centre
    theta = problem.to_theta(centre.z)
    predictive = {name: value for name, value in vars(checked.predictive).items() if name != "bands"}
    content = {
        "passed": passed,
        "verdict": verdict,
        "findings": findings,
        "examined_at": {
            "what": centre.words,
            "log_density": centre.log_density,
            "theta": dict(zip(problem.names, theta.tolist(), strict=True)),
        },
        "suspects": checked.suspects,
        "prior_predictive": predictive,
        "identifiability": checked.identifiability,
        "heat": checked.heat,
        "sensitivity": checked.sensitivity,
        "smoothness": checked.smoothness,
        "profiles": checked.profiles,
    }
    run.folder.write_json(_JSON, plain(content))
    created = str(read_provenance(run.path).get("created", ""))
    run.folder.write_text(_PAGE, render(checked, problem, findings, run.path, created))
