"""How large noise and unmodelled heat are, given what is linear around a point: the most probable sizes, and others."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf, dpotri
from scipy.optimize import minimize
from scipy.special import erf, gammaln, ndtr, ndtri, stdtr, stdtrit

from ..probability import Priors
from ..scenario import HalfNormal, HalfStudentT
from ..simulator import FloatArray, IntArray, in_parallel

_ITERATIONS = 100
_DIFFERENCE = 1e-3
"""Of a score."""
_LEAST, _MOST = -4.0, 30.0
"""Normal scores that a size may have: 4e-5 to 30 of its half-normal prior's scale."""
_LARGEST = 100.0
"""Of the scale of half of Student's t, what a size is at most."""
_TRAJECTORIES, _STEPS, _STEP = 2, 4, 0.4
"""Of a draw of sizes: about a quarter of a turn each, in deviations."""
_FLATTEST = 1.5
"""Deviation that a score has at most: that of the prior is one."""


@dataclass(frozen=True)
class Around:
    """What windows tell, linearised around a point, part by part; a part is a channel of a window.

    Of r = m + q unknowns: weights of heat in the kept directions, and z of what is simulated, from its prior's mean.
    """

    bases: tuple[FloatArray, ...]
    """Of each group [f, k] the kept directions."""
    sizes: Priors
    """Of noise and heat [s]."""
    free: IntArray
    """Of these, those that are free: the noise's shape is not."""
    noise: IntArray
    """[N] which is the deviation of each channel's noise; -1: it is known."""
    held: FloatArray
    """[N] K, and what it is then."""
    scale: IntArray
    """[m] which is each weight's prior deviation; -1: that is one."""
    mean: FloatArray
    """[q] of the prior of z, and"""
    deviation: FloatArray
    """[q] its deviations."""
    moving: IntArray
    """[q] places of these in z."""
    gram: FloatArray
    """[P, r, r] through noise of deviation one, as the next four."""
    moment: FloatArray
    """[P, r]"""
    squares: FloatArray
    """[P]"""
    samples: FloatArray
    """[P]"""
    determinant: FloatArray
    """[P]"""

    def precision(self, sizes: FloatArray) -> FloatArray:
        """[P] of each part's noise."""
        deviations = np.where(self.noise < 0, self.held, sizes[self.noise])
        return np.asarray(np.tile(deviations, len(self.squares) // len(deviations)) ** -2.0)

    def roots(self, sizes: FloatArray) -> FloatArray:
        """[r] prior deviations."""
        return np.concatenate([np.where(self.scale < 0, 1.0, sizes[self.scale]), self.deviation])

    def cost(self, score: FloatArray, sizes: FloatArray) -> tuple[float, FloatArray]:
        """Minus the log density of the free sizes at their normal scores, and its gradient; sizes: [s] the others."""
        u, stretch, log_stretch, by_stretch = self._of_score(score)
        z = self.sizes.to_z(sizes)
        z[self.free] = u
        at = self.sizes.at(z)
        precision, roots = self.precision(at.theta), self.roots(at.theta)
        gram, moment = np.tensordot(precision, self.gram, 1), precision @ self.moment
        inverse, log_determinant = _inverse(np.eye(len(roots)) + roots[:, None] * gram * roots)
        weights = inverse @ (roots * moment)
        total = precision @ self.squares + self.determinant.sum() - self.samples @ np.log(precision)
        value = -0.5 * (total + log_determinant - weights @ (roots * moment))
        mean = roots * weights
        second = roots[:, None] * inverse * roots + np.outer(mean, mean)
        left = self.squares - 2.0 * self.moment @ mean + self.gram.reshape(len(precision), -1) @ second.ravel()
        by_deviation = (precision * left - self.samples) * np.sqrt(precision)
        by_root = (weights**2 - 1.0 + np.diag(inverse)) / roots
        bar = np.zeros(len(z))
        channels = np.tile(self.noise, len(self.squares) // len(self.noise))
        np.add.at(bar, channels[channels >= 0], by_deviation[channels >= 0])
        of_weights = by_root[: len(self.scale)]
        np.add.at(bar, self.scale[self.scale >= 0], of_weights[self.scale >= 0])
        gradient = bar * at.slope + at.gradient
        return -(value + float(at.log_density) + log_stretch), -(gradient[self.free] * stretch + by_stretch)

    def log_density(self, sizes: FloatArray) -> float:
        """Of the telemetry and of sizes [s], up to a constant."""
        score = self._score(self.sizes.to_z(sizes)[self.free]).clip(_LEAST, self._most())
        return -self.cost(score, sizes)[0]

    def most_probable(self, sizes: FloatArray) -> FloatArray:
        """Sizes [s] with the free ones as the telemetry makes them most probable, in their normal scores."""
        return self._of_scores(self._most_probable(sizes)[None], sizes)[0]

    def _most_probable(self, sizes: FloatArray) -> FloatArray:
        """Normal scores [free]."""
        most = self._most()
        start = self._score(self.sizes.to_z(sizes)[self.free]).clip(_LEAST, most)
        options = {"maxiter": _ITERATIONS, "ftol": 1e-9}
        bounds = [(_LEAST, weights) for weights in most]
        found = minimize(self.cost, start, args=(sizes,), jac=True, method="L-BFGS-B", options=options, bounds=bounds)
        return np.asarray(found.x, float)

    def draw_sizes(self, sizes: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
        """Sizes [count, s] as the telemetry leaves them; sizes: [s] near the most probable ones.

        Drawn from the normal distribution of their scores around the mode, which is the prior where the telemetry
        tells nothing; each then moves by a few Hamiltonian trajectories, which correct what is not normal.
        """
        middle, most = self._most_probable(sizes), self._most()
        unit = _DIFFERENCE * np.eye(len(middle))
        slopes = [self.cost(middle + step, sizes)[1] - self.cost(middle - step, sizes)[1] for step in unit]
        hessian = np.stack(slopes) / (2.0 * _DIFFERENCE)
        eigenvalues, directions = np.linalg.eigh(0.5 * (hessian + hessian.T))
        root = directions * np.maximum(eigenvalues, _FLATTEST**-2.0) ** -0.5

        def potential(w: FloatArray) -> tuple[float, FloatArray]:
            score = middle + root @ w
            if (score < _LEAST).any() or (score > most).any():
                return np.inf, np.zeros_like(w)
            cost, gradient = self.cost(score, sizes)
            return cost, root.T @ gradient

        starts, rngs = rng.standard_normal((count, len(middle))), rng.spawn(count)
        drawn = in_parallel(lambda k: _moved(starts[k], potential, rngs[k]), count)
        return self._of_scores((middle + np.stack(drawn) @ root.T).clip(_LEAST, most), sizes)

    def _of_scores(self, scores: FloatArray, sizes: FloatArray) -> FloatArray:
        """Sizes [count, s] of scores [count, free], and the others as in sizes [s]."""
        z = np.tile(self.sizes.to_z(sizes), (len(scores), 1))
        z[:, self.free] = self._of_score(scores)[0]
        return self.sizes.to_theta(z)

    def _half(self) -> NDArray[np.bool_]:
        """[free] which have a half-normal prior or half of Student's t, whose z is a logarithm."""
        return np.array([isinstance(self.sizes.priors[k], HalfNormal | HalfStudentT) for k in self.free])

    def _freedom(self) -> FloatArray:
        """[free] degrees of freedom of Student's t; infinite: the prior is a half-normal, or another."""
        priors = [self.sizes.priors[k] for k in self.free]
        return np.array([p.degrees_of_freedom if isinstance(p, HalfStudentT) else np.inf for p in priors])

    def _most(self) -> FloatArray:
        """[free] the largest normal scores."""
        return np.where(np.isinf(self._freedom()), _MOST, self._score(np.full(len(self.free), np.log(_LARGEST))))

    def _score(self, u: FloatArray) -> FloatArray:
        """Normal scores of unconstrained u [free]: where that is a logarithm, of its prior; others are scores."""
        freedom, q = self._freedom(), np.exp(np.where(self._half(), u, 0.0))
        normal = np.isinf(freedom)
        # The tail above has the digits.
        above = np.where(normal, 2.0 * ndtr(-q), 2.0 * stdtr(np.where(normal, 1.0, freedom), -q))
        below = np.where(normal, erf(q / np.sqrt(2.0)), 1.0 - above)
        return np.where(self._half(), np.where(above < 0.5, -ndtri(above), ndtri(below)), u)

    def _of_score(self, score: FloatArray) -> tuple[FloatArray, FloatArray, float, FloatArray]:
        """u of scores [..., free], the slope, and the sum of its logarithms, to a constant, with its gradient."""
        half, freedom = self._half(), self._freedom()
        normal = np.isinf(freedom)
        nu = np.where(normal, 1.0, freedom)
        above = 0.5 * ndtr(-score)
        q = -np.where(normal, ndtri(above), stdtrit(nu, above))
        # Of the prior's density at q its logarithm, over the normal one's at zero, and minus q times the slope of that.
        at_zero = gammaln(0.5 * (nu + 1.0)) - gammaln(0.5 * nu) - 0.5 * np.log(0.5 * nu)
        log_density = np.where(normal, -0.5 * q**2, at_zero - 0.5 * (nu + 1.0) * np.log1p(q**2 / nu))
        falls = np.where(normal, q**2, (nu + 1.0) * q**2 / (nu + q**2))
        log_slope = np.where(half, -0.5 * score**2 - log_density - np.log(2.0 * q), 0.0)
        slope = np.exp(log_slope)
        by_score = np.where(half, (falls - 1.0) * slope - score, 0.0)
        return np.where(half, np.log(q), score), slope, float(log_slope.sum()), by_score

    def known_of_weights(self, sizes: FloatArray) -> tuple[FloatArray, float]:
        """Covariance [m, m] of the weights at sizes [s], all else known; and of how many the telemetry tells."""
        m = len(self.scale)
        roots = self.roots(sizes)[:m]
        gram = np.tensordot(self.precision(sizes), self.gram[:, :m, :m], 1)
        inverse, _ = _inverse(np.eye(m) + roots[:, None] * gram * roots)
        covariance = roots[:, None] * inverse * roots
        return covariance, float((covariance * gram).sum())

    def of_z(self, sizes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean [q] of z of what is simulated at sizes [s], and the Cholesky factor of its covariance [q, q]."""
        precision, roots = self.precision(sizes), self.roots(sizes)
        gram, moment = np.tensordot(precision, self.gram, 1), precision @ self.moment
        covariance = np.linalg.inv(np.eye(len(roots)) + roots[:, None] * gram * roots)
        mean, m = roots * (covariance @ (roots * moment)), len(self.scale)
        of_sizes = self.deviation[:, None] * covariance[m:, m:] * self.deviation
        return self.mean + mean[m:], np.asarray(np.linalg.cholesky(0.5 * (of_sizes + of_sizes.T)), float)

    def known_heat(self, sizes: FloatArray) -> FloatArray:
        """[q] deviations of z of what is simulated if the heat were known."""
        m = len(self.scale)
        gram = np.tensordot(self.precision(sizes), self.gram[:, m:, m:], 1)
        inner = np.eye(len(self.deviation)) + self.deviation[:, None] * gram * self.deviation
        return np.asarray(self.deviation * np.sqrt(np.diag(np.linalg.inv(inner))))

    def spread(
        self, z: FloatArray, sizes: FloatArray, drawn: FloatArray, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Draws z [S, d], which are those of the most probable sizes [s], as drawn sizes [k, s] spread them.

        Also the sizes [S, s] of each. Every draw moves as mean and covariance of the linearised posterior do from the
        most probable sizes to those that it is given.
        """
        which = rng.permutation(np.arange(len(z)) % len(drawn))
        centre, factor = self.of_z(sizes)
        standard = np.linalg.solve(factor, (z[:, self.moving] - centre).T).T
        spread = z.copy()
        for k, draw in enumerate(drawn):
            mean, wider = self.of_z(draw)
            here = np.ix_(which == k, self.moving)
            spread[here] = mean + standard[which == k] @ wider.T
        return spread, drawn[which]


def _moved(
    w: FloatArray, potential: Callable[[FloatArray], tuple[float, FloatArray]], rng: np.random.Generator
) -> FloatArray:
    """A draw w after Hamiltonian trajectories in a potential that is nearly |w|^2 / 2 (Neal 2011, section 5.3)."""
    value, slope = potential(w)
    for _ in range(_TRAJECTORIES):
        step = _STEP * rng.uniform(0.8, 1.2)
        momentum = rng.standard_normal(len(w))
        energy, at, here, downhill = value + 0.5 * momentum @ momentum, w, value, slope
        for _ in range(_STEPS):
            momentum = momentum - 0.5 * step * downhill
            at = at + step * momentum
            here, downhill = potential(at)
            momentum = momentum - 0.5 * step * downhill
        if np.isfinite(here) and np.log(rng.uniform()) < energy - here - 0.5 * momentum @ momentum:
            w, value, slope = at, here, downhill
    return w


def _inverse(matrix: FloatArray) -> tuple[FloatArray, float]:
    """Of a symmetric positive definite matrix [r, r], and the logarithm of its determinant."""
    # In LAPACK's order of rows and columns, so that nothing is copied.
    factor, _ = dpotrf(matrix.T, lower=True, overwrite_a=True)
    half, _ = dpotri(factor, lower=True)
    lower = np.tril(half)
    return lower + np.tril(half, -1).T, 2.0 * float(np.log(np.diag(factor)).sum())
