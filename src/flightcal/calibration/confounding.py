"""How far parameters and discrepancy stand in for each other in a posterior."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray

from ..problem import Problem, Runs
from ..run import labelled
from ..simulator import FloatArray, SimulationFailure

_TAIL = 0.025
_LABELS = {
    "correlation": ("1", "correlation of the discrepancy with what the parameter does"),
    "mean": ("K", "mean of the discrepancy"),
    "lower": ("K", "lower end of the discrepancy's interval"),
    "upper": ("K", "upper end of the discrepancy's interval"),
}


def discrepancy_given(problem: Problem, thetas: FloatArray, runs: Sequence[Runs | None]) -> FloatArray:
    """Discrepancy [S, T, N], K, expected with the residuals of each theta [S, d]; NaN where its simulation failed."""
    inside = [problem.at(window, thetas) for window in problem.windows]
    samples = sum(len(window.times) for window in problem.windows)
    expected = np.full((len(thetas), samples, len(problem.channels)), np.nan)
    for s, of_theta in enumerate(runs):
        if of_theta is not None:
            weights = problem.weights(of_theta, [of_window[s] for of_window in inside])
            bases = [window.residuals.terms.shapes.basis for window in problem.windows]
            parts = [basis @ mean.T for basis, (mean, _) in zip(bases, weights, strict=True)]
            expected[s] = np.concatenate(parts)
    return expected


def confounding(problem: Problem, thetas: FloatArray, runs: Sequence[Runs | None]) -> xarray.Dataset | None:
    """What the discrepancy is on the windows, and its correlation with each parameter; None: there is none.

    thetas: posterior draws [S, d], and their simulations. correlation [parameter]: over the draws, of parameter i with
    how much of the discrepancy lies in the direction in which it moves the temperatures, <J_i, delta>: J_i is the
    derivative of the simulated temperatures at the draws' mean, and the product is over valid samples in standard
    deviations of their noise. Near -1 the data tell the sum of the two and not the parameter: what the one gives, the
    other takes. mean, lower and upper [time, channel], K: of the expected discrepancy over the draws.
    """
    if not any(window.residuals.terms.discrepant.any() for window in problem.windows):
        return None
    expected = discrepancy_given(problem, thetas, runs)
    kept = np.isfinite(expected).all(axis=(1, 2))
    expected, thetas = expected[kept], thetas[kept]
    simulated = problem.simulated
    centre = thetas.mean(axis=0)
    try:
        jacobian = np.concatenate(problem.jacobians(problem.to_z(centre)))[..., simulated]
    except SimulationFailure:
        return None
    weights = []
    for window in problem.windows:
        noise = window.noise(problem.at(window, centre))
        weights.append(np.where(window.valid, 1.0 / noise**2, 0.0))
    along = np.einsum("tni,tn,stn->si", jacobian, np.concatenate(weights), expected, optimize=True)
    values = thetas[:, simulated]
    with np.errstate(invalid="ignore", divide="ignore"):
        centred = [part - part.mean(axis=0) for part in (along, values)]
        correlation = (centred[0] * centred[1]).mean(axis=0) / (along.std(axis=0) * values.std(axis=0))
    lower, upper = np.quantile(expected, [_TAIL, 1.0 - _TAIL], axis=0)
    by_sample = ("time", "channel")
    found = xarray.Dataset(
        {
            "correlation": ("parameter", correlation),
            "mean": (by_sample, expected.mean(axis=0)),
            "lower": (by_sample, lower),
            "upper": (by_sample, upper),
        },
        coords={
            "parameter": [problem.names[k] for k in simulated],
            "time": np.concatenate([window.times for window in problem.windows]),
            "channel": list(problem.channels),
        },
    )
    return labelled(found, _LABELS)
