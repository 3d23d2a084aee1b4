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
from functools import partial
from typing import Any

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.linalg.lapack import dtrtri
from scipy.optimize import minimize

from ..compiled import compiled_long
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
    """[r, S, S] symmetric: R on and below the diagonal, so that its columns too are read in order."""
    orthonormal: FloatArray
    """[r, S, q] Q."""
    upper_inverse: FloatArray
    """[r, q, q] U^-1."""

    def predict(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean [r] and variance [r] at x [d]."""
        mean, variance, *_ = self._evaluate(x, derivative=False)
        return mean, variance

    def linearise(self, x: FloatArray) -> tuple[FloatArray, FloatArray, Callable[[FloatArray, FloatArray], FloatArray]]:
        """Mean [r], variance [r] at x [d], and (cotangent of the mean [r], of the variance [r]) -> of x [d]."""
        mean, variance, by_correlation, by_trend, slopes = self._evaluate(x, derivative=True)
        return mean, variance, partial(self._cotangent, x, by_correlation, by_trend, slopes)

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
            a = np.tril(self.root[j]) @ matern(self.inputs, x, lengthscales)
            w = self.upper_inverse[j].T @ terms.T - self.orthonormal[j].T @ a
            found[j] = self.scale[j] * (matern(x, x, lengthscales) - a.T @ a + w.T @ w)
        return found

    def _projected(self, output: int) -> FloatArray:
        """(1 - Q Q^T) R [S, S]: its square is the precision of the runs' targets about an unknown trend."""
        root, orthonormal = np.tril(self.root[output]), self.orthonormal[output]
        return np.asarray(root - orthonormal @ (orthonormal.T @ root))

    def _evaluate(
        self, x: FloatArray, *, derivative: bool
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        """Mean [r], variance [r], half the variance's derivative by k [r, S] and h [r, q], and slopes [r, S] of k."""
        (outputs, runs), count = self.weights.shape, self.coefficients.shape[1]
        mean, variance, terms, correlation = np.empty(outputs), np.empty(outputs), np.empty(count), np.empty((2, runs))
        by_correlation, by_trend, slopes = (
            np.empty((outputs, runs)),
            np.empty((outputs, count)),
            np.empty((outputs, runs)),
        )
        _predict(
            np.ascontiguousarray(x, float), self.inputs, self.lengthscales, self.nugget, self.scale,
            self.weights, self.coefficients, self.root, self.orthonormal, self.upper_inverse, derivative,
            terms, correlation, mean, variance, by_correlation, by_trend, slopes,
        )  # fmt: skip
        return mean, variance, by_correlation, by_trend, slopes

    def _cotangent(
        self,
        x: FloatArray,
        by_correlation: FloatArray,
        by_trend: FloatArray,
        slopes: FloatArray,
        mean_bar: FloatArray,
        variance_bar: FloatArray,
    ) -> FloatArray:
        x_bar = np.zeros(len(x))
        mean_bar, variance_bar = (np.ascontiguousarray(bar, float) for bar in (mean_bar, variance_bar))
        _pull_back(
            np.ascontiguousarray(x, float), self.inputs, self.lengthscales, self.weights,
            self.coefficients, by_correlation, by_trend, slopes, mean_bar, variance_bar, x_bar,
        )  # fmt: skip
        return x_bar


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
    root = solve_triangular(factor, np.eye(runs), lower=True)
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
        np.tril(root) + np.tril(root, -1).T,
        orthonormal,
        solve_triangular(upper, np.eye(count)),
    )


@compiled_long
def _predict(
    x: Any, inputs: Any, lengthscales: Any, nugget: Any, scale: Any, weights: Any, coefficients: Any,
    root: Any, orthonormal: Any, upper_inverse: Any, derivative: Any,
    terms: Any, correlation: Any, mean: Any, variance: Any, by_correlation: Any, by_trend: Any, slopes: Any,
) -> None:  # fmt: skip
    runs, d = inputs.shape
    count = coefficients.shape[1]
    terms[0] = 1.0
    for i in range(d):
        terms[1 + i] = x[i]
    k, a = correlation[0], correlation[1]
    for output in range(weights.shape[0]):
        predicted = 0.0
        for s in range(runs):
            square = 0.0
            for i in range(d):
                difference = (x[i] - inputs[s, i]) / lengthscales[output, i]
                square += difference * difference
            distance = np.sqrt(5.0 * square)
            decay = np.exp(-distance)
            k[s] = (1.0 + distance + 5.0 / 3.0 * square) * decay
            # d k / d x_i is this times (x_i - input_i) / lengthscale_i^2.
            slopes[output, s] = -5.0 / 3.0 * (1.0 + distance) * decay
            predicted += k[s] * weights[output, s]
            a[s] = 0.0
        # Column by column: additions that run in lanes, where a row's sum would not.
        for s in range(runs):
            value = k[s]
            for m in range(s, runs):
                a[m] += value * root[output, s, m]
        w = by_trend[output]
        for j in range(count):
            predicted += terms[j] * coefficients[output, j]
            w[j] = 0.0
            for i in range(j + 1):
                w[j] += upper_inverse[output, i, j] * terms[i]
        explained = 0.0
        for s in range(runs):
            explained += a[s] * a[s]
            for j in range(count):
                w[j] -= orthonormal[output, s, j] * a[s]
        unknown_trend = 0.0
        for j in range(count):
            unknown_trend += w[j] * w[j]
        mean[output] = predicted
        # The nugget is there even on top of a run.
        variance[output] = scale[output] * (max(1.0 - explained + unknown_trend, 0.0) + nugget[output])
        if derivative:
            half = by_correlation[output]
            for s in range(runs):
                half[s] = 0.0
            for s in range(runs):
                value = a[s]
                for j in range(count):
                    value += orthonormal[output, s, j] * w[j]
                value *= -scale[output]
                for m in range(s + 1):
                    half[m] += value * root[output, s, m]
            for i in range(count):
                total = 0.0
                for j in range(i, count):
                    total += upper_inverse[output, i, j] * w[j]
                # In place: entry i is not read again.
                w[i] = scale[output] * total


@compiled_long
def _pull_back(
    x: Any, inputs: Any, lengthscales: Any, weights: Any, coefficients: Any, by_correlation: Any,
    by_trend: Any, slopes: Any, mean_bar: Any, variance_bar: Any, x_bar: Any,
) -> None:  # fmt: skip
    runs, d = inputs.shape
    for output in range(weights.shape[0]):
        for_mean, for_variance = mean_bar[output], 2.0 * variance_bar[output]
        for i in range(d):
            total = 0.0
            for s in range(runs):
                k_bar = for_mean * weights[output, s] + for_variance * by_correlation[output, s]
                total += k_bar * slopes[output, s] * (x[i] - inputs[s, i])
            x_bar[i] += total / (lengthscales[output, i] * lengthscales[output, i])
            x_bar[i] += for_mean * coefficients[output, 1 + i] + for_variance * by_trend[output, 1 + i]
