"""Coordinates in which what telemetry ties together lies on straight lines, where a prior has bounds.

Temperatures are nearly linear in an absorptivity, but near a bound of its prior z runs off to infinity while theta
stays. A conductance that telemetry ties to it then stays too: in z their line is bent, and where it is thin no step of
a sampler follows it. Here the conductance's z is moved by what the bend amounts to, so that the line is straight. Each
coordinate is moved by others alone, and in a fixed order, so volumes stay what they are, and so does the log density.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..compiled import Row
from .kernels.priors import NDTRI
from .kernels.straight import StraightCall, straight_backward, straight_forward
from .priors import Array, Priors

_AROUND = 2.0
"""Deviations from the centre at which it is looked at how bent a coordinate is."""
_SLIGHT = 0.05
"""So little off there, in deviations, it is straight enough."""


@dataclass(frozen=True)
class Straight:
    """Coordinates y [d] that equal z at a centre, to first order around it too."""

    priors: Priors
    centre: Array
    """[d] z"""
    order: NDArray[np.int64]
    """[d] places of z: first those of bounded priors, of which each moves all that follow."""
    slopes: Array
    """[d, p] dz_i / dy_k where k is one of the p bounded ones and comes before i, as telemetry ties them; else 0."""

    @property
    def bounded(self) -> NDArray[np.int64]:
        """[p] places."""
        return self.order[: self.slopes.shape[1]]

    def to_z(self, y: Array) -> Array:
        """z [..., d] of y [..., d]."""
        z = np.array(y, float).reshape(-1, len(self.order))
        self.rows(z, np.empty_like(z))[0]()
        return z.reshape(np.shape(y))

    def to_y(self, z: Array) -> Array:
        """y [..., d] of z [..., d]."""
        return np.asarray(z - self._bends(z)[0] @ self.slopes.T)

    def pull_back(self, z: Array, z_bar: Array) -> Array:
        """Derivatives [d] by y of those by z, at z [d]."""
        found = np.array(z_bar, float)[None]
        straight_backward.row(self._call(z[None], found, self._bends(z[None])[1]))()
        return found[0]

    def rows(self, z: Array, z_bar: Array) -> tuple[Row, Row]:
        """Of a Program: forward, from y to z in its place [S, d]; backward, from the derivative by z to that by y."""
        call = self._call(z, z_bar, np.empty((len(z), self.slopes.shape[1])))
        return straight_forward.row(call), straight_backward.row(call)

    def _call(self, z: Array, z_bar: Array, rates: Array) -> StraightCall:
        bounded = self.bounded
        kinds, arguments = self.priors.kinds[bounded], self.priors.arguments[bounded]
        return StraightCall(
            self.order, self.slopes, kinds, arguments, NDTRI, self._centre, z, np.empty_like(rates), rates, z_bar
        )

    @cached_property
    def _centre(self) -> Array:
        """[p, 3] z, theta and its slope."""
        found = self.priors.at(self.centre)
        return np.stack([self.centre, found.theta, found.slope], axis=1)[self.bounded]

    def _bends(self, z: Array) -> tuple[Array, Array]:
        """How far the bounded ones are from straight [..., p], and the derivative, at z [..., d]."""
        found, bounded = self.priors.at(z), self.bounded
        z_0, theta_0, slope_0 = self._centre.T
        bends = (found.theta[..., bounded] - theta_0) / slope_0 - (np.asarray(z)[..., bounded] - z_0)
        return bends, found.slope[..., bounded] / slope_0 - 1.0


def straight(priors: Priors, centre: Array, covariance: Array) -> Straight | None:
    """Coordinates that are straight where z is N(centre [d], covariance [d, d]) nearby; None: z itself is.

    The most bent come first: each is straight for all that follow.
    """
    bounded, deviations = priors.bounded, np.sqrt(np.diag(covariance))
    plain = Straight(priors, centre, bounded, np.zeros((len(centre), len(bounded))))
    ends = centre + _AROUND * np.multiply.outer([-1.0, 1.0], deviations)
    with np.errstate(divide="ignore", invalid="ignore"):
        off = np.abs(plain._bends(ends)[0]).max(axis=0) / deviations[bounded]
    # On a bound itself theta does not move at all.
    off = np.where(np.isfinite(off), off, 0.0)
    bounded = bounded[np.argsort(-off, kind="stable")][: int((off > _SLIGHT).sum())]
    if not len(bounded):
        return None
    order = np.concatenate([bounded, np.setdiff1d(np.arange(len(centre)), bounded)])
    slopes = np.zeros((len(centre), len(bounded)))
    for rank, place in enumerate(order[1:], 1):
        before = bounded[:rank]
        slopes[place, : len(before)] = np.linalg.solve(covariance[np.ix_(before, before)], covariance[before, place])
    return Straight(priors, centre, order, slopes)
