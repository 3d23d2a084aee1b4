"""Independent priors and what a log density needs of them; see `probability/priors.py`."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from llvmlite import ir
from numba.core import types
from numba.extending import get_cython_function_address, intrinsic

from ...compiled import inlined, kernel

UNIFORM, NORMAL, TRUNCATED, LOG_NORMAL, HALF_NORMAL, HALF_STUDENT_T, BETA, SIGNED_NORMAL, SIGNED_T = range(9)
"""Families; `probability/priors.py` says what each is."""
TINY = 1e-300
"""Smallest argument of the normal quantile function: it and its derivative are finite there."""
_LOG_ROOT_2_PI = 0.5 * math.log(2.0 * math.pi)
_ROOT_HALF = math.sqrt(0.5)
NDTRI = int(get_cython_function_address("scipy.special.cython_special", "ndtri"))


class PriorsCall(NamedTuple):
    """Priors of d parameters, at S points."""

    kinds: Any
    """[d] the family."""
    arguments: Any
    """[d, most] what the family computes with."""
    tilt: Any
    """[d] slope by z of what is added to the log density,"""
    centre: Any
    """[d] at this z, where it is zero;"""
    most: float
    """it comes no further than this from zero."""
    quantile: int
    """Address of the normal quantile function, which so does not end up in the cache."""
    z: Any
    """[S, d], and filled:"""
    theta: Any
    """[S, d], as the next two."""
    slope: Any
    gradient: Any
    log_density: Any
    """[S]"""


@intrinsic
def _call(typing_context: Any, address: Any, x: Any) -> Any:
    """The C function double -> double at an address."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        kind = ir.FunctionType(ir.DoubleType(), [ir.DoubleType()])
        return builder.call(builder.inttoptr(args[0], kind.as_pointer()), [args[1]])

    return types.float64(types.int64, types.float64), generate


@kernel
def evaluate(call):
    """Theta, its slope, the log density and its gradient."""
    kinds, arguments, quantile, z = call.kinds, call.arguments, call.quantile, call.z
    theta, slope, gradient, log_density = call.theta, call.slope, call.gradient, call.log_density
    tilt, centre, most = call.tilt, call.centre, call.most
    for s in range(z.shape[0]):
        total = 0.0
        for j in range(z.shape[1]):
            kind, score, given = kinds[j], z[s, j], arguments[j]
            value, rate = scaled(kind, given, quantile, score)
            # By default z is N(0, 1) under the prior.
            density, derivative = -0.5 * score * score - _LOG_ROOT_2_PI, -score
            if kind == HALF_NORMAL:
                square = math.exp(2.0 * score)
                density = 0.5 * math.log(2.0 / math.pi) - 0.5 * square + score
                derivative = 1.0 - square
            elif kind == HALF_STUDENT_T:
                freedom, square = given[1], math.exp(2.0 * score)
                density = given[2] - 0.5 * (freedom + 1.0) * math.log1p(square / freedom) + score
                derivative = 1.0 - (freedom + 1.0) * square / (freedom + square)
            elif kind == SIGNED_T:
                # Of a Student's t, of which the half is folded over.
                freedom, sine, cosine = given[1], math.sinh(score), math.cosh(score)
                density = given[2] - math.log(2.0) - 0.5 * (freedom + 1.0) * math.log1p(sine * sine / freedom)
                density += math.log(cosine)
                derivative = sine / cosine - (freedom + 1.0) * sine * cosine / (freedom + sine * sine)
            elif kind == BETA:
                alpha, beta = given[0], given[1]
                share, rest = 1.0 / (1.0 + math.exp(-score)), 1.0 / (1.0 + math.exp(score))
                density = -alpha * _softplus(-score) - beta * _softplus(score) - given[4]
                derivative = alpha * rest - beta * share
            theta[s, j], slope[s, j], gradient[s, j] = value, rate, derivative
            total += density
        tilted = 0.0
        for j in range(z.shape[1]):
            tilted += tilt[j] * (z[s, j] - centre[j])
        bent = math.tanh(tilted / most)
        for j in range(z.shape[1]):
            gradient[s, j] += (1.0 - bent * bent) * tilt[j]
        log_density[s] = total + most * bent
    return 0


@inlined
def scaled(kind, given, quantile, score):
    """Theta of a family at a score, and its slope."""
    if kind == UNIFORM:
        lower, upper = given[0], given[1]
        value = min(max(lower + (upper - lower) * _below(score), lower), upper)
        rate = (upper - lower) * _bell(score)
    elif kind == NORMAL:
        value, rate = given[0] + given[1] * score, given[1]
    elif kind == TRUNCATED:
        mean, deviation, lower, upper = given[0], given[1], given[2], given[3]
        below_lower, below_upper, above_lower, above_upper = given[4], given[5], given[6], given[7]
        below = below_lower + (below_upper - below_lower) * _below(score)
        above = above_upper + (above_lower - above_upper) * _below(-score)
        # The smaller of the two has the digits.
        x = _call(quantile, max(min(below, above), TINY))
        if below >= above:
            x = -x
        mass = above_lower - above_upper if above_lower < below_upper else below_upper - below_lower
        value = min(max(mean + deviation * x, lower), upper)
        rate = deviation * mass * _bell(score) / _bell(x)
    elif kind == LOG_NORMAL:
        value = math.exp(given[0] + given[1] * score)
        rate = given[1] * value
    elif kind == BETA:
        lower, upper = given[2], given[3]
        share, rest = 1.0 / (1.0 + math.exp(-score)), 1.0 / (1.0 + math.exp(score))
        value = lower + (upper - lower) * share
        rate = (upper - lower) * share * rest
    elif kind == SIGNED_NORMAL:
        value, rate = given[0] * abs(score), math.copysign(given[0], score)
    elif kind == SIGNED_T:
        value = given[0] * abs(math.sinh(score))
        rate = math.copysign(given[0] * math.cosh(score), score)
    else:
        value = given[0] * math.exp(score)
        rate = value
    return value, rate


@inlined
def _below(score):
    """Probability below a normal score."""
    return 0.5 * math.erfc(-score * _ROOT_HALF)


@inlined
def _bell(score):
    """Density of the standard normal."""
    return math.exp(-0.5 * score * score - _LOG_ROOT_2_PI)


@inlined
def _softplus(x):
    """log(1 + exp(x)), without overflow."""
    return max(x, 0.0) + math.log1p(math.exp(-abs(x)))
