"""How large noise and unmodelled heat are, given what is linear around a point: the most probable sizes, and others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from ..probability import Priors
from ..simulator import FloatArray, IntArray

_ITERATIONS = 100
_DIFFERENCE = 1e-3
"""Of the logarithm of a size."""
_SIZES = 64
"""Draws of the sizes of noise and heat: each is that of many draws of the parameters."""
_FLATTEST = 1.5
"""Deviation that the logarithm of a size has at most: of the half-normal prior it is about one."""


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
        inverse = np.linalg.inv(np.linalg.cholesky(np.eye(len(roots)) + roots[:, None] * gram * roots))
        half = inverse @ (roots * moment)
        weights = inverse.T @ half
        total = precision @ self.squares + self.determinant.sum() - self.samples @ np.log(precision)
        value = -0.5 * (total - 2.0 * np.log(np.diag(inverse)).sum() - half @ half)
        mean, factor = roots * weights, roots[:, None] * inverse.T
        second = factor @ factor.T + np.outer(mean, mean)
        left = self.squares - 2.0 * self.moment @ mean + np.einsum("pij,ij->p", self.gram, second)
        by_deviation = (precision * left - self.samples) * np.sqrt(precision)
        by_root = (weights**2 - 1.0 + (inverse**2).sum(axis=0)) / roots
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

    def draw_sizes(self, sizes: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
        """Sizes [count, s] from the normal distribution around the most probable ones, in their logarithms."""
        z = self.sizes.to_z(sizes)
        slopes = []
        for k in range(len(self.free)):
            step = np.zeros(len(self.free))
            step[k] = _DIFFERENCE
            above, below = (self.cost(z[self.free] + sign * step, sizes)[1] for sign in (1.0, -1.0))
            slopes.append((above - below) / (2.0 * _DIFFERENCE))
        hessian = np.reshape(slopes, (len(self.free), len(self.free)))
        eigenvalues, directions = np.linalg.eigh(0.5 * (hessian + hessian.T))
        deviations = np.maximum(eigenvalues, _FLATTEST**-2.0) ** -0.5
        drawn = np.tile(z, (count, 1))
        drawn[:, self.free] += (rng.standard_normal((count, len(self.free))) * deviations) @ directions.T
        return self.sizes.to_theta(drawn)

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
        drawn = self.draw_sizes(sizes, min(_SIZES, len(z)), rng)
        which = rng.permutation(np.arange(len(z)) % len(drawn))
        centre, factor = self.of_z(sizes)
        standard = np.linalg.solve(factor, (z[:, self.moving] - centre).T).T
        spread = z.copy()
        for k, own in enumerate(drawn):
            mean, wider = self.of_z(own)
            here = np.ix_(which == k, self.moving)
            spread[here] = mean + standard[which == k] @ wider.T
        return spread, drawn[which]
