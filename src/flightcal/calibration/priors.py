"""Priors: from the scenario's blocks to distributions, and to the unconstrained z of the samplers.

Uniform, Normal, TruncatedNormal and LogNormal use normal scores, theta = F^-1(Phi(z)) with F the prior's
distribution function: the prior of z is N(0, 1) whatever the units and bounds, z = 0 is the median, and the
prior's share of a Gauss-Newton Hessian is the identity. A HalfNormal, the usual prior of a noise level, uses
the logarithm, in which the likelihood of a noise level is close to normal and the level never rounds to zero.
A Beta uses the logit, because JAX has no inverse of the incomplete beta function.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from .._jax import jax, jnp
from ..scenario.schema import Beta, HalfNormal, LogNormal, Normal, Prior, TruncatedNormal, Uniform

if TYPE_CHECKING:
    from numpyro.distributions import Distribution

Array = NDArray[np.float64]

_SMALLEST = 2.0**-53
"""Probabilities stay this far from 0 and 1, so that quantiles are finite (normal score 8.2)."""

_TINY = 1e-300
"""Smallest argument of the normal quantile function: it and its derivative are finite there."""


def distribution(prior: Prior) -> Distribution:
    """The numpyro distribution of a prior, in the parameter's own SI unit."""
    import numpyro.distributions as dist

    match prior:
        case Uniform():
            return dist.Uniform(prior.lower, prior.upper)
        case Normal():
            return dist.Normal(prior.mean, prior.standard_deviation)
        case TruncatedNormal():
            return dist.TruncatedNormal(prior.mean, prior.standard_deviation, low=prior.lower, high=prior.upper)
        case LogNormal():
            return dist.LogNormal(np.log(prior.median), np.log(prior.factor))
        case HalfNormal():
            return dist.HalfNormal(prior.scale)
        case Beta():
            stretch = dist.transforms.AffineTransform(
                prior.lower, prior.upper - prior.lower, domain=dist.constraints.unit_interval
            )
            return dist.TransformedDistribution(dist.Beta(prior.alpha, prior.beta), stretch)


@dataclass(frozen=True)
class Priors:
    """Independent priors of d named parameters, in a fixed order: the last axis of every theta and z.

    theta is physical (SI), z unconstrained (dimensionless). `to_theta`, `to_z`, `log_density` and `precision`
    are JAX: compiled once per shape, differentiable, over any leading axes. The rest is NumPy.
    """

    names: tuple[str, ...]
    priors: tuple[Prior, ...]

    def to_theta(self, z: ArrayLike | jax.Array) -> jax.Array:
        """Physical theta [..., d] of unconstrained z [..., d]; it may reach a bound, never passes it."""
        return self._compiled["to_theta"](z)

    def to_z(self, theta: ArrayLike | jax.Array) -> jax.Array:
        """Unconstrained z [..., d] of physical theta [..., d]; on one of two bounds, that of just inside."""
        return self._compiled["to_z"](theta)

    def log_density(self, z: ArrayLike | jax.Array) -> jax.Array:
        """Log prior density [...] of z [..., d]: that of theta plus the log Jacobian of `to_theta`."""
        return self._compiled["log_density"](z).sum(-1)

    def precision(self, z: ArrayLike | jax.Array) -> jax.Array:
        """Diagonal [..., d] of minus the Hessian of `log_density`, which has nothing off it.

        It is the prior's share of a Gauss-Newton Hessian; no entry is negative.
        """
        return self._compiled["precision"](z)

    def quantile(self, probability: ArrayLike) -> Array:
        """Theta [..., d] below which `probability` [..., d] (or a scalar) of each prior lies."""
        p = np.broadcast_to(probability, np.broadcast_shapes(np.shape(probability), (len(self.priors),))).clip(
            _SMALLEST, 1.0 - _SMALLEST
        )
        z = np.empty(p.shape)
        for group in self._groups:
            z[..., group.index] = group.family.quantile(p[..., group.index], *group.arguments)
        return np.array(self.to_theta(z))

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

    @cached_property
    def _compiled(self) -> dict[str, Callable[..., jax.Array]]:
        """The families' functions by name. Each family is evaluated once, on all its parameters together."""
        order = np.argsort(np.concatenate([group.index for group in self._groups]))

        def compiled(name: str) -> Callable[..., jax.Array]:
            def evaluate(values: jax.Array) -> jax.Array:
                parts = [
                    getattr(group.family, name)(values[..., group.index], *group.arguments) for group in self._groups
                ]
                return jnp.concatenate(parts, axis=-1)[..., order]

            jitted = jax.jit(evaluate)
            return lambda values: jitted(jnp.asarray(values))

        return {name: compiled(name) for name in ("to_theta", "to_z", "log_density", "precision")}

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
    to_theta: Callable[..., jax.Array]
    to_z: Callable[..., jax.Array]
    log_density: Callable[..., jax.Array]
    precision: Callable[..., jax.Array]
    quantile: Callable[..., Array]
    """Quantiles of z (NumPy)."""


@dataclass(frozen=True)
class _Group:
    """All parameters of one family: their places [k] and their priors' arguments, each [k]."""

    family: _Family
    index: NDArray[np.intp]
    arguments: tuple[Array, ...]


def _standard_normal_log_density(z: jax.Array, *_: Array) -> jax.Array:
    return -0.5 * z**2 - 0.5 * np.log(2.0 * np.pi)


def _normal_score_family(
    arguments: Callable[[Any], tuple[float, ...]],
    to_theta: Callable[..., jax.Array],
    to_z: Callable[..., jax.Array],
) -> _Family:
    """A family whose z is N(0, 1) under the prior."""
    return _Family(
        arguments=arguments,
        to_theta=to_theta,
        to_z=to_z,
        log_density=_standard_normal_log_density,
        precision=lambda z, *_: jnp.ones_like(z),
        quantile=lambda p, *_: special.ndtri(p),
    )


def _probability_to_score(lower_tail: jax.Array | Array, upper_tail: jax.Array | Array) -> jax.Array:
    """Normal score from the probabilities below and above: the smaller of the two has the digits."""
    low = lower_tail < upper_tail
    # A selection, not a minimum: JAX halves the derivative of a minimum where both are equal, at the median.
    score = jax.scipy.special.ndtri(jnp.maximum(jnp.where(low, lower_tail, upper_tail), _TINY))
    return jnp.where(low, score, -score)


def _uniform_to_theta(z: jax.Array, lower: Array, upper: Array) -> jax.Array:
    return jnp.clip(lower + (upper - lower) * jax.scipy.special.ndtr(z), lower, upper)


def _uniform_to_z(theta: jax.Array, lower: Array, upper: Array) -> jax.Array:
    below, above = (theta - lower) / (upper - lower), (upper - theta) / (upper - lower)
    return _probability_to_score(jnp.maximum(below, _SMALLEST), jnp.maximum(above, _SMALLEST))


def _truncated_arguments(prior: TruncatedNormal) -> tuple[float, ...]:
    """Mean, standard deviation, bounds, and the uncut normal's probabilities below and above each bound."""
    a, b = (
        (prior.lower - prior.mean) / prior.standard_deviation,
        (prior.upper - prior.mean) / prior.standard_deviation,
    )
    tails = (special.ndtr(a), special.ndtr(b), special.ndtr(-a), special.ndtr(-b))
    return (prior.mean, prior.standard_deviation, prior.lower, prior.upper, *map(float, tails))


def _truncated_to_theta(
    z: jax.Array,
    mean: Array,
    deviation: Array,
    lower: Array,
    upper: Array,
    below_lower: Array,
    below_upper: Array,
    above_lower: Array,
    above_upper: Array,
) -> jax.Array:
    below = below_lower + (below_upper - below_lower) * jax.scipy.special.ndtr(z)
    above = above_upper + (above_lower - above_upper) * jax.scipy.special.ndtr(-z)
    return jnp.clip(mean + deviation * _probability_to_score(below, above), lower, upper)


def _truncated_to_z(
    theta: jax.Array,
    mean: Array,
    deviation: Array,
    lower: Array,
    upper: Array,
    below_lower: Array,
    below_upper: Array,
    above_lower: Array,
    above_upper: Array,
) -> jax.Array:
    x = (theta - mean) / deviation
    # Differences of probabilities near 1 lose their digits: with both bounds in a tail, only that tail counts.
    mass = np.where(above_lower < below_upper, above_lower - above_upper, below_upper - below_lower)
    from_below = (jax.scipy.special.ndtr(x) - below_lower) / mass
    from_above = (jax.scipy.special.ndtr(-x) - above_upper) / mass
    below = jnp.where(below_lower > 0.5, 1.0 - from_above, from_below)
    above = jnp.where(above_upper > 0.5, 1.0 - from_below, from_above)
    return _probability_to_score(jnp.maximum(below, _SMALLEST), jnp.maximum(above, _SMALLEST))


def _half_normal_log_density(z: jax.Array, scale: Array) -> jax.Array:
    return 0.5 * np.log(2.0 / np.pi) - 0.5 * jnp.exp(2.0 * z) + z


def _beta_log_density(z: jax.Array, alpha: Array, beta: Array, lower: Array, upper: Array) -> jax.Array:
    return alpha * jax.nn.log_sigmoid(z) + beta * jax.nn.log_sigmoid(-z) - special.betaln(alpha, beta)


def _beta_to_z(theta: jax.Array, alpha: Array, beta: Array, lower: Array, upper: Array) -> jax.Array:
    below, above = (theta - lower) / (upper - lower), (upper - theta) / (upper - lower)
    return jnp.log(jnp.maximum(below, _SMALLEST)) - jnp.log(jnp.maximum(above, _SMALLEST))


_FAMILIES: dict[type, _Family] = {
    Uniform: _normal_score_family(lambda prior: (prior.lower, prior.upper), _uniform_to_theta, _uniform_to_z),
    Normal: _normal_score_family(
        lambda prior: (prior.mean, prior.standard_deviation),
        lambda z, mean, deviation: mean + deviation * z,
        lambda theta, mean, deviation: (theta - mean) / deviation,
    ),
    TruncatedNormal: _normal_score_family(_truncated_arguments, _truncated_to_theta, _truncated_to_z),
    LogNormal: _normal_score_family(
        lambda prior: (np.log(prior.median), np.log(prior.factor)),
        lambda z, mean, deviation: jnp.exp(mean + deviation * z),
        lambda theta, mean, deviation: (jnp.log(theta) - mean) / deviation,
    ),
    HalfNormal: _Family(
        arguments=lambda prior: (prior.scale,),
        to_theta=lambda z, scale: scale * jnp.exp(z),
        to_z=lambda theta, scale: jnp.log(theta / scale),
        log_density=_half_normal_log_density,
        precision=lambda z, scale: 2.0 * jnp.exp(2.0 * z),
        quantile=lambda p, scale: np.log(np.sqrt(2.0) * special.erfinv(p)),
    ),
    Beta: _Family(
        arguments=lambda prior: (prior.alpha, prior.beta, prior.lower, prior.upper),
        to_theta=lambda z, alpha, beta, lower, upper: lower + (upper - lower) * jax.nn.sigmoid(z),
        to_z=_beta_to_z,
        log_density=_beta_log_density,
        precision=lambda z, alpha, beta, lower, upper: (alpha + beta) * jax.nn.sigmoid(z) * jax.nn.sigmoid(-z),
        quantile=lambda p, alpha, beta, lower, upper: special.logit(special.betaincinv(alpha, beta, p)),
    ),
}
