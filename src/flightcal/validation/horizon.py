"""Scores of predictions by how far ahead they are: of each channel, origin and band of the horizon."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray
from numpy.typing import NDArray

from ..simulator import FloatArray
from .residuals import effective_samples

ALL: Final = "all"
"""In the place of an origin, a channel or a band: all of them together."""

BANDS: Final = ("up to 10 min", "10 min to 1 orbit", "1 to 2 orbits", "2 to 4 orbits", "later")
_SHORTEST: Final = 600.0  # s


@dataclass(frozen=True)
class BandScore:
    """Scores of one channel of one origin in one band of the horizon; NaN without samples."""

    origin: str
    channel: str
    band: str
    samples: int
    rmse: float
    """K."""
    bias: float
    """Mean of prediction minus telemetry, K."""
    coverage: float
    """Share of the telemetry inside the interval."""
    coverage_error: float
    """Standard error of that, of as many independent samples as are effective."""
    effective: float
    """Effective number of samples."""
    width: float
    """Mean of the interval, K."""
    crps: float
    """K."""


@dataclass(frozen=True)
class DutyScore:
    """Share of the samples with a known status in which a heater is on after an origin."""

    origin: str
    heater: str
    measured: float
    """Share of its valid status samples."""
    mean: float
    lower: float
    upper: float
    hit: bool


@dataclass(frozen=True)
class _Origin:
    """Arrays of one prediction; [T, N] if not said otherwise."""

    band: NDArray[np.intp]
    """[T] place in `BANDS`."""
    valid: NDArray[np.bool_]
    error: FloatArray
    hit: NDArray[np.bool_]
    width: FloatArray
    crps: FloatArray
    effective_share: FloatArray
    """[N] effective samples of a sample."""


def band_scores(predictions: Mapping[str, xarray.Dataset], period: float) -> list[BandScore]:
    """Scores by origin, channel and band, and of all origins, channels and bands together (`ALL`).

    predictions: groups of backtest.nc by origin; period: of the orbit, s. Only scored samples count. Effective
    samples: by the autocorrelation of the residuals, with Geyer's initial monotone sequence (`effective_samples`).
    That is cautious: hits depend less on each other than residuals do. Several channels count as much as one does in
    the mean. Of several origins it is the sum, although predictions of neighbouring origins share telemetry. The error
    of coverage is that of Agresti & Coull (1998), Am. Stat. 52, which is not zero where all samples are inside.
    """
    if not predictions:
        return []
    arrays = {name: _arrays(prediction, period) for name, prediction in predictions.items()}
    channels = [str(channel) for channel in next(iter(predictions.values()))["channel"].values]
    places = list(range(len(channels)))
    found = []
    for origin, parts in [*((name, [array]) for name, array in arrays.items()), (ALL, list(arrays.values()))]:
        for channel, columns in [*((name, [k]) for k, name in enumerate(channels)), (ALL, places)]:
            for band, bands in [*((name, [k]) for k, name in enumerate(BANDS)), (ALL, list(range(len(BANDS))))]:
                found.append(_score(origin, channel, band, parts, columns, bands))
    return found


def duty_scores(predictions: Mapping[str, xarray.Dataset]) -> list[DutyScore]:
    """Of each heater whose status is measured after an origin, over the whole prediction."""
    return list(itertools.chain.from_iterable(_duty(origin, dataset) for origin, dataset in predictions.items()))


def _duty(origin: str, prediction: xarray.Dataset) -> Iterator[DutyScore]:
    tail = 0.5 * (1.0 - float(prediction.attrs["interval"]))
    for k, heater in enumerate(prediction["heater"].values):
        measured = float(prediction["observed_duty_cycle"].values[k])
        if math.isnan(measured):
            continue
        # On the same samples; predictions of an older flightcal have the whole time alone.
        draws = prediction["sampled_duty_cycle" if "sampled_duty_cycle" in prediction else "duty_cycle"].values[:, k]
        lower, upper = (float(bound) for bound in np.quantile(draws, [tail, 1.0 - tail]))
        yield DutyScore(origin, str(heater), measured, float(draws.mean()), lower, upper, lower <= measured <= upper)


def ahead(prediction: xarray.Dataset) -> FloatArray:
    """Time since the origin [T], s."""
    origin = np.datetime64(prediction.attrs["origin"], "ns")
    return np.asarray((prediction["time"].values - origin) / np.timedelta64(1, "ns") * 1e-9)


def _arrays(prediction: xarray.Dataset, period: float) -> _Origin:
    chosen = prediction.sel({"by": "stochastic"}).transpose("time", "channel", ...)
    observed, mean, lower, upper = (chosen[name].values for name in ("observed", "mean", "lower", "upper"))
    edges = np.array([_SHORTEST, period, 2 * period, 4 * period])
    valid = np.isfinite(observed) & np.isfinite(mean) & chosen["scored"].values.astype(bool)[:, None]
    time = chosen["time"].values
    share = [
        effective_samples((observed - mean)[flags, k], time[flags]) / flags.sum() if flags.any() else math.nan
        for k, flags in enumerate(valid.T)
    ]
    return _Origin(
        band=np.searchsorted(edges, ahead(prediction), side="left"),
        valid=valid,
        error=mean - observed,
        hit=(lower <= observed) & (observed <= upper),
        width=upper - lower,
        crps=chosen["crps"].values,
        effective_share=np.array(share),
    )


def _score(
    origin: str, channel: str, band: str, parts: Sequence[_Origin], columns: Sequence[int], bands: Sequence[int]
) -> BandScore:
    counted = [part.valid & np.isin(part.band, bands)[:, None] for part in parts]
    samples = [here[:, columns].sum(axis=0) for here in counted]  # by channel

    def of(name: str) -> FloatArray:
        chosen = [
            getattr(origin, name)[:, columns][here[:, columns]] for origin, here in zip(parts, counted, strict=True)
        ]
        return np.concatenate(chosen).astype(float)

    error, hit, width, crps = (of(name) for name in ("error", "hit", "width", "crps"))
    if not len(error):
        nothing = math.nan
        return BandScore(origin, channel, band, 0, nothing, nothing, nothing, nothing, 0.0, nothing, nothing)
    effective = 0.0
    for part, count in zip(parts, samples, strict=True):
        seen = count > 0
        if seen.any():
            effective += float(np.maximum(1.0, part.effective_share[columns][seen] * count[seen]).mean())
    share = float(hit.mean())
    middle = (share * effective + 2.0) / (effective + 4.0)
    return BandScore(
        origin=origin,
        channel=channel,
        band=band,
        samples=len(error),
        rmse=float(np.sqrt(np.mean(error**2))),
        bias=float(error.mean()),
        coverage=share,
        coverage_error=math.sqrt(middle * (1.0 - middle) / (effective + 4.0)),
        effective=effective,
        width=float(width.mean()),
        crps=float(crps.mean()),
    )
