"""FUNcube-1's temperatures some minutes and some orbits ahead: flightcal beside an extended Kalman filter."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from flightcal.calibration import calibrate_nuts, mean_and_some
from flightcal.environment import orbital_period
from flightcal.problem import build_problem, build_window
from flightcal.scenario import load_scenario
from flightcal.scenario.windows import Window as Span
from flightcal.telemetry import read_telemetry

from ..forecasts import Scores, flightcal_forecasts, of_normal, targets
from ..peers import ekf
from ..report import DataMissingError, Section, Table

_EXAMPLE = Path(__file__).parents[2] / "examples" / "funcube1" / "scenario.yaml"
_DRAWS, _COUNT, _ORBITS = 400, 24, 2


def measure(quick: bool) -> Section:
    """Both are trained on the first two orbits of telemetry and forecast from the same later origins."""
    scenario = load_scenario(_EXAMPLE)
    files = [scenario.folder / file for source in scenario.telemetry.sources.values() for file in source.file]
    if not all(file.exists() for file in files):
        raise DataMissingError("FUNcube-1's telemetry is not there: ../shared/data")
    period = orbital_period(scenario.environment, scenario.folder)
    telemetry = read_telemetry(scenario.telemetry, scenario.folder, period=period)
    begin, end = (telemetry["time"].values[k].astype("M8[us]").item() for k in (0, -1))
    # An hour earlier than the example, so that even 4 orbits have an orbit of origins after the training.
    windows = {"train": Span(start=begin, orbits=_ORBITS), "whole": Span(start=begin, end=end)}
    scenario = scenario.model_copy(update={"windows": windows})
    problem = build_problem(scenario, telemetry)
    settings = scenario.calibration.nuts
    posterior = calibrate_nuts(problem, settings.model_copy(update={"chains": 2, "draws": 100}) if quick else settings)
    draws = mean_and_some(posterior.flat, 100 if quick else _DRAWS, 1)[1:]

    # The filter's time tags are right.
    exact = scenario.model_copy(update={"time_error": "none"})
    train = build_window(exact, telemetry, "train")
    training = ekf.record_of(train, telemetry)
    mode = dict(zip(problem.names, problem.to_theta(posterior.modes[0].z), strict=True))
    start = np.array([mode[name] for name in train.simulator.parameters[: training.parameters]])
    fitted = ekf.fit(training, train, [start], draws=0 if quick else 4)

    # One window of all telemetry, so that the filter has all that came before an origin.
    whole = build_window(exact, telemetry, "whole")
    record = ekf.record_of(whole, telemetry)
    orbit = round(period)
    rows = []
    for name, horizon in {"1 min": 60, "10 min": 600, "1 orbit": orbit, "4 orbits": 4 * orbit}.items():
        pairs = targets(
            whole.times,
            np.isfinite(whole.observed).all(axis=1),
            np.timedelta64(horizon, "s"),
            trained=train.times[-1],
            known=np.timedelta64(round(scenario.calibration.prediction.initial_span), "s"),
            count=8 if quick else _COUNT,
        )
        peer = _filtered(record, fitted, pairs, whole.observed[pairs[:, 1]])
        at = [tuple(whole.times[pair]) for pair in pairs]
        forecasts = flightcal_forecasts(posterior.problem, telemetry, draws, at)
        rows += _rows(name, train.simulator.channels, forecasts, peer)
    ends = fitted.log_densities
    failed = "; ".join(f"{gate.name}, {gate.found}" for gate in posterior.diagnostics.gates if not gate.passed)
    return Section(
        "Forecasts",
        "FUNcube-1 (`examples/funcube1/scenario.yaml`) by default, with unmodelled heat, trained on the first two "
        "orbits of telemetry; then telemetry some time after an origin, drivers as measured throughout. CRPS in K "
        f"(smaller is better), the mean over {_COUNT} origins; covered: by 95% intervals. The difference is "
        "flightcal's minus the filter's, with the standard error of its mean as if origins were independent.",
        [Table(_COLUMNS, rows)],
        [
            "Filter: the same network and priors, with process noise at every node and white noise of the channels, "
            "fitted to the innovations of the training window (maximum a posteriori in log-parameters, "
            f"{len(ends)} starts, {sum(end > max(ends) - 0.1 for end in ends)} of them to within 0.1 nat of the best).",
            f"Filter's process noise: {_estimates(fitted, 'process.', 'K/s^0.5')}; measurement noise: "
            f"{_estimates(fitted, 'noise.', 'K')}.",
            f"flightcal: heat and AR(1) noise, {len(draws)} posterior draws; gates that failed: {failed or 'none'}.",
            "The filter knows more. It knows all telemetry from the training's start to the origin. flightcal knows "
            "the training, and the 10 min up to the origin, which tell the temperatures there.",
            "Origins are evenly spread over the telemetry after the training. Those within an orbit are much alike, "
            "so standard errors are too small, most of all those of 4 orbits.",
        ],
    )


def _filtered(record: ekf.Record, fitted: ekf.Fit, pairs: Any, observed: Any) -> Scores:
    """Scores of the filter's forecasts of samples [M, N] from origin to target, pairs [M, 2]."""
    runs = [ekf.forecast(record, fitted, i) for i, _ in pairs]
    at = list(zip(runs, record.sampled[pairs[:, 1]], strict=True))
    return of_normal(observed, np.array([run.mean[k] for run, k in at]), np.array([run.variance[k] for run, k in at]))


_COLUMNS = [
    "", "flightcal, CRPS", "filter, CRPS", "difference", "flightcal, covered", "filter, covered"
]  # fmt: skip


def _rows(horizon: str, channels: tuple[str, ...], scores: Scores, peer: Scores) -> list[list[str]]:
    rows = []
    for k, channel in enumerate(channels):
        difference = scores.crps[:, k] - peer.crps[:, k]
        error = difference.std(ddof=1) / np.sqrt(len(difference))
        rows.append(
            [
                f"{horizon}, {channel}",
                f"{scores.crps[:, k].mean():.2f}",
                f"{peer.crps[:, k].mean():.2f}",
                f"{difference.mean():+.2f} ({error:.2f})",
                f"{scores.covered[:, k].mean():.0%}",
                f"{peer.covered[:, k].mean():.0%}",
            ]
        )
    return rows


def _estimates(fitted: Any, prefix: str, unit: str) -> str:
    found = zip(fitted.names, fitted.values, strict=True)
    return ", ".join(
        f"{name.removeprefix(prefix)} {value:.2g} {unit}" for name, value in found if name.startswith(prefix)
    )
