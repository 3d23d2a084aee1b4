"""What the telemetry tells of each parameter and of their combinations: the Fisher information against the prior.

On the priors' unconstrained scale, in units of the priors' standard deviations, the information matrix F has
eigenvalues that say how many times the data count for more than the prior in each direction; a direction's width
shrinks by 1 / sqrt(1 + eigenvalue). Raue et al. (2009), Bioinformatics 25, 1923; Cui et al. (2014), Inverse Problems
30, 114015 (likelihood-informed subspace: the prior-preconditioned Hessian).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr

from ..problem import Problem
from ..simulator import FloatArray

UNTOLD = 1.0
"""Information below which the prior counts for more than the data."""
BLIND = 0.1
"""Information below which the data say next to nothing: the posterior is at least 95% as wide as the prior."""
CORRELATED = 0.95
_MEMBER = 0.2
"""Weight, of the largest, from which a parameter is a member of a combination."""
_NOTHING, _SPREAD = 1e-3, 3.0
"""Information below which the data say nothing, and the factor within which eigenvalues are taken as equal."""
_EQUAL = 0.1
"""Relative difference below which two exponents are equal."""


@dataclass(frozen=True)
class Move:
    """A parameter's share in a move that the telemetry hardly notices."""

    name: str
    before: float
    """SI."""
    after: float
    exponent: float
    """d log theta along the move, where theta is positive; NaN elsewhere."""

    @property
    def change(self) -> float:
        """Relative change; NaN where that has no meaning."""
        return self.after / self.before - 1.0 if np.isfinite(self.exponent) and self.before > 0.0 else float("nan")


@dataclass(frozen=True)
class Combination:
    """One or more parameters that can be moved together without the telemetry telling."""

    moves: tuple[Move, ...]
    information: float
    kind: str
    """alone, product (known, the factors not), ratio (known), scale (all known up to a factor), mixed"""

    @property
    def names(self) -> tuple[str, ...]:
        """Of the parameters."""
        return tuple(move.name for move in self.moves)

    @property
    def width(self) -> float:
        """Of the posterior along the move, as a share of the prior's."""
        return float(1.0 / np.sqrt(1.0 + self.information))


@dataclass(frozen=True)
class Identifiability:
    """The information spectrum and what follows from it; d entries of theta."""

    names: tuple[str, ...]
    information: FloatArray
    """[d] eigenvalues, least first."""
    directions: FloatArray
    """[d, d] a direction in each column, in standard deviations of the priors."""
    width: FloatArray
    """[d] of each parameter's posterior, as a share of its prior's."""
    known_alone: FloatArray
    """[d] the same if all others were known."""
    correlation: FloatArray
    """[d, d] of the posterior."""
    combinations: tuple[Combination, ...]
    """That the data cannot tell, the least known first."""
    correlated: tuple[tuple[str, str, float], ...]
    """Pairs with a correlation beyond 0.95, the strongest first."""


def identifiability(problem: Problem, z: FloatArray, hessian: FloatArray) -> Identifiability:
    """The spectrum at z [d], with the Gauss-Newton Hessian [d, d] there (the prior's share included)."""
    spread = problem.priors.spread()
    information = (hessian - np.diag(problem.priors.precision(z))) * np.outer(spread, spread)
    eigenvalues, directions = np.linalg.eigh(0.5 * (information + information.T))
    eigenvalues = np.maximum(eigenvalues, 0.0)
    covariance = (directions / (1.0 + eigenvalues)) @ directions.T
    width = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(width, width)
    found = [
        _combination(problem, z, spread * u, float(u @ information @ u))
        for group in _alike(eigenvalues[eigenvalues < UNTOLD])
        for u in sparse_basis(directions[:, group]).T
    ]
    rows, columns = np.nonzero(np.triu(np.abs(correlation) > CORRELATED, 1))
    pairs = [(problem.names[i], problem.names[j], float(correlation[i, j])) for i, j in zip(rows, columns, strict=True)]
    return Identifiability(
        names=problem.names,
        information=eigenvalues,
        directions=directions,
        width=width,
        known_alone=1.0 / np.sqrt(1.0 + np.diag(information)),
        correlation=correlation,
        combinations=tuple(sorted(found, key=lambda item: item.information)),
        correlated=tuple(sorted(pairs, key=lambda pair: -abs(pair[2]))),
    )


def _alike(eigenvalues: FloatArray) -> list[slice]:
    """Stretches of ascending eigenvalues that are equal for practical purposes."""
    groups: list[slice] = []
    for k, value in enumerate(eigenvalues):
        if groups and value <= max(_NOTHING, _SPREAD * eigenvalues[groups[-1].start]):
            groups[-1] = slice(groups[-1].start, k + 1)
        else:
            groups.append(slice(k, k + 1))
    return groups


def sparse_basis(space: FloatArray) -> FloatArray:
    """Unit vectors [d, k] that span the same space as the columns [d, k], of few parameters each.

    Eigenvectors of equal eigenvalues are any mixture of one another; here each vector has a parameter of its own
    that none of the others has.
    """
    count = space.shape[1]
    if count == 0:
        return space
    _, _, order = qr(space.T, mode="economic", pivoting=True)
    basis = space @ np.linalg.inv(space[order[:count]])
    scaled: FloatArray = basis / np.linalg.norm(basis, axis=0)
    return scaled


def _combination(problem: Problem, z: FloatArray, move: FloatArray, information: float) -> Combination:
    """What a move [d] of z by one standard deviation of the prior does to the parameters, in their own units."""
    information = max(information, 0.0)
    size = 1.0 / np.sqrt(1.0 + information)
    weights = move / problem.priors.spread()
    terms = problem.priors.at(z)
    after = problem.to_theta(z + size * move)
    lower, _ = problem.priors.bounds(1.0 - 1e-9)
    members = np.flatnonzero(np.abs(weights) >= _MEMBER * np.abs(weights).max())
    members = members[np.argsort(-np.abs(weights[members]), kind="stable")]
    moves = tuple(
        Move(
            problem.names[k],
            float(terms.theta[k]),
            float(after[k]),
            float(terms.slope[k] * move[k] / terms.theta[k])
            if lower[k] >= 0.0 and not problem.names[k].startswith("initial.")
            else np.nan,
        )
        for k in members
    )
    return Combination(moves, information, _kind(np.array([move.exponent for move in moves])))


def _kind(exponents: FloatArray) -> str:
    if len(exponents) == 1:
        return "alone"
    sizes = np.abs(exponents)
    if not np.isfinite(sizes).all() or sizes.max() - sizes.min() > _EQUAL * sizes.max():
        return "mixed"
    if len(exponents) == 2:
        return "product" if exponents.prod() < 0.0 else "ratio"
    return "scale" if (exponents > 0.0).all() or (exponents < 0.0).all() else "mixed"
