"""Do the predicted distributions say how often what happens? Probability integral transform, and coverage in parts.

Distributions are those of the prediction's draws. Samples that follow each other share their errors, so what chance may
do is judged by the effective number of samples. That is cautious: for normal errors, on which side of a threshold two
samples lie depends less on each other than the errors themselves do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy.stats import beta, kstwo

from ..simulator import FloatArray
from .residuals import effective_samples

PHASES = 12
"""Parts of the orbit whose coverage is told apart."""

MOST_PARTS = 24
"""Hours of a forecast that are told apart; a longer one is told apart in longer parts."""

BAND = 0.95
"""Probability of a band of chance."""


def probability_integral_transform(prediction: xr.Dataset) -> FloatArray:
    """Predicted probability of a lower temperature than telemetry's, [T, N]; NaN where nothing is scored.

    Uniform between 0 and 1 where the predicted distributions are right (Dawid 1984, J. R. Stat. Soc. A 147); more often
    near 0 and 1 where they are too narrow, near the middle where they are too wide. prediction: a group of
    prediction.nc.
    """
    values = prediction["probability_below"].where(prediction["scored"].astype(bool))
    return np.asarray(values.transpose("time", "channel").values, float)


@dataclass(frozen=True)
class Uniformity:
    """Whether one channel's probability integral transform is uniform."""

    channel: str
    samples: int
    effective: float
    distance: float
    """Kolmogorov-Smirnov: the largest between the distribution found and the uniform one."""
    p_value: float
    """Of as many independent samples as are effective."""


def uniformity(prediction: xr.Dataset) -> list[Uniformity]:
    """The Kolmogorov-Smirnov test of each channel's transform, with the effective number of samples."""
    time = prediction["time"].values
    results = []
    for channel, values in zip(prediction["channel"].values, probability_integral_transform(prediction).T, strict=True):
        present = np.isfinite(values)
        ordered, count = np.sort(values[present]), int(present.sum())
        effective = effective_samples(values[present], time[present])
        distance = p_value = math.nan
        if count > 1:
            rank = np.arange(count)
            distance = float(max((ordered - rank / count).max(), ((rank + 1) / count - ordered).max()))
            p_value = float(kstwo.sf(distance, max(1, round(effective))))
        results.append(Uniformity(str(channel), count, effective, distance, p_value))
    return results


@dataclass(frozen=True)
class Coverage:
    """Share of a channel's telemetry inside the interval, in one part of the orbit or of the forecast."""

    channel: str
    start: float
    end: float
    samples: int
    share: float
    lower: float
    """What the share may be by chance where the interval is right: bounds of `BAND`."""
    upper: float


def coverage_by_phase(prediction: xr.Dataset, parts: int = PHASES) -> list[Coverage]:
    """Coverage of each channel in equal parts of the orbit; start and end in orbits, 0 to 1."""
    return _coverage(prediction, prediction["orbit_phase"].values, np.linspace(0.0, 1.0, parts + 1))


def coverage_by_hour(prediction: xr.Dataset) -> list[Coverage]:
    """Coverage of each channel in each hour since the first scored sample, or in so many; start and end in hours."""
    time = prediction["time"].values
    scored = prediction["scored"].values.astype(bool)
    if not scored.any():
        return []
    ahead = (time - time[scored][0]).astype("timedelta64[ns]").astype(np.int64) / 3.6e12
    hours = float(max(1, math.ceil(math.ceil(ahead[-1]) / MOST_PARTS)))
    return _coverage(prediction, ahead, hours * np.arange(math.ceil(ahead[-1] / hours + 1e-9) + 1))


def _coverage(prediction: xr.Dataset, places: FloatArray, edges: FloatArray) -> list[Coverage]:
    """Coverage where `places` [T] lie between neighbouring edges; parts without a sample are left out."""
    chosen = prediction.sel({"by": "stochastic"}).transpose("time", "channel", ...)
    observed, lower, upper = (chosen[name].values for name in ("observed", "lower", "upper"))
    usable = np.isfinite(observed) & np.isfinite(lower) & prediction["scored"].values.astype(bool)[:, None]
    inside = (lower <= observed) & (observed <= upper)
    nominal = float(prediction.attrs.get("interval", 0.95))
    time = prediction["time"].values
    part = np.digitize(places, edges) - 1
    results = []
    for k, channel in enumerate(prediction["channel"].values):
        valid = usable[:, k]
        if not valid.any():
            continue
        share_effective = effective_samples((observed - chosen["mean"].values)[valid, k], time[valid]) / valid.sum()
        for p in range(len(edges) - 1):
            here = valid & (part == p)
            if here.any():
                low, high = chance_band(nominal, max(1.0, share_effective * here.sum()))
                results.append(
                    Coverage(
                        str(channel), float(edges[p]), float(edges[p + 1]), int(here.sum()), inside[here, k].mean(),
                        low, high,
                    )
                )  # fmt: skip
    return results


def chance_band(probability: float, count: float) -> tuple[float, float]:
    """Shares of `count` independent events of this probability between which `BAND` of them lie, about.

    Quantiles of the beta distribution of the same mean, with the variance of a share: `count` need not be whole.
    """
    tail = 0.5 * (1.0 - BAND)
    # Var = p (1 - p) / (a + b + 1)
    size = max(count - 1.0, 1e-3)
    low, high = beta.ppf([tail, 1.0 - tail], probability * size, (1.0 - probability) * size)
    return float(low), float(high)
