"""How probable the telemetry is, given simulated temperatures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..compiled import compiled
from ..simulator.system import FloatArray


def iid_log_likelihood(
    observed: FloatArray, simulated: FloatArray, noise: FloatArray
) -> tuple[float, FloatArray, FloatArray]:
    """Independent Gaussian noise, as published: y ~ N(y(theta), sigma^2) with one sigma per channel.

    observed: [T, N] K, NaN where there is no valid sample; simulated: [T, N] K; noise: [N] K.
    Returns the log likelihood and its derivatives by `simulated` [T, N] and by `noise` [N].
    """
    simulated_bar, noise_bar = np.empty(simulated.shape), np.empty(noise.shape)
    return iid_compiled(observed, simulated, noise, simulated_bar, noise_bar), simulated_bar, noise_bar


@compiled
def iid_compiled(observed, simulated, noise, simulated_bar, noise_bar):
    """`iid_log_likelihood` in compiled code: fills the derivatives, returns the value."""
    value = 0.0
    for k in range(noise.shape[0]):
        precision = 1.0 / noise[k]
        squares, samples = 0.0, 0
        for t in range(observed.shape[0]):
            scaled = (observed[t, k] - simulated[t, k]) * precision
            if np.isfinite(observed[t, k]):
                squares += scaled * scaled
                samples += 1
                simulated_bar[t, k] = scaled * precision
            else:
                simulated_bar[t, k] = 0.0
        value -= 0.5 * squares + samples * (np.log(noise[k]) + 0.5 * np.log(2.0 * np.pi))
        noise_bar[k] = (squares - samples) * precision
    return value


@dataclass(frozen=True)
class ErrorShapes:
    """Shapes in which the simulated temperatures may be off, at the valid samples of a window."""

    basis: FloatArray
    """[T, N, r] K, zero where there is no valid sample."""
    products: FloatArray
    """[N, r, r] of each channel's shapes with one another."""

    def weighted_products(self, noise: FloatArray) -> FloatArray:
        """Phi^T D^-1 Phi [r, r], with D the noise's variance."""
        return np.einsum("n,nij->ij", noise**-2.0, self.products)


def error_shapes(basis: FloatArray, valid: NDArray[np.bool_]) -> ErrorShapes:
    """Prepare a simulator's `error_basis` [T, N, r] for a window whose samples are `valid` [T, N]."""
    masked = np.where(valid[..., None], basis, 0.0)
    return ErrorShapes(masked, np.einsum("tni,tnj->nij", masked, masked))


def shrinkage(shapes: ErrorShapes, noise: FloatArray, variance: FloatArray) -> tuple[FloatArray, float]:
    """Posterior covariance [r, r] of the shapes' weights given residuals, and log det (I + V Phi^T D^-1 Phi).

    The inverse of the residuals' covariance is D^-1 - D^-1 Phi (this) Phi^T D^-1 (Woodbury), for variances of zero too.
    """
    root = np.sqrt(variance)
    factor = np.linalg.cholesky(np.eye(len(root)) + root[:, None] * shapes.weighted_products(noise) * root)
    half = np.linalg.solve(factor, np.diag(root))
    return half.T @ half, 2.0 * float(np.log(np.diag(factor)).sum())


def low_rank_log_likelihood(
    observed: FloatArray, simulated: FloatArray, noise: FloatArray, shapes: ErrorShapes, variance: FloatArray
) -> tuple[float, FloatArray, FloatArray, FloatArray]:
    """Gaussian noise, and an error of the simulator in given shapes: y ~ N(y(theta), D + Phi diag(variance) Phi^T).

    variance: [r] of the shapes' weights; the rest as in `iid_log_likelihood`, with D the noise's variance. Returns the
    log likelihood and its derivatives by `simulated` [T, N], `noise` [N] and `variance` [r]; the cost is that of one
    pass over Phi.
    """
    value, simulated_bar, noise_bar = iid_log_likelihood(observed, simulated, noise)
    projected = np.einsum("tnr,tn->r", shapes.basis, simulated_bar)  # Phi^T D^-1 (y - y(theta))
    covariance, log_determinant = shrinkage(shapes, noise, variance)
    weights = covariance @ projected  # expected, given the residuals
    value += 0.5 * float(projected @ weights) - 0.5 * log_determinant
    precision = noise**-2.0
    fitted = np.einsum("tnr,r->tn", shapes.basis, weights)
    # Phi^T (covariance of the residuals)^-1 Phi, and the same with the residuals.
    products = shapes.weighted_products(noise)
    explained = products - products @ covariance @ products
    variance_bar = 0.5 * ((projected - products @ weights) ** 2 - np.diag(explained))
    # By noise: -2 D^-3/2 times the derivative by the precision, of the two terms added to the iid ones.
    second = np.einsum("nij,ij->n", shapes.products, covariance + np.outer(weights, weights))
    crossed = np.einsum("tn,tn->n", fitted, simulated_bar)
    noise_bar = noise_bar + precision * second / noise - 2.0 * crossed / noise
    return value, simulated_bar - fitted * precision, noise_bar, variance_bar
