"""Thresholds that are parameters, where heaters are driven by their measured status: as its switches show them.

In open loop the temperatures say nothing of thresholds. So they are drawn after all else, draw by draw: given the
parameters and the heat of a draw it is known where its thermostats' sensors were when the heaters switched.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from ..probability import Priors
from ..problem import (
    Passages,
    Problem,
    Runs,
    exact_heat,
    heat_of_weights,
    log_prior_of_scatter,
    passages,
    shifts_of_weights,
    split,
    unit_heats,
    whole_weights,
)
from ..scenario import threshold_parameters
from ..simulator import FloatArray, IntArray

_AT_ONCE = 200
"""Draws that are simulated together."""
_MISSED = 0.01
"""K, by which simulations may be off what weights of heat stand for: a tenth of what thermostats scatter."""
_LOOKED_AT = np.linspace(-4.0, 4.0, 161)
"""Normal scores of a prior, among which the likeliest is where sampling begins,"""
_IN_TURN, _OF_DRAWS = 3, 10
"""looked for so often of one parameter after another, for so many draws,"""
_ROUNDS = 10
"""and rounds of the sampler from there: each moves every parameter alone, and then all."""


def with_thresholds(problem: Problem, thetas: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Draws [S, d] of a problem with heat, with thresholds as measured switches show them and all else as it is.

    Draws whose simulation fails stay as they are.
    """
    names = [name for name in threshold_parameters(problem.scenario) if name in problem.names]
    if not names or any(window.switching is None for window in problem.windows):
        return thetas
    good, parts = [], []
    for first in range(0, len(thetas), _AT_ONCE):
        part = thetas[first : first + _AT_ONCE]
        runs = problem.simulate_many(part)
        done = np.flatnonzero([of_draw is not None for of_draw in runs])
        if len(done):
            good.append(first + done)
            parts.append(_passages(problem, part[done], [of_draw for of_draw in runs if of_draw is not None], rng))
    if not good:
        return thetas
    found, rows = thetas.copy(), np.concatenate(good)
    of_windows = [
        [Passages.joined(parts) for parts in zip(*of_parts, strict=True)] for of_parts in zip(*parts, strict=True)
    ]
    columns = np.array([problem.names.index(name) for name in names])
    found[np.ix_(rows, columns)] = _drawn(_Told(problem, names, thetas[rows], of_windows), rng)
    return found


def _passages(problem: Problem, thetas: FloatArray, runs: list[Runs], rng: np.random.Generator) -> list[list[Passages]]:
    """Of each window and heater, with heat given the telemetry; runs: the simulations at thetas [S, d]."""
    model, found = problem.heat, []
    assert model is not None
    kept = exact_heat(problem, runs, thetas, rng, within=_MISSED).weights
    weights, _ = whole_weights(problem, thetas, kept, rng)
    for window in problem.windows:
        heat = heat_of_weights(model, unit_heats(model, window), split(model, kept - model.centre))
        shifts = shifts_of_weights(model, window, weights)
        found.append(passages(window, problem.at(window, thetas), heat, shifts))
    return found


def _drawn(told: _Told, rng: np.random.Generator) -> FloatArray:
    """Parameters [S, p] given what is told: elliptical slice sampling (Murray, Adams and MacKay 2010, AISTATS 9)."""
    draws, count = len(told.base), len(told.priors.names)
    scores = np.tile(_likeliest(told, np.arange(min(draws, _OF_DRAWS)), count), (draws, 1))
    for _ in range(_ROUNDS):
        # If all moved as one, a threshold that is known well would hold the others where they are.
        for moved in (*np.eye(count, dtype=bool), np.ones(count, bool)):
            _turn(told, scores, moved, rng)
    return told.values(scores)


def _likeliest(told: _Told, rows: IntArray, count: int) -> FloatArray:
    """[p] scores that are likely for the draws in rows."""
    scores, looks = np.zeros(count), len(_LOOKED_AT)
    for _ in range(_IN_TURN):
        for k in range(count):
            looked = np.tile(scores, (looks * len(rows), 1))
            looked[:, k] = np.repeat(_LOOKED_AT, len(rows))
            each = told.log_likelihood(looked, np.tile(rows, looks)).reshape(looks, -1)
            scores[k] = _LOOKED_AT[np.argmax(each.mean(axis=1) - 0.5 * _LOOKED_AT**2)]
    return scores


def _turn(told: _Told, scores: FloatArray, moved: NDArray[np.bool_], rng: np.random.Generator) -> None:
    """One step of all draws' scores [S, p], in those that are moved [p], in place."""
    left, begun = np.arange(len(scores)), scores.copy()
    other = np.where(moved, rng.standard_normal(scores.shape), 0.0)
    level = told.log_likelihood(scores, left) + np.log(rng.random(len(left)))
    angle = rng.uniform(0.0, 2.0 * np.pi, len(left))
    low, high = angle - 2.0 * np.pi, angle.copy()
    while len(left):
        turn = angle[left, None]
        scores[left] = np.where(moved, begun[left] * np.cos(turn) + other[left] * np.sin(turn), begun[left])
        left = left[told.log_likelihood(scores[left], left) < level[left]]
        below = angle[left] < 0.0
        low[left], high[left] = np.where(below, angle[left], low[left]), np.where(below, high[left], angle[left])
        angle[left] = rng.uniform(low[left], high[left])


class _Told:
    """What switches tell of parameters that are thresholds, at S draws of all else."""

    def __init__(
        self, problem: Problem, names: list[str], thetas: FloatArray, of_windows: list[list[Passages]]
    ) -> None:
        """names: [p] of the parameters; of_windows: of each window and heater, at thetas [S, d]."""
        window = problem.windows[0]
        network, inside = window.network, problem.at(window, thetas)
        self.priors = Priors(tuple(names), tuple(problem.entries[problem.names.index(name)].prior for name in names))
        self.of_heaters = list(zip(*of_windows, strict=True))
        self.scatter = log_prior_of_scatter(window, np.median(inside, axis=0))
        # Thresholds are straight in the parameters that set them.
        columns = [network.names.index(name) for name in names]
        simulated = inside[:, window.simulated]
        simulated[:, columns] = 0.0
        self.base = np.stack([network.thresholds(trajectories) for trajectories in simulated])
        self.slope = np.empty((*self.base.shape[1:], len(columns)))
        for k, column in enumerate(columns):
            one = simulated[0].copy()
            one[column] = 1.0
            self.slope[..., k] = network.thresholds(one) - self.base[0]

    def values(self, scores: FloatArray) -> FloatArray:
        """The parameters [n, p] of their priors' normal scores [n, p]."""
        return self.priors.quantile(ndtr(scores))

    def log_likelihood(self, scores: FloatArray, rows: IntArray) -> FloatArray:
        """[n] of normal scores [n, p] of the draws in rows [n]."""
        thresholds = self.base[rows] + np.einsum("shp,np->nsh", self.slope, self.values(scores))
        total = np.zeros(len(rows))
        for heater, of_windows in enumerate(self.of_heaters):
            chosen = [of_window.of(rows) for of_window in of_windows]
            for side in (0, 1):
                at = thresholds[:, side, heater, None]
                switched = sum(value.log_likelihood(side, at)[:, 0] for value in chosen)
                total += np.logaddexp.reduce(switched + self.scatter[heater], axis=1)
            middle = thresholds[:, :, heater].mean(axis=1, keepdims=True)
            total += sum(value.log_of_middle(middle)[:, 0] for value in chosen)
        return total
