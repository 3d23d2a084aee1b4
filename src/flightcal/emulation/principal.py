"""Trajectories as a mean and a few principal shapes, with what is left out measured on runs that were left out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..simulator import FloatArray

_FOLDS = 10
_MOST_SHAPES = 25
_MOST_TAIL = 12
_TAIL_SHARE = 0.95
"""Of the truncation error's mean square, in the shapes that stand for it; they are enlarged to make up for the rest."""


@dataclass(frozen=True)
class PrincipalShapes:
    """temperatures ~ mean + shapes . coefficients, with an error of shapes `tail` and variances `tail_variance`."""

    mean: FloatArray
    """[T, N] K."""
    shapes: FloatArray
    """[T, N, r] K for a coefficient of one."""
    projector: FloatArray
    """[T, N, r] 1/K: coefficients of temperatures less their mean."""
    size: FloatArray
    """[r] root mean square of each shape over all outputs, in tolerances."""
    tail: FloatArray
    """[T, N, t] K."""
    tail_variance: FloatArray
    """[t]."""

    def during(self, window: slice) -> PrincipalShapes:
        """The same at these of the sample times."""
        at_times = {name: getattr(self, name)[window] for name in ("mean", "shapes", "projector", "tail")}
        return replace(self, **at_times)

    def coefficients(self, temperatures: FloatArray) -> FloatArray:
        """Coefficients [S, r] of trajectories [S, T, N]."""
        return np.einsum("stn,tnr->sr", temperatures - self.mean, self.projector)


def principal_shapes(temperatures: FloatArray, tolerance: FloatArray) -> PrincipalShapes:
    """Principal shapes of trajectories [S, T, N] K, as many as leave out at most `tolerance` [N] K of each channel.

    What they leave out (root mean square) is measured by cross-validation: shapes explain the runs that they were
    made from better than the next one. At most 25 shapes, and half as many as runs; what is then left out counts as
    error. Coefficients have a mean of zero and a variance of one over the runs.
    """
    runs, samples, channels = temperatures.shape
    mean = temperatures.mean(axis=0)
    scaled = ((temperatures - mean) / tolerance).reshape(runs, -1)
    left, sizes, right = np.linalg.svd(scaled, full_matrices=False)
    # Coordinates in the space of all runs: the folds' decompositions are then small.
    coordinates = left * sizes
    rank = int(np.count_nonzero(sizes > 1e-12 * sizes[0])) if sizes[0] > 0.0 else 0
    most = max(1, min(_MOST_SHAPES, runs // 2, rank))

    def truncation(count: int) -> FloatArray:
        return (_left_out(coordinates, count) @ right).reshape(temperatures.shape)

    low, high = 0, most
    while high - low > 1:
        middle = (low + high) // 2
        if (np.sqrt(np.mean(truncation(middle) ** 2, axis=(0, 1))) <= 1.0).all():
            high = middle
        else:
            low = middle
    kept = right[:high].T.reshape(samples, channels, high)
    deviation = np.maximum(sizes[:high], 1e-300) / np.sqrt(max(runs - 1, 1))
    tail, tail_variance = _tail(truncation(high).reshape(runs, -1))
    return PrincipalShapes(
        mean=mean,
        shapes=np.ascontiguousarray(kept * tolerance[:, None] * deviation),
        projector=kept / tolerance[:, None] / deviation,
        size=deviation / np.sqrt(samples * channels),
        tail=tail.reshape(samples, channels, -1) * tolerance[:, None],
        tail_variance=tail_variance,
    )


def _left_out(coordinates: FloatArray, count: int) -> FloatArray:
    """What the first `count` principal directions of the other folds leave of each run, [S, S]."""
    runs = len(coordinates)
    folds = np.arange(runs) % min(_FOLDS, runs)
    error = np.empty_like(coordinates)
    for fold in np.unique(folds):
        others = coordinates[folds != fold]
        mean = others.mean(axis=0)
        directions = np.linalg.svd(others - mean, full_matrices=False)[2][:count]
        centred = coordinates[folds == fold] - mean
        error[folds == fold] = centred - centred @ directions.T @ directions
    return error


def _tail(error: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Shapes [T N, t] of the truncation error [S, T N] and their variances [t], which add up to all of it."""
    _, sizes, right = np.linalg.svd(error, full_matrices=False)
    energy = sizes**2 / len(error)
    total = float(energy.sum())
    if total <= 0.0:
        return np.empty((error.shape[1], 0)), np.empty(0)
    count = min(_MOST_TAIL, 1 + int(np.searchsorted(np.cumsum(energy), _TAIL_SHARE * total)))
    return right[:count].T, energy[:count] * (total / energy[:count].sum())
