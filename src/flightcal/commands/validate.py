"""`flightcal validate`: simulation-based calibration of the user's own scenario."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..errors import GATE_FAILED
from ..progress import SILENT, Progress
from .options import ScenarioFile, TelemetryPlace

if TYPE_CHECKING:
    from ..validation import Validation


def validate(
    scenario: ScenarioFile,
    out: Annotated[Path, typer.Option(help="Folder to write; repeats that are done in it are not run again.")],
    repeats: Annotated[int, typer.Option(min=20, help="Repeats; a larger number than before adds to them.")] = 200,
    workers: Annotated[int, typer.Option(min=1, help="Processes, one repeat at a time in each.")] = 2,
    residuals: Annotated[
        str | None, typer.Option(help="Model of the residuals instead of the scenario's, as of `compare`.")
    ] = None,
    telemetry: TelemetryPlace = None,
) -> None:
    """Check the calibration on telemetry that the scenario itself makes: do its intervals cover what made it?

    Example: `flightcal validate scenario.yaml --repeats 200 --out runs/validation`
    """
    from .display import display, print_in_short

    with display() as progress:
        validation = validate_scenario(
            scenario, out, repeats, workers=workers, telemetry=telemetry, residuals=residuals, progress=progress
        )
    print_in_short(validation.folder, "validation", validation.folder / "validation.html")
    if not validation.passed:
        raise typer.Exit(GATE_FAILED)


def validate_scenario(
    scenario_file: Path | str,
    out: Path | str,
    repeats: int,
    *,
    workers: int = 2,
    telemetry: Path | str | None = None,
    residuals: str | None = None,
    progress: Progress = SILENT,
) -> Validation:
    """Run the repeats that are missing in the folder `out`, and judge all of them.

    workers: processes; 1: this one. residuals: one of `validation.MODELS` in the place of the scenario's own.
    Raises FlightcalError for what is the user's to mend.
    """
    from ..report import write_validation
    from ..run import hash_of
    from ..validation import judge_repeats, prepared, run_repeats, short
    from .folder import open_for

    source = (str(scenario_file), None if telemetry is None else str(telemetry), residuals)
    problem, _ = prepared(*source)
    scenario = problem.scenario
    how = hash_of("validate", short(scenario.calibration.nuts).model_dump(), scenario.calibration.seed)
    with open_for(scenario, Path(out), progress, more={"the sampler and the seed": how}) as run:
        run_repeats(run.folder, source, repeats, workers=workers, progress=progress)
        validation = judge_repeats(run.folder, problem, repeats)
        write_validation(run.path)
    return validation
