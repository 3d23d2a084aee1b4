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
    from ..prediction import Extreme, Metric, Unseen
    from ..problem import Problem
    from ..report import Verdict
    from ..run import Run

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
    """Size of the unmodelled heat of nodes, as a share of the heat that flows through them; see `largest_heat`."""
    unseen: dict[str, tuple[Unseen, ...]] = field(default_factory=dict)
    """What of each window was not trained on; windows in which all was are not named."""
    parameters: tuple[Calibrated, ...] = ()
    """Every uncertain quantity before and after."""
    limits: tuple[Extreme, ...] = ()
    """What plans come to, of channels with limits, the likeliest to pass theirs first."""
    checked: dict[str, Any] | None = None
    """Content of full_simulator_check.json; None: the simulator stands for no other."""

    def __repr__(self) -> str:
        counts = f"{len(self.parameters)} quantities, {len(self.metrics)} scores"
        return f"<Summary of {self.run}: {self.verdict.use} {counts}>"

    def _repr_html_(self) -> str:
        from ..calibration import html_table

        told = (f"{answer.question} {answer.worst.mark}: {answer.worst.title}" for answer in self.verdict.answers)
        answers = (f"<li>{escape(line)}</li>" for line in told)
        shown = [quantity for quantity in self.parameters if quantity.is_parameter]
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

    scenario_file: or a reduction file. Then the reduced model that it asks for is made first, in `reduced` in `out`;
    one in `reduced` beside the file is taken where it was made from the same files.
    telemetry: a file or folder to read the telemetry from instead of where the scenario says.
    searched: a run of the same satellite, of which the genetic algorithm and what may be wrong are taken over. Noise
    and heat make no difference to them.
    Raises FlightcalError for what is the user's to mend. An interrupted sampling is saved, scored and reported.
    """
    from ..problem import build_problem, build_window
    from ..reduction import is_reduction, scenario_of
    from ..scenario import load_scenario
    from ..telemetry import read
    from .advice import advice
    from .folder import keep_what_was_read, open_for

    if is_reduction(scenario_file):
        scenario_file = scenario_of(Path(scenario_file), Path(out), progress)
    scenario = load_scenario(scenario_file, telemetry=telemetry)
    text = Path(scenario_file).read_text(encoding="utf-8-sig")
    with progress.stage("reading telemetry"):
        data = read(scenario)
    with progress.stage("building the problem (the first time it compiles the simulator)"):
        problem = build_problem(scenario, data)
        for name in scenario.windows:
            if name not in scenario.train_windows:
                build_window(scenario, data, name)  # what is wrong with it is said before anything is changed
    for line in advice(scenario, data, problem.windows):
        progress.say(f"advice: {line}")
    with open_for(scenario, Path(out), progress, data) as run:
        keep_what_was_read(run, data, problem)
        return _run_stages(run, problem, data, text, searched)


def _run_stages(run: Run, problem: Problem, data: xarray.Dataset, text: str, searched: Path | None) -> Summary:
    """All stages of an experiment; text: of the scenario's file; searched: see `run_experiment`."""
    from ..calibration import COMPILE, GENETIC, NUTS, RESULTS
    from ..check import SUSPECTS, PriorRuns
    from ..emulation import NUTS_THROUGH_EMULATOR, emulator_stage, needs_emulator
    from ..prediction import PREDICT, PREDICTION_FILE, limits_of, limits_told, read_unseen, simulator_errors
    from ..report import largest_heat, read_run, verdict_of, write_report
    from ..scenario import input_files
    from ..validation import FULL_SIMULATOR, flown_from
    from .folder import taken_over

    scenario = problem.scenario
    method, seed = scenario.calibration, scenario.calibration.seed
    emulation = None
    if needs_emulator(problem):
        # An emulator learns from the windows to train on: telemetry that grows elsewhere makes no other.
        learnt_from = data.copy()
        run.given(run.folder.identity, learnt_from)
        emulation = run.stage(emulator_stage(problem), problem, learnt_from, settings=method.emulator, seed=seed)
        run.given(run.key(emulation), emulation.searched)
    # Where the simulator is run and not looked into, its runs through the priors say what may be wrong.
    prior_runs = PriorRuns(problem, made=None if emulation is None else emulation.start)
    run.given(run.folder.identity if emulation is None else run.key(emulation), prior_runs)
    for line in run.stage(taken_over(SUSPECTS, searched), problem, data, prior_runs).lines:
        run.progress.say(line)
    if emulation is not None:
        genetic = run.stage(GENETIC, emulation.searched, settings=method.genetic, seed=seed)
        sampled = run.stage(NUTS_THROUGH_EMULATOR, problem, genetic, emulation, settings=method.nuts, seed=seed)
    else:
        run.stage(COMPILE, problem)
        genetic = run.stage(taken_over(GENETIC, searched), problem, settings=method.genetic, seed=seed)
        sampled = run.stage(NUTS, problem, genetic, settings=method.nuts, seed=seed)
    checked = None
    if getattr(scenario.simulator, "checked_on", None) is not None:
        checked = run.stage(
            FULL_SIMULATOR, problem, sampled,
            flown_from=flown_from(scenario), simulations=method.prediction.simulations, seed=seed,
        )  # fmt: skip
    metrics = run.stage(
        PREDICT, problem, data, genetic, sampled, emulation,
        windows=scenario.windows, limits=limits_of(scenario), settings=method.prediction, seed=seed,
    )  # fmt: skip
    with run.progress.stage("writing the report"), run.folder.stage("report", run.key(metrics)):
        found = read_run(run.path)
        verdict = verdict_of(found)
        run.folder.write_json(VERDICT, verdict.record)
        files = [str(file.absolute()) for file in input_files(scenario)]
        about = "\n".join([f"Verdict: {verdict.use}", *map(str, simulator_errors(metrics)), *_of_trends(problem)])
        parameters = run.stage(RESULTS, problem, genetic, sampled, text=text, about=about, files=files)
        report = write_report(run.path)
    outside = read_unseen(run.folder.file(PREDICTION_FILE))
    return Summary(
        run.path,
        report,
        sampled.diagnostics,
        metrics,
        sampled.interrupted,
        verdict,
        largest_heat(found),
        outside,
        parameters,
        tuple(limits_told(found.windows)),
        checked,
    )


def _of_trends(problem: Problem) -> list[str]:
    """Of when the values of parameters with a trend are, for the files that have these alone."""
    import numpy as np

    from ..problem import middle_of

    names = [name for name, parameter in problem.scenario.parameters.items() if parameter.trend is not None]
    if not names:
        return []
    day = np.datetime_as_string(middle_of(problem.windows), unit="D")
    return [
        f"As on {day}, in the middle of training: {', '.join(names)}. A simulation of this file leaves the trend out; "
        "the errors above have it."
    ]


def calibrate(
    scenario: ScenarioFile,
    out: Annotated[Path, typer.Option(help="Folder of the run; stages that are done in it are not run again.")],
    telemetry: TelemetryPlace = None,
) -> None:
    """Calibrate with the genetic algorithm and with NUTS, predict and score every window, and write the report.

    A reduction file in place of the scenario: the full simulator is reduced, its reduced model calibrated, and the
    result checked on the full one.

    Example: `flightcal calibrate scenario.yaml --out runs/first`
    """
    from .display import display, print_summary

    with display() as progress:
        summary = run_experiment(scenario, out, telemetry=telemetry, progress=progress)
    print_summary(summary)
    if summary.interrupted:
        raise typer.Exit(INTERRUPTED)
    raise typer.Exit(summary.verdict.exit_code)
