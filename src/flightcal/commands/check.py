"""`flightcal check`: everything that can be said of a scenario before it is sampled, in one folder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..errors import GATE_FAILED, ScenarioError
from ..progress import SILENT, Progress
from .options import ScenarioFile, TelemetryPlace

if TYPE_CHECKING:
    from ..check import CheckSummary

RUNS = 400
"""Simulations that a check may take of a simulator that is not flightcal's own."""


def check(
    scenario: ScenarioFile,
    out: Annotated[Path, typer.Option(help="Folder to write check.html and check.json into; may be the run's.")],
    profiles: Annotated[
        list[str] | None, typer.Option("--profile", help="Parameter whose profile likelihood is wanted; repeatable.")
    ] = None,
    runs: Annotated[
        int, typer.Option(min=30, help="Budget of runs of a simulator that is not flightcal's own.")
    ] = RUNS,
    telemetry: TelemetryPlace = None,
) -> None:
    """Say before sampling what the telemetry can tell, and whether the prior reaches it and NUTS will get along.

    Example: `flightcal check scenario.yaml --out runs/first`
    """
    from .display import display, print_check

    with display() as progress:
        summary = check_scenario(
            scenario, out, telemetry=telemetry, profiles=profiles or [], runs=runs, progress=progress
        )
    print_check(summary)
    if not summary.passed:
        raise typer.Exit(GATE_FAILED)


def check_scenario(
    scenario_file: Path | str,
    out: Path | str,
    *,
    telemetry: Path | str | None = None,
    profiles: Sequence[str] = (),
    runs: int = RUNS,
    progress: Progress = SILENT,
) -> CheckSummary:
    """Check a scenario on its training windows and write check.json and check.html into the folder `out`.

    profiles: parameters whose profile likelihood is wanted. runs: budget of a simulator that is not flightcal's own.
    The folder may be that of the calibration; the same check is not made twice. Raises FlightcalError for what is the
    user's to mend.
    """
    from ..check import CHECK, SUSPECTS, PriorRuns, check_names, effort_for
    from ..emulation import needs_emulator
    from ..problem import build_problem
    from ..scenario import load_scenario
    from ..telemetry import read
    from .advice import advice
    from .folder import key_of_telemetry, open_for, parameter_records

    scenario = load_scenario(scenario_file, telemetry=telemetry)
    with progress.stage("reading telemetry"):
        data = read(scenario)
        problem = build_problem(scenario, data)
        check_names(problem, list(profiles))
        if profiles and needs_emulator(problem):
            raise ScenarioError("--profile: found a simulator without derivatives, expected one with them")
    for line in advice(scenario, data, problem.windows):
        progress.say(f"advice: {line}")
    with open_for(scenario, Path(out), progress, data) as run:
        effort = effort_for(problem, runs)
        prior_runs = PriorRuns(problem, effort.draws)
        run.given(key_of_telemetry(run, scenario), data)
        run.given(run.folder.identity, problem, prior_runs)
        suspected = run.stage(SUSPECTS, problem, data, prior_runs)
        return run.stage(
            CHECK, problem, parameter_records(problem), suspected, prior_runs,
            effort=effort, profiles=profiles, seed=scenario.calibration.seed,
        )  # fmt: skip
