"""Coordinates in which the posterior is nearly round: those that the sampler moves in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import FlightcalError

Array = NDArray[np.float64]

LARGEST_DEVIATION = 10.0
"""Of whitened directions, in units of z, which is of order one under every prior: a flatter direction of the
Gauss-Newton Hessian is flat by a failed linearisation."""


@dataclass(frozen=True)
class Whitening:
    """z = mean + factor w, with w nearly standard normal."""

    mean: Array
    """[d]"""
    factor: Array
    """[d, d]"""

    def to_z(self, w: Array) -> Array:
        """z [..., d] of w [..., d]."""
        return self.mean + w @ self.factor.T

    def to_w(self, z: Array) -> Array:
        """w [..., d] of z [..., d]."""
        return np.asarray(np.linalg.solve(self.factor, (z - self.mean)[..., None])[..., 0], float)


def whitening(mode: Array, precision: Array) -> Whitening:
    """Whitening around `mode` [d] with factor factor^T = inverse of `precision` [d, d].

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
    return Whitening(np.array(mode, float), directions / np.sqrt(np.maximum(eigenvalues, floor)))
