"""Priors: from the scenario's blocks to the unconstrained z of the samplers.

Uniform, Normal, TruncatedNormal and LogNormal use normal scores, theta = F^-1(Phi(z)) with F the prior's
distribution function: the prior of z is N(0, 1) whatever the units and bounds, z = 0 is the median, and the
prior's share of a Gauss-Newton Hessian is the identity. A HalfNormal, the usual prior of a noise level, and a
HalfStudentT use the logarithm, in which the likelihood of a noise level is close to normal and the level never
rounds to zero. A Beta uses the logit.

A size of unmodelled heat may be nothing at all. Its logarithm would run off to minus infinity, and there all else is
known better: a funnel in which chains stay for long. So its z has a sign that does not matter (`signed`), and a chain
passes through zero: theta = scale |z| of a half-normal, scale |sinh z| of half a Student's t, whose tail is long.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import betaincinv, betaln, erfinv, expit, gammaln, logit, ndtr, ndtri, stdtrit

from ..compiled import Row
from ..scenario import Beta, HalfNormal, HalfStudentT, LogNormal, Normal, Prior, TruncatedNormal, Uniform
from .kernels.priors import (
    BETA,
    HALF_NORMAL,
    HALF_STUDENT_T,
    LOG_NORMAL,
    NDTRI,
    NORMAL,
    SIGNED_NORMAL,
    SIGNED_T,
    TINY,
    TRUNCATED,
    UNIFORM,
    PriorsCall,
    evaluate,
)

Array = NDArray[np.float64]

_BELOW = 0.5 * math.erfc(1.0 / math.sqrt(2.0))
CENTRAL = (_BELOW, 1.0 - _BELOW)
"""Probabilities below the ends of the central 68%: a deviation of a normal distribution to each side."""
_SMALLEST = 2.0**-53
"""Probabilities stay this far from 0 and 1, so that quantiles are finite (normal score 8.2)."""

_MOST_ARGUMENTS = 8


class SignedHalfNormal(HalfNormal):
    """A half-normal whose z has a sign that does not matter."""


class SignedHalfStudentT(HalfStudentT):
    """The same of half of Student's t."""


def signed(prior: Prior) -> Prior:
    """A half-normal, or half of Student's t, of a size that may be nothing: the same in another z."""
    if isinstance(prior, HalfStudentT):
        return SignedHalfStudentT(scale=prior.scale, degrees_of_freedom=prior.degrees_of_freedom)
    return SignedHalfNormal(scale=prior.scale) if isinstance(prior, HalfNormal) else prior


class PriorTerms(NamedTuple):
    """The priors at z; all [..., d] but the log density [...]."""

    theta: Array
    slope: Array
    """d theta / d z."""
    log_density: Array
    """Of z: that of theta plus the log of the slope."""
    gradient: Array
    """Of the log density."""


class Tilt(NamedTuple):
    """A slope in a log density, by z: most * tanh(slope @ (z - centre) / most)."""

    slope: tuple[float, ...]
    """[d]"""
    centre: tuple[float, ...]
    """[d] z"""
    most: float


@dataclass(frozen=True)
class Priors:
    """Independent priors of d named parameters, in a fixed order: the last axis of every theta and z.

    theta is physical (SI), z unconstrained (dimensionless); functions of either take any leading axes.
    """

    names: tuple[str, ...]
    priors: tuple[Prior, ...]
    tilt: Tilt | None = None
    """Added to the log density."""

    def at(self, z: ArrayLike) -> PriorTerms:
        """Everything that a log density and its gradient need of the priors at z [..., d]."""
        z = np.ascontiguousarray(z, float)
        theta, slope, gradient = np.empty((3, *z.shape))
        log_density = np.empty(z.shape[:-1])
        a, b, c, d = (array.reshape(-1, len(self.priors)) for array in (z, theta, slope, gradient))
        self.row(a, b, c, d, log_density.reshape(-1))()
        return PriorTerms(theta, slope, log_density, gradient)

    def row(self, z: Array, theta: Array, slope: Array, gradient: Array, log_density: Array) -> Row:
        """The same as a row of a Program: reads z [S, d], fills the others, log_density [S]."""
        tilt = self.tilt or Tilt((0.0,) * len(self.priors), (0.0,) * len(self.priors), 1.0)
        return evaluate.row(
            PriorsCall(
                self.kinds, self.arguments, np.array(tilt.slope, float), np.array(tilt.centre, float), tilt.most, NDTRI,
                z, theta, slope, gradient, log_density,
            )
        )  # fmt: skip

    def to_theta(self, z: ArrayLike) -> Array:
        """Physical theta [..., d] of unconstrained z [..., d]; it may reach a bound, never passes it."""
        return self.at(z).theta

    def to_z(self, theta: ArrayLike) -> Array:
        """Unconstrained z [..., d] of physical theta [..., d]; on one of two bounds, that of just inside."""
        return self._by_family("to_z", theta)

    def unsigned(self, z: ArrayLike) -> Array:
        """z [..., d] of the same theta, in which no sign is left that does not matter."""
        either = [isinstance(prior, SignedHalfNormal | SignedHalfStudentT) for prior in self.priors]
        return np.where(either, np.abs(z), z)

    def precision(self, z: ArrayLike) -> Array:
        """Diagonal [..., d] of minus the Hessian of the log density without its tilt, which has nothing off it.

        It is the prior's share of a Gauss-Newton Hessian; no entry is negative.
        """
        return self._by_family("precision", z)

    def quantile(self, probability: ArrayLike) -> Array:
        """Theta [..., d] below which `probability` [..., d] (or a scalar) of each prior lies."""
        p = np.broadcast_to(probability, np.broadcast_shapes(np.shape(probability), (len(self.priors),)))
        return self.to_theta(self._by_family("quantile", p.clip(_SMALLEST, 1.0 - _SMALLEST)))

    def spread(self) -> Array:
        """Standard deviation [d] of each prior on the unconstrained scale: half the width of its central 68%."""
        lower, upper = (self.to_z(self.quantile(p)) for p in CENTRAL)
        return np.asarray(0.5 * (upper - lower))

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
        for family in _FAMILIES.values():
            index = np.flatnonzero(self.kinds == family.code)
            if len(index):
                result[..., index] = getattr(family, function)(values[..., index], *self.arguments[index].T)
        return result

    @cached_property
    def kinds(self) -> NDArray[np.int64]:
        """[d] each prior's family, as the kernels number them."""
        return np.array([_FAMILIES[type(prior)].code for prior in self.priors], np.int64)

    @cached_property
    def bounded(self) -> NDArray[np.int64]:
        """Places of the priors that are bounded from both sides."""
        return np.array([k for k, prior in enumerate(self.priors) if _FAMILIES[type(prior)].bounded], np.int64)

    @cached_property
    def arguments(self) -> Array:
        """[d, most] what each prior's family computes with."""
        arguments = np.zeros((len(self.priors), _MOST_ARGUMENTS))
        for row, prior in zip(arguments, self.priors, strict=True):
            values = _FAMILIES[type(prior)].arguments(prior)
            row[: len(values)] = values
        return arguments


# --- families: one set of functions per kind of prior -------------------------------------------------------


@dataclass(frozen=True)
class _Family:
    """The functions of one kind of prior; each takes values [..., k] and `arguments`, [k] and as many as any has."""

    code: int
    """By which the kernels know it."""
    arguments: Callable[[Any], tuple[float, ...]]
    to_z: Callable[..., Array]
    # By default z is N(0, 1) under the prior.
    precision: Callable[..., Array] = lambda z, *_: np.ones_like(z)
    quantile: Callable[..., Array] = lambda p, *_: ndtri(p)
    bounded: bool = False
    """From both sides: then neither theta nor its logarithm is linear in z."""


def _score(lower_tail: Array, upper_tail: Array) -> Array:
    """Normal score from the probabilities below and above: the smaller of the two has the digits."""
    score = ndtri(np.maximum(np.minimum(lower_tail, upper_tail), TINY))
    return np.where(lower_tail < upper_tail, score, -score)


def _shares(theta: Array, lower: Array, upper: Array) -> tuple[Array, Array]:
    """How far theta is from its lower and from its upper bound, of the distance between them; never zero."""
    below, above = (theta - lower) / (upper - lower), (upper - theta) / (upper - lower)
    return np.maximum(below, _SMALLEST), np.maximum(above, _SMALLEST)


def _truncated_arguments(prior: TruncatedNormal) -> tuple[float, ...]:
    """Mean, standard deviation, bounds, and the uncut normal's probabilities below and above each bound."""
    a, b = ((bound - prior.mean) / prior.standard_deviation for bound in (prior.lower, prior.upper))
    return (prior.mean, prior.standard_deviation, prior.lower, prior.upper, ndtr(a), ndtr(b), ndtr(-a), ndtr(-b))


def _truncated_to_z(theta: Array, mean: Array, deviation: Array, *bounds: Array) -> Array:
    below_lower, below_upper, above_lower, above_upper = bounds[-4:]
    x = (theta - mean) / deviation
    # Differences of numbers near 1 lose their digits: take the smaller ones.
    mass = np.where(above_lower < below_upper, above_lower - above_upper, below_upper - below_lower)
    from_below = (ndtr(x) - below_lower) / mass
    from_above = (ndtr(-x) - above_upper) / mass
    below = np.where(below_lower > 0.5, 1.0 - from_above, from_below)
    above = np.where(above_upper > 0.5, 1.0 - from_below, from_above)
    return _score(np.maximum(below, _SMALLEST), np.maximum(above, _SMALLEST))


def _student_arguments(prior: HalfStudentT) -> tuple[float, ...]:
    """Scale, degrees of freedom, and the logarithm of the density at zero of the distribution of scale one."""
    nu = prior.degrees_of_freedom
    at_zero = np.log(2.0) + gammaln(0.5 * (nu + 1.0)) - gammaln(0.5 * nu) - 0.5 * np.log(nu * np.pi)
    return prior.scale, nu, float(at_zero)


def _student_quantile(p: Array, scale: Array, freedom: Array, *_: Array) -> Array:
    # From the tail of the two that has the digits; the least probabilities are lost beside a half.
    found = np.abs(stdtrit(freedom, np.where(p < 0.5, 0.5 + 0.5 * p, 0.5 - 0.5 * p)))
    return np.asarray(np.log(found.clip(_SMALLEST)))


def _student_precision(z: Array, scale: Array, nu: Array, *_: Array) -> Array:
    square = np.exp(2.0 * z)
    return np.asarray(2.0 * (nu + 1.0) * nu * square / (nu + square) ** 2)


def _signed_student_precision(z: Array, scale: Array, nu: Array, *_: Array) -> Array:
    square = np.sinh(z) ** 2
    return np.asarray((nu + 1.0) * (nu + (2.0 * nu - 1.0) * square) / (nu + square) ** 2 - 1.0 / (1.0 + square))


def _beta_to_z(theta: Array, alpha: Array, beta: Array, lower: Array, upper: Array, *_: Array) -> Array:
    below, above = _shares(theta, lower, upper)
    return np.log(below) - np.log(above)


_FAMILIES: dict[type, _Family] = {
    Uniform: _Family(
        code=UNIFORM,
        arguments=lambda prior: (prior.lower, prior.upper),
        to_z=lambda theta, lower, upper, *_: _score(*_shares(theta, lower, upper)),
        bounded=True,
    ),
    Normal: _Family(
        code=NORMAL,
        arguments=lambda prior: (prior.mean, prior.standard_deviation),
        to_z=lambda theta, mean, deviation, *_: (theta - mean) / deviation,
    ),
    TruncatedNormal: _Family(
        code=TRUNCATED,
        arguments=_truncated_arguments,
        to_z=_truncated_to_z,
        bounded=True,
    ),
    LogNormal: _Family(
        code=LOG_NORMAL,
        arguments=lambda prior: (np.log(prior.median), np.log(prior.factor)),
        to_z=lambda theta, mean, deviation, *_: (np.log(theta) - mean) / deviation,
    ),
    HalfNormal: _Family(
        code=HALF_NORMAL,
        arguments=lambda prior: (prior.scale,),
        to_z=lambda theta, scale, *_: np.log(theta / scale),
        precision=lambda z, scale, *_: 2.0 * np.exp(2.0 * z),
        quantile=lambda p, scale, *_: np.log(np.sqrt(2.0) * erfinv(p)),
    ),
    HalfStudentT: _Family(
        code=HALF_STUDENT_T,
        arguments=_student_arguments,
        to_z=lambda theta, scale, *_: np.log(theta / scale),
        precision=_student_precision,
        quantile=_student_quantile,
    ),
    Beta: _Family(
        code=BETA,
        arguments=lambda prior: (prior.alpha, prior.beta, prior.lower, prior.upper, betaln(prior.alpha, prior.beta)),
        to_z=_beta_to_z,
        precision=lambda z, alpha, beta, *_: (alpha + beta) * expit(z) * expit(-z),
        quantile=lambda p, alpha, beta, *_: logit(betaincinv(alpha, beta, p)),
        bounded=True,
    ),
    SignedHalfNormal: _Family(
        code=SIGNED_NORMAL,
        arguments=lambda prior: (prior.scale,),
        to_z=lambda theta, scale, *_: theta / scale,
        quantile=lambda p, scale, *_: np.sqrt(2.0) * erfinv(p),
    ),
    SignedHalfStudentT: _Family(
        code=SIGNED_T,
        arguments=_student_arguments,
        to_z=lambda theta, scale, *_: np.arcsinh(theta / scale),
        precision=_signed_student_precision,
        quantile=lambda p, *arguments: np.arcsinh(np.exp(_student_quantile(p, *arguments))),
    ),
}
