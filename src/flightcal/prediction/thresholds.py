"""By how much thermostats truly switch off their thresholds, as measured switches show: draw by draw of a posterior.

Thresholds that are parameters are those of each draw already, and only scatter around them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp
from scipy.stats import norm

from ..problem import SCATTERS, Passages, Window, log_prior_of_scatter, passages
from ..simulator import FloatArray

_PRIOR = 0.5
"""K, deviation of a threshold from that of its draw of theta, as the prior has it;"""
_CHANGED, _CHANGE = 0.02, 4.0
"""chance that it was changed on board and nobody wrote so, and K, deviation of such a change."""
_OFFSETS = np.linspace(-1.5, 1.5, 76)
"""K, that are looked at closely,"""
_CENTRES = np.linspace(-10.0, 10.0, 81)
"""around the likeliest of these, where that is beyond them."""
_FEW = 50
"""Draws of which the likeliest is found."""


@dataclass(frozen=True)
class Thresholds:
    """By how much thresholds are off those of S draws of theta, K: to go on, and to go off."""

    offsets: FloatArray
    """[S, 2, H]"""
    scatter: FloatArray
    """[S, 2, H] standard deviation from switch to switch."""

    @property
    def told(self) -> tuple[FloatArray, FloatArray]:
        """[2, H] mean offsets, and how far off zero on that side 95% of them are at least.

        Where a sensor changes by kelvins between two samples, nobody knows at which temperature its heater switches.
        """
        mean, (low, high) = self.offsets.mean(axis=0), np.quantile(self.offsets, (0.05, 0.95), axis=0)
        return mean, np.where(mean > 0.0, np.maximum(low, 0.0), np.minimum(high, 0.0))


def draw_thresholds(
    windows: tuple[Window, ...],
    thetas: list[FloatArray],
    heats: list[FloatArray],
    shifts: list[FloatArray],
    rng: np.random.Generator,
) -> Thresholds | None:
    """Thresholds given measured switches, one draw for each of S draws of theta [S, q] and heat [S, h, 2 K] of windows.

    shifts: [S, E] s by which each switch of a window's `switching` made a heater's time on longer than midway does.
    None: heaters are not driven by their measured status, or there are none.
    """
    first = windows[0]
    heaters = first.simulator.heaters
    if not heaters or any(window.switching is None for window in windows):
        return None
    uncertain = first.scenario.uncertain
    written = [[f"heaters.{name}.{side}" not in uncertain for name in heaters] for side in ("on_below", "off_above")]
    counted = np.array(written, float)[..., None]
    seen = [
        (
            np.stack([window.network.thresholds(numbers) for numbers in theta[:, window.simulated]]),
            passages(window, theta, heat, shift),
        )
        for window, theta, heat, shift in zip(windows, thetas, heats, shifts, strict=True)
    ]
    of_scatter = log_prior_of_scatter(first, np.median(thetas[0], axis=0))[:, None, None, :]
    offsets = counted * (_OFFSETS + _centres(seen, counted, of_scatter))
    logs = _logs(seen, offsets, of_scatter)
    chances = np.exp(logs - logs.max(axis=(3, 4), keepdims=True)).reshape(*logs.shape[:3], -1)
    bounds = np.cumsum(chances, axis=3)
    chosen = (bounds < rng.random((*bounds.shape[:3], 1)) * bounds[..., -1:]).sum(axis=3)
    place, which = np.divmod(chosen, len(SCATTERS))
    drawn = np.take_along_axis(offsets[:, :, None], place[..., None], axis=3)[..., 0]
    drawn += (offsets[..., 1] - offsets[..., 0])[..., None] * (rng.random(place.shape) - 0.5)
    return Thresholds(np.moveaxis(drawn, 2, 0), np.moveaxis(SCATTERS[which], 2, 0))


def _centres(
    seen: Sequence[tuple[FloatArray, list[Passages]]], counted: FloatArray, of_scatter: FloatArray
) -> FloatArray:
    """[2, H, 1] K around which offsets are looked at closely: 0, or what is likeliest where that is far off."""
    rows = np.arange(min(_FEW, len(seen[0][0])))
    few = [(thresholds[rows], [found.of(rows) for found in of_heaters]) for thresholds, of_heaters in seen]
    logs = _logs(few, counted * _CENTRES, of_scatter)
    likeliest = _CENTRES[logsumexp(logs, axis=(2, 4)).argmax(axis=2)]
    return np.where(np.abs(likeliest) > _OFFSETS[-1], likeliest, 0.0)[..., None]


def _logs(seen: Sequence[tuple[FloatArray, list[Passages]]], offsets: FloatArray, of_scatter: FloatArray) -> FloatArray:
    """Log posterior density [2, H, S, o, c] of offsets [2, H, o] and `SCATTERS`, whose log prior is [H, 1, 1, c].

    seen: of each window thresholds [S, 2, H] K, and passages of each heater.
    """
    logs = np.zeros((*offsets.shape[:2], len(seen[0][0]), offsets.shape[2], len(SCATTERS)))
    for thresholds, of_heaters in seen:
        for heater, found in enumerate(of_heaters):
            for side in (0, 1):
                threshold = thresholds[:, slice(None) if found.cycles else [side], heater].mean(axis=1)
                at = threshold[:, None] + offsets[side, heater]
                logs[side, heater] += found.log_likelihood(side, at) + found.log_of_middle(at)[..., None]
    usual, changed = (norm.logpdf(offsets, scale=scale) for scale in (_PRIOR, _CHANGE))
    prior = np.logaddexp(np.log(1.0 - _CHANGED) + usual, np.log(_CHANGED) + changed)
    return logs + prior[:, :, None, :, None] + of_scatter


def scattered(thresholds: Thresholds, switches: int, rng: np.random.Generator | None) -> FloatArray:
    """What is added to thresholds at each switch, [S, E, 2, H] K; rng: None: no scatter."""
    offsets = thresholds.offsets[:, None]
    if rng is None:
        return offsets
    drawn = rng.standard_normal((len(thresholds.offsets), switches, *thresholds.offsets.shape[1:]))
    return np.asarray(offsets + thresholds.scatter[:, None] * drawn)
