"""Finding the posterior mode, where the sampler starts.

The closed-loop likelihood has many local optima, because a thermostat can cycle in step with the telemetry or out of
it; with the heaters driven by their measured status it has one. So the search runs in open loop from several starts,
and only its result (and the genetic algorithm's) is polished in closed loop: on the whole window, and on growing shares
of it before that, because a thermostat's phase drifts from switch to switch and a start that is in step with the
telemetry at first may be out of it at the end. No ladder of shares is always right, so there are two; and where a
sensor starts near a threshold, the other side of it is tried.

Correlated noise and discrepancies explain any residuals, so far from the mode they would hold the parameters there: the
search is made with independent noise, and only its best modes are followed with the residuals' own model.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..simulator import SimulationFailure
from ..simulator.system import FloatArray
from .joint import AnyProblem
from .start import fit_residuals

_ITERATIONS = 100
_MOST_DAMPING = 1e8
_CONVERGED = 1e-5  # nats that a further Newton step promises
_POLISHED = 3  # open-loop modes that are followed in closed loop
_SAME = 0.1  # nats; modes that differ by less are one
_LADDERS = ((1 / 8, 1 / 4, 1 / 2), (1 / 16, 1 / 8, 3 / 16, 1 / 4, 3 / 8, 1 / 2, 3 / 4))
"""Shares of the window that are followed before the whole."""
_NEAR = 1.0  # K, of a sensor's initial temperature to a threshold


@dataclass(frozen=True)
class Mode:
    """A local optimum of the log density on unconstrained coordinates."""

    z: FloatArray
    """[d]."""
    log_density: float
    converged: bool
    iterations: int
    origin: str
    """Which start it was reached from."""


def climb(problem: AnyProblem, z: FloatArray, origin: str = "") -> Mode:
    """Levenberg-Marquardt ascent of the log density from z [d], with its exact gradient and Gauss-Newton Hessian.

    Marquardt's scaled damping (Marquardt 1963), so steps do not depend on the parameters' units.
    """
    damping = 1e-3
    value, gradient = problem.log_density_and_gradient(z)
    for iteration in range(_ITERATIONS):
        if not np.isfinite(value):
            break
        try:
            hessian = problem.gauss_newton_hessian(z)
        except SimulationFailure:
            break
        while damping < _MOST_DAMPING:
            step = np.linalg.solve(hessian + damping * np.diag(np.diag(hessian)), gradient)
            promised = 0.5 * float(gradient @ step)
            if promised < _CONVERGED and damping <= 1e-2:
                return Mode(z, value, True, iteration, origin)
            new_value, new_gradient = problem.log_density_and_gradient(z + step)
            if np.isfinite(new_value) and new_value > value:
                z, value, gradient = z + step, new_value, new_gradient
                damping = max(damping * 0.2, 1e-9)
                break
            damping *= 5.0
        else:
            return Mode(z, value, promised < 100 * _CONVERGED, iteration, origin)
    return Mode(z, value, False, _ITERATIONS, origin)


def climb_in_step(problem: AnyProblem, z: FloatArray, origin: str = "", ladder: Sequence[float] = _LADDERS[0]) -> Mode:
    """`climb` on growing shares of the window, each from where the one before ended."""
    for share in ladder:
        z = climb(problem.beginning(share), z).z
    return climb(problem, z, origin)


def find_mode(
    problem: AnyProblem,
    starts: Sequence[tuple[str, FloatArray]],
    *,
    open_loop: AnyProblem | None = None,
    rng: np.random.Generator,
    random_starts: int = 6,
    on_start: Callable[[str], None] = lambda _: None,
) -> tuple[Mode, ...]:
    """Modes reached from the named thetas [d] in `starts` and from prior draws, best first.

    open_loop: the same problem with measured heater status; where it is given, all starts are followed in it first, and
    the best of the modes found there are polished in closed loop, as are the named starts.
    """
    if not problem.residuals.is_independent:
        modes = find_mode(
            problem.independent(), starts, open_loop=None if open_loop is None else open_loop.independent(),
            rng=rng, random_starts=random_starts, on_start=on_start,
        )  # fmt: skip
        found = []
        for mode in _distinct(modes)[:_POLISHED]:
            on_start(f"noise and discrepancy from the mode of {mode.origin}")
            found.append(climb(problem, fit_residuals(problem, mode.z), mode.origin))
        return tuple(sorted(found, key=lambda mode: -mode.log_density))
    first = problem if open_loop is None else open_loop
    found = []
    for k, theta in enumerate(problem.priors.sample(rng, random_starts)):
        on_start(f"prior draw {k + 1} of {random_starts}")
        found.append(climb(first, problem.to_z(theta), f"prior draw {k + 1}"))
    for name, theta in starts:
        on_start(name)
        found.append(climb(first, problem.to_z(theta), name))
    if open_loop is not None:
        best = _distinct(sorted(found, key=lambda mode: -mode.log_density))[:_POLISHED]
        found = []
        for mode in best:
            on_start(f"closed loop from the open-loop mode of {mode.origin}")
            found.append(climb(problem, mode.z, f"open loop from {mode.origin}"))
            found += [
                climb_in_step(problem, mode.z, f"open loop from {mode.origin}, in growing shares", ladder)
                for ladder in _LADDERS
            ]
        for name, theta in starts:
            on_start(f"closed loop from {name}")
            found.append(climb(problem, problem.to_z(theta), name))
        best_mode = max(found, key=lambda mode: mode.log_density)
        for z in problem.across_thresholds(best_mode.z, _NEAR):
            found.append(climb(problem, z, f"{best_mode.origin}, across a threshold"))
    return tuple(sorted(found, key=lambda mode: -mode.log_density))


def _distinct(modes: Sequence[Mode]) -> list[Mode]:
    """Modes of different log density, in their order."""
    kept: list[Mode] = []
    for mode in modes:
        if all(abs(mode.log_density - other.log_density) > _SAME for other in kept):
            kept.append(mode)
    return kept
