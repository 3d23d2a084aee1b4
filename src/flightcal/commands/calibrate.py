"""The published experiment, whole: read, genetic algorithm, stochastic update, prediction, scores, report.

Each stage is a function of what came before and of the scenario; its results lie in the run directory, and a later
call takes up where an earlier one stopped.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray

from ..calibration import (
    Diagnostics,
    calibrate_genetic,
    calibrate_nuts,
    genetic_points,
    posterior_tree,
    search_record,
    with_residual_noise,
)
from ..emulation import CHECK_FILE, Emulation, check_emulator, emulator_stage, needs_emulator, window_emulator
from ..environment import orbital_period
from ..errors import FlightcalError, RunError, ScenarioError
from ..prediction import Metric, predict, score
from ..problem import Problem, Window, build_problem
from ..progress import Listener, Silent
from ..report import write_report
from ..run import Run, hash_of, hash_of_file, open_run, plain
from ..scenario import Scenario, SimulatorModel, input_files, load_scenario, not_normal, resolved_yaml
from ..simulator import FloatArray
from ..telemetry import quality_table, read_telemetry
from ..validation import full_check_stage


@dataclass(frozen=True)
class Summary:
    """What a caller needs to know of a finished run; everything else lies in the run directory."""

    run: Path
    report: Path
    diagnostics: dict[str, Any]
    """Content of diagnostics.json."""
    metrics: tuple[Metric, ...]
    interrupted: bool

    @property
    def passed(self) -> bool:
        """Whether the sampling was whole and passed all its gates."""
        return bool(self.diagnostics["passed"]) and not self.interrupted


def read(scenario: Scenario) -> xarray.Dataset:
    """The telemetry of a scenario, cleaned, as `telemetry.read_telemetry` gives it. Raises TelemetryError."""
    return read_telemetry(
        scenario.telemetry, scenario.folder, period=orbital_period(scenario.environment, scenario.folder)
    )


def run_experiment(
    scenario_file: Path | str, out: Path | str, *, telemetry: Path | str | None = None, listener: Listener | None = None
) -> Summary:
    """Calibrate by both methods, predict and score every window, and write the report into the folder `out`.

    telemetry: a file or folder to read the telemetry from instead of where the scenario says.
    Raises FlightcalError for what is the user's to mend. An interrupted sampling is saved, scored and reported.
    """
    listener = listener or Silent()
    scenario = load_scenario(scenario_file, telemetry=telemetry)
    listener.stage("read", False)
    data = read(scenario)
    problem = build_problem(scenario, data)
    inputs = {str(name): hash_of_file(Path(name)) for name in input_files(scenario)}
    identity = identity_of(scenario, inputs)
    run = open_run(Path(out), identity, resolved_yaml(scenario, absolute=True), inputs, scenario.calibration.seed)
    with run.stage("read", identity):
        run.write_json("telemetry_quality.json", [plain(record) for record in quality_table(data)])
        run.write_json("parameters.json", parameter_records(problem))

    settings = scenario.calibration
    emulation = None
    if needs_emulator(problem):
        if not all(window.residuals.is_normal for window in problem.windows):
            raise ScenarioError(
                f"noise: found {' and '.join(not_normal(scenario))} noise, expected normal noise: the simulator's "
                "server offers no gradient, and only with normal noise can an emulator's error be integrated out"
            )
        key = hash_of(identity, settings.emulator.model_dump())
        emulation = emulator_stage(run, key, problem, data, listener)
        emulator_identity = hash_of(identity, settings.emulator.model_dump(), settings.seed)
    else:
        emulator_identity = identity
        _compile_stage(run, identity, problem, listener)
    genetic_key = hash_of(emulator_identity, settings.genetic.model_dump(), settings.seed)
    nuts_key = hash_of(genetic_key, settings.nuts.model_dump())
    predict_key = hash_of(nuts_key, settings.prediction.model_dump())

    genetic = _genetic_stage(run, genetic_key, problem if emulation is None else emulation.searched, listener)
    points = genetic_points(problem, genetic)
    posterior, diagnostics = _nuts_stage(run, nuts_key, problem, points, emulation, listener)
    interrupted = posterior.attrs["interrupted"] == "true"
    if interrupted:
        predict_key = hash_of(predict_key, "interrupted")
    draws = posterior_draws(posterior, problem.names, settings.prediction.simulations, settings.seed)
    if isinstance(scenario.simulator, SimulatorModel):
        full_check_stage(run, predict_key, problem, draws, listener)
    metrics = _predict_stage(run, predict_key, problem, data, points, draws, emulation, listener)
    listener.stage("report", False)
    with run.stage("report", hash_of(predict_key, "report")):
        report = write_report(run.path)
    return Summary(run.path, report, diagnostics, metrics, interrupted)


def _compile_stage(run: Run, key: str, problem: Problem, listener: Listener) -> None:
    """Compile and call what the later stages call, so that their times are without compilation."""
    done = run.is_done("compile", key, ())
    listener.stage("compile", done)
    if not done:
        with run.stage("compile", key):
            problem.warm()
            median = problem.priors.median()
            problem.log_density_and_gradient(problem.to_z(median))
            problem.simulate_many(np.tile(median, (8, 1)))


def _genetic_stage(run: Run, key: str, problem: Problem, listener: Listener) -> xarray.Dataset:
    done = run.is_done("genetic", key, ("genetic.nc",))
    listener.stage("genetic", done)
    if not done:
        with run.stage("genetic", key):
            result = calibrate_genetic(problem, on_generation=listener.generation)
            run.write_netcdf("genetic.nc", result)
    return run.read_dataset("genetic.nc")


def _nuts_stage(
    run: Run,
    key: str,
    problem: Problem,
    points: dict[str, FloatArray],
    emulation: Emulation | None,
    listener: Listener,
) -> tuple[xarray.DataTree, dict[str, Any]]:
    files = ("posterior.nc", "diagnostics.json", *((CHECK_FILE,) if emulation else ()))
    done = run.is_done("nuts", key, files)
    listener.stage("nuts", done)
    if not done:
        interrupted = None
        with run.stage("nuts", key):
            sampled = problem if emulation is None else emulation.problem
            posterior = calibrate_nuts(
                sampled,
                starts=[("the genetic algorithm's best", points["genetic_best"])]
                if emulation is None
                else [("active learning", emulation.theta)],
                random_starts=6 if emulation is None else 0,
                on_start=listener.search,
                progress=listener.sampling,
            )
            run.log(stage="nuts", event="mode", mode_search=search_record(sampled, posterior.modes))
            interrupted = posterior.draws.interrupted
            if posterior.theta.shape[1] == 0:
                raise RunError("sampling was interrupted before the first draw; run the same command to start it again")
            tree = posterior_tree(sampled, posterior, seed=problem.scenario.calibration.seed)
            run.write_netcdf("posterior.nc", tree)
            diagnostics = posterior.diagnostics
            if emulation is not None:
                diagnostics = check_emulator(run, problem, emulation, posterior.flat, diagnostics)
            run.write_json("diagnostics.json", _diagnostics(diagnostics, posterior.draws))
        if interrupted:
            run.forget("nuts")
    return run.read_tree("posterior.nc"), json.loads(run.file("diagnostics.json").read_text(encoding="utf-8"))


def _predict_stage(
    run: Run,
    key: str,
    problem: Problem,
    data: xarray.Dataset,
    points: dict[str, FloatArray],
    draws: FloatArray,
    emulation: Emulation | None,
    listener: Listener,
) -> tuple[Metric, ...]:
    done = run.is_done("predict", key, ("prediction.nc", "metrics.json"))
    listener.stage("predict", done)
    if not done:
        with run.stage("predict", key):
            scenario = problem.scenario
            seed = scenario.calibration.seed
            uncalibrated = with_residual_noise(problem, problem.priors.median())
            points = {"uncalibrated": uncalibrated, **points}
            stand_in: Callable[[Window], Window] = (
                _as_it_is if emulation is None else partial(window_emulator, run, key, emulation, draws)
            )
            windows = {}
            for window in scenario.windows:
                windows[window] = predict(problem, data, window, points, draws, seed=seed, stand_in=stand_in)[0]
            metrics = [metric for window, predicted in windows.items() for metric in score(predicted, window)]
            run.write_netcdf("prediction.nc", xarray.DataTree.from_dict(windows))
            run.write_json("metrics.json", [plain(metric) for metric in metrics])
    records = json.loads(run.file("metrics.json").read_text(encoding="utf-8"))
    return tuple(Metric(**record) for record in records)


def posterior_draws(posterior: xarray.DataTree, names: tuple[str, ...], count: int, seed: int) -> FloatArray:
    """At most `count` posterior thetas [S, d], chosen at random without repetition."""
    group = posterior["posterior"].to_dataset()
    draws = np.stack([group[name].values.ravel() for name in names], axis=1)
    if len(draws) <= count:
        return draws
    return draws[np.sort(np.random.default_rng(seed).choice(len(draws), count, replace=False))]


def identity_of(scenario: Scenario, inputs: dict[str, str]) -> str:
    """Hash of what is calibrated: the scenario without its method settings and its place, and the input files."""
    content = scenario.model_dump(mode="json", exclude={"calibration", "description", "folder"})
    content["telemetry"].pop("file")
    return hash_of(content, sorted(inputs.values()))


def parameter_records(problem: Problem) -> list[dict[str, Any]]:
    """parameters.json: what each entry of theta is, its prior and its unit."""
    quantiles = np.stack([problem.priors.quantile(p) for p in (0.025, 0.5, 0.975)], axis=1)
    records = []
    for entry, of_prior in zip(problem.entries, quantiles.tolist(), strict=True):
        values = ", ".join(f"{key} {value:.6g}" for key, value in entry.prior.model_dump(exclude={"kind"}).items())
        records.append(
            {
                "name": entry.name,
                "kind": entry.kind,
                "unit": entry.unit,
                "target": [*entry.sets, *entry.scales],
                "mode": "sets" if entry.sets else "scales" if entry.scales else "",
                "prior": f"{entry.prior.kind}: {values}",
                "prior_quantiles": of_prior,
            }
        )
    return records


def _as_it_is(window: Window) -> Window:
    return window


def _diagnostics(diagnostics: Diagnostics, draws: Any) -> dict[str, Any]:
    content = plain(diagnostics)
    content["passed"] = diagnostics.passed
    content["verdict"] = diagnostics.verdict
    content["gradient_evaluations"] = int(draws.gradients)
    return content


__all__ = ["FlightcalError", "Listener", "Silent", "Summary", "read", "run_experiment"]
