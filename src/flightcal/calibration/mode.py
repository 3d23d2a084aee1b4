"""Finding the posterior mode, where the sampler starts.

The closed-loop likelihood has many local optima, because a thermostat can cycle in step with the telemetry or out of
it; with the heaters driven by their measured status (open loop) it has few. So the search runs in open loop first. The
normal distribution around each mode there holds the closed loop's parameters: of many draws from it, those that are
most in step with the telemetry are climbed from. In a gap of the status thermostats act in open loop too, and out of
step there they make its mode wrong, and surer of itself than it should be: so draws from a distribution ten times as
wide around the best are looked at as well.

Correlated noise and discrepancies explain any residuals, so far from the mode they would hold the parameters there:
modes with independent noise are followed with the residuals' own model, beside the search in that model itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import FlightcalError
from ..problem import Problem
from ..progress import SILENT, Progress
from ..simulator import FloatArray, SimulationFailure, in_parallel
from .start import fit_residuals

Start = tuple[str, FloatArray]
"""What it is, and z [d]."""

SAME = 0.1
"""Nats; modes that differ by less are one."""

_ITERATIONS = 100
_MOST_DAMPING = 1e8
_CONVERGED = 1e-5  # nats that a further Newton step promises
_FOLLOWED = 3  # modes of a simpler problem that are followed in the one that is asked for
_DRAWS = 500  # of which the best few are climbed from
_CLIMBED = 6
_WIDE = 10.0  # times the deviations of an open loop's mode


@dataclass(frozen=True)
class Mode:
    """A local optimum of the log density on unconstrained coordinates."""

    z: FloatArray
    """[d]."""
    log_density: float
    converged: bool
    origin: str
    """Which start it was reached from."""


def climb(problem: Problem, z: FloatArray, origin: str = "") -> Mode:
    """Levenberg-Marquardt ascent of the log density from z [d], with its exact gradient and Gauss-Newton Hessian.

    Marquardt's scaled damping (Marquardt 1963), so steps do not depend on the parameters' units.
    """
    damping = 1e-3
    value, gradient = problem.log_density_and_gradient(z)
    for _ in range(_ITERATIONS):
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
                return Mode(z, value, True, origin)
            new_value, new_gradient = problem.log_density_and_gradient(z + step)
            if np.isfinite(new_value) and new_value > value:
                z, value, gradient = z + step, new_value, new_gradient
                damping = max(damping * 0.2, 1e-9)
                break
            damping *= 5.0
        else:
            return Mode(z, value, promised < 100 * _CONVERGED, origin)
    return Mode(z, value, False, origin)


def find_mode(
    problem: Problem,
    starts: Sequence[tuple[str, FloatArray]],
    *,
    rng: np.random.Generator,
    random_starts: int = _CLIMBED,
    progress: Progress = SILENT,
) -> tuple[Mode, ...]:
    """Modes reached from the named thetas [d] in `starts` and from prior draws, best first.

    Where the problem has an open loop, all starts are followed in it first, and the closed loop is searched around the
    best of the modes found there, and from the named starts.
    """
    open_loop = problem.open_loop
    if open_loop is None:
        return _search(problem, starts, rng, random_starts, progress)
    modes = _distinct(_search(open_loop, starts, rng, random_starts, progress))[:_FOLLOWED]
    beside: list[Start] = []
    far: list[Start] = []
    for mode in modes:
        around = _best(problem, _around(open_loop, mode.z, 1.0, rng), _CLIMBED)
        beside += [(f"open loop from {mode.origin}", z) for z in (mode.z, *around)]
    if modes:
        wide = _nearest(problem, _around(open_loop, modes[0].z, _WIDE, rng), _CLIMBED)
        far = [(f"far around the open loop from {modes[0].origin}", z) for z in wide]
    named = [(name, problem.to_z(theta)) for name, theta in starts]
    progress.at(0.0, f"closed loop from {len(beside + far + named)} starts")
    return _climbed(problem, [*beside, *_with_residuals(problem, [*far, *named])])


def _search(
    problem: Problem,
    starts: Sequence[tuple[str, FloatArray]],
    rng: np.random.Generator,
    random_starts: int,
    progress: Progress,
) -> tuple[Mode, ...]:
    """`find_mode` in one problem: from the named starts, and from the best of many prior draws."""
    begun: list[Start] = []
    if not problem.is_independent:
        modes = _distinct(_search(problem.independent(), starts, rng, random_starts, progress))[:_FOLLOWED]
        begun += _with_residuals(problem, [(mode.origin, mode.z) for mode in modes])
    if random_starts:
        draws = problem.to_z(problem.priors.sample(rng, _DRAWS))
        begun += [(f"prior draw {k + 1}", z) for k, z in enumerate(_best(problem, draws, random_starts))]
    begun += [(name, problem.to_z(theta)) for name, theta in starts]
    progress.at(0.0, f"from {len(begun)} starts")
    return _climbed(problem, begun)


def _climbed(problem: Problem, starts: Sequence[Start]) -> tuple[Mode, ...]:
    """What is reached from each start, best first."""
    found = in_parallel(lambda k: climb(problem, starts[k][1], starts[k][0]), len(starts))
    return tuple(sorted(found, key=lambda mode: -mode.log_density))


def _with_residuals(problem: Problem, starts: Sequence[Start]) -> list[Start]:
    """Starts with noise and discrepancy as the residuals there have them."""
    fitted = in_parallel(lambda k: fit_residuals(problem, starts[k][1]), len(starts))
    return [(origin, z) for (origin, _), z in zip(starts, fitted, strict=True)]


def _around(problem: Problem, z: FloatArray, width: float, rng: np.random.Generator) -> FloatArray:
    """Draws [S, d] of the normal distribution around a mode z [d], so many times as wide.

    Empty where simulations next to the mode fail.
    """
    try:
        coordinates = problem.coordinates(z)
    except (SimulationFailure, FlightcalError):
        return np.empty((0, len(z)))
    return coordinates.to_z(width * rng.standard_normal((_DRAWS, len(z))))


def _best(problem: Problem, draws: FloatArray, count: int) -> FloatArray:
    """The draws [S, d] of highest log density [count, d]."""
    densities = np.array(in_parallel(lambda k: problem.log_density(draws[k]), len(draws)))
    return draws[np.argsort(-densities)[:count]]


def _nearest(problem: Problem, draws: FloatArray, count: int) -> FloatArray:
    """The draws [S, d] whose simulated temperatures are nearest to the telemetry [count, d], whatever their noise."""
    misfits = np.full(len(draws), np.inf)
    for k, runs in enumerate(problem.simulate_many(problem.to_theta(draws))):
        if runs is not None:
            residual = problem.residual(runs)
            samples = np.isfinite(residual).sum(axis=0)
            square = np.nan_to_num(residual) ** 2
            misfits[k] = samples @ np.log(square.sum(axis=0))  # minus twice the log likelihood of the best noise
    return draws[np.argsort(misfits)[:count]]


def _distinct(modes: Sequence[Mode]) -> list[Mode]:
    """Modes of different log density, in their order."""
    kept: list[Mode] = []
    for mode in modes:
        if all(abs(mode.log_density - other.log_density) > SAME for other in kept):
            kept.append(mode)
    return kept


def check_simulated(modes: Sequence[Mode]) -> None:
    """Raises FlightcalError where there is no start of the search, or none has a finite density."""
    if not modes:
        raise FlightcalError("calibration: found no start, expected a named or a random one")
    if not np.isfinite(modes[0].log_density):
        raise FlightcalError(
            "no start of the calibration can be simulated: every simulation fails or is not finite; "
            "check the priors with 'flightcal simulate'"
        )
