"""The likelihood where the simulator stands in for a slower one: its error has known shapes, which channels share.

The shapes' weights are normal given theta and integrated out, on top of noise and discrepancy (`likelihood`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..simulator import FloatArray
from .likelihood import Likelihood, Residuals, iid_log_likelihood, precision_times
from .shapes import shrinkage


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
    covariance, log_determinant = shrinkage(shapes.weighted_products(noise), variance)
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


def with_error_shapes(
    residuals: Residuals,
    observed: FloatArray,
    simulated: FloatArray,
    numbers: FloatArray,
    shapes: ErrorShapes,
    variance: FloatArray,
) -> tuple[float, FloatArray, FloatArray, FloatArray]:
    """`log_likelihood` with an error of the simulator in given shapes on top of noise and discrepancy, all normal.

    Returns the log likelihood and its derivatives by `simulated` [T, N], `numbers` [N, n] and `variance` [r]. With C
    the covariance that `log_likelihood` knows, its derivatives by the simulated are C^-1 times residuals, and those by
    the numbers are quadratic in residuals but for their value at zero: all that Woodbury's identity needs, at the cost
    of two likelihoods for each shape.
    """
    none = np.zeros(simulated.shape)
    residual, likelihood = observed - simulated, Likelihood(residuals, numbers.shape[1])

    def base(residual: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        return likelihood(residual, none, numbers)

    value, simulated_bar, _ = base(residual)
    products = np.einsum("tni,tnj->ij", shapes.basis, precision_times(residuals, shapes.basis, numbers))
    covariance, log_determinant = shrinkage(products, variance)
    projected = np.einsum("tnr,tn->r", shapes.basis, simulated_bar)
    weights = covariance @ projected
    value += 0.5 * float(projected @ weights) - 0.5 * log_determinant
    _, simulated_bar, numbers_bar = base(residual - shapes.basis @ weights)
    explained = products - products @ covariance @ products
    variance_bar = 0.5 * ((projected - products @ weights) ** 2 - np.diag(explained))
    # The trace that is missing: half of covariance times the shapes' products with the derivative of C^-1.
    eigenvalues, directions = np.linalg.eigh(covariance)
    at_zero = base(none)[2]
    for column in (directions * np.sqrt(np.maximum(eigenvalues, 0.0))).T:
        numbers_bar = numbers_bar + base(shapes.basis @ column)[2] - at_zero
    return value, simulated_bar, numbers_bar, variance_bar
