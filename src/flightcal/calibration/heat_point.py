"""A point around which a problem with unmodelled heat is linear, and what is made of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..probability import Gains
from ..problem import HeatModel, Problem, followed, with_heat
from ..simulator import FloatArray
from .sizes import Around

_SIZES = 64
"""Draws of the sizes of noise and heat."""


@dataclass(frozen=True)
class HeatPoint:
    """Around what a problem with heat is linear."""

    model: HeatModel
    names: tuple[str, ...]
    """[d] of the entries of theta of the problem without heat,"""
    theta: FloatArray
    """[d] and theta."""
    sizes: dict[str, float]
    """Of noise and heat, by their names in theta: the most probable ones."""
    around: Around
    """What all this follows from, with the most probable sizes and with others."""

    @property
    def evidence(self) -> float:
        """Log density of the telemetry and the most probable sizes, all that is linear integrated out."""
        return self.around.log_density(self.most_probable)

    @property
    def most_probable(self) -> FloatArray:
        """[s] the sizes in the order of `around`."""
        return np.array([self.sizes[name] for name in self.around.sizes.names])


def start_with_heat(problem: Problem, point: HeatPoint) -> tuple[Problem, FloatArray]:
    """The problem around a point, and z [d] of it to begin at."""
    heated = with_heat(problem, point.model, point.theta)
    theta = heated.priors.median()
    known = dict(zip(problem.names, point.theta, strict=True)) | point.sizes
    for k, name in enumerate(heated.names):
        theta[k] = known.get(name, theta[k])
    return heated, heated.to_z(theta)


def moved(point: HeatPoint, heated: Problem, theta: FloatArray) -> HeatPoint:
    """The point at theta [d] of the problem with heat, and at the weights that are expected there.

    Raises SimulationFailure.
    """
    left = heated.heat_left([heated.simulate(theta)], theta[None])
    gains = Gains([window.terms for window in heated.windows], heated.weighed, *heated.heat_sizes(theta[None]))
    growth = heated.heat_growth(theta[None])[0]
    parts = [group.part for group in point.model.groups]
    counts = [basis.shape[1] for basis in point.model.kept]
    centre = np.where(np.repeat([part == "error" for part in parts], counts), 0.0, gains(left)[0] / growth)
    known = dict(zip(heated.names, theta.tolist(), strict=True))
    there = [known.get(name, value) for name, value in zip(point.names, point.theta.tolist(), strict=True)]
    return replace(point, model=replace(point.model, centre=centre), theta=np.array(there))


def follow(problem: Problem, point: HeatPoint, heated: Problem, theta: FloatArray) -> HeatPoint:
    """The point at theta [d] of the problem with heat, and there how the response to heat follows the parameters.

    problem: without heat. Raises SimulationFailure.
    """
    there = moved(point, heated, theta)
    known = dict(zip(heated.names, theta.tolist(), strict=True))
    straight = replace(there.model, tilted={}, followed={})
    found = followed(with_heat(problem, straight, there.theta), theta)
    sizes = {name: known.get(name, size) for name, size in there.sizes.items()}
    return replace(there, model=replace(straight, followed=found), sizes=sizes)


def bend(point: HeatPoint, heated: Problem, thetas: FloatArray) -> float:
    """By how much the response to heat differs between thetas [S, d] of the problem with heat, as it follows them.

    The variance of the logarithm of its growth, over all weights of which the telemetry tells: about by how much the
    log density is off, to second order in the parameters, where the response is taken as the same for all.
    """
    sizes = point.most_probable
    covariance, _ = point.around.known_of_weights(sizes)
    told = 1.0 - np.diag(covariance) / point.around.roots(sizes)[: len(covariance)] ** 2
    return float(told @ np.log(heated.heat_growth(thetas)).var(axis=0))


def draw_sizes(point: HeatPoint, rng: np.random.Generator) -> FloatArray:
    """Sizes [k, s] of noise and heat as the telemetry leaves them; each is that of many draws of the parameters."""
    return point.around.draw_sizes(point.most_probable, _SIZES, rng)


def spread_sizes(
    problem: Problem,
    heated: Problem,
    point: HeatPoint,
    known: Problem,
    z: FloatArray,
    drawn: FloatArray,
    rng: np.random.Generator,
) -> FloatArray:
    """Thetas [chain, draw, d] of a problem with heat from draws z [chain, draw, k] at its most probable sizes.

    problem: without heat; known: at those sizes; drawn: the sizes [k, s] that draws get.
    """
    flat = z.reshape(-1, z.shape[-1])
    whole = np.tile(problem.to_z(point.theta), (len(flat), 1))
    for k, name in enumerate(problem.names):
        if name in known.names:
            whole[:, k] = flat[:, known.names.index(name)]
    names = point.around.sizes.names
    whole, window_weights = point.around.spread(whole, point.most_probable, drawn, rng)
    values = problem.to_theta(whole)
    found = [
        window_weights[:, names.index(name)] if name in names else values[:, problem.names.index(name)]
        for name in heated.names
    ]
    return np.stack(found, axis=-1).reshape(*z.shape[:2], len(found))
