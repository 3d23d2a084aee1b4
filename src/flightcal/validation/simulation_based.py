"""Simulation-based calibration: do posteriors of telemetry that the model itself made cover what made it?

Where theta is drawn from the prior, telemetry from the likelihood and draws from the posterior, the rank of theta among
the draws is uniform for any function of theta and telemetry (Talts et al. 2018, arXiv:1804.06788). Posteriors that are
too narrow pile ranks up at both ends, too wide ones in the middle, biased ones at one end.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.stats import binom

from ..simulator import FloatArray

INTERVALS = (0.5, 0.8, 0.95)
"""Probabilities of the central intervals whose coverage is counted."""

BAND = 0.95
"""Probability that the ranks of a right machinery stay inside all bands together."""

MOST_DRAWS = 200
"""That a posterior is thinned to for its ranks."""

_TRIALS = 20_000
"""Of uniform ranks from which a band is found: 60 of them lie outside of the band of one in 15 quantities."""


@dataclass(frozen=True)
class Repeat:
    """What drawing theta [q] from the prior and calibrating the telemetry that it makes came to.

    Quantities are the entries of theta and functions of it.
    """

    truth: FloatArray
    """[q]"""
    rank: FloatArray
    """[q] share of the posterior below the truth, 0 to 1."""
    mean: FloatArray
    """[q] of the posterior."""
    deviation: FloatArray
    """[q]"""
    draws: int
    """Independent ones that the ranks are among."""
    gates: tuple[str, ...]
    """Names of the sampler's gates that failed."""
    redrawn: int
    """Draws of theta before this one that could not be simulated."""
    seconds: float


def ranks(truth: FloatArray, draws: FloatArray, effective: float, rng: np.random.Generator) -> tuple[FloatArray, int]:
    """Share of the posterior below the truth [q], and among how many draws, of draws [chain, draw, q].

    The chains are thinned to as many draws as are effective: those of a chain resemble each other, and ranks among them
    are not uniform (Talts et al., sec. 5.1). Draws that have the same value of a quantity, as sizes of heat are shared
    by several, count once. The rank k among L values becomes (k + U) / (L + 1), with U uniform, which is uniform
    whatever L.
    """
    chains, length, quantities = draws.shape
    each = int(np.clip(min(MOST_DRAWS, effective) / chains, 1, length))
    chosen = draws[:, np.linspace(0, length - 1, each).round().astype(int)].reshape(-1, quantities)
    values = [np.unique(column) for column in chosen.T]
    below = np.array([np.searchsorted(column, true) for column, true in zip(values, truth, strict=True)])
    count = np.array([len(value) for value in values])
    return (below + rng.random(quantities)) / (count + 1), len(chosen)


@dataclass(frozen=True)
class RankCheck:
    """Whether one quantity's ranks are uniform, and what the repeats say of it."""

    name: str
    inside: bool
    """Whether the distribution of the ranks stays in the band of all quantities together."""
    p_value: float
    """Of a distribution that strays as far at any point, for this quantity alone."""
    coverage: tuple[float, ...]
    """Share of the repeats in which each of `INTERVALS` covers the truth."""
    contraction: float
    """Median over the repeats of 1 - posterior variance / prior variance; NaN where there is no prior."""
    score: float
    """Root mean square of (posterior mean - truth) / posterior standard deviation: about 1."""


@dataclass(frozen=True)
class Band:
    """What the distribution function of uniform ranks stays in, at `points`."""

    points: FloatArray
    lower: FloatArray
    upper: FloatArray


def check_ranks(names: Sequence[str], repeats: Sequence[Repeat], prior_deviation: FloatArray) -> list[RankCheck]:
    """Each quantity's ranks against the band in which those of all quantities stay with probability `BAND`.

    prior_deviation: [q], NaN where a quantity has no prior.
    """
    rank = np.array([repeat.rank for repeat in repeats])
    mean = np.array([repeat.mean for repeat in repeats])
    deviation = np.array([repeat.deviation for repeat in repeats])
    error = mean - np.array([repeat.truth for repeat in repeats])
    band = ecdf_band(len(repeats), joint(BAND, len(names)))
    contraction = 1.0 - deviation**2 / prior_deviation**2
    return [
        RankCheck(
            name=name,
            inside=stays_inside(rank[:, q], band),
            p_value=p_value(rank[:, q]),
            coverage=tuple(float(np.mean(np.abs(rank[:, q] - 0.5) < 0.5 * share)) for share in INTERVALS),
            contraction=float(np.median(contraction[:, q])),
            score=float(np.sqrt(np.mean((error[:, q] / deviation[:, q]) ** 2))),
        )
        for q, name in enumerate(names)
    ]


def joint(probability: float, quantities: int) -> float:
    """Probability of each of several bands, so that all of them hold together (Bonferroni: however they depend)."""
    return 1.0 - (1.0 - probability) / quantities


def ecdf(values: FloatArray, points: FloatArray) -> FloatArray:
    """Share of the values at or below each point."""
    return np.searchsorted(np.sort(values), points, side="right") / len(values)


def ecdf_band(count: int, probability: float) -> Band:
    """Band in which the whole distribution function of `count` uniform values stays with `probability`.

    Säilynoja, Bürkner & Vehtari (2022), Statistics and Computing 32, sec. 2: binomial intervals at every point, wide
    enough for all points together, found by simulation.
    """
    from arviz_stats.ecdf_utils import get_pointwise_confidence_band

    points = np.arange(1, count) / count
    pointwise = 1.0 - 2.0 * float(np.quantile(_least_tails(count), 1.0 - probability))
    lower, upper = get_pointwise_confidence_band(pointwise, count, points)
    return Band(points, lower, upper)


def stays_inside(values: FloatArray, band: Band) -> bool:
    """Whether the values' distribution function stays in the band."""
    found = ecdf(values, band.points)
    return bool(np.all((band.lower <= found) & (found <= band.upper)))


def p_value(values: FloatArray) -> float:
    """Probability that uniform values stray as far as these at any point."""
    tails = _least_tails(len(values))
    found = _least_tail(np.asarray(values)[None])[0]
    return float((1 + np.count_nonzero(tails <= found * (1 + 1e-9))) / (1 + len(tails)))


@lru_cache(maxsize=8)
def _least_tails(count: int) -> FloatArray:
    """`_least_tail` of many sets of `count` uniform values."""
    rng = np.random.default_rng(20_220_401)
    return np.concatenate([_least_tail(rng.random((500, count))) for _ in range(_TRIALS // 500)])


def _least_tail(values: FloatArray) -> FloatArray:
    """Of sets [S, R]: the smaller binomial tail of the distribution function, at its worst point, [S]."""
    sets, count = values.shape
    # How many values lie between neighbouring points, then below each.
    places = np.floor(values * count).astype(int).clip(0, count - 1)
    counts = np.bincount((places + count * np.arange(sets)[:, None]).ravel(), minlength=sets * count)
    below = np.cumsum(counts.reshape(sets, count), axis=1)[:, :-1]
    least: FloatArray = _tails(count)[below, np.arange(count - 1)].min(axis=1)
    return least


@lru_cache(maxsize=8)
def _tails(count: int) -> FloatArray:
    """The smaller of the probabilities of at most and at least k of `count` values below k / count, [k, point]."""
    below, points = np.arange(count + 1)[:, None], np.arange(1, count) / count
    tails: FloatArray = np.minimum(binom.cdf(below, count, points), binom.sf(below - 1, count, points))
    return tails
