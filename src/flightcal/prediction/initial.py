"""Initial temperatures of a window that the calibration has not seen.

They are not known, and not of interest: they are estimated from the window's first samples, which are then never
scored. Over so short a span temperatures are nearly linear in the initial ones, so each draw of the parameters gets a
Gaussian update of the prior of `initial_priors`: its mean for a point estimate, a draw from it for a posterior draw.
The update is iterated (Gauss-Newton), with a Jacobian at the median of the draws.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..environment import orbit_phase, seconds_later
from ..problem import Problem, Window
from ..scenario import ExternalModel, Normal
from ..simulator import FloatArray, SimulationFailure, Trajectory, courses
from .errors import FirstErrors, WhiteErrors

_DIFFERENCE = 0.01  # K
_ALIKE = 5.0
"""K by which nodes that are read differ where others are about alike."""
_MOST_TRIED = 4
"""Heaters without a status, of which all states at first are tried."""
_RARELY = 0.05
"""Of the time: as little as a heater may be on or off at a time of which nothing is known."""
_PLACE = 0.05
"""Orbits, in which temperatures are about alike."""
_ITERATIONS = 3  # a heater that switches in the span bends what is linear otherwise


def around_usual(first: Window, problem: Problem, draws: FloatArray) -> Window:
    """The window with nodes that none of its samples tells of anywhere where training had them, at draws [S, d].

    What the scenario says of where these start is of a training window's start. Here they start as they were in
    training, in the mean of the draws, while the nodes that are told were about as warm as their samples say; where
    none is told, at the same place in the orbit. The deviation is no less than what the scenario says. A reduced
    model's file says it itself.
    """
    model = first.scenario.simulator
    if isinstance(model, ExternalModel) or model.reduced_model is not None:
        return first
    seen = {
        first.scenario.observations[channel].node
        for channel, observed in zip(first.simulator.channels, first.observed.T, strict=True)
        if np.isfinite(observed).any()
    }
    starts = {
        name: prior
        for name in first.names
        if name.startswith("initial.") and isinstance(prior := first.reads[name], Normal)
    }
    nodes = [name.removeprefix("initial.") for name in starts]
    told = np.array([node in seen for node in nodes], bool)
    if told.all():
        return first
    found, lasted = [], []
    for window in problem.windows:
        theta = problem.at(window, draws.mean(axis=0))[window.simulated]
        try:
            course, steps = courses(window.network, nodes, theta)
        except SimulationFailure:
            continue
        found.append(course)
        lasted.append(steps if told.any() else steps * _at_the_place(first, window))
    if not found:
        return first
    read = np.array([prior.mean for prior in starts.values()])[told]
    likely, spread = beside(np.concatenate(found), np.concatenate(lasted), told, read)
    reads = dict(first.reads)
    untold = [name for name, is_told in zip(starts, told, strict=True) if not is_told]
    for name, value, deviation in zip(untold, likely.tolist(), spread.tolist(), strict=True):
        reads[name] = Normal(mean=value, standard_deviation=max(deviation, starts[name].standard_deviation))
    return replace(first, reads=reads)


def _at_the_place(first: Window, window: Window) -> FloatArray:
    """[K] how much the steps of a training window count: those at the place in the orbit where another begins."""
    edges = window.network.drive.times
    middle = seconds_later(window.start, 0.5 * (edges[1:] + edges[:-1]))
    environment, folder = first.scenario.environment, first.scenario.folder
    phases = orbit_phase(environment, np.append(middle, first.start), folder, window.start)
    off = np.remainder(phases[:-1] - phases[-1] + 0.5, 1.0) - 0.5
    return np.asarray(np.exp(-0.5 * (off / _PLACE) ** 2))


def beside(
    kelvins: FloatArray, weights: FloatArray, told: NDArray[np.bool_], read: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Means and deviations, K, of nodes that nothing tells of while others are about as warm as is `read`.

    kelvins: [K, n] what all of them have been, with weights [K]; told: [n] which are read. By a kernel (Nadaraya 1964,
    Watson 1964) and no line, which would go on beyond what has been.
    """
    off = ((kelvins[:, told] - read) ** 2).mean(axis=1) if told.any() else np.zeros(len(kelvins))
    alike = weights * np.exp(-0.5 * (off - off.min()) / _ALIKE**2)
    mean = np.average(kelvins[:, ~told], axis=0, weights=alike)
    variance = np.average((kelvins[:, ~told] - mean) ** 2, axis=0, weights=alike)
    return mean, np.sqrt(variance + off.min())


def begun(
    problem: Problem, first: Window, thetas: FloatArray, at_first: FirstErrors | WhiteErrors,
    rng: np.random.Generator, heat: FloatArray | None,
) -> tuple[FloatArray, FloatArray | None]:  # fmt: skip
    """Thetas [S, q] with initial temperatures as the first samples have them, and [S, H] heaters that are on then.

    None: those that the status or the scenario says. at_first, heat: see `condition_initial`.
    """
    if first.unmeasured:
        return condition_start(first, thetas, at_first, rng, heat, _shares(problem))
    return condition_initial(first, thetas, at_first, rng, heat), None


def _shares(problem: Problem) -> FloatArray:
    """[H] of the time that heaters are on in training, as far as it is known: a half of the others."""
    status = np.concatenate([window.status for window in problem.windows])
    known = np.isfinite(status)
    shares = np.where(known, status, 0.0).sum(axis=0) / known.sum(axis=0).clip(1)
    return np.where(known.any(axis=0), shares, 0.5).clip(_RARELY, 1.0 - _RARELY)


def condition_initial(
    first: Window,
    thetas: FloatArray,
    errors: FirstErrors | WhiteErrors,
    rng: np.random.Generator | None = None,
    heat: FloatArray | None = None,
) -> FloatArray:
    """Thetas [S, q] with their initial temperatures replaced by ones conditioned on the samples of `first`.

    first: the window cut to the window's first samples; errors: by which these may differ from the simulation, of
    each theta; rng: draw from the Gaussian (None: take its mean). A theta whose simulation fails keeps the prior mean;
    an external simulator may have none. heat: [S, h, 2 K] W that no block describes, of each theta.
    """
    found, factors, _ = _conditioned(first, thetas, errors, heat)
    return found if rng is None else _drawn(first, found, factors, rng)


def condition_start(
    first: Window,
    thetas: FloatArray,
    errors: FirstErrors | WhiteErrors,
    rng: np.random.Generator,
    heat: FloatArray | None,
    share: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """The same, and which heaters are on at first [S, H]: of those without a status the samples tell, too.

    share: [H] of the time that each is on, which is how likely it is on where samples tell nothing.
    """
    unmeasured = list(first.unmeasured[:_MOST_TRIED])
    patterns = np.tile(first.network.drive.initially_on, (2 ** len(unmeasured), 1))
    patterns[:, unmeasured] = list(itertools.product((0.0, 1.0), repeat=len(unmeasured)))
    tried = [_conditioned(first.begun(on), thetas, errors, heat) for on in patterns]
    chance = np.where(patterns[:, unmeasured] > 0.5, share[unmeasured], 1.0 - share[unmeasured])
    logs = np.log(chance).sum(axis=1)[:, None] + np.stack([fit for _, _, fit in tried])
    chosen = (logs + rng.gumbel(size=logs.shape)).argmax(axis=0)
    every = np.arange(len(thetas))
    found = np.stack([weight for weight, _, _ in tried])[chosen, every]
    factors = np.stack([spread for _, spread, _ in tried])[chosen, every]
    return _drawn(first, found, factors, rng), patterns[chosen]


def _drawn(first: Window, thetas: FloatArray, factors: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Thetas [S, q] with initial temperatures drawn around theirs; factors: [S, n, n] Cholesky's, of the precisions."""
    positions = initial_places(first)
    for theta, factor in zip(thetas, factors, strict=True):
        theta[positions] += np.linalg.solve(factor.T, rng.standard_normal(len(positions)))
    return thetas


def initial_places(window: Window) -> NDArray[np.intp]:
    """Places of initial temperatures in theta."""
    return np.array([k for k, name in enumerate(window.names) if name.startswith("initial.")], np.intp)


def final_temperatures(window: Window, runs: Sequence[Trajectory | None]) -> FloatArray:
    """[S, n] K at a window's end of what has an initial temperature, in theta's order; NaN where a run failed."""
    names = [window.names[k] for k in initial_places(window)]
    # The simulator numbers its nodes as it eliminates them.
    simulated = [name for name in window.simulator.parameters if name.startswith("initial.")]
    order = [simulated.index(name) for name in names]
    return np.stack([np.full(len(names), np.nan) if run is None else run.final[order] for run in runs])


def _conditioned(
    first: Window, thetas: FloatArray, errors: FirstErrors | WhiteErrors, heat: FloatArray | None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Thetas [S, q] at the mean, Cholesky factors [S, n, n] of the precisions, and log densities [S] of the samples."""
    positions, thetas = initial_places(first), thetas.copy()
    if not len(positions):
        return thetas, np.empty((len(thetas), 0, 0)), np.zeros(len(thetas))
    priors = [first.reads[first.names[k]] for k in positions]
    mean = np.array([prior.mean for prior in priors if isinstance(prior, Normal)])
    precision = np.array([prior.standard_deviation**-2.0 for prior in priors if isinstance(prior, Normal)])
    thetas[:, positions] = mean
    valid = np.isfinite(first.observed)
    hessians = np.tile(np.diag(precision), (len(thetas), 1, 1))
    fits = np.zeros(len(thetas))
    simulated_so_far = np.ones(len(thetas), bool)
    for _ in range(_ITERATIONS):
        jacobian = _jacobian(first, np.median(thetas, axis=0), positions)
        if jacobian is None:
            fits[:] = -np.inf
            break
        columns = np.broadcast_to(np.where(valid[..., None], jacobian, 0.0), (len(thetas), *jacobian.shape))
        weighted = errors.whiten(columns).reshape(len(thetas), -1, len(positions))
        hessians = np.einsum("sti,stj->sij", weighted, weighted) + np.diag(precision)
        runs = first.simulate_many(thetas, heat)
        simulated = np.stack([np.full(valid.shape, np.nan) if run is None else run.temperatures for run in runs])
        residuals = errors.whiten(np.where(valid, first.observed - simulated - errors.mean, 0.0)[..., None])
        simulated_so_far &= np.array([run is not None for run in runs])
        for s, residual in enumerate(residuals.reshape(len(thetas), -1)):
            if not simulated_so_far[s]:
                thetas[s, positions], fits[s] = mean, -np.inf
                continue
            off = mean - thetas[s, positions]
            gradient = weighted[s].T @ residual + precision * off
            step = np.linalg.solve(hessians[s], gradient)
            thetas[s, positions] += step
            # With what is left after the step, where all is linear.
            fits[s] = -0.5 * (residual @ residual + off @ (precision * off) - gradient @ step)
    factors = np.linalg.cholesky(hessians)
    fits -= np.log(np.diagonal(factors, axis1=1, axis2=2)).sum(axis=1)
    return thetas, factors, fits


def _jacobian(first: Window, theta: FloatArray, positions: NDArray[np.intp]) -> FloatArray | None:
    """d temperatures / d initial temperatures at theta [q], [T, N, n]; None where a simulation fails."""
    shifts = np.zeros((len(positions), len(theta)))
    shifts[np.arange(len(positions)), positions] = _DIFFERENCE
    runs = first.simulate_many(np.concatenate([theta + shifts, theta - shifts]))
    if any(run is None for run in runs):
        return None
    temperatures = np.stack([run.temperatures for run in runs if run is not None])
    above, below = np.split(temperatures, 2)
    jacobian: FloatArray = np.moveaxis((above - below) / (2 * _DIFFERENCE), 0, -1)
    return jacobian
