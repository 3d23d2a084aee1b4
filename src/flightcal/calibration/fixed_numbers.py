"""What errors of the scenario's fixed numbers would make of the calibrated ones: a consider analysis.

A calibration takes capacities, areas and links that are no parameters as exact, and they are not: where one is off, the
parameters make up for it, and no fit shows it. Numbers that are uncertain but not estimated are known as considered
(Bierman 1977, chapter 8; Tapley, Schutz and Born 2004, chapter 6). Here their relative errors are taken as normal and
small, with what the telemetry itself says against them, and all as linear around the mean of the posterior.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from ..problem import Problem, Window, whitening
from ..simulator import FloatArray, SimulationFailure
from .table import scores

_KNOWN: Final = ("environment.solar_constant",)
"""Numbers that are known too well to be off."""
_NUDGE: Final = 0.01
"""Relative, for a derivative."""
_MOST: Final = 3
"""Numbers that are named for each value,"""
_MATTERS: Final = 0.5
"""which they move by as many deviations of its posterior, or more."""


@dataclass(frozen=True)
class Footing:
    """A fixed number that a value depends on."""

    name: str
    """Of the value."""
    number: str
    """Its path in the scenario."""
    off: float
    """Relative deviation that the telemetry leaves it."""
    change: float
    """Of the value where the number is larger by that, and others are as the telemetry then has them."""


@dataclass(frozen=True)
class FixedNumbers:
    """By how much they are taken to be off, and which of them matter."""

    within: float
    """Relative deviation before telemetry."""
    footings: tuple[Footing, ...]
    """Of each value the numbers that it depends on most."""


def considered(
    problem: Problem, thetas: FloatArray, within: float, seed: int
) -> tuple[FloatArray, FixedNumbers] | None:
    """Posterior draws thetas [S, d] with fixed numbers that are off by a relative deviation of `within`, and these.

    Changes are in SI. None: the simulator is no thermal network, or a reduced one, in which most numbers are no longer
    apart; nothing is fixed; or a simulation near the mean fails.
    """
    z = scores(problem.priors, thetas)
    centre, d = z.mean(axis=0), z.shape[1]
    effects = _effects(problem, problem.to_theta(centre), within)
    if effects is None:
        return None
    paths, beside = effects
    try:
        precision = problem.gauss_newton_hessian(centre, beside)
    except SimulationFailure:
        return None
    if not np.isfinite(precision).all():
        return None
    precision[d:, d:] += np.eye(len(paths))
    alone, together = (whitening(centre, matrix).factor for matrix in (precision[:d, :d], precision))
    gain = -(alone @ alone.T) @ precision[:d, d:]
    errors = together[d:]
    off = np.random.default_rng(seed).standard_normal((len(z), len(together))) @ errors.T
    left, deviations = np.sqrt((errors**2).sum(axis=1)), z.std(axis=0)
    moves = gain @ errors @ errors.T / left
    footings = [
        Footing(name, paths[place], within * float(left[place]), _change(problem, centre, moves[:, place], k))
        for k, name in enumerate(problem.names)
        for place in np.argsort(-np.abs(moves[k]))[:_MOST]
        if abs(moves[k, place]) >= _MATTERS * deviations[k]
    ]
    return problem.to_theta(z + off @ gain.T), FixedNumbers(within, tuple(footings))


def _change(problem: Problem, centre: FloatArray, moved: FloatArray, place: int) -> float:
    """Of one entry of theta, in SI, where z [d] is moved."""
    return float(problem.to_theta(centre + moved)[place] - problem.to_theta(centre)[place])


def _effects(problem: Problem, theta: FloatArray, within: float) -> tuple[list[str], list[FloatArray]] | None:
    """Paths [m] of fixed numbers, and K [T, N, m] of each window that such an error of theirs makes at theta [d]."""
    window = problem.windows[0]
    if not window.is_network or problem.scenario.network.reduced_model is not None:
        return None
    mapping, paths = window.network.mapping, window.network.network.paths
    moved = {*mapping.set_positions.tolist(), *mapping.scaled_positions.tolist()}
    places = [k for k in window.sizes if k not in moved and paths[k] not in _KNOWN]
    found: list[tuple[str, list[FloatArray]]] = []
    for k in places:
        try:
            of_windows = [_effect(window, problem.at(window, theta), k) for window in problem.windows]
        except SimulationFailure:
            continue
        found.append((paths[k], [within * of_window for of_window in of_windows]))
    if not found:
        return None
    names, columns = zip(*found, strict=True)
    return list(names), [np.stack(column, axis=-1) for column in zip(*columns, strict=True)]


def _effect(window: Window, theta: FloatArray, place: int) -> FloatArray:
    """K [T, N] of a relative change of one number of a window's network, at theta [q]. Raises SimulationFailure."""
    more, less = (window.multiplied([place], factor).simulate(theta) for factor in (1.0 + _NUDGE, 1.0 - _NUDGE))
    return np.asarray((more.temperatures - less.temperatures) / (2.0 * _NUDGE))
