"""Initial temperatures of a window that the calibration has not seen.

They are not known, and not of interest: they are estimated from the window's first samples, which are then never
scored. Over so short a span temperatures are nearly linear in the initial ones, so each draw of the parameters gets a
Gaussian update of the prior of `initial_priors`: its mean for a point estimate, a draw from it for a posterior draw.
The update is iterated (Gauss-Newton), with a Jacobian at the median of the draws.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..problem import Window
from ..scenario import Normal
from ..simulator import FloatArray
from .errors import FirstErrors, WhiteErrors

_DIFFERENCE = 0.01  # K
_ITERATIONS = 3  # a heater that switches in the span bends what is linear otherwise


def condition_initial(
    first: Window,
    thetas: FloatArray,
    errors: FirstErrors | WhiteErrors,
    rng: np.random.Generator | None = None,
    heat: FloatArray | None = None,
) -> FloatArray:
    """Thetas [S, q] with their initial temperatures replaced by ones conditioned on the samples of `first`.

    first: the window cut to the window's first samples; errors: by which these may differ from the simulation, of
    each theta; rng: draw from the Gaussian (None: take its mean). A theta whose simulation fails keeps the prior mean;
    an external simulator may have none. heat: [S, h, 2 K] W that no block describes, of each theta.
    """
    positions = np.array([k for k, name in enumerate(first.names) if name.startswith("initial.")])
    if not len(positions):
        return thetas.copy()
    priors = [first.reads[first.names[k]] for k in positions]
    mean = np.array([prior.mean for prior in priors if isinstance(prior, Normal)])
    precision = np.array([prior.standard_deviation**-2.0 for prior in priors if isinstance(prior, Normal)])
    thetas = thetas.copy()
    thetas[:, positions] = mean
    valid = np.isfinite(first.observed)
    hessians = np.tile(np.diag(precision), (len(thetas), 1, 1))
    simulated_so_far = np.ones(len(thetas), bool)
    for _ in range(_ITERATIONS):
        jacobian = _jacobian(first, np.median(thetas, axis=0), positions)
        if jacobian is None:
            break
        columns = np.broadcast_to(np.where(valid[..., None], jacobian, 0.0), (len(thetas), *jacobian.shape))
        weighted = errors.whiten(columns).reshape(len(thetas), -1, len(positions))
        hessians = np.einsum("sti,stj->sij", weighted, weighted) + np.diag(precision)
        runs = first.simulate_many(thetas, heat)
        simulated = np.stack([np.full(valid.shape, np.nan) if run is None else run.temperatures for run in runs])
        residuals = errors.whiten(np.where(valid, first.observed - simulated - errors.mean, 0.0)[..., None])
        simulated_so_far &= np.array([run is not None for run in runs])
        for s, residual in enumerate(residuals.reshape(len(thetas), -1)):
            if not simulated_so_far[s]:
                thetas[s, positions] = mean
                continue
            gradient = weighted[s].T @ residual + precision * (mean - thetas[s, positions])
            thetas[s, positions] += np.linalg.solve(hessians[s], gradient)
    if rng is not None:
        for theta, hessian in zip(thetas, hessians, strict=True):
            factor = np.linalg.cholesky(hessian)
            theta[positions] += np.linalg.solve(factor.T, rng.standard_normal(len(positions)))
    return thetas


def _jacobian(first: Window, theta: FloatArray, positions: NDArray[np.intp]) -> FloatArray | None:
    """d temperatures / d initial temperatures at theta [q], [T, N, n]; None where a simulation fails."""
    shifts = np.zeros((len(positions), len(theta)))
    shifts[np.arange(len(positions)), positions] = _DIFFERENCE
    runs = first.simulate_many(np.concatenate([theta + shifts, theta - shifts]))
    if any(run is None for run in runs):
        return None
    temperatures = np.stack([run.temperatures for run in runs if run is not None])
    above, below = np.split(temperatures, 2)
    jacobian: FloatArray = np.moveaxis((above - below) / (2 * _DIFFERENCE), 0, -1)
    return jacobian
