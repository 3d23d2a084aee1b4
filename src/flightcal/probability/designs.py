"""Designs: at which thetas [S, d] a campaign runs the simulator.

Every design is a function of its seed. Those in `GROWING` are sequences: the first S thetas of a longer one are the
S of a shorter one, so that a campaign can be grown.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import xarray
from scipy.stats import qmc

from ..errors import RunError
from ..simulator import FloatArray
from .priors import Priors

KINDS: Final = ("sobol", "latin-hypercube", "prior", "posterior")
GROWING: Final = ("sobol", "prior", "posterior")


def sobol(priors: Priors, runs: int, seed: int, *, share: float = 1.0) -> FloatArray:
    """Scrambled Sobol points [S, d] through the priors' quantiles. A power of two of them fills the space best.

    share: the middle part of each prior that they go through.
    Owen (1998), Scrambling Sobol' and Niederreiter-Xing points, J. Complexity 14, 466-489.
    """
    engine = qmc.Sobol(len(priors.names), seed=np.random.default_rng(seed))
    points = engine.random_base2(max(runs - 1, 1).bit_length())[:runs]
    return priors.quantile(0.5 + (points - 0.5) * share)


def latin_hypercube(priors: Priors, runs: int, seed: int) -> FloatArray:
    """A Latin hypercube [S, d] through the priors' quantiles: a point in each of S equally likely slices of each axis.

    McKay, Beckman & Conover (1979), Technometrics 21, 239-245. It cannot be grown.
    """
    return priors.quantile(qmc.LatinHypercube(len(priors.names), seed=np.random.default_rng(seed)).random(runs))


def prior_draws(priors: Priors, runs: int, seed: int) -> FloatArray:
    """Independent draws [S, d] from the priors."""
    return priors.sample(np.random.default_rng(seed), runs)


def around_posterior(
    priors: Priors, posterior: xarray.Dataset, runs: int, seed: int, *, spread: float = 1.0
) -> FloatArray:
    """Posterior draws [S, d], no draw twice, their distance from the posterior's mean scaled by `spread`.

    posterior: the group of that name in a run's posterior.nc, a variable [chain, draw] for each parameter; parameters
    that it lacks (initial temperatures of another window) are drawn from their priors. The scaling is done in the
    unconstrained coordinates, so that no theta leaves its prior's support.
    Raises RunError where the posterior has none of the parameters, or fewer draws than runs.
    """
    known = [name in posterior for name in priors.names]
    if not any(known):
        raise RunError(
            f"found a posterior of {', '.join(map(str, posterior.data_vars))}, "
            f"expected one of {', '.join(priors.names)}"
        )
    available = posterior.sizes["chain"] * posterior.sizes["draw"]
    if runs > available:
        raise RunError(f"found {available} posterior draws, expected at least {runs}, one a run")
    choosing, filling = np.random.default_rng(seed).spawn(2)
    # Drawn for all draws, so that the first S do not depend on S.
    theta = priors.sample(filling, available)
    for k in np.flatnonzero(known):
        theta[:, k] = posterior[priors.names[k]].values.ravel()
    if spread != 1.0:
        z = priors.to_z(theta)
        centre = np.where(known, z.mean(axis=0), 0.0)
        theta = np.where(known, priors.to_theta(centre + spread * (z - centre)), theta)
    return theta[choosing.permutation(available)[:runs]]
