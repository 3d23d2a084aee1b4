"""Scores of a prediction against telemetry: functions on arrays, and `score` for a window's prediction.

All functions take arrays of one shape, leave out every sample in which an argument is NaN, and return NaN
where nothing is left. Temperatures in kelvin.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from ..scenario import ICE_POINT, is_trained
from ..simulator import FloatArray

"""K, by definition of the Celsius scale (SI brochure, 2019, sec. 2.3.1)."""

NEAR_ZERO = 1.0
"""K. Closer to 0 degC than this, a percentage of the Celsius temperature means nothing."""

UNCALIBRATED, CALIBRATED, BEST_FIT, STOCHASTIC = "uncalibrated", "calibrated", "genetic_best", "stochastic"
"""The simulator before, with the calibrated numbers, and with those that alone fit best; and the mean of simulations of
posterior draws with heat."""

POINT_METHODS = (UNCALIBRATED, "poorly_calibrated", "genetic", BEST_FIT, CALIBRATED)
"""Methods that give one temperature and no interval."""

GENETIC_RUNS = "genetic_runs"
"""What scores of the genetic algorithm's runs, together, are under."""

PUBLISHED = {"rmse": 0.1014 / 0.1346, "mape_kelvin": 0.054 / 0.061, "mape_celsius": 0.054 / 0.061}
"""Stochastic over genetic scores of the paper, whose units are masked: 0.753 and 0.885."""


def _valid(*arrays: ArrayLike) -> tuple[FloatArray, ...]:
    """The arrays, flat, without the samples in which any of them is NaN."""
    broadcast = np.broadcast_arrays(*[np.asarray(a, float) for a in arrays])
    keep = np.all([np.isfinite(a) for a in broadcast], axis=0)
    return tuple(a[keep] for a in broadcast)


def _mean(values: FloatArray) -> float:
    """Mean, NaN of nothing."""
    return float(values.mean()) if values.size else math.nan


def rmse(observed: ArrayLike, predicted: ArrayLike) -> float:
    """Root mean square error, K."""
    y, p = _valid(observed, predicted)
    return math.sqrt(_mean((y - p) ** 2))


def mape_kelvin(observed: ArrayLike, predicted: ArrayLike) -> float:
    """Mean absolute percentage error, percent of the absolute temperature in kelvin."""
    y, p = _valid(observed, predicted)
    return 100 * _mean(np.abs((y - p) / y))


def mape_celsius(observed: ArrayLike, predicted: ArrayLike) -> float | None:
    """Mean absolute percentage error, percent of the temperature in degrees Celsius, as published.

    None where an observed temperature lies within 1 degC of zero: the percentage is then unbounded.
    observed, predicted: K.
    """
    y, p = _valid(observed, predicted)
    celsius = y - ICE_POINT
    if celsius.size and np.abs(celsius).min() < NEAR_ZERO:
        return None
    return 100 * _mean(np.abs((y - p) / celsius))


def picp(observed: ArrayLike, lower: ArrayLike, upper: ArrayLike) -> float:
    """Prediction interval coverage probability: share of samples inside the interval or on its bounds."""
    y, low, high = _valid(observed, lower, upper)
    return _mean(((low <= y) & (y <= high)).astype(float))


def mpiw(lower: ArrayLike, upper: ArrayLike) -> float:
    """Mean prediction interval width, K."""
    low, high = _valid(lower, upper)
    return _mean(high - low)


def mean_absolute_error(observed: ArrayLike, predicted: ArrayLike) -> float:
    """Mean absolute error, K: the CRPS of a point."""
    y, p = _valid(observed, predicted)
    return _mean(np.abs(y - p))


def log_score_normal(observed: ArrayLike, mean: ArrayLike, standard_deviation: ArrayLike) -> float:
    """Mean logarithm of the predicted density of each sample by itself, of normal predictions; larger is better.

    In nats, of a density in 1/K (Gneiting & Raftery 2007, sec. 4.1); -inf where a deviation is zero. Of other
    predictions it is a proper score of their mean and deviation (Dawid & Sebastiani (1999), Ann. Stat. 27).
    """
    y, mu, sd = _valid(observed, mean, standard_deviation)
    if not (sd > 0).all():
        return -math.inf
    return _mean(-0.5 * ((y - mu) / sd) ** 2 - np.log(sd) - 0.5 * math.log(2 * math.pi))


def crps_of_draws(observed: ArrayLike, draws: ArrayLike) -> FloatArray:
    """Continuous ranked probability score of each sample in the distribution that draws [S, ...] are from, K.

    E|X - y| - E|X - X'| / 2 (Gneiting & Raftery (2007), J. Am. Stat. Assoc. 102, eq. 21, with the sign turned: smaller
    is better), the second mean over pairs of different draws, so that it does not depend on how many there are (Ferro
    (2014), Q. J. R. Meteorol. Soc. 140); by the sorted draws, in O(S log S). observed: [...] K. Of one draw: |X - y|.
    """
    y, members = np.asarray(observed, float), np.sort(np.asarray(draws, float), axis=0)
    size = len(members)
    weights = (2 * np.arange(1, size + 1) - size - 1) / max(1, size * (size - 1))
    return np.asarray(np.abs(members - y).mean(axis=0) - np.tensordot(weights, members, axes=1))


def probability_below(observed: ArrayLike, draws: ArrayLike) -> FloatArray:
    """Share of the draws [S, ...] that lie below telemetry [...]; draws equal to it count half. NaN where it is NaN."""
    y, members = np.asarray(observed, float), np.asarray(draws, float)
    share = 0.5 * ((members < y).mean(axis=0) + (members <= y).mean(axis=0))
    return np.where(np.isfinite(y), share, np.nan)


def status_agreement(observed_status: ArrayLike, probability: ArrayLike) -> float:
    """Expected share of samples in which a simulated heater is on or off as telemetry says.

    observed_status: 0 or 1; probability: of on, 0 to 1 (0 or 1 for a point method). The mean over
    simulations of the share in which one simulation agrees is the mean of 1 - |probability - observed|.
    """
    y, p = _valid(observed_status, probability)
    return _mean(1 - np.abs(p - y))


@dataclass(frozen=True)
class Metric:
    """One score: a record of metrics.json. `value` None: undefined, `note` says why."""

    method: str
    window: str
    channel: str
    metric: str
    value: float | None
    unit: str
    note: str = ""


def by_place(metrics: Iterable[Metric]) -> dict[tuple[str, str, str, str], Metric]:
    """Scores by method, window, channel and metric."""
    return {(m.method, m.window, m.channel, m.metric): m for m in metrics}


def values_of(metrics: Iterable[Metric]) -> dict[tuple[str, str, str, str], float | None]:
    """Values by method, window, channel and metric."""
    return {place: metric.value for place, metric in by_place(metrics).items()}


def score(prediction: xr.Dataset, window: str) -> list[Metric]:
    """All metrics of a window: for each method and channel, "all" channels pooled, and each heater.

    prediction: a group of prediction.nc. Only its `scored` samples count, save for duty cycles, switch
    counts and energies, which are those of the file. Intervals are scored for the methods that give one.
    """
    scored = prediction.isel(time=prediction["scored"].values.astype(bool))
    metrics: list[Metric] = []
    for method in [str(m) for m in prediction["by"].values]:
        of_method = scored.sel({"by": method})
        channels = [str(c) for c in scored["channel"].values]
        heaters = [str(h.values) for h in prediction.coords.get("heater", ())]
        scores = [
            *((channel, _temperature_scores(of_method.sel(channel=[channel]), method)) for channel in channels),
            ("all", _temperature_scores(of_method, method)),
            *((heater, _heater_scores(of_method.sel(heater=heater))) for heater in heaters),
        ]
        metrics += [Metric(method, window, place, *row) for place, found in scores for row in found]
    return metrics


Score = tuple[str, float | None, str, str]
"""Name, value or None, unit, note."""


def _checked(name: str, value: float | None, unit: str, note: str, remark: str = "") -> Score:
    """The score with a remark; None with a note where it is undefined."""
    defined = value is not None and math.isfinite(value)
    return name, value if defined else None, unit, remark if defined else note


def _temperature_scores(part: xr.Dataset, method: str) -> Iterator[Score]:
    """Scores of the temperatures in `part`: variables [time, channel] of one method."""
    observed, mean = part["observed"].values, part["mean"].values
    empty = "no scored telemetry"
    yield _checked("rmse", rmse(observed, mean), "K", empty)
    yield _checked("mape_kelvin", mape_kelvin(observed, mean), "%", empty)
    percent = mape_celsius(observed, mean)
    near_zero = "telemetry comes within 1 degC of 0 degC"
    yield _checked("mape_celsius", percent, "%", near_zero if percent is None else empty)
    if method in POINT_METHODS:
        yield _checked("crps", mean_absolute_error(observed, mean), "K", empty, "of a point: the mean absolute error")
        return
    lower, upper = part["lower"].values, part["upper"].values
    seen = np.where(np.isfinite(observed), 0.0, np.nan)
    yield _checked("picp", picp(observed, lower, upper), "1", empty)
    yield _checked("mpiw", mpiw(lower + seen, upper + seen), "K", empty)
    deviation = part["standard_deviation"].values
    yield _checked("crps", _mean(*_valid(part["crps"].values)), "K", empty)
    yield _checked("log_score", log_score_normal(observed, mean, deviation), "nat", empty)


def _heater_scores(part: xr.Dataset) -> Iterator[Score]:
    """Scores of one heater of one method; for the stochastic method of the mean over simulations.

    Errors are simulated minus observed: share of the samples with a known status in which it is on, times that it
    switches, energy. Its duty cycle is that of the whole window.
    """
    empty = "no status in telemetry"
    observed_duty, observed_count = float(part["observed_duty_cycle"]), float(part["observed_switch_count"])
    duty, energy = float(part["point_duty_cycle"]), float(part["point_energy"])
    sampled_duty = float(part["point_sampled_duty_cycle"])
    yield _checked("duty_cycle_error", sampled_duty - observed_duty, "1", empty)
    yield _checked("duty_cycle", duty, "1", "not simulated", "of the whole window")
    yield _checked("status_unknown", float(part["unknown_status"]), "1", "", "share of the window's time")
    agreement = status_agreement(part["observed_status"].values, part["status"].values)
    yield _checked("status_agreement", agreement, "1", empty)
    yield _checked("switch_count_error", float(part["point_switch_count"]) - observed_count, "1", empty)
    if duty > 0 or math.isnan(observed_duty):
        error = energy - implied_energy(observed_duty + duty - sampled_duty, duty, energy)
        remark = (
            "telemetry's energy: its duty cycle at the simulated power, and as simulated where its status is unknown"
        )
        yield _checked("energy_error", error, "J", empty, remark)
    else:
        yield _checked("energy_error", None, "J", "the simulated heater is never on, so its power is not known")


def scores_of_runs(metrics: Sequence[Metric]) -> list[Metric]:
    """Lowest, median and highest RMSE of several point estimates, for each window and channel: how far they differ.

    metrics: of these estimates. None where all are undefined.
    """
    errors: dict[tuple[str, str], list[float]] = {}
    for metric in metrics:
        if metric.metric == "rmse" and metric.value is not None:
            errors.setdefault((metric.window, metric.channel), []).append(metric.value)
    return [
        Metric(GENETIC_RUNS, *place, f"rmse_{name}", float(of(values)), "K", f"of {len(values)} runs")
        for place, values in errors.items()
        for name, of in (("lowest", np.min), ("median", np.median), ("highest", np.max))
    ]


@dataclass(frozen=True)
class SimulatorError:
    """What the calibrated numbers alone are worth in a window: RMSE over all channels, K."""

    window: str
    before: float
    """At the priors' medians."""
    calibrated: float
    """At the posterior's mean, without unmodelled heat: as a simulation of calibrated.yaml."""
    best_fit: float
    """With the numbers that alone fit the training best, as a simulation of best_fit.yaml."""
    predicted: float
    """As the run predicts: with unmodelled heat, where it has any."""

    def __str__(self) -> str:
        return (
            f"{self.window}: RMSE {self.before:.3g} K before, {self.predicted:.3g} K as this run predicts; simulated "
            f"alone {self.calibrated:.3g} K with calibrated.yaml, {self.best_fit:.3g} K with best_fit.yaml"
        )


def simulator_errors(metrics: Iterable[Metric]) -> list[SimulatorError]:
    """What the calibrated numbers alone are worth, in each window that was not trained on and has telemetry."""
    found = values_of(metrics)
    windows = dict.fromkeys(window for _, window, _, _ in found if not is_trained(window))
    methods = (UNCALIBRATED, CALIBRATED, BEST_FIT, STOCHASTIC)
    errors = {window: [found.get((method, window, "all", "rmse")) for method in methods] for window in windows}
    return [
        SimulatorError(window, *(value for value in of if value is not None))
        for window, of in errors.items()
        if None not in of
    ]


def implied_energy(observed_duty: float, duty: float, energy: float) -> float:
    """Energy that telemetry's duty cycle implies at the simulated power, J; NaN for a heater never on.

    Telemetry has a heater's status and not its power, so this is as much as it says about energy.
    """
    return observed_duty * energy / duty if duty > 0 else math.nan


@dataclass(frozen=True)
class ScoreRow:
    """Genetic against stochastic: `ratio` is stochastic / genetic, `published` the paper's ratio.

    genetic is the mean of the runs, as published; genetic_best the best run, and ratio_best stochastic / that.
    """

    window: str
    channel: str
    metric: str
    unit: str
    genetic: float | None
    stochastic: float | None
    ratio: float | None
    published: float | None
    note: str = ""
    genetic_best: float | None = None
    ratio_best: float | None = None


def comparison_table(metrics: Sequence[Metric]) -> list[ScoreRow]:
    """Genetic against stochastic in every window and channel: RMSE, MAPE, CRPS, in the order of `metrics`."""
    compared = ("rmse", "mape_kelvin", "mape_celsius", "crps")
    found = by_place(m for m in metrics if m.metric in compared)
    places = dict.fromkeys((m.window, m.channel, m.metric) for m in found.values())
    rows = []
    for place in places:
        pair = [found.get((method, *place)) for method in ("genetic", "stochastic")]
        genetic, stochastic = [m.value if m else None for m in pair]
        best = None if (of_best := found.get(("genetic_best", *place))) is None else of_best.value
        ratio, to_best = (stochastic / value if stochastic is not None and value else None for value in (genetic, best))
        note = next((m.note for m in pair if m and m.value is None), "")
        unit = next((m.unit for m in pair if m), "")
        rows.append(ScoreRow(*place, unit, genetic, stochastic, ratio, PUBLISHED.get(place[2]), note, best, to_best))
    return rows
