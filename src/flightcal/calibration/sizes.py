"""How large noise and unmodelled heat are, given what is linear around a point: the most probable sizes, and others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf, dpotri
from scipy.optimize import minimize
from scipy.special import erf, ndtr, ndtri

from ..probability import Priors
from ..problem import whitening
from ..scenario import HalfNormal, NutsSettings
from ..simulator import FloatArray, IntArray
from .nuts import sample

_ITERATIONS = 100
_DIFFERENCE = 1e-3
"""Of the logarithm of a size."""
_SIZES = 64
"""Draws of the sizes of noise and heat: each is that of many draws of the parameters."""
_FURTHEST = 8.0
"""Normal score of a size, beyond which rounding spoils it."""
_CHAINS, _WARMUP, _APART = 2, 100, 2
"""Of these: chains, draws before they count, and how many to one that is kept."""


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

    def cost(self, u: FloatArray, sizes: FloatArray) -> tuple[float, FloatArray]:
        """Minus the log density of the free sizes at unconstrained u, and its gradient; sizes: [s] the others."""
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
        return -(value + float(at.log_density)), -gradient[self.free]

    def most_probable(self, sizes: FloatArray) -> FloatArray:
        """Sizes [s] with the free ones as the telemetry makes them most probable."""
        start = self.sizes.to_z(sizes)
        options = {"maxiter": _ITERATIONS, "ftol": 1e-9}
        found = minimize(self.cost, start[self.free], args=(sizes,), jac=True, method="L-BFGS-B", options=options)
        start[self.free] = found.x
        return self.sizes.to_theta(start)

    def draw_sizes(self, sizes: FloatArray, count: int, seed: int) -> FloatArray:
        """Sizes [count, s] as the telemetry leaves them, drawn with NUTS; sizes: [s] the most probable ones."""
        z = self.sizes.to_z(sizes)

        def log_density(score: FloatArray) -> tuple[float, FloatArray]:
            if np.abs(score).max() > _FURTHEST:
                return -np.inf, np.zeros_like(score)
            u, slope, log_slope, by_score = self._of_score(score)
            cost, gradient = self.cost(u, sizes)
            return log_slope - cost, by_score - gradient * slope

        middle = self._score(z[self.free])
        unit = _DIFFERENCE * np.eye(len(middle))
        curved = [log_density(middle - step)[1] - log_density(middle + step)[1] for step in unit]
        around = whitening(middle, np.stack(curved) / (2.0 * _DIFFERENCE))
        settings = NutsSettings(chains=_CHAINS, draws=-(-count * _APART // _CHAINS), warmup=_WARMUP)
        found = sample(log_density, around, settings, seed)
        drawn = np.tile(z, (count, 1))
        drawn[:, self.free] = self._of_score(found.z.reshape(-1, len(middle))[_APART - 1 :: _APART][:count])[0]
        return self.sizes.to_theta(drawn)

    def _half(self) -> NDArray[np.bool_]:
        """[free] which have a half-normal prior."""
        return np.array([isinstance(self.sizes.priors[k], HalfNormal) for k in self.free])

    def _score(self, u: FloatArray) -> FloatArray:
        """Normal scores of unconstrained u [free]: of a half-normal prior that is a logarithm."""
        return np.where(self._half(), ndtri(erf(np.exp(u) / np.sqrt(2.0))), u)

    def _of_score(self, score: FloatArray) -> tuple[FloatArray, FloatArray, float, FloatArray]:
        """u of scores [..., free], the slope, and the sum of its logarithms, to a constant, with its gradient."""
        half = self._half()
        q = -ndtri(0.5 * ndtr(-score))
        log_slope = np.where(half, 0.5 * (q**2 - score**2) - np.log(2.0 * q), 0.0)
        slope = np.exp(log_slope)
        by_score = np.where(half, (q**2 - 1.0) * slope - score, 0.0)
        return np.where(half, np.log(q), score), slope, float(log_slope.sum()), by_score

    def of_z(self, sizes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean [q] of z of what is simulated at sizes [s], and the Cholesky factor of its covariance [q, q]."""
        precision, roots = self.precision(sizes), self.roots(sizes)
        gram, moment = np.tensordot(precision, self.gram, 1), precision @ self.moment
        covariance = np.linalg.inv(np.eye(len(roots)) + roots[:, None] * gram * roots)
        mean, m = roots * (covariance @ (roots * moment)), len(self.scale)
        own = self.deviation[:, None] * covariance[m:, m:] * self.deviation
        return self.mean + mean[m:], np.asarray(np.linalg.cholesky(0.5 * (own + own.T)), float)

    def known_heat(self, sizes: FloatArray) -> FloatArray:
        """[q] deviations of z of what is simulated if the heat were known."""
        m = len(self.scale)
        gram = np.tensordot(self.precision(sizes), self.gram[:, m:, m:], 1)
        inner = np.eye(len(self.deviation)) + self.deviation[:, None] * gram * self.deviation
        return np.asarray(self.deviation * np.sqrt(np.diag(np.linalg.inv(inner))))

    def spread(self, z: FloatArray, sizes: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Draws z [S, d], which are those of the most probable sizes, as the sizes' uncertainty spreads them.

        Also the sizes [S, s] of each. Every draw moves as mean and covariance of the linearised posterior do from the
        most probable sizes to those that it is given.
        """
        drawn = self.draw_sizes(sizes, min(_SIZES, len(z)), int(rng.integers(2**31)))
        which = rng.permutation(np.arange(len(z)) % len(drawn))
        centre, factor = self.of_z(sizes)
        standard = np.linalg.solve(factor, (z[:, self.moving] - centre).T).T
        spread = z.copy()
        for k, own in enumerate(drawn):
            mean, wider = self.of_z(own)
            here = np.ix_(which == k, self.moving)
            spread[here] = mean + standard[which == k] @ wider.T
        return spread, drawn[which]


def _inverse(matrix: FloatArray) -> tuple[FloatArray, float]:
    """Of a symmetric positive definite matrix [r, r], and the logarithm of its determinant."""
    factor, _ = dpotrf(matrix, lower=True)
    half, _ = dpotri(factor, lower=True)
    lower = np.tril(half)
    return lower + np.tril(half, -1).T, 2.0 * float(np.log(np.diag(factor)).sum())
