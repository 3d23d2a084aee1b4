"""`flightcal compare`: a scenario with several models of what the simulator lacks, side by side on unseen windows.

Every model is the whole experiment in a folder of its own. What is compared is how well its posterior predicts the
windows that come after the training: leaving out the future, as an operator does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..errors import GATE_FAILED, MODEL_FAILED, RunError
from ..progress import SILENT, Progress, about
from .backtest import ORIGINS, PREDICTIONS, backtest_scenario
from .calibrate import Summary, run_experiment
from .options import ScenarioFile, TelemetryPlace

if TYPE_CHECKING:
    import xarray

    from ..scenario import Scenario

_RESULT = "comparison.json"
_LEFT_OUT = "left_out.json"
_LOCK = "compare.lock"


def compare(
    scenario: ScenarioFile,
    out: Annotated[Path, typer.Option(help="Folder of the runs; what is done in it is not run again.")],
    models: Annotated[
        str | None,
        typer.Option(help="Which to compare: heat, iid, ar1, phase, phase+ar1. [default: heat, iid, ar1, phase+ar1]"),
    ] = None,
    leave_windows_out: Annotated[
        bool, typer.Option("--leave-windows-out", help="Also predict each training window by the others.")
    ] = False,
    backtest: Annotated[
        bool, typer.Option("--backtest", help="Also backtest each model from rolling origins, and rank by that.")
    ] = False,
    telemetry: TelemetryPlace = None,
) -> None:
    """Calibrate with several models of what the simulator lacks, compare them on unseen windows, and recommend one.

    A few windows may favour a model by chance: with `--backtest` they are ranked by their CRPS after rolling origins.

    Example: `flightcal compare scenario.yaml --out runs/compared`
    """
    from .display import display, print_in_short

    chosen = None if models is None else [model.strip() for model in models.split(",") if model.strip()]
    with display() as progress:
        comparison = compare_models(
            scenario,
            out,
            chosen,
            telemetry=telemetry,
            leave_windows_out=leave_windows_out,
            backtest=backtest,
            progress=progress,
        )
    print_in_short(comparison.folder, "comparison", comparison.folder / "comparison.html")
    if not comparison.passed:
        raise typer.Exit(GATE_FAILED)


@dataclass(frozen=True)
class ComparedModels:
    """What the models came to."""

    folder: Path
    summaries: dict[str, Summary]
    content: dict[str, Any]
    """Of comparison.json."""

    @property
    def passed(self) -> bool:
        """Whether the sampling of every model passed its gates."""
        return all(summary.passed for summary in self.summaries.values())


def compare_models(
    scenario_file: Path | str,
    out: Path | str,
    models: Sequence[str] | None = None,
    *,
    telemetry: Path | str | None = None,
    leave_windows_out: bool = False,
    backtest: bool = False,
    progress: Progress = SILENT,
) -> ComparedModels:
    """Run the experiment with each model in a folder of its name in `out`, and write comparison.json and .html.

    models: some of `validation.MODELS`; None: the usual ones that the scenario can have. What is done in the folder is
    not run again; the genetic algorithm is run once for all. leave_windows_out: also predict each training window by
    the others (see `validation.leave_windows_out`). backtest: also backtest each model, in `<model>_backtest`, and
    recommend by that.
    Raises FlightcalError for what is the user's to mend, and KeyboardInterrupt after a sampling that was interrupted.
    """
    from ..prediction import score
    from ..report import write_comparison
    from ..run import locked, plain, sweep, write_json, write_text
    from ..scenario import is_trained, load_scenario, resolved_yaml
    from ..telemetry import read
    from ..validation import band_scores, check_simulator, check_windows, comparison_of, scored_by_all, variant

    scenario = load_scenario(scenario_file, telemetry=telemetry)
    models = _asked_for(scenario, models)
    if all(is_trained(window) for window in scenario.windows):
        raise RunError(f"{scenario_file}: windows: found none but those to train on, expected one to compare on")
    if leave_windows_out:
        check_windows(scenario)
    if backtest:
        check_simulator(scenario, lambda: read(scenario))
    folder = Path(out)
    if folder.is_dir() and any(folder.iterdir()) and not (folder / _LOCK).exists():
        raise RunError(f"{folder}: the folder holds files but no comparison; expected an empty or new folder")
    folder.mkdir(parents=True, exist_ok=True)
    with locked(folder, _LOCK):
        sweep(folder)
        summaries: dict[str, Summary] = {}
        others, backtests, rolled = {}, {}, {}
        progress.say(_expected(scenario, models, leave_windows_out=leave_windows_out, backtest=backtest))
        for model in models:
            progress.say(model)
            file = folder / f"{model}.yaml"
            changed = variant(scenario, model)
            write_text(file, resolved_yaml(changed, absolute=True))
            first = next(iter(summaries.values()), None)
            searched = None if first is None else first.run
            summaries[model] = run_experiment(file, folder / model, searched=searched, progress=progress)
            if summaries[model].interrupted:
                raise KeyboardInterrupt
            if leave_windows_out:
                others[model] = _left_out(file, summaries[model], progress)
            if backtest:
                found = backtest_scenario(file, folder / f"{model}_backtest", progress=progress)
                backtests[model], rolled[model] = found.content, _predictions(found.folder / PREDICTIONS)
        for model, by_origin in scored_by_all(rolled).items():
            scores = band_scores(by_origin, backtests[model]["period"])
            backtests[model] = backtests[model] | {"scores": plain(scores)}
        passed = {model: summary.passed for model, summary in summaries.items()}
        useless = [model for model, summary in summaries.items() if summary.verdict.exit_code == MODEL_FAILED]
        predictions = scored_by_all({model: _unseen(summary) for model, summary in summaries.items()})
        metrics = {
            model: [metric for window, dataset in of_model.items() for metric in score(dataset, window)]
            for model, of_model in predictions.items()
        }
        content = comparison_of(scenario.name, metrics, passed, useless, backtests, predictions)
        content |= {
            "left_out": others,
            "failed_gates": {model: _failed(summary) for model, summary in summaries.items()},
        }
        content["interval"] = scenario.calibration.prediction.interval
        write_json(folder / _RESULT, plain(content))
        write_comparison(folder)
        return ComparedModels(folder, summaries, content)


def _asked_for(scenario: Scenario, models: Sequence[str] | None) -> list[str]:
    """The models to compare; None: the usual ones that the scenario can have. Raises RunError."""
    from ..validation import USUAL, models_of

    known = models_of(scenario)
    if models is None:
        models = [model for model in USUAL if model in known]
    unknown = [model for model in models if model not in known]
    if unknown or len(set(models)) < 2:
        raise RunError(f"--models: found {', '.join(unknown or models)}, expected two or more of {', '.join(known)}")
    return list(models)


def _unseen(summary: Summary) -> dict[str, xarray.Dataset]:
    """Predictions of the windows that a run was not trained on."""
    from ..prediction import PREDICTION_FILE
    from ..scenario import is_trained

    predictions = _predictions(summary.run / PREDICTION_FILE)
    return {window: dataset for window, dataset in predictions.items() if not is_trained(window)}


def _predictions(file: Path) -> dict[str, xarray.Dataset]:
    """Those of a run's or a backtest's file, by window or origin."""
    from ..run import read_tree

    return {name: group.to_dataset() for name, group in read_tree(file).children.items()}


def _failed(summary: Summary) -> list[str]:
    """The gates that the sampling of a model failed, with what was found."""
    return [f"{gate['name']} {gate['found']}" for gate in summary.diagnostics.get("gates", ()) if not gate["passed"]]


def _expected(scenario: Scenario, models: Sequence[str], *, leave_windows_out: bool, backtest: bool) -> str:
    """How long this will take, by the time that sampling takes with the first model."""
    from ..calibration import rough_seconds
    from ..emulation import needs_emulator
    from ..problem import build_problem
    from ..scenario import is_trained
    from ..telemetry import read
    from ..validation import variant

    each = 1 + sum(map(is_trained, scenario.windows)) * leave_windows_out + ORIGINS * backtest
    count = each * len(models)
    words = f"{len(models)} models: {count} calibrations" if each > 1 else f"{count} models, each a whole calibration"
    changed = variant(scenario, models[0])
    problem = build_problem(changed, read(changed))
    if needs_emulator(problem):
        return f"{words}, each with an emulator of its own"
    return f"{words}; sampling takes {about(count * rough_seconds(problem, changed.calibration.nuts))} in all"


def _left_out(file: Path, summary: Summary, progress: Progress) -> dict[str, Any]:
    """Scores of training windows that were left out, kept in the run's folder, which is this scenario's alone."""
    from ..run import hold, plain, read_json
    from ..scenario import load_scenario
    from ..telemetry import read
    from ..validation import leave_windows_out

    with hold(summary.run) as folder:
        if not folder.keeps(_LEFT_OUT):
            loaded = load_scenario(file)
            scores = leave_windows_out(loaded, read(loaded), progress=progress)
            folder.write_json(_LEFT_OUT, plain(scores))
        found: dict[str, Any] = read_json(folder.file(_LEFT_OUT))
    return found
