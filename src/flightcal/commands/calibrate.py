"""`flightcal calibrate`: the published experiment, whole. Each stage is read from the run's folder where it can be."""

from __future__ import annotations

from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..errors import INTERRUPTED
from ..progress import SILENT, Progress
from .options import ScenarioFile, TelemetryPlace

if TYPE_CHECKING:
    import xarray

    from ..calibration import Calibrated
    from ..prediction import Metric, Unseen
    from ..problem import Problem
    from ..report import Verdict
    from ..run import Run

DEMO = Path(__file__).parents[1] / "demo"
"""The bundled satellite."""
BESIDE = "beside.json"
"""Scores of the published model, in the folder of a run of the same satellite."""
VERDICT = "verdict.json"
"""Whether the run can be used, for what, and why."""


@dataclass(frozen=True)
class Summary:
    """What a caller needs to know of a finished run; everything else lies in the run's folder."""

    run: Path
    report: Path
    diagnostics: dict[str, Any]
    """Content of diagnostics.json."""
    metrics: tuple[Metric, ...]
    interrupted: bool
    verdict: Verdict
    heat: dict[str, float]
    """Size of the unmodelled heat of nodes, as a share of the heat that flows through them; see `heat_shares`."""
    unseen: dict[str, tuple[Unseen, ...]] = field(default_factory=dict)
    """What of each window was not trained on; windows in which all was are not named."""
    parameters: tuple[Calibrated, ...] = ()
    """Every uncertain quantity before and after."""

    def __repr__(self) -> str:
        counts = f"{len(self.parameters)} quantities, {len(self.metrics)} scores"
        return f"<Summary of {self.run}: {self.verdict.use} {counts}>"

    def _repr_html_(self) -> str:
        from ..calibration import html_table

        told = (f"{own.question} {own.worst.mark}: {own.worst.title}" for own in self.verdict.answers)
        answers = (f"<li>{escape(line)}</li>" for line in told)
        shown = [own for own in self.parameters if own.kind in ("parameter", "drift")]
        return f"<p><b>{escape(self.verdict.use)}</b></p><ul>{''.join(answers)}</ul>{html_table(shown)}"

    @property
    def passed(self) -> bool:
        """Whether the sampling was whole and passed all its gates; `verdict` judges the model too."""
        return bool(self.diagnostics["passed"]) and not self.interrupted


def run_experiment(
    scenario_file: Path | str,
    out: Path | str,
    *,
    telemetry: Path | str | None = None,
    searched: Path | None = None,
    progress: Progress = SILENT,
) -> Summary:
    """Calibrate by both methods, predict and score every window, and write the report into the folder `out`.

    telemetry: a file or folder to read the telemetry from instead of where the scenario says.
    searched: a run of the same satellite, whose genetic algorithm is taken over. Noise and heat make no difference to
    it.
    Raises FlightcalError for what is the user's to mend. An interrupted sampling is saved, scored and reported.
    """
    from ..problem import build_problem
    from ..scenario import load_scenario
    from ..telemetry import read
    from .folder import keep_what_was_read, open_for

    scenario = load_scenario(scenario_file, telemetry=telemetry)
    text = Path(scenario_file).read_text(encoding="utf-8-sig")
    with progress.stage("reading telemetry"):
        data = read(scenario)
    with progress.stage("building the problem (the first time it compiles the simulator)"):
        problem = build_problem(scenario, data)
    with open_for(scenario, Path(out), progress) as run:
        keep_what_was_read(run, data, problem)
        return _run_stages(run, problem, data, text, searched)


def _run_stages(run: Run, problem: Problem, data: xarray.Dataset, text: str, searched: Path | None) -> Summary:
    """All stages of an experiment; text: of the scenario's file; searched: see `run_experiment`."""
    from ..calibration import COMPILE, GENETIC, NUTS, RESULTS
    from ..check import SUSPECTS
    from ..emulation import NUTS_THROUGH_EMULATOR, emulator_stage, needs_emulator
    from ..prediction import PREDICT, PREDICTION_FILE, read_unseen
    from ..report import read_run, verdict_of, write_report
    from ..scenario import input_files
    from ..validation import FULL_SIMULATOR
    from .folder import heat_shares, taken_over

    scenario = problem.scenario
    method, seed = scenario.calibration, scenario.calibration.seed
    for line in run.stage(SUSPECTS, problem, data).lines:
        run.progress.say(line)
    if needs_emulator(problem):
        emulation = run.stage(emulator_stage(problem), problem, data, settings=method.emulator, seed=seed)
        run.given(run.key(emulation), emulation.searched)
        genetic = run.stage(GENETIC, emulation.searched, settings=method.genetic, seed=seed)
        sampled = run.stage(NUTS_THROUGH_EMULATOR, problem, genetic, emulation, settings=method.nuts, seed=seed)
    else:
        emulation = None
        run.stage(COMPILE, problem)
        search = GENETIC if searched is None else taken_over(GENETIC, searched)
        genetic = run.stage(search, problem, settings=method.genetic, seed=seed)
        sampled = run.stage(NUTS, problem, genetic, settings=method.nuts, seed=seed)
    if getattr(scenario.simulator, "checked_on", None) is not None:
        run.stage(FULL_SIMULATOR, problem, sampled, simulations=method.prediction.simulations, seed=seed)
    metrics = run.stage(
        PREDICT, problem, data, genetic, sampled, emulation,
        windows=scenario.windows, settings=method.prediction, seed=seed,
    )  # fmt: skip
    with run.progress.stage("writing the report"), run.folder.stage("report", run.key(metrics)):
        verdict = verdict_of(read_run(run.path))
        run.folder.write_json(VERDICT, verdict.record)
        files = [str(file.absolute()) for file in input_files(scenario)]
        parameters = run.stage(RESULTS, problem, sampled, text=text, use=verdict.use, files=files)
        report = write_report(run.path)
    shares, outside = heat_shares(sampled.posterior), read_unseen(run.folder.file(PREDICTION_FILE))
    return Summary(
        run.path, report, sampled.diagnostics, metrics, sampled.interrupted, verdict, shares, outside, parameters
    )


def calibrate(
    scenario: ScenarioFile,
    out: Annotated[Path, typer.Option(help="Folder of the run; stages that are done in it are not run again.")],
    telemetry: TelemetryPlace = None,
) -> None:
    """Calibrate with the genetic algorithm and with NUTS, predict and score every window, and write the report.

    Example: `flightcal calibrate scenario.yaml --out runs/first`
    """
    from .display import display, print_summary

    with display() as progress:
        summary = run_experiment(scenario, out, telemetry=telemetry, progress=progress)
    print_summary(summary)
    if summary.interrupted:
        raise typer.Exit(INTERRUPTED)
    raise typer.Exit(summary.verdict.exit_code)


def demo(out: Annotated[Path, typer.Option(help="Folder for the run.")] = Path("runs/leo_observer")) -> None:
    """Calibrate the bundled satellite with unmodelled heat and, in `published` in the folder, as published.

    The exit code is that of the first.

    Example: `flightcal demo --out runs/demo`
    """
    from .display import display, print_beside, print_summary

    with display() as progress:
        own, published = run_demo(out, progress=progress)
    if published is not None:
        print_beside(own, published)
    print_summary(own)
    if own.interrupted or published is None or published.interrupted:
        raise typer.Exit(INTERRUPTED)
    raise typer.Exit(own.verdict.exit_code)


def run_demo(out: Path, folder: Path = DEMO, *, progress: Progress = SILENT) -> tuple[Summary, Summary | None]:
    """The runs of scenario.yaml and published.yaml of a folder, in `out` and in `published` there.

    None: the first was interrupted. The scores of the second are kept beside the first, for its report.
    """
    from ..report import write_report
    from ..run import hold

    own = run_experiment(folder / "scenario.yaml", out, progress=progress)
    if own.interrupted:
        return own, None
    progress.say("the same as published: independent noise, no unmodelled heat")
    published = run_experiment(folder / "published.yaml", out / "published", searched=own.run, progress=progress)
    kept = [metric for metric in published.metrics if metric.channel == "all"]
    fields = ("method", "window", "metric", "value")
    with hold(own.run) as run:
        run.write_json(BESIDE, [{name: getattr(metric, name) for name in fields} for metric in kept])
        write_report(own.run)
    return own, published
