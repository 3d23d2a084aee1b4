"""The stage of a run that predicts every window and scores it."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, Final

import numpy as np
import xarray

from ..calibration import (
    Sampled,
    genetic_points,
    genetic_run_points,
    posterior_draws,
    posterior_mean,
    with_kept_heat,
    with_residual_noise,
)
from ..emulation import Emulation, window_emulator
from ..problem import Problem
from ..run import Run, Stage, labelled, plain, read_records, typed
from ..scenario import PredictionSettings, Window
from ..simulator import FloatArray
from .heat import draw_heat
from .labels import LABELS
from .limits import Limits, limit_scores, with_limits
from .metrics import CALIBRATED, GENETIC_RUNS, STOCHASTIC, UNCALIBRATED, Metric, score, scores_of_runs
from .predict import predict

PREDICTION_FILE, METRICS_FILE = "prediction.nc", "metrics.json"


def _predict(
    run: Run,
    problem: Problem,
    data: xarray.Dataset,
    genetic: xarray.Dataset,
    sampled: Sampled,
    emulation: Emulation | None,
    *,
    windows: Mapping[str, Window],
    limits: Limits,
    settings: PredictionSettings,
    seed: int,
) -> None:
    uncalibrated = with_residual_noise(problem, problem.priors.median())
    points = {
        UNCALIBRATED: uncalibrated,
        **genetic_points(problem, genetic),
        CALIBRATED: posterior_mean(problem, sampled.posterior),
    }
    shown = list(points)
    if emulation is None:  # else each takes runs of a slow simulator
        points |= genetic_run_points(problem, genetic)
    heated = with_kept_heat(problem, sampled.posterior)
    points = {method: _in_order(theta, problem, heated) for method, theta in points.items()}
    problem = heated
    draws = posterior_draws(sampled.posterior, problem.names, settings.simulations, seed)
    stand_in = {} if emulation is None else {"stand_in": partial(window_emulator, run, emulation, draws)}
    heat = None if problem.heat is None else draw_heat(problem, draws, np.random.default_rng(seed))
    predicted = {}
    for k, window in enumerate(windows):
        run.progress.at(k, f"window {window}")
        prediction, _ = predict(problem, data, window, points, draws, seed=seed, heat=heat, **stand_in)
        predicted[window] = labelled(with_limits(prediction, limits), LABELS)
    scores = [
        metric
        for window, prediction in predicted.items()
        for metric in (*score(prediction, window), *limit_scores(prediction, window))
    ]
    kept = [*shown, STOCHASTIC]
    of_runs = [metric for metric in scores if metric.method not in kept]
    metrics = [metric for metric in scores if metric.method in kept]
    metrics += [*scores_of_runs(of_runs), _converged(problem, genetic)]
    predicted = {window: prediction.sel(by=kept) for window, prediction in predicted.items()}
    run.folder.write_netcdf(PREDICTION_FILE, xarray.DataTree.from_dict(predicted))
    run.folder.write_json(METRICS_FILE, plain(metrics))


def _converged(problem: Problem, genetic: xarray.Dataset) -> Metric:
    """How many runs of the genetic algorithm have converged."""
    note = f"of {genetic.sizes['run']} runs; {genetic.attrs['converged_when']}"
    window = problem.windows[0].name
    return Metric(GENETIC_RUNS, window, "all", "converged", float(genetic.attrs["converged_runs"]), "1", note)


def _in_order(theta: FloatArray, problem: Problem, heated: Problem) -> FloatArray:
    """theta [d] of a problem as one of the same with heat, whose sizes matter to no point."""
    known = dict(zip(problem.names, theta, strict=True))
    medians = dict(zip(heated.names, heated.priors.median(), strict=True))
    return np.array([known.get(name, medians[name]) for name in heated.names])


def _read(run: Run, *_: Any) -> tuple[Metric, ...]:
    return tuple(read_records(run.folder.file(METRICS_FILE), partial(typed, Metric)))


PREDICT: Final = Stage("predict", "predicting and scoring", (PREDICTION_FILE, METRICS_FILE), _predict, _read)
"""Of a problem, its telemetry, what the genetic algorithm and NUTS gave, and the emulator, if any."""
