"""Gaussian processes of several outputs over the same inputs, each with lengthscales of its own.

Output j at input x is h(x) beta + f(x), with h = [1, x], a flat prior on beta, and f a zero-mean
Gaussian process of Matern-5/2 correlation with one lengthscale for each input, plus a nugget: what is rougher than the
lengthscales resolve (a thermostat that switches once more), and so part of every prediction's variance. Kriging with
a trend, Rasmussen and Williams (2006), secs. 2.7 and 4.2.1; hyper-parameters by restricted maximum likelihood.

With K = L L^T the runs' correlation, R = L^-1, R H = Q U the trend at the runs, k(x) the correlation with the runs:
mean k.weights + h.coefficients, and variance s^2 (1 + nugget - |a|^2 + |w|^2) with a = R k and w = U^-T h - Q^T a. Its
derivative by k is -2 s^2 R^T (a + Q w): one pass through R for the value, another for all derivatives.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.linalg.lapack import dtrtri
from scipy.optimize import minimize

from ..errors import FlightcalError
from ..simulator import FloatArray

_SHORTEST, _LONGEST = 0.1, 30.0
_LEAST_NUGGET, _GREATEST_NUGGET = 1e-7, 1e2
_STARTS = ((3.0, 1e-6), (8.0, 1e-4), (1.5, 1e-2))
"""Lengthscale and nugget from which the likelihood is climbed, for inputs with a spread of about one."""
_FIRST_ITERATIONS = 15
"""From each start; only the best is followed to the end."""
_CONVERGED = 1e-7  # relative, of a log likelihood of some hundreds
_ROOT_5 = math.sqrt(5.0)


@dataclass(frozen=True)
class GaussianProcesses:
    """r independent Gaussian processes, conditioned on S runs. Inputs should have a spread of about one."""

    inputs: FloatArray
    """[S, d]."""
    lengthscales: FloatArray
    """[r, d]."""
    nugget: FloatArray
    """[r], in units of `scale`."""
    scale: FloatArray
    """[r] variance s^2 of the process about its trend."""
    weights: FloatArray
    """[r, S]."""
    coefficients: FloatArray
    """[r, q] of the trend."""
    root: FloatArray
    """[r, S, S] R, lower triangular."""
    orthonormal: FloatArray
    """[r, S, q] Q."""
    upper_inverse: FloatArray
    """[r, q, q] U^-1."""

    def predict(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean [r] and variance [r] at x [d]."""
        mean, variance, *_ = self._at(x)
        return mean, variance

    def linearise(self, x: FloatArray) -> tuple[FloatArray, FloatArray, Callable[[FloatArray, FloatArray], FloatArray]]:
        """Mean [r], variance [r] at x [d], and (cotangent of the mean [r], of the variance [r]) -> of x [d]."""
        mean, variance, difference, slope, a, w = self._at(x)

        def cotangent(mean_bar: FloatArray, variance_bar: FloatArray) -> FloatArray:
            double = 2.0 * variance_bar * self.scale
            by_root = np.matmul((a + _times(self.orthonormal, w))[:, None], self.root)[:, 0]
            correlation_bar = mean_bar[:, None] * self.weights - double[:, None] * by_root
            x_bar = np.matmul((correlation_bar * slope)[:, None], difference)[:, 0] / self.lengthscales
            terms_bar = mean_bar @ self.coefficients + double @ _times(self.upper_inverse, w)
            return np.asarray(x_bar.sum(axis=0) + terms_bar[1:])

        return mean, variance, cotangent

    def _at(self, x: FloatArray) -> tuple[FloatArray, ...]:
        """At x [d]: mean and variance [r], x less the runs' inputs in lengthscales [r, S, d], slope [r, S], a and w.

        slope: d k / d x is this times that difference over the lengthscale.
        """
        difference = (x / self.lengthscales)[:, None] - self._scaled_inputs
        square = np.einsum("rsd,rsd->rs", difference, difference)
        distance = _ROOT_5 * np.sqrt(square)
        decay = np.exp(-distance)
        correlation = (1.0 + distance + 5.0 / 3.0 * square) * decay
        terms = trend(x[None])[0]
        a = _times(self.root, correlation)
        w = terms @ self.upper_inverse - np.matmul(a[:, None], self.orthonormal)[:, 0]
        mean = np.einsum("rs,rs->r", correlation, self.weights) + self.coefficients @ terms
        known = 1.0 - np.einsum("rs,rs->r", a, a) + np.einsum("rq,rq->r", w, w)
        # The nugget is there even on top of a run.
        variance = self.scale * (np.maximum(known, 0.0) + self.nugget)
        return mean, variance, difference, -5.0 / 3.0 * (1.0 + distance) * decay, a, w

    @cached_property
    def _scaled_inputs(self) -> FloatArray:
        """[r, S, d] in lengthscales."""
        return np.asarray(self.inputs / self.lengthscales[:, None])

    def leave_one_out(self) -> tuple[FloatArray, FloatArray]:
        """Each run's target minus its prediction from the other runs [S, r], and that prediction's variance [S, r].

        With the hyper-parameters of all runs. Dubrule (1983), Mathematical Geology 15, 687-699.
        """
        diagonal = np.stack([np.sum(self._projected(j) ** 2, axis=0) for j in range(len(self.scale))])
        return (self.weights / diagonal).T, (self.scale[:, None] / diagonal).T

    def covariance(self, x: FloatArray) -> FloatArray:
        """Covariance of the predictions at x [P, d] with each other, without the nugget, [r, P, P]."""
        terms = trend(x)
        found = np.empty((len(self.scale), len(x), len(x)))
        for j, lengthscales in enumerate(self.lengthscales):
            a = self.root[j] @ matern(self.inputs, x, lengthscales)
            w = self.upper_inverse[j].T @ terms.T - self.orthonormal[j].T @ a
            found[j] = self.scale[j] * (matern(x, x, lengthscales) - a.T @ a + w.T @ w)
        return found

    def _projected(self, output: int) -> FloatArray:
        """(1 - Q Q^T) R [S, S]: its square is the precision of the runs' targets about an unknown trend."""
        root, orthonormal = self.root[output], self.orthonormal[output]
        return np.asarray(root - orthonormal @ (orthonormal.T @ root))


def _times(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    """Each of matrices [r, m, n] times its vector [r, n]."""
    return np.asarray(np.matmul(matrices, vectors[..., None])[..., 0])


def fit(inputs: FloatArray, targets: FloatArray) -> GaussianProcesses:
    """Gaussian processes of targets [S, r] at inputs [S, d], whose spread should be about one.

    Raises FlightcalError with fewer runs than twice the terms of the trend.
    """
    runs, d = inputs.shape
    inputs = np.ascontiguousarray(inputs, float)
    if runs < 2 * (d + 1):
        raise FlightcalError(
            f"emulator: found {runs} finished runs, expected at least {2 * (d + 1)} for {d} uncertain inputs"
        )
    terms = trend(inputs)
    found = [_condition(inputs, terms, target, *_hyper_parameters(inputs, terms, target)) for target in targets.T]
    return GaussianProcesses(inputs, *(np.ascontiguousarray(np.stack(part)) for part in zip(*found, strict=True)))


def trend(x: FloatArray) -> FloatArray:
    """One and each input: h [P, q] at x [P, d]."""
    return np.concatenate([np.ones((len(x), 1)), x], axis=1)


def matern(first: FloatArray, second: FloatArray, lengthscales: FloatArray) -> FloatArray:
    """Matern-5/2 correlation [P, Q] of inputs [P, d] and [Q, d]."""
    difference = (first[:, None] - second[None]) / lengthscales
    distance = np.sqrt(np.einsum("pqd,pqd->pq", difference, difference))
    return np.asarray((1.0 + _ROOT_5 * distance + 5.0 / 3.0 * distance**2) * np.exp(-_ROOT_5 * distance))


def _hyper_parameters(inputs: FloatArray, terms: FloatArray, target: FloatArray) -> tuple[FloatArray, float]:
    """Lengthscales [d] and nugget of the greatest restricted likelihood, from several starts."""
    orthonormal = np.linalg.qr(terms)[0]
    # The likelihood does not see the trend; without it the residual's digits are not lost in it.
    residual = target - orthonormal @ (orthonormal.T @ target)
    size = float(np.sqrt(np.mean(residual**2)))
    d = inputs.shape[1]
    if size <= 1e-12 * float(np.abs(target).max(initial=0.0)):
        return np.full(d, _LONGEST), _LEAST_NUGGET
    squares = np.moveaxis((inputs[:, None] - inputs[None]) ** 2, -1, 0).copy()

    def objective(x: FloatArray) -> tuple[float, FloatArray]:
        try:
            value, gradient = _minus_log_likelihood(x, squares, orthonormal, residual / size)
        except np.linalg.LinAlgError:
            return 1e10, np.zeros_like(x)
        return (value, gradient) if np.isfinite(value + gradient.sum()) else (1e10, np.zeros_like(x))

    bounds = [(math.log(_SHORTEST), math.log(_LONGEST))] * d + [(math.log(_LEAST_NUGGET), math.log(_GREATEST_NUGGET))]
    starts = [np.log(np.append(np.full(d, lengthscale), nugget)) for lengthscale, nugget in _STARTS]
    climb = partial(minimize, objective, jac=True, method="L-BFGS-B", bounds=bounds)
    found = [climb(x0=start, options={"maxiter": _FIRST_ITERATIONS}) for start in starts]
    best = climb(x0=min(found, key=lambda result: float(result.fun)).x, options={"ftol": _CONVERGED}).x
    return np.exp(best[:d]), float(np.exp(best[d]))


def _minus_log_likelihood(
    logarithms: FloatArray, squares: FloatArray, orthonormal: FloatArray, residual: FloatArray
) -> tuple[float, FloatArray]:
    """Minus the restricted log likelihood with the variance at its best, and its gradient by `logarithms` [d + 1].

    squares: [d, S, S] of differences. With P the precision of the residual r about an unknown trend of q terms, the
    derivative by K is (P - (S - q) P r r^T P / r^T P r) / 2; Rasmussen and Williams (2006), sec. 5.4.1, has the same
    without a trend. Raises LinAlgError where K is not positive definite.
    """
    inverse_squares, nugget = np.exp(-2.0 * logarithms[:-1]), np.exp(logarithms[-1])
    runs, terms = orthonormal.shape
    flat = squares.reshape(len(squares), -1)
    square = inverse_squares @ flat
    distance = _ROOT_5 * np.sqrt(square)
    decay = np.exp(-distance)
    correlation = ((1.0 + distance + 5.0 / 3.0 * square) * decay).reshape(runs, runs)
    correlation[np.diag_indices(runs)] += nugget
    factor = cholesky(correlation, lower=True, overwrite_a=True, check_finite=False)
    root = dtrtri(factor, lower=1)[0]
    basis, upper = np.linalg.qr(root @ orthonormal)
    whitened = root @ residual
    unexplained = whitened - basis @ (basis.T @ whitened)
    sum_of_squares = float(unexplained @ unexplained)
    value = (
        0.5 * (runs - terms) * math.log(sum_of_squares)
        + np.log(np.diagonal(factor)).sum()
        + np.log(np.abs(np.diagonal(upper))).sum()
    )
    projected, pulled = root - basis @ (basis.T @ root), root.T @ unexplained
    by_correlation = 0.5 * (projected.T @ projected - (runs - terms) / sum_of_squares * np.outer(pulled, pulled))
    # d k / d log lengthscale is 5/3 (1 + distance) decay times its part of the square.
    by_square = 5.0 / 3.0 * (1.0 + distance) * decay * by_correlation.ravel()
    return float(value), np.append(inverse_squares * (flat @ by_square), nugget * np.trace(by_correlation))


def _condition(
    inputs: FloatArray, terms: FloatArray, target: FloatArray, lengthscales: FloatArray, nugget: float
) -> tuple[Any, ...]:
    """The fields of GaussianProcesses from `lengthscales` on, of one output."""
    runs, count = terms.shape
    factor = cholesky(matern(inputs, inputs, lengthscales) + nugget * np.eye(runs), lower=True)
    root = np.tril(solve_triangular(factor, np.eye(runs), lower=True))
    orthonormal, upper = np.linalg.qr(solve_triangular(factor, terms, lower=True))
    whitened = solve_triangular(factor, target, lower=True)
    explained = orthonormal.T @ whitened
    unexplained = whitened - orthonormal @ explained
    return (
        lengthscales,
        nugget,
        float(unexplained @ unexplained) / (runs - count),
        root.T @ unexplained,
        solve_triangular(upper, explained),
        root,
        orthonormal,
        solve_triangular(upper, np.eye(count)),
    )
