"""What a simulation lacks: known shapes with normal weights that are integrated out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..compiled import Row
from ..simulator import FloatArray
from .kernels.shapes import CloseCall, close


class WeightsPrior(Protocol):
    """The prior of a channel's weights: independent normal ones, with deviations from the last of its numbers."""

    def deviations(self, numbers: FloatArray) -> FloatArray:
        """Standard deviations [m]."""

    def first(self, count: int) -> WeightsPrior:
        """That of the first weights alone."""

    def rows(self, numbers: FloatArray, numbers_bar: FloatArray, weights: Weights, place: int) -> tuple[Row, Row]:
        """What fills the weights' prior in one of their windows, and what takes their posterior to the derivatives.

        Those of weights that windows share are counted in the first window alone.
        """


@dataclass(frozen=True)
class Shapes:
    """Shapes in a window of T samples, with weights of each channel's own."""

    channels: NDArray[np.bool_]
    """[N] which have them."""
    basis: FloatArray
    """[T, m] those whose weights are a window's own first, then those whose weights all windows share."""
    products: FloatArray
    """[N, m, m] of the basis with itself, at each channel's valid samples."""
    own: int
    prior: WeightsPrior

    @property
    def is_shared(self) -> bool:
        """Whether windows share weights."""
        return self.own < self.basis.shape[1]

    def alone(self) -> Shapes:
        """Those whose weights are the window's own."""
        own = self.own
        return replace(
            self, basis=np.ascontiguousarray(self.basis[:, :own]), products=self.products[:, :own, :own].copy(),
            prior=self.prior.first(own), channels=self.channels & (own > 0),
        )  # fmt: skip


def products_at(basis: FloatArray, valid: NDArray[np.bool_]) -> FloatArray:
    """Of a basis [T, m] with itself at each channel's valid samples [N, T], [N, m, m]."""
    return np.stack([np.einsum("ti,tj->ij", basis[own], basis[own]) for own in valid])


def shrinkage(products: FloatArray, variance: FloatArray) -> tuple[FloatArray, float]:
    """Posterior covariance [r, r] of the shapes' weights given residuals, and log det (I + V Phi^T C^-1 Phi).

    products: Phi^T C^-1 Phi [r, r]. The inverse of C + Phi V Phi^T is C^-1 - C^-1 Phi (this) Phi^T C^-1 (Woodbury), for
    variances [r] of zero too.
    """
    root = np.sqrt(variance)
    factor = np.linalg.cholesky(np.eye(len(root)) + root[:, None] * products * root)
    half = np.linalg.solve(factor, np.diag(root))
    return half.T @ half, 2.0 * float(np.log(np.diag(factor)).sum())


class Weights:
    """A channel's m weights in W windows: what these know of them, and their posterior; see `CloseCall`."""

    def __init__(self, windows: int, own: int, count: int) -> None:
        shared = count - own
        self.own = own
        self.root, self.slope, self.moment, self.weights, self.shrunk, self.mean = np.empty((6, windows, count))
        self.gram, self.inverse = np.empty((2, windows, count, count))
        self.scale, self.untold = np.empty((2, windows, 1))
        self.known = np.empty((windows, 3))
        self._upper = np.empty((count, count))
        self._messages = np.empty((windows + 1, shared, shared)), np.empty((windows + 1, shared))

    def close(self, gram: FloatArray, value: FloatArray) -> Row:
        """What makes the posterior of what the windows know; gram: [W, m, m]; value: [1] log likelihood."""
        return close.row(
            CloseCall(
                self.own, self.root, gram, self.scale, self.moment, self.known, self.weights, self.shrunk, self.mean,
                self.inverse, self.untold, value, self._upper, *self._messages,
            )
        )  # fmt: skip
