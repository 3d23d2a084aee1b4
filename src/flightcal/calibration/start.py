"""Where noise and discrepancy start: fitted to the residuals of a simulation that is held."""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize

from ..problem import Problem
from ..simulator import FloatArray, SimulationFailure
from ..telemetry import quiet_noise

_LEAST = 1e-3  # K
_STEPS = 200
_SMALL = 0.1
"""Of a discrepancy to start with, over the residuals: so that one that is not there is found not to be."""


def fit_residuals(problem: Problem, z: FloatArray) -> FloatArray:
    """z [d] with the entries of noise and discrepancy at their best for the residuals there.

    From two starts: residuals that are nearly all noise, and residuals that are nearly all discrepancy.
    """
    positions = np.unique(problem.places[2])
    theta = problem.to_theta(z)
    try:
        runs = problem.simulate(theta)
    except SimulationFailure:
        return z
    if not len(positions):
        return z
    residual = problem.residual(runs)

    def cost(part: FloatArray) -> tuple[float, FloatArray]:
        whole = z.copy()
        whole[positions] = part
        prior = problem.priors.at(whole)
        value, theta_bar = problem.likelihood_of_numbers(runs, prior.theta)
        gradient = prior.gradient + prior.slope * theta_bar
        return -float(prior.log_density) - value, -gradient[positions]

    best, lowest = z, np.inf
    for share in (_SMALL, 1.0):
        start = problem.to_z(_guess(problem, theta, residual, share))[positions]
        found = minimize(cost, start, jac=True, method="L-BFGS-B", options={"maxiter": _STEPS})
        if found.fun < lowest:
            best, lowest = z.copy(), found.fun
            best[positions] = found.x
    return best


def _guess(problem: Problem, theta: FloatArray, residual: FloatArray, share: float) -> FloatArray:
    """theta [d] with sizes of noise and discrepancy from residuals [T, N]; share: of the discrepancy in them."""
    theta = theta.copy()
    median = problem.priors.median()
    rmse = np.sqrt(np.nanmean(residual**2, axis=0))
    channels, _, positions = problem.places
    sizes = np.array([entry.size for entry in problem.windows[0].residuals.entries])
    for position in np.unique(positions):
        theta[position] = median[position]
        of_it = channels[positions == position]
        kind = sizes[positions == position][0]
        size = max(float(np.exp(np.log(np.maximum(rmse[of_it], _LEAST)).mean())), _LEAST)
        white = max(float(np.mean([quiet_noise(residual[:, k]) for k in of_it])), _LEAST)
        explained = problem.windows[0].residuals.terms.discrepant[of_it].all()
        if kind == "noise":
            theta[position] = white if explained and share == 1.0 else size
        elif kind == "white":
            theta[position] = white
        elif kind == "discrepancy":
            theta[position] = share * size
    return theta
