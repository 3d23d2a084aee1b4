"""Coordinates in which the posterior is nearly round: those that the sampler moves in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import FlightcalError
from ..probability import Priors, Straight, straight

Array = NDArray[np.float64]

LARGEST_DEVIATION = 10.0
"""Of whitened directions, in units of z, which is of order one under every prior: a flatter direction of the
Gauss-Newton Hessian is flat by a failed linearisation."""


@dataclass(frozen=True)
class Whitening:
    """y = mean + factor w, with w nearly standard normal, and z of straight coordinates y."""

    mean: Array
    """[d]"""
    factor: Array
    """[d, d]"""
    straight: Straight | None = None
    """None: z is y."""

    def to_z(self, w: Array) -> Array:
        """z [..., d] of w [..., d]."""
        y = self.mean + w @ self.factor.T
        return y if self.straight is None else self.straight.to_z(y)

    def to_y(self, z: Array) -> Array:
        """Straight coordinates [..., d] of z [..., d]."""
        return z if self.straight is None else self.straight.to_y(z)

    def to_w(self, z: Array) -> Array:
        """w [..., d] of z [..., d]."""
        return np.asarray(np.linalg.solve(self.factor, (self.to_y(z) - self.mean)[..., None])[..., 0], float)

    def pull_back(self, z: Array, z_bar: Array) -> Array:
        """Derivatives [d] by w of those by z, at z [d]."""
        y_bar = z_bar if self.straight is None else self.straight.pull_back(z, z_bar)
        return np.asarray(self.factor.T @ y_bar)


def whitening(mode: Array, precision: Array, priors: Priors | None = None) -> Whitening:
    """Whitening around `mode` [d] with factor factor^T = inverse of `precision` [d, d].

    priors: of z, to make straight what their bounds bend; None: nothing is made straight.

    By eigenvalues, so that a direction that neither data nor prior hold is given `LARGEST_DEVIATION`.
    Raises FlightcalError where the precision is not finite.
    """
    if not np.isfinite(precision).all():
        raise FlightcalError(
            f"whitening: found {int((~np.isfinite(precision)).sum())} values that are not finite in the "
            "Gauss-Newton Hessian at the mode, expected none: simulations next to the mode fail"
        )
    eigenvalues, directions = np.linalg.eigh(0.5 * (precision + precision.T))
    floor = max(LARGEST_DEVIATION**-2, np.finfo(float).eps * float(eigenvalues.max()))
    factor = directions / np.sqrt(np.maximum(eigenvalues, floor))
    made = None if priors is None else straight(priors, np.array(mode, float), factor @ factor.T)
    return Whitening(np.array(mode, float), factor, made)
