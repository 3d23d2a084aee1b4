"""Whether temperatures respond to unmodelled heat as linearly as a calibration takes them to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..problem import Problem, exact_heat
from ..simulator import FloatArray


@dataclass(frozen=True)
class HeatCheck:
    """How well temperatures respond to heat as they were taken to: posterior draws simulated with their own heat."""

    draws: int
    pareto_k: float
    """Of the weights that draws get for what they were taken to be (Vehtari et al. 2024); above 0.7: too far off."""
    difference: float
    """K, root mean square of simulated minus linear temperatures."""
    relative: float
    """The same of the worst channel, over the deviation of its noise."""
    weights: FloatArray
    """[draws, m] of the heat of each."""


def check_heat(problem: Problem, thetas: FloatArray, rng: np.random.Generator) -> HeatCheck:
    """Simulate draws [S, d] of a problem with heat, each with weights of heat that are drawn given the telemetry."""
    from arviz_stats.base import array_stats

    assert problem.heat is not None
    found = problem.simulate_many(thetas)
    done = [runs for runs in found if runs is not None]
    if len(done) < max(1, len(thetas) // 2):
        return HeatCheck(len(done), np.inf, np.inf, np.inf, np.empty((0, len(problem.heat.centre))))
    kept = thetas[[runs is not None for runs in found]]
    exact = exact_heat(problem, done, kept, rng)
    deviations, _ = problem.heat_sizes(kept)
    ratios, squares, relative, first = np.zeros(len(kept)), [], 0.0, 0
    for window, whitens, of_exact, of_linear in zip(
        problem.windows, problem.weighed.filters, exact.temperatures, exact.linear, strict=True
    ):
        precision = deviations[:, first : first + len(window.residuals.terms.kinds)] ** -2.0
        first += precision.shape[1]
        off = np.nanmean((of_exact - of_linear) ** 2, axis=(0, 1))
        squares.append(off.mean())
        inside = problem.at(window, np.median(kept, axis=0))
        relative = max(relative, float(np.sqrt((off / window.noise(inside) ** 2).max())))
        for sign, simulated in ((-0.5, of_exact), (0.5, of_linear)):
            left = np.where(window.valid, window.observed - simulated, 0.0)
            white = whitens.whiten(left.transpose(2, 1, 0), window.terms.valid)
            ratios += sign * np.einsum("sk,kts->s", precision, white**2)
    ratios = ratios[np.isfinite(ratios)]
    if len(ratios) < max(1, len(thetas) // 2):
        return HeatCheck(len(ratios), np.inf, np.inf, np.inf, exact.weights)
    # Where nearly all of the weight is one draw's there is no tail to fit, and k is no number.
    with np.errstate(divide="ignore", invalid="ignore"):
        _, pareto_k = array_stats.psislw(ratios - ratios.max())
    difference = float(np.sqrt(np.mean(squares)))
    return HeatCheck(len(ratios), float(pareto_k), difference, relative, exact.weights)
