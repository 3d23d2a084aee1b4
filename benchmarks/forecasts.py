"""Forecasts from rolling origins, and their scores: of a filter's normal distributions, or of draws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray
from scipy.special import ndtr

from flightcal.prediction import predict
from flightcal.prediction.heat import draw_heat
from flightcal.prediction.metrics import crps_of_draws
from flightcal.problem import Problem
from flightcal.scenario.windows import Window as Span

INTERVAL = 0.95
_NORMAL = 1.959963984540054
"""Half of that interval of a standard normal."""
_NEAR = np.timedelta64(30, "s")
"""So far from its horizon a sample may be."""


@dataclass(frozen=True)
class Scores:
    """Of M forecasts of N channels."""

    crps: Any
    """[M, N] K."""
    covered: Any
    """[M, N] whether the 95% interval holds the sample."""


def of_normal(observed: Any, mean: Any, variance: Any) -> Scores:
    """Scores of normal forecasts, all [M, N]: Gneiting & Raftery (2007), J. Am. Stat. Assoc. 102, sec. 4.2."""
    deviation = np.sqrt(variance)
    u = (observed - mean) / deviation
    density = np.exp(-0.5 * u**2) / np.sqrt(2.0 * np.pi)
    crps = deviation * (u * (2.0 * ndtr(u) - 1.0) + 2.0 * density - 1.0 / np.sqrt(np.pi))
    return Scores(crps, np.abs(u) <= _NORMAL)


def of_draws(observed: Any, draws: Any) -> Scores:
    """Scores of forecasts as draws [S, M, N] of telemetry, noise included; observed [M, N]."""
    lower, upper = np.quantile(draws, [0.5 - 0.5 * INTERVAL, 0.5 + 0.5 * INTERVAL], axis=0)
    return Scores(crps_of_draws(observed, draws), (lower <= observed) & (observed <= upper))


def targets(times: Any, valid: Any, horizon: Any, *, trained: Any, known: Any, count: int) -> Any:
    """[M, 2] samples that are origins and those that lie a horizon later, evenly among all that there are.

    times [T] datetime64, valid [T]; horizon, known: timedelta64; trained: end of the training window, after which all
    origins are. All samples of the time `known` before an origin are valid.
    """
    pairs = []
    for i, origin in enumerate(times):
        j = int(np.argmin(np.abs(times - origin - horizon)))
        before = (times >= origin - known) & (times <= origin)
        whole = trained <= origin and times[0] <= origin - known and valid[before].all()
        if whole and valid[j] and j > i and abs(times[j] - origin - horizon) <= _NEAR:
            pairs.append((i, j))
    found = np.array(pairs).reshape(-1, 2)
    return found[np.unique(np.linspace(0, len(found) - 1, count).round().astype(int))]


def flightcal_forecasts(
    problem: Problem, telemetry: xarray.Dataset, draws: Any, pairs: Sequence[tuple[Any, Any]], seed: int = 1
) -> Scores:
    """Scores of the posterior's forecasts, of any model; draws [S, d]; pairs: times of origins and samples.

    Each is a window of its own whose first samples, which tell the initial temperatures, end at the origin.
    """
    scenario, crps, covered = problem.scenario, [], []
    heat = None if problem.heat is None else draw_heat(problem, draws, np.random.default_rng(seed))
    before = np.timedelta64(round(scenario.calibration.prediction.initial_span), "s")
    for origin, target in pairs:
        span = Span(start=(origin - before).astype("datetime64[us]").item(), end=_just_after(target))
        windows = {name: scenario.windows[name] for name in scenario.train_windows} | {"forecast": span}
        moved = replace(problem, scenario=scenario.model_copy(update={"windows": windows}))
        prediction, ensemble = predict(moved, telemetry, "forecast", {}, draws, seed=seed, heat=heat)
        observed = prediction["observed"].values[-1]
        assert prediction["scored"].values.any()
        assert prediction["time"].values[-1] == target
        crps.append(ensemble.crps[-1])
        covered.append((ensemble.lower[-1] <= observed) & (observed <= ensemble.upper[-1]))
    return Scores(np.array(crps), np.array(covered))


def _just_after(time: Any) -> Any:
    """A window's end belongs to the next one."""
    return (time + np.timedelta64(1, "s")).astype("datetime64[us]").item()
