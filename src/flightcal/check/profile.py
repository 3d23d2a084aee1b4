"""Profile likelihoods: how well the telemetry can do at each value of one parameter, all others fitted again.

Raue et al. (2009), Bioinformatics 25, 1923. What is maximised is the log density, priors of the others included: a
parameter that the data do not hold stays where its prior has it instead of running away.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.optimize import minimize

from ..errors import ScenarioError
from ..problem import Problem
from ..progress import SILENT, Progress
from ..simulator import FloatArray, IntArray, SimulationFailure
from .centre import Centre

DROP = 1.92
"""Nats that bound a 95% interval: half of chi-square's 95% with one degree of freedom."""
_POINTS = 12
_REACH = 3.0
"""Standard deviations of the Gaussian approximation to each side."""
_ITERATIONS = 60


@dataclass(frozen=True)
class Profile:
    """The profile of one parameter; P points, in its order."""

    name: str
    theta: FloatArray
    """[P] SI."""
    log_density: FloatArray
    """[P] maximised over the others, relative to the best."""
    log_likelihood: FloatArray
    """[P] without the priors' share, relative to the best."""
    lower: float
    """Where the profile of the log density has dropped by 1.92 nats, SI; NaN where it does not within the points."""
    upper: float

    @property
    def told(self) -> bool:
        """Whether the likelihood itself, without priors, bounds the parameter on both sides."""
        best = int(np.argmax(self.log_density))
        drop = self.log_likelihood[best] - self.log_likelihood
        return bool(drop[0] > DROP and drop[-1] > DROP)


def profile(problem: Problem, centre: Centre, name: str, progress: Progress = SILENT) -> Profile:
    """The profile of a parameter on both sides of the centre, each point starting from its neighbour's.

    It needs a gradient.
    """
    k = problem.names.index(name)
    deviation = min(float(np.sqrt(centre.covariance[k, k])), float(problem.priors.spread()[k]))
    others = np.delete(np.arange(len(centre.z)), k)
    offsets = np.linspace(0.0, _REACH * deviation, _POINTS + 1)[1:]
    found = [_fitted(problem, centre.z, others)]
    for sign in (-1.0, 1.0):
        last = found[0]
        for offset in offsets:
            last = _fitted(problem, _followed(centre, last, k, float(centre.z[k] + sign * offset)), others)
            found.append(last)
            progress.at((len(found) - 1) / (2 * _POINTS))
    found.sort(key=lambda z: float(z[k]))
    points = np.stack(found)
    density = np.array([problem.log_density(z) for z in points])
    likelihood = density - problem.priors.at(points).log_density
    best = int(np.argmax(density))
    theta = problem.to_theta(points)[:, k]
    interval = _interval(points[:, k], density - density[best], best)
    edges = np.stack([centre.z, centre.z])
    edges[:, k] = np.nan_to_num(interval)
    lower, upper = np.where(np.isnan(interval), np.nan, problem.to_theta(edges)[:, k]).tolist()
    return Profile(name, theta, density - density[best], likelihood - likelihood[best], lower, upper)


def check_names(problem: Problem, names: list[str]) -> None:
    """Raise ScenarioError for a name that is no entry of theta."""
    for name in names:
        if name not in problem.names:
            raise ScenarioError(f"--profile {name}: expected one of {', '.join(problem.names)}")


def _followed(centre: Centre, last: FloatArray, k: int, value: float) -> FloatArray:
    """The last point with the parameter at a new value, the others moved as the Gaussian approximation says."""
    direction = centre.covariance[:, k] / centre.covariance[k, k]
    moved: FloatArray = last + (value - last[k]) * direction
    moved[k] = value
    return moved


def _fitted(problem: Problem, start: FloatArray, others: IntArray) -> FloatArray:
    """The log density maximised over the others, from `start` [d]."""

    def whole(part: FloatArray) -> FloatArray:
        z = start.copy()
        z[others] = part
        return z

    def fall(part: FloatArray) -> tuple[float, FloatArray]:
        value, gradient = problem.log_density_and_gradient(whole(part))
        return (-value, -gradient[others]) if np.isfinite(value) else (1e30, np.zeros(len(part)))

    def curvature(part: FloatArray) -> FloatArray:
        try:
            return problem.gauss_newton_hessian(whole(part))[np.ix_(others, others)]
        except SimulationFailure:
            return np.eye(len(part))

    found = minimize(
        fall,
        start[others],
        jac=True,
        hess=curvature,
        method="trust-exact",
        options={"maxiter": _ITERATIONS, "gtol": 1e-3},
    )
    return whole(found.x)


def _interval(places: FloatArray, height: FloatArray, best: int) -> tuple[float, float]:
    """Where the profile crosses -1.92 on both sides of its best point, interpolated; NaN where it does not."""

    def crossing(order: IntArray) -> float:
        for a, b in pairwise(order):
            if height[b] <= -DROP:
                share = (height[a] + DROP) / (height[a] - height[b])
                return float(places[a] + share * (places[b] - places[a]))
        return float("nan")

    return crossing(np.arange(best, -1, -1)), crossing(np.arange(best, len(places)))
