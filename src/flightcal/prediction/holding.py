"""Do intervals hold? A window's coverage and errors against those of telemetry drawn from the prediction itself.

Samples that follow each other share their errors, so coverage scatters far more than that of independent samples. By
how much depends on the window. The prediction's own draws tell: each of them is taken as if it were the telemetry.
Where a whole window may lie outside its intervals by chance, coverage says nothing; how far outside it lies does, and
how far off it is for some minutes on end.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d

from ..simulator import FloatArray

HELD: Final = 0.99
"""Probability with which all channels of all windows lie in the band where the prediction is right."""

_TAIL: Final = 0.05
"""Share of a channel's replicates that tell how its coverage or error falls off."""
_LASTS, _IN_A_ROW = 300.0, 5
"""s, and samples, for which an error lasts that counts by itself: less may be a spike."""
_TAILS: Final = 1.5
"""Times as large as a right prediction's, up to which such an error is of no practical weight: real errors have longer
tails than the noise that is assumed."""
_LEAST: Final = 1e-18
"""K^2, of a prediction that is sure of itself."""


@dataclass(frozen=True)
class Replicates:
    """Coverage and errors of one window by channel: of its telemetry, and of draws in the place of the telemetry."""

    coverage: FloatArray
    """[N] share of the samples inside the interval; NaN of a channel that has none."""
    replicated: FloatArray
    """[S, N]."""
    error: FloatArray
    """[N] root mean square of the samples' distances from the mean, in deviations of the prediction; NaN likewise."""
    replicated_error: FloatArray
    """[S, N]."""
    lasting: FloatArray
    """[N] the largest distance from the mean that all samples of five minutes have, five of them or more, in
    deviations; NaN where there are not so many."""
    replicated_lasting: FloatArray
    """[S, N]."""

    def dataset(self) -> xarray.Dataset:
        """As a window of prediction.nc keeps it."""
        return xarray.Dataset(
            {
                "coverage": ("channel", self.coverage),
                "replicated": (("replicate", "channel"), self.replicated),
                "error": ("channel", self.error),
                "replicated_error": (("replicate", "channel"), self.replicated_error),
                "lasting": ("channel", self.lasting),
                "replicated_lasting": (("replicate", "channel"), self.replicated_lasting),
            }
        )


def replicates_of(prediction: xarray.Dataset) -> Replicates:
    """Those that a window of prediction.nc keeps; without errors that last where an earlier version made it."""
    if "lasting" not in prediction:
        for name in ("error", "replicated_error"):
            prediction = prediction.assign({name.replace("error", "lasting"): np.nan * prediction[name]})
    names = ("coverage", "replicated", "error", "replicated_error", "lasting", "replicated_lasting")
    return Replicates(*(prediction[name].values for name in names))


@dataclass(frozen=True)
class Holding:
    """Whether the intervals of one window hold."""

    coverage: FloatArray
    """[N] as in `Replicates`."""
    lower: FloatArray
    """[N] lower end of the band of coverage; NaN of a channel without samples."""
    upper: FloatArray
    """[N]."""
    error: FloatArray
    """[N] as in `Replicates`."""
    most_error: FloatArray
    """[N] that of a right prediction; NaN of a channel without samples."""
    lasting: FloatArray
    """[N] as in `Replicates`."""
    most_lasting: FloatArray
    """[N] up to which it holds, half as much again as that of a right prediction; NaN likewise."""

    @property
    def room(self) -> FloatArray:
        """[N] how far a channel is from not holding: coverage above its band's lower end, errors below their most."""
        of_errors = np.fmin(1.0 - self.error / self.most_error, 1.0 - self.lasting / self.most_lasting)
        return np.minimum(self.coverage - self.lower, of_errors)

    @property
    def holds(self) -> bool:
        """No channel's coverage is below its band, and no error above its most."""
        return not bool((self.room < 0.0).any())

    @property
    def worst(self) -> int:
        """The channel that holds least; -1 without samples."""
        return int(np.nanargmin(self.room)) if np.isfinite(self.room).any() else -1

    def why(self, k: int) -> str:
        """Why a channel does not hold: an error that lasts, one of all samples, or coverage; empty where it holds."""
        if self.lasting[k] > self.most_lasting[k]:
            return f"{self.lasting[k]:.1f} deviations off for five minutes or more, above {self.most_lasting[k]:.1f}"
        if self.error[k] > self.most_error[k]:
            return f"{self.error[k]:.1f} deviations off, above {self.most_error[k]:.1f}"
        return f"below {self.lower[k]:.1%}" if self.coverage[k] < self.lower[k] else ""

    @property
    def too_wide(self) -> NDArray[np.bool_]:
        """[N] channels whose coverage is above the band: intervals wider than need be, which is no failure."""
        return np.asarray(self.coverage > self.upper)


def replicate(
    seconds: FloatArray, observed: FloatArray, scored: NDArray[np.bool_], draws: FloatArray, interval: float
) -> Replicates:
    """Coverage by the central interval of draws [S, T, N], and errors, of telemetry [T, N] and of draws in its place.

    seconds: [T] since any time; observed: K, NaN where missing; scored: [T], samples that count; draws: K, noise
    included, at least 40; interval: probability inside. A draw is held to the interval of all the others, for telemetry
    has no part in it either.
    """
    tails = 0.5 * (1 - interval), 0.5 * (1 + interval)
    counted = np.isfinite(observed) & np.asarray(scored, bool)[:, None]
    low, high = np.quantile(draws, tails, axis=0)
    inside = counted & (low <= observed) & (observed <= high)
    lowest, highest = _lower_end(draws, tails[0]), -_lower_end(-draws, tails[0])
    drawn = counted & (lowest < draws) & (draws < highest)
    samples = counted.sum(axis=0)
    size, mean, variance = len(draws), draws.mean(axis=0), draws.var(axis=0, ddof=1).clip(_LEAST)
    off, squared = (observed - mean) ** 2 / variance, (draws - mean) ** 2
    # Distance from the mean of the others, and their variance.
    others = ((size - 1) * variance - squared * size / (size - 1)).clip(_LEAST) / (size - 2)
    squared *= (size / (size - 1)) ** 2 / others
    lasting = np.stack(
        [_lasting(seconds[k], np.vstack([off[k, n], squared[:, k, n]])) for n, k in enumerate(counted.T)]
    )
    with np.errstate(invalid="ignore"):
        return Replicates(
            inside.sum(axis=0) / samples,
            drawn.sum(axis=1) / samples,
            np.sqrt(np.where(counted, off, 0.0).sum(axis=0) / samples),
            np.sqrt(np.where(counted, squared, 0.0).sum(axis=1) / samples),
            lasting[:, 0],
            lasting[:, 1:].T,
        )


def _lasting(seconds: FloatArray, squares: FloatArray) -> FloatArray:
    """The largest number [S] whose square all squares [S, T] of five minutes reach, one after another."""
    steps = np.diff(seconds)
    count = max(_IN_A_ROW, round(_LASTS / float(np.median(steps)))) if steps.size else _IN_A_ROW
    if squares.shape[1] < count:
        return np.full(len(squares), np.nan)
    least = minimum_filter1d(squares, count, axis=1, mode="constant", cval=0.0)
    return np.asarray(np.sqrt(least.max(axis=1)))


def _lower_end(draws: FloatArray, probability: float) -> FloatArray:
    """[T, N], above which a draw [S, T, N] lies that is not below this quantile of the other draws.

    In order, draws up to place `k` are below the quantile of the others, which lies between the places `k` and
    `k` + 2; those from `k` + 2 on are not; the one between them has to be looked at.
    """
    whole, part = divmod(probability * (len(draws) - 2), 1.0)
    k = int(whole)
    first, middle, last = np.partition(draws, (k, k + 1, k + 2), axis=0)[k : k + 3]
    of_others = (1.0 - part) * first + part * last
    return np.asarray(np.where(middle < of_others, middle, first))


def hold_together(windows: Sequence[Replicates]) -> list[Holding]:
    """Whether intervals hold in every window: no coverage, of any channel, lies below its band, and no error above.

    Errors are those of all samples, and the largest that lasts: a model without a slew is off for ten minutes, which
    coverage hardly notices. The bands are family-wise: of replicates drawn from the prediction 99% (`HELD`) have
    coverage and errors of all channels of all windows inside. A replicate counts by its most extreme value, and a value
    by the replicate's rank in it. Where channels are many, ranks alone cannot tell: of a thousand draws twenty are the
    lowest or highest in one of ten channels. These are told apart by their distance from the next one. Rows of all
    windows are taken for the same draws, as they are unless a simulation failed in some of the windows alone.

    A perfect model's channel leaves the region of 90 to 100% often. With noise that is correlated over 20 min
    (AR(1)), samples a minute apart, 95% intervals and four channels the band ends at about 64% in a window of two
    orbits of 95 min, and at about 82% in one of eight.
    """
    size = min(len(window.replicated) for window in windows)
    of_windows = [
        (replicates.replicated, replicates.replicated_error, replicates.replicated_lasting) for replicates in windows
    ]
    replicated = np.concatenate(
        [np.stack([part[:size] for part in of_window], axis=1) for of_window in of_windows], axis=2
    )
    known = np.isfinite(replicated).all(axis=0)
    ends = np.full((2, *known.shape), np.nan)
    ends[:, known] = _ends(replicated[:, known])
    ends[:, 0] = ends[:, 0].clip(0.0, 1.0)
    found, at = [], 0
    for window in windows:
        rows = slice(at, at := at + len(window.coverage))
        (lower, *_), (upper, most_error, most_lasting) = ends[:, :, rows]
        errors = window.error, most_error, window.lasting, _TAILS * most_lasting
        found.append(Holding(window.coverage, lower, upper, *errors))
    return found


def _ends(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lower and upper end [n] of the band that `HELD` of the rows of values [S, n] lie in with all columns."""
    if not values.shape[1]:
        return np.empty(0), np.empty(0)
    extremity = np.maximum(_extremity(values), _extremity(-values)).max(axis=1)
    allowed = float(np.quantile(extremity, HELD, method="higher"))
    return _lowest_allowed(values, allowed), -_lowest_allowed(-values, allowed)


def _extremity(values: FloatArray) -> FloatArray:
    """How low values [S, n] are in their columns: minus the logarithm of the share of values that are not higher.

    Below all others: the same with the exponential tail of the column's lowest twentieth.
    """
    size = len(values)
    ordered, scale = np.sort(values, axis=0), _tail(values)
    found = np.empty_like(values)
    for k, column in enumerate(values.T):
        rank = np.searchsorted(ordered[:, k], column, side="right")
        gap = (ordered[1, k] - ordered[0, k]) / scale[k]
        found[:, k] = np.where(rank == 1, gap, 0.0) - np.log(rank / size)
    return found


def _lowest_allowed(values: FloatArray, extremity: float) -> FloatArray:
    """The lowest value in each column of values [S, n] that is no more extreme than this, [n]; see `_extremity`."""
    ordered, beyond = np.sort(values, axis=0), extremity - np.log(len(values))
    if beyond > 0.0:
        return np.asarray(ordered[0] - beyond * _tail(values))
    # A rank of whole draws comes back from its logarithm with an error of rounding.
    return np.asarray(ordered[max(int(np.ceil(np.exp(-beyond) - 1e-9)), 1) - 1])


def _tail(values: FloatArray) -> FloatArray:
    """Mean distance of the lowest values [S, n] of each column from the quantile below which they lie, [n]."""
    start = np.quantile(values, _TAIL, axis=0)
    inside = values <= start
    return np.maximum(np.where(inside, start - values, 0.0).sum(axis=0) / inside.sum(axis=0), 1e-6)
