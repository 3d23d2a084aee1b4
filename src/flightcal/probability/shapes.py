"""What a simulation lacks: known shapes with normal weights that are integrated out.

There are those of a discrepancy (`discrepancy`) and those of the error of a simulator that stands in for another.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..compiled import Row
from ..simulator import FloatArray, IntArray
from .discrepancy import MaternPrior
from .kernels.shapes import CloseCall, SpreadCall, close, pull_back_spread, spread


@dataclass(frozen=True)
class Shapes:
    """Shapes in a window of T samples: a discrepancy's, with weights of each channel's own, and a simulator's error's.

    The error is that of a surrogate; channels share its weights, and their variances may depend on theta.
    """

    channels: NDArray[np.bool_]
    """[N] which have a discrepancy."""
    basis: FloatArray
    """[T, m] of the discrepancy, whose weights all windows share."""
    prior: MaternPrior
    errors: FloatArray = field(default_factory=lambda: np.empty((0, 0, 0)))
    """[T, N, r] K, of the simulator's error."""

    @cached_property
    def seen(self) -> NDArray[np.bool_]:
        """[N, r] whether a channel has a shape of the error."""
        return np.asarray(self.errors.any(axis=0))

    @cached_property
    def between(self) -> IntArray:
        """Shapes of the error that more than one channel has."""
        return np.flatnonzero(self.seen.sum(axis=0) > 1)

    def error_of(self, k: int) -> IntArray:
        """Shapes of the error of a channel: those that it alone has, and last `between`, if it has any."""
        if not self.errors.shape[2]:
            return self.between
        alone = np.flatnonzero(self.seen[k] & (self.seen.sum(axis=0) == 1))
        return np.concatenate([alone, self.between]) if self.seen[k].any() else alone

    def of_channel(self, k: int) -> FloatArray:
        """All shapes of a channel, [T, M]: of the discrepancy, and `error_of`."""
        which = self.error_of(k)
        return np.concatenate([self.basis, self.errors[:, k, which]], axis=1) if len(which) else self.basis


def no_shapes(samples: int, channels: int) -> Shapes:
    """None, in a window of so many samples and channels."""
    return Shapes(np.zeros(channels, bool), np.empty((samples, 0)), MaternPrior(np.empty(0), 1.5))


class Weights:
    """M weights of each of P parts, which are channels of windows: what these know of them, and their posterior.

    See `CloseCall`.
    """

    def __init__(self, private: int, shared: IntArray, count: int) -> None:
        """shared: [P, c] places of what a part's last c weights are among those that parts share."""
        parts, total = len(shared), int(shared.max(initial=-1)) + 1
        self.own, self.count, self._shared = private, count, shared
        self.root, self.slope, self.moment, self.weights, self.shrunk, self.mean = np.zeros((6, parts, count))
        self.gram, self.inverse = np.empty((2, parts, count, count))
        self.scale, self.untold = np.empty((2, parts, 1))
        self.known = np.empty((parts, 3))
        self._work = (
            np.empty((count, count)), np.empty((*shared.shape, shared.shape[1])), np.empty(shared.shape),
            np.empty((total, total)), np.empty(total), np.empty(total, np.int64),
        )  # fmt: skip

    def close(self, gram: FloatArray, value: FloatArray) -> Row:
        """What makes the posterior of what the parts know; gram: [P, M, M]; value: [1] log likelihood."""
        return close.row(
            CloseCall(
                self.own, self._shared, self.root, gram, self.scale, self.moment, self.known, self.weights,
                self.shrunk, self.mean, self.inverse, self.untold, value, *self._work,
            )
        )  # fmt: skip

    def of_discrepancy(
        self, part: int, prior: MaternPrior, numbers: FloatArray, numbers_bar: FloatArray, *, counted: int
    ) -> tuple[Row, Row]:
        """What fills the prior of a part's first weights, and what takes their posterior to the derivatives.

        counted: of how many of them; what windows share is counted in one of them.
        """
        places = (array[part] for array in (self.root, self.slope, self.weights, self.shrunk))
        return prior.rows(numbers, numbers_bar, *places, counted=counted)

    def of_errors(
        self, part: int, first: int, which: IntArray, variance: FloatArray, variance_bar: FloatArray, *, counted: int
    ) -> tuple[Row, Row]:
        """The same of a simulator's error, of whose weights, of a variance [r], the part has some from `first` on."""
        root, weights, shrunk = self.root[part], self.weights[part], self.shrunk[part]
        call = SpreadCall(variance, which, first, counted, root, weights, shrunk, variance_bar)
        return spread.row(call), pull_back_spread.row(call)
