"""The command line. Heavy packages are imported by the commands that need them, so that --help is instant."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Annotated, Any

import typer

from .errors import FlightcalError

USER_ERROR, GATE_FAILED, INTERRUPTED = 1, 3, 130

app = typer.Typer(
    name="flightcal",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    help="Calibrate spacecraft operational simulation models in flight, with honest uncertainty.\n\n"
    "Exit codes: 0 done; 1 something in the input is wrong; 2 wrong usage; 3 done, but the sampling or the validation "
    "failed a gate, or a check found what matters; 130 interrupted.",
)

ScenarioFile = Annotated[Path, typer.Argument(help="The scenario, a YAML file.", show_default=False)]
TelemetryPlace = Annotated[
    Path | None,
    typer.Option("--telemetry", help="Read the telemetry from this file or folder instead of where the scenario says."),
]


def _user_errors_are_messages(command: Callable[..., None]) -> Callable[..., None]:
    """Show what is the user's to mend as a message, never as a traceback."""

    @wraps(command)
    def wrapped(*args: Any, **kwargs: Any) -> None:
        try:
            command(*args, **kwargs)
        except FlightcalError as error:
            typer.echo(f"error: {error}", err=True)
            raise typer.Exit(USER_ERROR) from None
        except OSError as error:
            typer.echo(f"error: {error.filename or ''}: {error.strerror or error}", err=True)
            raise typer.Exit(USER_ERROR) from None
        except KeyboardInterrupt:
            typer.echo("interrupted; the same command takes up where this one stopped", err=True)
            raise typer.Exit(INTERRUPTED) from None

    return wrapped


@app.command(epilog="Example: `flightcal demo --out runs/demo`")
@_user_errors_are_messages
def demo(
    out: Annotated[Path, typer.Option(help="Folder for the run.")] = Path("runs/leo_observer"),
) -> None:
    """Run the whole experiment on the bundled scenario, an Earth-observation satellite with three heaters."""
    _calibrate(Path(__file__).parent / "demo" / "scenario.yaml", out, None)


@app.command(epilog="Example: `flightcal init my_satellite`")
@_user_errors_are_messages
def init(folder: Annotated[Path, typer.Argument(help="Folder to create.", show_default=False)]) -> None:
    """Write a commented scenario and example telemetry to start from."""
    from .scenario import write_template

    for file in write_template(folder):
        typer.echo(f"wrote {file}")
    typer.echo(f"next: flightcal lint {folder / 'scenario.yaml'}")


@app.command(epilog="Example: `flightcal lint scenario.yaml`")
@_user_errors_are_messages
def lint(scenario: ScenarioFile, telemetry: TelemetryPlace = None) -> None:
    """List everything that is wrong with a scenario and its telemetry, each with its place."""
    from .scenario import lint as lint_scenario
    from .scenario import load_scenario

    findings = lint_scenario(scenario, telemetry=telemetry)
    for finding in findings:
        typer.echo(str(finding))
    if findings:
        typer.echo(f"{len(findings)} problem{'s' if len(findings) > 1 else ''} found", err=True)
        raise typer.Exit(USER_ERROR)
    from .commands.calibrate import read
    from .problem import build_window
    from .telemetry import quality_table

    loaded = load_scenario(scenario, telemetry=telemetry)
    data = read(loaded)
    for window in loaded.windows:
        built = build_window(loaded, data, window)
        typer.echo(f"window {window}: {len(built.times)} samples of {len(built.simulator.channels)} channels")
    for record in quality_table(data):
        typer.echo(f"telemetry {record.channel or 'file'}: {record.finding}, {record.samples} samples; {record.detail}")
    typer.echo(f"{scenario}: no problems found")


@app.command(epilog="Example: `flightcal schema > flightcal.schema.json`")
@_user_errors_are_messages
def schema(
    spacecraft: Annotated[bool, typer.Option("--spacecraft", help="Of the files that `fly` reads instead.")] = False,
) -> None:
    """Print the JSON Schema of scenario files, for editors."""
    if spacecraft:
        from .operational import SpacecraftFile
        from .scenario import schema_of

        content = schema_of(SpacecraftFile)
    else:
        from .scenario import json_schema

        content = json_schema()
    typer.echo(json.dumps(content, indent=2))


@app.command(epilog="Example: `flightcal simulate scenario.yaml --window test --set radiator_absorptivity=0.2`")
@_user_errors_are_messages
def simulate(
    scenario: ScenarioFile,
    window: Annotated[str, typer.Option(help="Window of the scenario.")] = "train",
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set", help="name=value of a parameter or of initial.<node>, in SI; the rest is at its prior median."
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="CSV file to write; default: <window>_simulated.csv.")] = None,
    telemetry: TelemetryPlace = None,
) -> None:
    """Simulate one window and write temperatures and heater status beside the telemetry."""
    from .commands.simulate import simulate_to_csv

    file = out or Path(f"{window}_simulated.csv")
    for line in simulate_to_csv(scenario, window, settings or [], file, telemetry):
        typer.echo(line)


@app.command(epilog="Example: `flightcal calibrate scenario.yaml --out runs/first`")
@_user_errors_are_messages
def calibrate(
    scenario: ScenarioFile,
    out: Annotated[Path, typer.Option(help="Folder of the run; stages that are done in it are not run again.")],
    telemetry: TelemetryPlace = None,
) -> None:
    """Calibrate with the genetic algorithm and with NUTS, predict and score every window, and write the report."""
    _calibrate(scenario, out, telemetry)


@app.command(epilog="Example: `flightcal check scenario.yaml --out runs/first`")
@_user_errors_are_messages
def check(
    scenario: ScenarioFile,
    out: Annotated[Path, typer.Option(help="Folder to write check.html and check.json into; may be the run's.")],
    profiles: Annotated[
        list[str] | None, typer.Option("--profile", help="Parameter whose profile likelihood is wanted; repeatable.")
    ] = None,
    runs: Annotated[int, typer.Option(min=30, help="Budget of runs of a simulator that is not flightcal's own.")] = 400,
    telemetry: TelemetryPlace = None,
) -> None:
    """Say before sampling what the telemetry can tell, and whether the prior reaches it and NUTS will get along."""
    from .commands.check import check_scenario
    from .commands.display import bars, print_check

    with bars() as advance:
        summary = check_scenario(
            scenario, out, telemetry=telemetry, profiles=profiles or [], runs=runs, advance=advance
        )
    print_check(summary)
    if not summary.passed:
        raise typer.Exit(GATE_FAILED)


@app.command(epilog="Example: `flightcal fly spacecraft.yaml --out telemetry.csv`")
@_user_errors_are_messages
def fly(
    spacecraft: Annotated[Path, typer.Argument(help="The spacecraft, a YAML file.", show_default=False)],
    out: Annotated[Path, typer.Option(help="CSV file to write; nothing is overwritten.")] = Path("telemetry.csv"),
    pace: Annotated[
        float | None, typer.Option(min=0.001, help="Seconds to simulate in a second at most; 1: real time.")
    ] = None,
) -> None:
    """Fly the full-order operational simulator, on-board software in the loop, and write its telemetry."""
    from .commands.display import bar
    from .commands.fly import fly_to_csv

    with bar("flying") as advance:
        lines = fly_to_csv(spacecraft, out, pace, advance)
    for line in lines:
        typer.echo(line)


@app.command(epilog="Example: `flightcal reduce reduce.yaml --out rom`")
@_user_errors_are_messages
def reduce(
    file: Annotated[Path, typer.Argument(help="The reduction, a YAML file.", show_default=False)],
    out: Annotated[Path, typer.Option(help="Folder to write; nothing is overwritten.")],
) -> None:
    """Make a reduced order model of an operational simulator, with a certificate of its error."""
    from .commands.display import bars
    from .commands.reduce import reduce_to_folder

    with bars() as advance:
        lines = reduce_to_folder(file, out, advance)
    for line in lines:
        typer.echo(line)


@app.command(epilog="Example: `flightcal report runs/first`")
@_user_errors_are_messages
def report(
    run: Annotated[Path, typer.Argument(help="Folder of a run.", show_default=False)],
    out: Annotated[Path | None, typer.Option(help="HTML file to write; default: report.html in the run.")] = None,
) -> None:
    """Write the report of a run again, from its files alone."""
    from .report import write_report

    typer.echo(f"report: {write_report(run, out)}")


@app.command(epilog="Example: `flightcal campaign scenario.yaml --design sobol --runs 2000 --out runs/sobol`")
@_user_errors_are_messages
def campaign(
    scenario: ScenarioFile,
    out: Annotated[Path, typer.Option(help="Folder of the campaign; runs that are done in it are not run again.")],
    runs: Annotated[int, typer.Option(min=1, help="Runs of the design; a larger number than before grows it.")],
    design: Annotated[
        str | None,
        typer.Option(help="sobol, latin-hypercube, prior or posterior; default: sobol, with --around posterior."),
    ] = None,
    around: Annotated[Path | None, typer.Option(help="Run whose posterior the design's draws are of.")] = None,
    spread: Annotated[float, typer.Option(min=0.0, help="Scales the posterior draws' distance from their mean.")] = 1.0,
    window: Annotated[str, typer.Option(help="Window of the scenario.")] = "train",
    seed: Annotated[int | None, typer.Option(min=0, help="Of the design; default: the scenario's.")] = None,
    workers: Annotated[int, typer.Option(min=1, help="Processes on this machine, one run at a time in each.")] = 2,
    scheduler: Annotated[
        str | None, typer.Option(help="Run on this Dask cluster instead, such as tcp://host:8786; it must see --out.")
    ] = None,
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="Run failed runs again, too.")] = False,
    telemetry: TelemetryPlace = None,
) -> None:
    """Run the simulator at every theta of a design, and keep what each run gave."""
    from .commands.campaign import run_scenario_campaign
    from .commands.display import bar

    with bar("running") as advance:
        run_scenario_campaign(
            scenario,
            out,
            runs,
            window=window,
            kind=design,
            seed=seed,
            around=around,
            spread=spread,
            workers=workers,
            scheduler=scheduler,
            retry_failed=retry_failed,
            telemetry=telemetry,
            say=typer.echo,
            on_progress=lambda tally: advance(1.0 - tally.left / tally.total, str(tally)),
        )


@app.command(epilog="Example: `flightcal compare scenario.yaml --out runs/compared`")
@_user_errors_are_messages
def compare(
    scenario: ScenarioFile,
    out: Annotated[Path, typer.Option(help="Folder of the runs; what is done in it is not run again.")],
    models: Annotated[
        str, typer.Option(help="Which to compare: iid, ar1, time, phase, both, phase+ar1.")
    ] = "iid,ar1,time,phase,both,phase+ar1",
    leave_windows_out: Annotated[
        bool, typer.Option("--leave-windows-out", help="Also predict each training window by the others.")
    ] = False,
    telemetry: TelemetryPlace = None,
) -> None:
    """Calibrate with several models of noise and discrepancy, compare them on unseen windows, and recommend one."""
    from .commands.compare import compare_models
    from .commands.display import Display, print_comparison

    chosen = [model.strip() for model in models.split(",") if model.strip()]
    with Display() as display:
        comparison = compare_models(
            scenario, out, chosen, telemetry=telemetry, leave_windows_out=leave_windows_out, listener=display,
            say=display.learning,
        )  # fmt: skip
    print_comparison(comparison)
    if not comparison.passed:
        raise typer.Exit(GATE_FAILED)


@app.command(epilog="Example: `flightcal validate scenario.yaml --repeats 200 --out runs/validation`")
@_user_errors_are_messages
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
    """Check the calibration on telemetry that the scenario itself makes: do its intervals cover what made it?"""
    from .commands.display import bar, print_validation
    from .commands.validate import validate_scenario

    with bar("validating") as advance:
        validation = validate_scenario(
            scenario,
            out,
            repeats,
            workers=workers,
            telemetry=telemetry,
            residuals=residuals,
            on_progress=lambda done, total: advance(done / total, f"{done} of {total} repeats"),
        )
    print_validation(validation)
    if not validation.passed:
        raise typer.Exit(GATE_FAILED)


def _calibrate(scenario: Path, out: Path, telemetry: Path | None) -> None:
    from .commands.calibrate import run_experiment
    from .commands.display import Display, print_summary

    with Display() as display:
        summary = run_experiment(scenario, out, telemetry=telemetry, listener=display)
    print_summary(summary)
    if summary.interrupted:
        raise typer.Exit(INTERRUPTED)
    if not summary.passed:
        raise typer.Exit(GATE_FAILED)


def main() -> None:
    """Entry point of the `flightcal` command."""
    app(prog_name="flightcal")


if __name__ == "__main__":
    main()
