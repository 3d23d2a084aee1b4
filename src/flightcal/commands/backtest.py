"""`flightcal backtest`: would intervals have held? From origins all over the telemetry, what follows is predicted."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..errors import GATE_FAILED, MODEL_FAILED
from ..progress import SILENT, Progress, about
from .options import ScenarioFile, TelemetryPlace

if TYPE_CHECKING:
    from ..run import Run
    from ..scenario import Scenario
    from ..validation import Plan

ORIGINS = 5
"""Unless a number is asked for."""
RESULT, PREDICTIONS = "backtest.json", "backtest.nc"


def backtest(
    scenario: ScenarioFile,
    out: Annotated[Path, typer.Option(help="Folder of the run; origins that are done in it are not run again.")],
    origins: Annotated[int, typer.Option(min=1, help="How many, spread evenly over the telemetry.")] = ORIGINS,
    train: Annotated[
        str | None,
        typer.Option(help="What to train on before each, as '2 orbits' or '3 h'; default: as long as the scenario's."),
    ] = None,
    horizon: Annotated[
        str | None,
        typer.Option(help="How far to predict, as '8 orbits' or '1 day'; default: four times the training."),
    ] = None,
    telemetry: TelemetryPlace = None,
) -> None:
    """Train up to each of several origins, predict what follows with no temperature after it, and score by horizon.

    Example: `flightcal backtest scenario.yaml --out runs/backtest --origins 5 --train "2 orbits"`
    """
    from .display import display, print_in_short

    with display() as progress:
        found = backtest_scenario(
            scenario, out, origins, train=train, horizon=horizon, telemetry=telemetry, progress=progress
        )
    print_in_short(found.folder, "backtest", found.report)
    if not found.content["passed"]:
        raise typer.Exit(GATE_FAILED)
    if not found.content["holds"]:
        raise typer.Exit(MODEL_FAILED)


@dataclass(frozen=True)
class Backtest:
    """What a backtest came to."""

    folder: Path
    report: Path
    content: dict[str, Any]
    """Of backtest.json."""


def backtest_scenario(
    scenario_file: Path | str,
    out: Path | str,
    origins: int = ORIGINS,
    *,
    train: str | None = None,
    horizon: str | None = None,
    telemetry: Path | str | None = None,
    progress: Progress = SILENT,
) -> Backtest:
    """Backtest a scenario in the folder `out`: backtest.json, backtest.nc and report.html.

    origins: how many; train, horizon: as a user writes them, see `validation.plan_origins`.
    Raises FlightcalError for what is the user's to mend, and KeyboardInterrupt where a sampling is interrupted.
    """
    import xarray

    from ..environment import orbital_period
    from ..report import write_backtest
    from ..run import plain
    from ..scenario import load_scenario
    from ..telemetry import read
    from ..validation import backtest_record, check_simulator, plan_origins, read_length
    from .folder import open_for

    scenario = load_scenario(scenario_file, telemetry=telemetry)
    period = orbital_period(scenario.environment, scenario.folder)
    lengths = {
        name: read_length(text, period, f"--{name}")
        for name, text in (("train", train), ("horizon", horizon))
        if text is not None
    }
    with progress.stage("reading telemetry"):
        data = read(scenario)
    check_simulator(scenario, lambda: data)
    plan = plan_origins(scenario, data, origins, **lengths)
    with open_for(scenario, Path(out), progress, more={"the command": "backtest"}) as run:
        run.given(run.folder.identity, data)
        predictions = _predictions(run, scenario, data, plan)
        content: dict[str, Any] = plain(backtest_record(scenario, plan, predictions))
        with progress.stage("writing the report"):
            run.folder.write_netcdf(PREDICTIONS, xarray.DataTree.from_dict(predictions))
            run.folder.write_json(RESULT, content)
            report = write_backtest(run.path)
    return Backtest(run.path, report, content)


def _predictions(run: Run, scenario: Scenario, data: Any, plan: Plan) -> dict[str, Any]:
    """The prediction from each origin, by its label; says after each how long the others will take."""
    from ..validation import origin_settings, origin_stage
    from ..words import minute

    count = len(plan.origins)
    run.progress.say(
        f"{count} origins, each a calibration on {plan.train / plan.period:.3g} orbits and a prediction of up to "
        f"{plan.horizon / plan.period:.3g} orbits"
    )
    for line in plan.skipped:
        run.progress.say(f"no origin from {line}")
    predictions, taken = {}, []
    for k, origin in enumerate(plan.origins):
        title = f"origin {k + 1} of {count}, {minute(origin.time)}"
        stage, settings = origin_stage(scenario, origin, title), origin_settings(scenario, origin)
        started = perf_counter()
        predictions[origin.label] = run.stage(stage, data, **settings)
        taken.append(perf_counter() - started)
        left = count - k - 1
        if left:
            # The first one may compile, and what was done before takes no time.
            seconds = max(taken[1:] or taken) * left
            words = "one is left" if left == 1 else f"{left} are left"
            run.progress.say(f"origin {k + 1} took {taken[-1]:.0f} s; {words}, {about(seconds)}")
    return predictions
