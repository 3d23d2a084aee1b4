"""FUNcube-1's temperatures some minutes and some orbits ahead: flightcal beside an extended Kalman filter."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from flightcal.calibration import calibrate_nuts, mean_and_some
from flightcal.environment import orbital_period
from flightcal.problem import build_problem, build_window
from flightcal.scenario import NutsSettings, load_scenario
from flightcal.scenario.windows import Window as Span
from flightcal.telemetry import read_telemetry

from ..forecasts import Scores, flightcal_forecasts, of_normal, targets
from ..peers import ekf
from ..report import Section, Table

_EXAMPLE = Path(__file__).parents[2] / "examples" / "funcube1" / "with_discrepancy.yaml"
_DRAWS = 400


def measure(quick: bool) -> Section:
    """Both are trained on the example's training window and forecast from the same origins."""
    scenario = load_scenario(_EXAMPLE)
    period = orbital_period(scenario.environment, scenario.folder)
    telemetry = read_telemetry(scenario.telemetry, scenario.folder, period=period)
    problem = build_problem(scenario, telemetry)
    settings = NutsSettings(chains=2, draws=100 if quick else 500, target_acceptance=0.95)
    posterior = calibrate_nuts(problem, settings)
    draws = mean_and_some(posterior.flat, 100 if quick else _DRAWS, 1)[1:]

    (train,) = problem.windows
    training = ekf.record_of(train, telemetry)
    mode = problem.at(train, problem.to_theta(posterior.modes[0].z)[None])[0]
    fitted = ekf.fit(training, train, [mode[train.simulated][: training.parameters]], draws=0 if quick else 4)
    ends = fitted.log_densities

    # One window from the training's start to the telemetry's end, so that the filter has all that came before.
    to_end = Span(start=scenario.windows["train"].start, end=telemetry["time"].values[-1].astype("M8[us]").item())
    windows = scenario.windows | {"whole": to_end}
    whole = build_window(scenario.model_copy(update={"windows": windows}), telemetry, "whole")
    record = ekf.record_of(whole, telemetry)
    orbit = np.timedelta64(round(period), "s")
    horizons = {"1 min": np.timedelta64(60, "s"), "10 min": np.timedelta64(600, "s"), "1 orbit": orbit}
    rows, count = [], 8 if quick else 24
    for name, horizon in (horizons | {"4 orbits": 4 * orbit}).items():
        pairs = targets(
            whole.times,
            np.isfinite(whole.observed).all(axis=1),
            horizon,
            trained=train.times[-1],
            orbit=orbit,
            known=np.timedelta64(round(scenario.calibration.prediction.initial_span), "s"),
            count=count,
        )
        filtered = [ekf.forecast(record, fitted, i) for i, _ in pairs]
        at = record.sampled[pairs[:, 1]]
        mean, variance = (
            np.array([getattr(run, what)[k] for run, k in zip(filtered, at, strict=True)])
            for what in ("mean", "variance")
        )
        peer = of_normal(whole.observed[pairs[:, 1]], mean, variance)
        own = flightcal_forecasts(problem, telemetry, draws, [tuple(whole.times[pair]) for pair in pairs])
        rows += _rows(name, train.simulator.channels, own, peer)
    return Section(
        "Forecasts",
        "FUNcube-1 (`examples/funcube1/with_discrepancy.yaml`), trained on two orbits: telemetry some time after the "
        "last temperature that is known, drivers as measured throughout. CRPS in K (smaller is better), the mean over "
        f"{count} origins; covered: by 95% intervals. The difference is flightcal's minus the filter's, with the "
        "standard error of its mean as if origins were independent.",
        [Table(_COLUMNS, rows)],
        [
            "Filter: the same network and priors, with process noise at every node and white noise of the channels, "
            "fitted to the innovations of the training window (maximum a posteriori in log-parameters, "
            f"{len(ends)} starts, {sum(end > max(ends) - 0.1 for end in ends)} of them to within 0.1 nat of the best). "
            "It knows all telemetry from the training's start to the origin.",
            f"Filter's process noise: {_estimates(fitted, 'process.', 'K/s^0.5')}; measurement noise: "
            f"{_estimates(fitted, 'noise.', 'K')}.",
            "flightcal: the example's model (discrepancy in orbit phase, AR(1) noise), "
            f"{len(draws)} posterior draws. Of the telemetry after the training it knows only the 10 min up to the "
            "origin, which tell the initial temperatures: its window begins 10 min before the origin.",
            "Origins are evenly spread over the telemetry after the training. For 4 orbits they begin in the training "
            "window, so that they spread over an orbit; what is forecast is never in it. Origins within an orbit are "
            "much alike, so standard errors are too small, most of all those of 4 orbits.",
        ],
    )


_COLUMNS = [
    "", "flightcal, CRPS", "filter, CRPS", "difference", "flightcal, covered", "filter, covered"
]  # fmt: skip


def _rows(horizon: str, channels: tuple[str, ...], own: Scores, peer: Scores) -> list[list[str]]:
    rows = []
    for k, channel in enumerate(channels):
        difference = own.crps[:, k] - peer.crps[:, k]
        error = difference.std(ddof=1) / np.sqrt(len(difference))
        rows.append(
            [
                f"{horizon}, {channel}",
                f"{own.crps[:, k].mean():.2f}",
                f"{peer.crps[:, k].mean():.2f}",
                f"{difference.mean():+.2f} ({error:.2f})",
                f"{own.covered[:, k].mean():.0%}",
                f"{peer.covered[:, k].mean():.0%}",
            ]
        )
    return rows


def _estimates(fitted: Any, prefix: str, unit: str) -> str:
    found = zip(fitted.names, fitted.values, strict=True)
    return ", ".join(
        f"{name.removeprefix(prefix)} {value:.2g} {unit}" for name, value in found if name.startswith(prefix)
    )
