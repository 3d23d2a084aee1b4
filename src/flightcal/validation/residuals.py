"""Are the residuals the noise that the likelihood takes them for: independent, or correlated as it says?

Telemetry has gaps, so everything here works on pairs of samples that lie a whole number of nominal spacings
apart; no pair reaches across a break in the sampling, and no missing sample is invented. Of irregular sampling every
pair counts, at the lag that is nearest.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy.signal import correlate
from scipy.stats import chi2

from ..probability import INDEPENDENT, called
from ..simulator import FloatArray

Times = NDArray[np.datetime64]

JITTER = 0.25
"""Share of the nominal spacing by which a sample may be late or early and still count as on the grid."""

_REGULAR = 0.9
"""Share of the steps between samples that are whole in regular sampling."""
_LONG = 20.0
"""Steps longer than so many nominal ones are gaps, which say nothing about regularity."""
_BREAK = 5.0
"""Steps longer than so many nominal ones part bursts of samples."""
_FEWEST_BURSTS = 8
_USUAL = 0.9
"""Share of the steps of irregular sampling that are no gaps."""

SIGNIFICANCE = 0.01
"""p value of the Ljung-Box test below which autocorrelation is taken as shown."""

HARMLESS = 1.1
"""Factor of narrowing below which shown autocorrelation is of no practical weight."""

FEWEST = 20
"""Residuals needed to say anything."""

IID = INDEPENDENT.words
"""What noise is called where a prediction does not say."""

Verdict = Literal["white", "slight", "expected", "contradicted", "unknown"]


def nominal_spacing(time: Times) -> float:
    """Most usual step between samples: the median, s. NaN for fewer than two samples."""
    steps = np.diff(time).astype("timedelta64[ns]").astype(np.int64)
    return float(np.median(steps)) * 1e-9 if steps.size else math.nan


def segments(residuals: ArrayLike, time: Times, max_lag: int) -> list[FloatArray]:
    """Stretches of regular sampling, each on a grid of nominal spacing with NaN where a sample is missing.

    residuals: [T], time: [T] datetime64, increasing. A step that is no whole number of nominal spacings, or
    longer than `max_lag` of them, ends a stretch.
    """
    values = np.asarray(residuals, float)
    if values.size < 2:
        return [values]
    steps = np.diff(time).astype("timedelta64[ns]").astype(np.int64) * 1e-9 / nominal_spacing(time)
    whole = np.rint(steps)
    regular = (np.abs(steps - whole) <= JITTER) & (whole >= 1) & (whole <= max_lag)
    ends = [0, *(np.flatnonzero(~regular) + 1), values.size]
    grids = []
    for start, end in itertools.pairwise(ends):
        places = np.concatenate([[0], np.cumsum(whole[start : end - 1])]).astype(int)
        grid = np.full(places[-1] + 1, np.nan)
        grid[places] = values[start:end]
        grids.append(grid)
    return grids


class _Cells(NamedTuple):
    """A stretch of samples on a grid: in each cell their sum, their number, and the sum of their squares."""

    sums: FloatArray
    counts: FloatArray
    squares: FloatArray


def _cells(values: FloatArray, time: Times, max_lag: int, width: float | None) -> list[_Cells]:
    """Stretches of values [T], NaN where missing, each on a grid of `spacing`, or of cells of `width` s.

    Of regular sampling each cell has at most one sample. Where sampling is irregular (fewer than `_REGULAR` of the
    steps are whole numbers of nominal spacings), or a width is given, a cell holds the samples nearest to it, so that
    pairs of samples are taken for those of the nearest lag (slots: Edelson & Krolik 1988, ApJ 333); a stretch then ends
    at a gap longer than `max_lag` alone.
    """
    if width is None and _is_regular(time):
        grids = segments(values, time, max_lag)
        sums = [np.where(np.isfinite(grid), grid, 0.0) for grid in grids]
        return [
            _Cells(total, np.isfinite(grid).astype(float), total**2) for total, grid in zip(sums, grids, strict=True)
        ]
    present = np.isfinite(values)
    values, at = values[present], _seconds(time[present]) / (width or spacing(time))
    ends = [0, *(np.flatnonzero(np.diff(at) > max_lag + 1) + 1), values.size]
    found = []
    for start, end in itertools.pairwise(ends):
        places, span_values = np.rint(at[start:end] - at[start]).astype(int), values[start:end]
        weights = (span_values, np.ones(span_values.size), span_values**2)
        found.append(_Cells(*(np.asarray(np.bincount(places, of), float) for of in weights)))
    return found


def _is_regular(time: Times) -> bool:
    """Whether neighbouring samples lie whole numbers of nominal spacings apart, but for few and for long gaps."""
    steps = np.diff(_seconds(time))
    if not steps.size:
        return True
    steps = steps[steps <= _LONG * np.median(steps)] / np.median(steps)
    whole = np.rint(steps)
    return bool(np.mean((np.abs(steps - whole) <= JITTER) & (whole >= 1)) >= _REGULAR)


def spacing(time: Times) -> float:
    """What one lag is, s: the nominal spacing, of irregular sampling about the mean one without the longest gaps."""
    if _is_regular(time):
        return nominal_spacing(time)
    steps = np.diff(_seconds(time))
    return float(max(np.median(steps), steps[steps <= np.quantile(steps, _USUAL)].mean()))


def _seconds(time: Times) -> FloatArray:
    return np.asarray((time - time[:1]).astype("timedelta64[ns]").astype(np.int64) * 1e-9)


def pair_counts(residuals: ArrayLike, time: Times, max_lag: int, width: float | None = None) -> NDArray[np.int64]:
    """Number of pairs of valid residuals at each lag from 0 to `max_lag`: [max_lag + 1]; at lag 0 the residuals."""
    counts = [cells.counts for cells in _cells(np.asarray(residuals, float), time, max_lag, width)]
    pairs = np.rint(_products(counts, counts, max_lag)).astype(np.int64)
    pairs[0] = round(sum(count.sum() for count in counts))
    return pairs


def autocorrelation(residuals: ArrayLike, time: Times, max_lag: int, width: float | None = None) -> FloatArray:
    """Autocorrelation at lags 0 to `max_lag`, in steps of `spacing`: [max_lag + 1], -1 to 1; NaN without pairs.

    residuals: [T], NaN where missing; time: [T] datetime64; width: s, of other steps than `spacing`. At each lag the
    sum of products over the pairs that exist, over the geometric mean of the sums of squares of their first and of
    their second members, about the mean of all residuals.
    """
    values = np.asarray(residuals, float)
    if not np.isfinite(values).any():
        return np.full(max_lag + 1, np.nan)
    cells = _cells(values - np.nanmean(values), time, max_lag, width)
    sums, counts, squares = ([cell[k] for cell in cells] for k in range(3))
    size = np.sqrt(
        np.maximum(_products(squares, counts, max_lag), 0) * np.maximum(_products(counts, squares, max_lag), 0)
    )
    exists = size > 1e-12 * sum(s.sum() for s in squares)
    products = _products(sums, sums, max_lag)
    ratio = np.divide(products, size, out=np.full(max_lag + 1, np.nan), where=exists)
    ratio[0] = 1.0 if exists[0] else math.nan
    return np.clip(ratio, -1.0, 1.0)


def _together(residuals: FloatArray, time: Times, width: float | None) -> float:
    """What pairs of samples in the same cell add to the variance of the mean: their number times their correlation."""
    cells = _cells(residuals - np.nanmean(residuals), time, residuals.size, width)
    sums, counts, squares = (np.concatenate([cell[k] for cell in cells]) for k in range(3))
    pairs, size = float((counts * (counts - 1)).sum()), float((squares * (counts - 1)).sum())
    return pairs * float((sums**2 - squares).sum()) / size if size > 0.0 else 0.0


def _products(first: list[FloatArray], second: list[FloatArray], max_lag: int) -> FloatArray:
    """Sum of first[i] * second[i + k] over i and stretches, for k from 0 to `max_lag`: [max_lag + 1]."""
    total = np.zeros(max_lag + 1)
    for one, other in zip(first, second, strict=True):
        sums = correlate(other, one, mode="full", method="auto")[one.size - 1 :][: max_lag + 1]
        total[: sums.size] += sums
    return total


def effective_samples(residuals: ArrayLike, time: Times) -> float:
    """Number of independent residuals that would fix their mean as well as these do.

    n^2 / (n + 2 sum_k n_k r_k), with n_k pairs at lag k, which is n / (1 + 2 sum r_k) for a long series
    without gaps. Pairs in the same cell of irregular sampling count besides. The sum ends where a sum of two
    neighbouring autocorrelations turns negative, and these sums are made to fall: the initial monotone sequence
    estimator, Geyer (1992), Stat. Sci. 7, sec. 3.3. Of samples in bursts the sum ends with a burst, so that it is also
    taken over cells that hold a burst each; the larger counts.
    Between 1 and n.
    """
    values = np.asarray(residuals, float)
    count = int(np.isfinite(values).sum())
    if count < 2:
        return float(count)
    widths = [None, *_between_bursts(time[np.isfinite(values)])]
    inflation = max(_inflation(values, time, width) for width in widths)
    return float(np.clip(count / max(inflation, 1.0), 1.0, count))


def _between_bursts(time: Times) -> list[float]:
    """Mean time from one burst of samples to the next, s; none where there are fewer than `_FEWEST_BURSTS`."""
    steps = np.diff(_seconds(time))
    breaks = int((steps > _BREAK * np.median(steps)).sum()) if steps.size else 0
    return [float(steps.sum()) / breaks] if breaks >= _FEWEST_BURSTS else []


def _inflation(values: FloatArray, time: Times, width: float | None) -> float:
    """By how much the variance of the mean is larger than of independent samples; width: see `autocorrelation`."""
    count = int(np.isfinite(values).sum())
    max_lag = max(1, values.size // 2)
    correlation = np.nan_to_num(autocorrelation(values, time, max_lag, width))
    weighted = correlation * pair_counts(values, time, max_lag, width) / count
    length = weighted.size // 2 * 2
    pairs = weighted[:length:2] + weighted[1:length:2]
    negative = np.flatnonzero(pairs <= 0)
    pairs = pairs[: negative[0]] if negative.size else pairs
    inflation = 2 * np.minimum.accumulate(pairs).sum() - 1 if pairs.size else 1.0
    return float(inflation + max(_together(values, time, width), 0.0) / count)


def ljung_box(residuals: ArrayLike, time: Times, lags: int) -> tuple[float, float]:
    """Ljung-Box statistic over `lags` lags, and its p value under white noise.

    Ljung & Box (1978), Biometrika 65, eq. 1.5, with the number of pairs n_k that exist in place of n - k:
    Q = (n + 2) / n * sum_k n_k r_k^2, chi-squared with as many degrees of freedom as there are lags with
    pairs.
    """
    correlation = autocorrelation(residuals, time, lags)[1:]
    pairs = pair_counts(residuals, time, lags)
    usable = np.isfinite(correlation)
    if not usable.any():
        return math.nan, math.nan
    statistic = (pairs[0] + 2) / pairs[0] * float(np.sum(pairs[1:][usable] * correlation[usable] ** 2))
    return statistic, float(chi2.sf(statistic, int(usable.sum())))


@dataclass(frozen=True)
class ResidualCheck:
    """What the residuals of one channel say about what is assumed of its noise.

    Of correlated noise its innovations are tested, the part of each residual that the ones before do not tell: these
    are white where the assumption is right, and `factor` is about how far it is wrong.
    """

    channel: str
    noise: str
    """What is assumed."""
    samples: int
    mean: float
    """Telemetry minus prediction, K."""
    standard_deviation: float
    """K."""
    verdict: Verdict = "unknown"
    words: str = ""
    lag1: float = math.nan
    """Autocorrelation one spacing apart."""
    ljung_box: float = math.nan
    p_value: float = math.nan
    lags: int = 0
    """Of the Ljung-Box test."""
    effective: float = math.nan
    """Effective number of independent residuals."""
    factor: float = math.nan
    """The posterior is too narrow by about this factor: sqrt(samples / effective)."""
    factor_ar1: float = math.nan
    """The same for AR(1) noise: sqrt((1 + lag1) / (1 - lag1)); too large for residuals that vary smoothly."""
    discrepant: bool = False
    """Whether a discrepancy is assumed, whose mean the prediction holds."""
    residual_lag1: float = math.nan
    """Of the residuals themselves, whatever was tested."""

    @property
    def tested(self) -> str:
        """What was tested: of noise with a memory what is new in each sample."""
        return "innovations" if called(self.noise).has_memory else "residuals"


def check_residuals(
    channel: str, residuals: ArrayLike, time: Times, *, noise: str = IID, uncertain: bool = False
) -> ResidualCheck:
    """Tests of one channel's residuals, and in words whether they contradict the noise that is assumed.

    residuals: [T] K, telemetry minus prediction, of AR(1) noise its innovations, NaN where missing; time: [T]
    datetime64. uncertain: slow heat is not known in this window, which makes residuals correlated.

    An iid likelihood counts every residual as new information; in directions of parameter space whose
    effect on the temperatures varies slowly, only the effective number of them is. Its standard deviations
    are then too small by sqrt(samples / effective), which is sqrt((1 + r) / (1 - r)) for AR(1) noise of
    lag-1 autocorrelation r.
    """
    values = np.asarray(residuals, float)
    present = np.isfinite(values)
    values, time = values[present], time[present]
    count = values.size
    mean, spread = (float(values.mean()), float(values.std())) if count else (math.nan, math.nan)
    check = ResidualCheck(channel, noise, count, mean, spread)
    if count < FEWEST or np.ptp(values) == 0:
        reason = "too few residuals" if count < FEWEST else "residuals that do not vary"
        return replace(check, words=f"{channel}: {reason} ({count}) to judge the noise.")
    lags = min(20, count // 5)
    lag1 = float(autocorrelation(values, time, 1)[1])
    statistic, p_value = ljung_box(values, time, lags)
    effective = effective_samples(values, time)
    factor = math.sqrt(count / effective)
    check = replace(
        check,
        verdict=_verdict(p_value, factor, uncertain),
        lag1=lag1,
        ljung_box=statistic,
        p_value=p_value,
        lags=lags,
        effective=effective,
        factor=factor,
        factor_ar1=math.sqrt((1 + lag1) / max(1 - lag1, 1e-12)) if lag1 > 0 else 1.0,
        residual_lag1=lag1,
    )
    return replace(check, words=_words(check))


def check_window(prediction: xr.Dataset, *, unseen: bool = False, heat: bool = False) -> list[ResidualCheck]:
    """Tests of every channel's scored residuals in a window. prediction: a group of prediction.nc.

    Where the noise is more than iid, of its `innovation`. unseen: the window was not calibrated on;
    heat: the prediction has unmodelled heat, of which the slow part is not known there.
    """
    scored = prediction.isel(time=prediction["scored"].values.astype(bool)).sel({"by": "stochastic"})
    residuals = (scored["observed"] - scored["mean"]).transpose("time", "channel").values
    tested, time = residuals, scored["time"].values
    channels = [str(c) for c in scored["channel"].values]
    noise, discrepant = [IID] * len(channels), [False] * len(channels)
    if "innovation" in prediction:
        tested = scored["innovation"].transpose("time", "channel").values
        noise = [str(v) for v in scored["noise"].values]
        discrepant = [bool(v) for v in scored["discrepant"].values]
    checks = []
    for i, channel in enumerate(channels):
        check = check_residuals(channel, tested[:, i], time, noise=noise[i], uncertain=unseen and heat)
        present = np.isfinite(residuals[:, i])
        correlation = autocorrelation(residuals[present, i], time[present], 1)[1] if present.sum() > 1 else math.nan
        checks.append(replace(check, discrepant=discrepant[i], residual_lag1=float(correlation)))
    return checks


def _verdict(p_value: float, factor: float, uncertain: bool) -> Verdict:
    if math.isnan(p_value):
        return "unknown"
    if p_value >= SIGNIFICANCE:
        return "white"
    if factor < HARMLESS:
        return "slight"
    return "expected" if uncertain else "contradicted"


def _words(check: ResidualCheck) -> str:
    channel, noise, verdict, lag1, tested = check.channel, check.noise, check.verdict, check.lag1, check.tested
    if verdict == "unknown":
        return f"{channel}: no two residuals lie near to each other, so the noise cannot be judged."
    chance = "p < 0.0001" if check.p_value < 1e-4 else f"p = {check.p_value:.2g}"
    of = " of the innovations" if tested == "innovations" else ""
    if verdict == "white":
        return f"{channel}: no contradiction to {noise} (lag-1 autocorrelation{of} {lag1:.2f}, {chance})."
    if verdict == "slight":
        return (
            f"{channel}: autocorrelation{of} can be shown ({lag1:.2f} at lag 1, {chance}) but hardly "
            f"matters: parameter intervals are too narrow by a factor of about {check.factor:.2f}."
        )
    if verdict == "expected":
        return (
            f"{channel}: the {tested} are correlated (lag-1 autocorrelation {lag1:.3f}, {chance}), which what the "
            f"simulator lacks makes them where no telemetry tells it; the prediction's interval contains it."
        )
    least = "at least " if check.effective < 10 else "about "
    return (
        f"{channel}: the {tested} contradict {noise} (lag-1 autocorrelation {lag1:.3f}, {chance}): "
        f"{check.samples} {tested} carry the information of about {check.effective:.0f} independent ones, so the "
        f"parameter intervals that rest on them are too narrow by {least}a factor of {check.factor:.1f}."
    )
