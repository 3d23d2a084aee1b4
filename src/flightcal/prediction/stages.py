"""The stage of a run that predicts every window and scores it."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, Final

import xarray

from ..calibration import Sampled, genetic_points, posterior_draws, with_residual_noise
from ..emulation import Emulation, window_emulator
from ..problem import Problem
from ..run import Run, Stage, plain, read_records, typed
from ..scenario import PredictionSettings, Window
from .metrics import Metric, score
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
    settings: PredictionSettings,
    seed: int,
) -> None:
    draws = posterior_draws(sampled.posterior, problem.names, settings.simulations, seed)
    uncalibrated = with_residual_noise(problem, problem.priors.median())
    points = {"uncalibrated": uncalibrated, **genetic_points(problem, genetic)}
    stand_in = {} if emulation is None else {"stand_in": partial(window_emulator, run, emulation, draws)}
    predicted = {}
    for k, window in enumerate(windows):
        run.progress.at(k, f"window {window}")
        predicted[window], _ = predict(problem, data, window, points, draws, seed=seed, **stand_in)
    metrics = [metric for window, prediction in predicted.items() for metric in score(prediction, window)]
    run.folder.write_netcdf(PREDICTION_FILE, xarray.DataTree.from_dict(predicted))
    run.folder.write_json(METRICS_FILE, plain(metrics))


def _read(run: Run, *_: Any) -> tuple[Metric, ...]:
    return tuple(read_records(run.folder.file(METRICS_FILE), partial(typed, Metric)))


PREDICT: Final = Stage("predict", "predicting and scoring", (PREDICTION_FILE, METRICS_FILE), _predict, _read)
"""Of a problem, its telemetry, what the genetic algorithm and NUTS gave, and the emulator, if any."""
