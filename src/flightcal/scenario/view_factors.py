"""View factors between rectangles whose edges are parallel to the axes, exact.

Closed forms for parallel and for perpendicular rectangles: Ehlert & Smith 1993, J. Thermophys. Heat Transfer 7,
173-175. Nothing stands between two rectangles here; what does must be another enclosure.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Rectangles:
    """Rectangles [m] that face along one axis, to one side."""

    axis: int
    """0, 1 or 2: that of their normal."""
    side: int
    """+1 or -1: where the normal points."""
    lower: Array
    """[m, 3] corner with the smallest coordinates, m; equal to `upper` along the axis."""
    upper: Array

    @property
    def area(self) -> Array:
        """[m] m^2."""
        edges = np.delete(self.upper - self.lower, self.axis, axis=1)
        return np.asarray(edges.prod(axis=1))


def view_factors(first: Rectangles, second: Rectangles) -> Array:
    """F [m, k]: the share of what leaves each of `first`, diffusely, that reaches each of `second`."""
    if first.axis == second.axis:
        return _parallel(first, second)
    return _perpendicular(first, second)


def gebhart_factors(factors: Array, emissivity: Array) -> Array:
    """B [n, n]: the share of what each surface emits that each absorbs, after all reflections (Gebhart 1961).

    factors [n, n] and emissivity [n] of all surfaces of an enclosure; what misses them all is lost to the outside.
    """
    reflected = factors * (1.0 - emissivity)
    return np.asarray(np.linalg.solve(np.eye(len(emissivity)) - reflected, factors * emissivity))


def _parallel(first: Rectangles, second: Rectangles) -> Array:
    a, b = (k for k in range(3) if k != first.axis)
    distance = second.lower[None, :, first.axis] - first.lower[:, None, first.axis]
    seen = (first.side == -second.side) & (distance * first.side > 0.0)
    z = np.where(seen, np.abs(distance), 1.0)
    total = np.zeros_like(z)
    for i, x in enumerate((first.lower[:, a], first.upper[:, a])):
        for j, y in enumerate((first.lower[:, b], first.upper[:, b])):
            for k, xi in enumerate((second.lower[:, a], second.upper[:, a])):
                for m, eta in enumerate((second.lower[:, b], second.upper[:, b])):
                    u, v = x[:, None] - xi[None], y[:, None] - eta[None]
                    p, q = np.sqrt(u**2 + z**2), np.sqrt(v**2 + z**2)
                    term = v * p * np.arctan(v / p) + u * q * np.arctan(u / q)
                    total += (-1) ** (i + j + k + m) * (term - 0.5 * z**2 * np.log(u**2 + v**2 + z**2))
    return np.where(seen, total / (2.0 * np.pi) / first.area[:, None], 0.0)


def _perpendicular(first: Rectangles, second: Rectangles) -> Array:
    along = 3 - first.axis - second.axis
    # Distances from the line in which the two planes meet; what lies behind the other's plane sees nothing of it.
    x1, x2 = _in_front(first, second)
    xi1, xi2 = _in_front(second, first)
    y1, y2 = (corner[:, None, along] + 0.0 * x1 for corner in (first.lower, first.upper))
    eta1, eta2 = (corner[None, :, along] + 0.0 * x1 for corner in (second.lower, second.upper))
    total = np.zeros_like(x1)
    for i, x in enumerate((x1, x2)):
        for j, y in enumerate((y1, y2)):
            for k, xi in enumerate((xi1.T, xi2.T)):
                for m, eta in enumerate((eta1, eta2)):
                    total += (-1) ** (i + j + k + m) * _corner(x**2 + xi**2, y - eta)
    return np.asarray(total / (2.0 * np.pi) / first.area[:, None])


def _in_front(these: Rectangles, those: Rectangles) -> tuple[Array, Array]:
    """Extent [m, k] of `these` in front of the planes of `those`, both ends from 0."""
    plane = those.lower[None, :, those.axis]
    ends = [(corner[:, None, those.axis] - plane) * those.side for corner in (these.lower, these.upper)]
    near, far = np.minimum(*ends), np.maximum(*ends)
    return np.maximum(near, 0.0), np.maximum(far, 0.0)


def _corner(square: Array, gap: Array) -> Array:
    """The antiderivative at a pair of corners: x^2 + xi^2 and y - eta; continuous where both are zero."""
    root = np.sqrt(square)
    angle = np.arctan2(gap, root)
    whole = square + gap**2
    logarithm = np.where(whole > 0.0, (square - gap**2) * np.log(np.where(whole > 0.0, whole, 1.0)), 0.0)
    return np.asarray(gap * root * angle - 0.25 * logarithm)
