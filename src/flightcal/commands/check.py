"""`flightcal check`: everything that can be said of a scenario before it is sampled, in one folder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..check import (
    THOROUGH,
    Checked,
    Effort,
    check_names,
    effort_for,
    find_centre,
    findings_of,
    identifiability,
    prior_predictive,
    profile,
    render,
    runs_of_a_search,
    sensitivity,
    smoothness,
    verdict_of,
)
from ..emulation import needs_emulator
from ..errors import FlightcalError, ScenarioError
from ..problem import Problem, build_problem
from ..report import Finding, read_run, write_page
from ..run import Run, hash_of, hash_of_file, open_run, plain, read_json, read_provenance, typed
from ..scenario import input_files, load_scenario, resolved_yaml
from ..telemetry import window_bounds
from .calibrate import identity_of, parameter_records, read

RUNS = 400
"""Simulations that a check may take of a simulator that is not flightcal's own."""
_JSON, _PAGE = "check.json", "check.html"

Progress = Callable[[str, float], None]
"""Is told a stage and its share (0..1)."""


@dataclass(frozen=True)
class CheckSummary:
    """What a caller needs to know of a finished check."""

    passed: bool
    verdict: str
    findings: tuple[Finding, ...]
    page: Path


def check_scenario(
    scenario_file: Path | str,
    out: Path | str,
    *,
    telemetry: Path | str | None = None,
    profiles: Sequence[str] = (),
    runs: int = RUNS,
    advance: Progress = lambda stage, share: None,
) -> CheckSummary:
    """Check a scenario on its training windows and write check.json and check.html into the folder `out`.

    profiles: parameters whose profile likelihood is wanted. runs: budget of a simulator that is not flightcal's own.
    The folder may be that of the calibration; the same check is not made twice. Raises FlightcalError for what is the
    user's to mend.
    """
    scenario = load_scenario(scenario_file, telemetry=telemetry)
    advance("reading telemetry", 0.0)
    problem = build_problem(scenario, read(scenario))
    check_names(problem, list(profiles))
    if profiles and needs_emulator(problem):
        raise ScenarioError("--profile: found a simulator without derivatives, expected one with them")
    inputs = {str(name): hash_of_file(Path(name)) for name in input_files(scenario)}
    identity = identity_of(scenario, inputs)
    run = open_run(Path(out), identity, resolved_yaml(scenario, absolute=True), inputs, scenario.calibration.seed)
    advance("reading telemetry", 1.0)
    effort = effort_for(problem, runs)
    key = hash_of(identity, scenario.calibration.seed, list(profiles), plain(effort))
    if not run.is_done("check", key, (_JSON, _PAGE)):
        with run.stage("check", key):
            run.write_json("parameters.json", parameter_records(problem))
            checked = check(problem, effort, tuple(read_run(run.path).parameters), profiles, advance)
            advance("writing", 0.0)
            _write(run, problem, checked)
            advance("writing", 1.0)
    content = read_json(run.file(_JSON))
    findings = tuple(typed(Finding, item) for item in content["findings"])
    return CheckSummary(content["passed"], content["verdict"], findings, run.file(_PAGE))


def check(
    problem: Problem,
    effort: Effort,
    infos: tuple[Any, ...],
    profiles: Sequence[str] = (),
    advance: Progress = lambda stage, share: None,
) -> Checked:
    """Everything that is checked of a problem; infos: how its parameters are shown (`report.run_files`)."""
    seed = problem.scenario.calibration.seed
    advance("prior predictive", 0.0)
    draws = problem.priors.sample(np.random.default_rng(seed), effort.draws)
    prior_runs = draws, problem.simulate_many(draws)
    if all(run is None for run in prior_runs[1]):
        raise FlightcalError(f"none of {len(draws)} simulations at prior draws finishes; see 'flightcal simulate'")
    advance("prior predictive", 1.0)
    advance("search of the mode", 0.0)
    centre = find_centre(problem, prior_runs, effort.searches, seed)
    advance("search of the mode", 1.0)
    found = identifiability(problem, centre.z, centre.hessian)
    advance("sensitivity", 0.0)
    indices = sensitivity(problem, centre.z, effort, seed, prior_runs, lambda share: advance("sensitivity", share))
    advance("scans and gradient", 0.0)
    smooth = smoothness(
        problem, centre, effort, seed,
        gradient=not needs_emulator(problem), advance=lambda share: advance("scans and gradient", share),
    )  # fmt: skip
    profiled = tuple(
        profile(problem, centre, name, lambda share, name=name: advance(f"profile of {name}", share))  # type: ignore[misc]
        for name in profiles
    )
    spans = problem.scenario.windows
    return Checked(
        infos=infos,
        centre=centre,
        identifiability=found,
        predictive=prior_predictive(problem, prior_runs, centre, seed),
        sensitivity=indices,
        smoothness=smooth,
        profiles=profiled,
        starts={own.label: window_bounds(spans[own.name], own.period)[0] for own in problem.windows},
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
    centre, found = checked.centre, checked.identifiability
    theta = problem.to_theta(centre.z)
    content = {
        "passed": passed,
        "verdict": verdict,
        "findings": plain(findings),
        "examined_at": {
            "what": centre.words,
            "log_density": centre.log_density,
            "theta": dict(zip(problem.names, theta.tolist(), strict=True)),
        },
        "prior_predictive": {
            "draws": checked.predictive.draws,
            "failed": checked.predictive.failed,
            "channels": checked.predictive.channels,
            "heaters": checked.predictive.heaters,
            "pressed": checked.predictive.pressed,
        },
        "identifiability": found,
        "sensitivity": checked.sensitivity,
        "smoothness": checked.smoothness,
        "profiles": checked.profiles,
    }
    run.write_json(_JSON, plain(content))
    created = str(read_provenance(run.path).get("created", ""))
    write_page(run.file(_PAGE), render(checked, problem, findings, run.path, created))
