"""How well a model of the residuals predicts a stretch of the training window from the rest of it.

Leaving out single samples of a series says little: their neighbours know them. So whole blocks are left out, each
predicted from all others: log p(y_b | y_-b) under the posterior without the block, by Pareto-smoothed importance
sampling (Vehtari, Gelman & Gabry 2017, Statistics and Computing 27, 1413-1432; blocks: Roberts et al. 2017, Ecography
40, 913-929).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..simulator import FloatArray

if TYPE_CHECKING:
    from ..problem import Window

_BLOCKS_PER_ORBIT = 4

UNRELIABLE = 0.7
"""Pareto k above which leaving a block out changes the posterior too much for its draws to say how."""


@dataclass(frozen=True)
class BlockLoo:
    """Expected log predictive density of the left-out blocks."""

    density: float
    """Summed over the blocks, nats."""
    of_blocks: FloatArray
    """[B]"""
    pareto_k: FloatArray
    """[B]"""

    @property
    def unreliable(self) -> int:
        """Blocks whose density cannot be relied on."""
        return int((self.pareto_k > UNRELIABLE).sum())


def blocks_of(times: NDArray[np.datetime64], period: float) -> NDArray[np.int64]:
    """Number of the block of each sample [T]: equal parts of an orbit of `period` s, from the first sample on."""
    elapsed = (times - times[0]) / np.timedelta64(1, "ns") * 1e-9
    part = np.floor(elapsed * _BLOCKS_PER_ORBIT / period).astype(np.int64)
    # A part of which there is next to nothing belongs to the one before.
    last = part == part[-1]
    if last.sum() < 0.5 * np.median(np.bincount(part)):
        part[last] -= 1
    return np.asarray(np.unique(part, return_inverse=True)[1], np.int64)


def block_log_likelihood(window: Window, thetas: FloatArray, blocks: NDArray[np.int64]) -> FloatArray:
    """log p(y_b | y_-b, theta) of the temperatures of each block at thetas [S, q]: [S, B]; NaN where one fails.

    Blocks [B] are those with a valid sample: the others say nothing of any model.

    It is log p(y | theta) - log p(y_-b | theta), the likelihood of all samples less that of all others.
    """
    whole = window.of_temperatures(np.ones((len(blocks), 1), bool))
    others = [window.of_temperatures((blocks != b)[:, None]) for b in np.unique(blocks[window.valid.any(axis=1)])]
    found = np.full((len(thetas), len(others)), np.nan)
    for s, (theta, run) in enumerate(zip(thetas, window.simulate_many(thetas), strict=True)):
        if run is not None:
            value = whole.of_residuals(theta, run)
            found[s] = [value - part.of_residuals(theta, run) for part in others]
    return found


def leave_blocks_out(log_likelihood: FloatArray) -> BlockLoo:
    """log_likelihood: [S, B] as of `block_log_likelihood`, of draws of the whole posterior."""
    from arviz_stats.base import array_stats

    kept = log_likelihood[np.isfinite(log_likelihood).all(axis=1)]
    # One chain: the draws come shuffled.
    density, pareto_k, _ = array_stats.loo(kept.T[:, None, :], chain_axis=-2, draw_axis=-1)
    return BlockLoo(float(density.sum()), np.asarray(density, float), np.asarray(pareto_k, float))
