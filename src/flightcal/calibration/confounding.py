"""How far parameters and discrepancy stand in for each other in a posterior."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray

from ..probability import weights_given
from ..problem import Problem
from ..simulator import FloatArray, SimulationFailure, Trajectory

_TAIL = 0.025


def discrepancy_given(problem: Problem, thetas: FloatArray, runs: Sequence[Trajectory | None]) -> FloatArray:
    """Discrepancy [S, T, N], K, expected with the residuals of each theta [S, d]; NaN where its simulation failed."""
    model = problem.residuals
    expected = np.full((len(thetas), *problem.observed.shape), np.nan)
    for s, run in enumerate(runs):
        if run is not None:
            numbers = problem.numbers(thetas[s])
            weights, _ = weights_given(model.terms, problem.observed, run.temperatures, numbers)
            expected[s] = model.terms.shapes.basis @ weights.T
    return expected


def confounding(problem: Problem, thetas: FloatArray, runs: Sequence[Trajectory | None]) -> xarray.Dataset | None:
    """What the discrepancy is on the problem's window, and its correlation with each parameter; None: there is none.

    thetas: posterior draws [S, d], and their simulations. correlation [parameter]: over the draws, of parameter i with
    how much of the discrepancy lies in the direction in which it moves the temperatures, <J_i, delta>: J_i is the
    derivative of the simulated temperatures at the draws' mean, and the product is over valid samples in standard
    deviations of their noise. Near -1 the data tell the sum of the two and not the parameter: what the one gives, the
    other takes. mean, lower and upper [time, channel], K: of the expected discrepancy over the draws.
    """
    if not problem.residuals.terms.discrepant.any():
        return None
    expected = discrepancy_given(problem, thetas, runs)
    kept = np.isfinite(expected).all(axis=(1, 2))
    expected, thetas = expected[kept], thetas[kept]
    simulated = problem.simulated
    centre = thetas.mean(axis=0)
    try:
        jacobian = problem.jacobian(problem.to_z(centre))[..., simulated]
    except SimulationFailure:
        return None
    scale = np.where(problem.valid, 1.0 / problem.noise(centre) ** 2, 0.0)
    along = np.einsum("tni,tn,stn->si", jacobian, scale, expected, optimize=True)
    values = thetas[:, simulated]
    with np.errstate(invalid="ignore", divide="ignore"):
        centred = [part - part.mean(axis=0) for part in (along, values)]
        correlation = (centred[0] * centred[1]).mean(axis=0) / (along.std(axis=0) * values.std(axis=0))
    lower, upper = np.quantile(expected, [_TAIL, 1.0 - _TAIL], axis=0)
    by_sample = ("time", "channel")
    return xarray.Dataset(
        {
            "correlation": ("parameter", correlation),
            "mean": (by_sample, expected.mean(axis=0)),
            "lower": (by_sample, lower),
            "upper": (by_sample, upper),
        },
        coords={
            "parameter": [problem.names[k] for k in simulated],
            "time": problem.times,
            "channel": list(problem.simulator.channels),
        },
    )
