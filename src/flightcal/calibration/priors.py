"""Priors: from the scenario's blocks to the unconstrained z of the samplers.

Uniform, Normal, TruncatedNormal and LogNormal use normal scores, theta = F^-1(Phi(z)) with F the prior's
distribution function: the prior of z is N(0, 1) whatever the units and bounds, z = 0 is the median, and the
prior's share of a Gauss-Newton Hessian is the identity. A HalfNormal, the usual prior of a noise level, uses
the logarithm, in which the likelihood of a noise level is close to normal and the level never rounds to zero.
A Beta uses the logit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import betaincinv, betaln, erfinv, expit, log_expit, logit, ndtr, ndtri

from ..scenario.schema import Beta, HalfNormal, LogNormal, Normal, Prior, TruncatedNormal, Uniform

Array = NDArray[np.float64]

_SMALLEST = 2.0**-53
"""Probabilities stay this far from 0 and 1, so that quantiles are finite (normal score 8.2)."""

_TINY = 1e-300
"""Smallest argument of the normal quantile function: it and its derivative are finite there."""

_LOG_ROOT_2_PI = 0.5 * np.log(2.0 * np.pi)


@dataclass(frozen=True)
class Priors:
    """Independent priors of d named parameters, in a fixed order: the last axis of every theta and z.

    theta is physical (SI), z unconstrained (dimensionless); functions of either take any leading axes.
    """

    names: tuple[str, ...]
    priors: tuple[Prior, ...]

    def to_theta(self, z: ArrayLike) -> Array:
        """Physical theta [..., d] of unconstrained z [..., d]; it may reach a bound, never passes it."""
        return self._by_family("to_theta", z)

    def slope(self, z: ArrayLike) -> Array:
        """d theta / d z [..., d] at z [..., d]; theta_i depends on z_i alone."""
        return self._by_family("slope", z)

    def to_z(self, theta: ArrayLike) -> Array:
        """Unconstrained z [..., d] of physical theta [..., d]; on one of two bounds, that of just inside."""
        return self._by_family("to_z", theta)

    def log_density(self, z: ArrayLike) -> Array:
        """Log prior density [...] of z [..., d]: that of theta plus the log of `slope`."""
        return np.asarray(self._by_family("log_density", z).sum(-1))

    def gradient(self, z: ArrayLike) -> Array:
        """Gradient [..., d] of `log_density` at z [..., d]."""
        return self._by_family("gradient", z)

    def precision(self, z: ArrayLike) -> Array:
        """Diagonal [..., d] of minus the Hessian of `log_density`, which has nothing off it.

        It is the prior's share of a Gauss-Newton Hessian; no entry is negative.
        """
        return self._by_family("precision", z)

    def quantile(self, probability: ArrayLike) -> Array:
        """Theta [..., d] below which `probability` [..., d] (or a scalar) of each prior lies."""
        p = np.broadcast_to(probability, np.broadcast_shapes(np.shape(probability), (len(self.priors),)))
        return self.to_theta(self._by_family("quantile", p.clip(_SMALLEST, 1.0 - _SMALLEST)))

    def sample(self, rng: np.random.Generator, count: int) -> Array:
        """`count` independent prior draws of theta [count, d]."""
        return self.quantile(rng.random((count, len(self.priors))))

    def median(self) -> Array:
        """Prior medians of theta [d]."""
        return self.quantile(0.5)

    def bounds(self, probability: float = 0.998) -> tuple[Array, Array]:
        """Finite box (lower [d], upper [d]) of theta that holds the central `probability` of each prior."""
        tail = 0.5 * (1.0 - probability)
        return self.quantile(tail), self.quantile(1.0 - tail)

    def _by_family(self, function: str, values: ArrayLike) -> Array:
        """A function of each family, evaluated once on all the family's parameters together."""
        values = np.asarray(values, float)
        result = np.empty(values.shape)
        # Far out a log-normal theta is infinite, which is the problem's to refuse.
        with np.errstate(over="ignore"):
            for group in self._groups:
                result[..., group.index] = getattr(group.family, function)(values[..., group.index], *group.arguments)
        return result

    @cached_property
    def _groups(self) -> tuple[_Group, ...]:
        groups = []
        for kind, family in _FAMILIES.items():
            index = [j for j, prior in enumerate(self.priors) if type(prior) is kind]
            if index:
                arguments = np.array([family.arguments(self.priors[j]) for j in index], float).T
                groups.append(_Group(family, np.array(index), tuple(arguments)))
        return tuple(groups)


# --- families: one set of functions per kind of prior -------------------------------------------------------


@dataclass(frozen=True)
class _Family:
    """The functions of one kind of prior; each takes values [..., k] and the prior's arguments, each [k]."""

    arguments: Callable[[Any], tuple[float, ...]]
    to_theta: Callable[..., Array]
    slope: Callable[..., Array]
    to_z: Callable[..., Array]
    # Of z; by default z is N(0, 1) under the prior.
    log_density: Callable[..., Array] = lambda z, *_: -0.5 * z**2 - _LOG_ROOT_2_PI
    gradient: Callable[..., Array] = lambda z, *_: -z
    precision: Callable[..., Array] = lambda z, *_: np.ones_like(z)
    quantile: Callable[..., Array] = lambda p, *_: ndtri(p)


@dataclass(frozen=True)
class _Group:
    """All parameters of one family: their places [k] and their priors' arguments, each [k]."""

    family: _Family
    index: NDArray[np.intp]
    arguments: tuple[Array, ...]


def _normal_density(z: Array) -> Array:
    return np.exp(-0.5 * z**2 - _LOG_ROOT_2_PI)


def _score(lower_tail: Array, upper_tail: Array) -> Array:
    """Normal score from the probabilities below and above: the smaller of the two has the digits."""
    score = ndtri(np.maximum(np.minimum(lower_tail, upper_tail), _TINY))
    return np.where(lower_tail < upper_tail, score, -score)


def _shares(theta: Array, lower: Array, upper: Array) -> tuple[Array, Array]:
    """How far theta is from its lower and from its upper bound, of the distance between them; never zero."""
    below, above = (theta - lower) / (upper - lower), (upper - theta) / (upper - lower)
    return np.maximum(below, _SMALLEST), np.maximum(above, _SMALLEST)


def _truncated_arguments(prior: TruncatedNormal) -> tuple[float, ...]:
    """Mean, standard deviation, bounds, and the uncut normal's probabilities below and above each bound."""
    a, b = (
        (prior.lower - prior.mean) / prior.standard_deviation,
        (prior.upper - prior.mean) / prior.standard_deviation,
    )
    return (prior.mean, prior.standard_deviation, prior.lower, prior.upper, ndtr(a), ndtr(b), ndtr(-a), ndtr(-b))


def _truncated_score(z: Array, below_lower: Array, below_upper: Array, above_lower: Array, above_upper: Array) -> Array:
    """Score under the uncut normal of score z under the cut one."""
    below = below_lower + (below_upper - below_lower) * ndtr(z)
    above = above_upper + (above_lower - above_upper) * ndtr(-z)
    return _score(below, above)


def _mass(below_lower: Array, below_upper: Array, above_lower: Array, above_upper: Array) -> Array:
    """Probability between the bounds. Differences of numbers near 1 lose their digits: take the smaller ones."""
    return np.where(above_lower < below_upper, above_lower - above_upper, below_upper - below_lower)


def _truncated_to_theta(
    z: Array, mean: Array, deviation: Array, lower: Array, upper: Array, *probabilities: Array
) -> Array:
    return np.clip(mean + deviation * _truncated_score(z, *probabilities), lower, upper)


def _truncated_slope(
    z: Array, mean: Array, deviation: Array, lower: Array, upper: Array, *probabilities: Array
) -> Array:
    x = _truncated_score(z, *probabilities)
    return deviation * _mass(*probabilities) * _normal_density(z) / _normal_density(x)


def _truncated_to_z(
    theta: Array,
    mean: Array,
    deviation: Array,
    lower: Array,
    upper: Array,
    below_lower: Array,
    below_upper: Array,
    above_lower: Array,
    above_upper: Array,
) -> Array:
    x = (theta - mean) / deviation
    mass = _mass(below_lower, below_upper, above_lower, above_upper)
    from_below = (ndtr(x) - below_lower) / mass
    from_above = (ndtr(-x) - above_upper) / mass
    below = np.where(below_lower > 0.5, 1.0 - from_above, from_below)
    above = np.where(above_upper > 0.5, 1.0 - from_below, from_above)
    return _score(np.maximum(below, _SMALLEST), np.maximum(above, _SMALLEST))


def _beta_to_z(theta: Array, alpha: Array, beta: Array, lower: Array, upper: Array) -> Array:
    below, above = _shares(theta, lower, upper)
    return np.log(below) - np.log(above)


_FAMILIES: dict[type, _Family] = {
    Uniform: _Family(
        arguments=lambda prior: (prior.lower, prior.upper),
        to_theta=lambda z, lower, upper: np.clip(lower + (upper - lower) * ndtr(z), lower, upper),
        slope=lambda z, lower, upper: (upper - lower) * _normal_density(z),
        to_z=lambda theta, lower, upper: _score(*_shares(theta, lower, upper)),
    ),
    Normal: _Family(
        arguments=lambda prior: (prior.mean, prior.standard_deviation),
        to_theta=lambda z, mean, deviation: mean + deviation * z,
        slope=lambda z, mean, deviation: np.broadcast_to(deviation, z.shape),
        to_z=lambda theta, mean, deviation: (theta - mean) / deviation,
    ),
    TruncatedNormal: _Family(
        arguments=_truncated_arguments,
        to_theta=_truncated_to_theta,
        slope=_truncated_slope,
        to_z=_truncated_to_z,
    ),
    LogNormal: _Family(
        arguments=lambda prior: (np.log(prior.median), np.log(prior.factor)),
        to_theta=lambda z, mean, deviation: np.exp(mean + deviation * z),
        slope=lambda z, mean, deviation: deviation * np.exp(mean + deviation * z),
        to_z=lambda theta, mean, deviation: (np.log(theta) - mean) / deviation,
    ),
    HalfNormal: _Family(
        arguments=lambda prior: (prior.scale,),
        to_theta=lambda z, scale: scale * np.exp(z),
        slope=lambda z, scale: scale * np.exp(z),
        to_z=lambda theta, scale: np.log(theta / scale),
        log_density=lambda z, scale: 0.5 * np.log(2.0 / np.pi) - 0.5 * np.exp(2.0 * z) + z,
        gradient=lambda z, scale: 1.0 - np.exp(2.0 * z),
        precision=lambda z, scale: 2.0 * np.exp(2.0 * z),
        quantile=lambda p, scale: np.log(np.sqrt(2.0) * erfinv(p)),
    ),
    Beta: _Family(
        arguments=lambda prior: (prior.alpha, prior.beta, prior.lower, prior.upper),
        to_theta=lambda z, alpha, beta, lower, upper: lower + (upper - lower) * expit(z),
        slope=lambda z, alpha, beta, lower, upper: (upper - lower) * expit(z) * expit(-z),
        to_z=_beta_to_z,
        log_density=lambda z, alpha, beta, *_: alpha * log_expit(z) + beta * log_expit(-z) - betaln(alpha, beta),
        gradient=lambda z, alpha, beta, *_: alpha * expit(-z) - beta * expit(z),
        precision=lambda z, alpha, beta, *_: (alpha + beta) * expit(z) * expit(-z),
        quantile=lambda p, alpha, beta, *_: logit(betaincinv(alpha, beta, p)),
    ),
}
