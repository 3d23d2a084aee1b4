"""Which fixed numbers a parameter's value is as good as, where the telemetry tells the two together only.

A node's capacity, its links and its areas can often all be scaled together: then a fixed area says how large the
capacity is, and an error of the area is one of the capacity.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve

from ..simulator import FloatArray, SimulationFailure
from .evidence import Fit, gaussian
from .view import Point, View
from .wrongs import BLOCKS, fixed_numbers, multiplied

_OFF = 0.1
"""Share by which a fixed number may well be off."""
_NUDGE = 0.02
"""The same, for a derivative."""
_UNNOTICED = 2.0
"""Nats that such an error may cost where telemetry does not tell it."""
_FOLLOWS = 0.3
"""Share of a number's error, from which a value follows it."""
_KNOWN = ("environment.solar_constant",)
"""Numbers that are known better than that."""
_MOST = 3
"""Numbers that are kept of each parameter."""


@dataclass(frozen=True)
class Footing:
    """A fixed number that a parameter's value is as good as."""

    parameter: str
    number: str
    """Its path in the scenario."""
    share: float
    """Relative change of the value, over that of the number; below zero: the other way."""


def footings(view: View, start: Point, fit: Fit) -> tuple[Footing, ...]:
    """Of each parameter the numbers that it follows most, and by more than its own posterior deviation.

    start: a point whose response to heat is near enough; fit: where the entries are likeliest. Raises
    SimulationFailure.
    """
    point = view.point(view.window, fit.z, start)
    (factor,) = gaussian(view.rows, point, np.isfinite(view.as_read), (fit.size,)).factors
    told = cho_solve((factor, True), point.effects, check_finite=False)
    left = np.sqrt(np.clip(1.0 - (point.effects * told).sum(axis=0), 0.0, None))
    relative = _relative(view, point.z)
    found: list[Footing] = []
    scaled = set(view.network.mapping.scaled_positions.tolist())
    for place in fixed_numbers(view, (*BLOCKS, "heaters", "loads")):
        name = view.network.network.paths[place]
        if name in _KNOWN or place in scaled:
            continue
        try:
            effect = _effect(view, place, point.z)
        except SimulationFailure:
            continue
        cost = 0.5 * _OFF**2 * float(effect @ cho_solve((factor, True), effect, check_finite=False))
        shares = -(told.T @ effect) * relative
        follows = (np.abs(shares) > _FOLLOWS) & (_OFF * np.abs(shares) > left * np.abs(relative))
        if cost < _UNNOTICED:
            found += [Footing(view.problem.names[k], name, float(shares[k])) for k in np.flatnonzero(follows)]
    found.sort(key=lambda own: -abs(own.share))
    kept = [own for k, own in enumerate(found) if [o.parameter for o in found[:k]].count(own.parameter) < _MOST]
    return tuple(sorted(kept, key=lambda own: view.problem.names.index(own.parameter)))


def _effect(view: View, place: int, z: FloatArray) -> FloatArray:
    """[R] K of a relative change of the number at a place. Raises SimulationFailure."""
    more, less = (view.temperatures(multiplied(view, [place], factor), z) for factor in (1.0 + _NUDGE, 1.0 - _NUDGE))
    return np.asarray((more - less) / (2.0 * _NUDGE))


def _relative(view: View, z: FloatArray) -> FloatArray:
    """[d] relative change of each value with a deviation of its prior; zero of what is no parameter or not positive."""
    at = view.problem.priors.at(z)
    is_parameter = np.array([name in view.window.scenario.parameters for name in view.problem.names])
    return np.where(
        is_parameter & (at.theta > 0.0), at.slope * view.spread / np.where(at.theta > 0.0, at.theta, 1.0), 0.0
    )
