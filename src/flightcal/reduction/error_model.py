"""A reduced model's error as a Gaussian process in time for each sensor, and its shapes on a window.

The error of a run has a constant part and one that varies; over held-out runs each has a standard deviation, and the
varying one a correlation time. The likelihood takes the error as a sum of shapes with independent weights: the
leading eigenvectors of the covariance at the window's samples.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..scenario import SimulatorError
from ..simulator import FloatArray

if TYPE_CHECKING:
    from .candidate import Errors

_KEPT = 0.95
"""Share of the variance that the shapes of a sensor hold; the rest, the quickest part, is spread over them."""
_MOST_SHAPES = 10
"""Of a sensor on a window: a likelihood costs as the square of their number. What is quicker looks like noise."""
_MATERN_AT_ONE_OVER_E = 2.146
"""(1 + a) exp(-a) = 1/e."""


def covariance(error: SimulatorError, seconds: FloatArray) -> FloatArray:
    """[T, T] K^2 at times [T] s: offset^2 + deviation^2 (1 + a) exp(-a), a = 2.146 lag / correlation_time.

    Matern 3/2; at a = 2.146 it has fallen to 1/e.
    """
    a = _MATERN_AT_ONE_OVER_E * np.abs(seconds[:, None] - seconds) / error.correlation_time
    return np.asarray(error.offset**2 + error.deviation**2 * (1.0 + a) * np.exp(-a))


def estimate(errors: Sequence[Errors], channels: Sequence[str], sampling: float) -> dict[str, SimulatorError]:
    """From errors on held-out runs, sampled every `sampling` s. Windows may have different lengths."""
    found = {}
    for k, channel in enumerate(channels):
        means = np.concatenate([item.temperatures[..., k].mean(axis=1) for item in errors])
        rest = [item.temperatures[..., k] - item.temperatures[..., k].mean(axis=1, keepdims=True) for item in errors]
        variance = float(np.mean(np.concatenate([(part**2).ravel() for part in rest])))
        found[channel] = SimulatorError.model_construct(
            offset=float(np.sqrt(np.mean(means**2))),
            deviation=math.sqrt(variance),
            correlation_time=_correlation_time(rest, variance, sampling),
        )
    return found


def _correlation_time(parts: Sequence[FloatArray], variance: float, sampling: float) -> float:
    """Where the autocorrelation, pooled over runs [S, T], first falls below 1/e; at least one sampling interval."""
    longest = min(part.shape[1] for part in parts) - 1
    before = 1.0
    for lag in range(1, longest):
        products = np.concatenate([(part[:, lag:] * part[:, :-lag]).ravel() for part in parts])
        now = float(products.mean()) / variance if variance > 0.0 else 0.0
        if now < math.exp(-1.0):
            return max(sampling * (lag - (math.exp(-1.0) - now) / (before - now)), sampling)
        before = now
    return sampling * longest


def shapes(
    model: Mapping[str, SimulatorError], channels: Sequence[str], seconds: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The `error_basis` [T, N, r] K of a simulator sampled at `seconds` [T], and the weights' variances [r].

    Channels that the model does not name have no error. A sensor's mean variance over the samples is kept.
    """
    columns: list[tuple[int, FloatArray, float]] = []
    for n, channel in enumerate(channels):
        if channel not in model or not len(seconds):
            continue
        values, vectors, held = _leading(model[channel], seconds)
        scale = 1.0 / (held * len(seconds)) if held > 0.0 else 0.0
        columns += [
            (n, math.sqrt(len(seconds)) * vectors[:, k], scale * values[k]) for k in range(len(values)) if scale > 0.0
        ]
    basis = np.zeros((len(seconds), len(channels), len(columns)))
    for r, (n, shape, _) in enumerate(columns):
        basis[:, n, r] = shape
    return basis, np.array([variance for *_, variance in columns])


def left_out(error: SimulatorError, seconds: FloatArray) -> float:
    """Share of the variance that is spread over the shapes instead of having ones of its own."""
    return 1.0 - _leading(error, seconds)[2] if error.offset + error.deviation > 0.0 else 0.0


def _leading(error: SimulatorError, seconds: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """The leading eigenvalues [k] and eigenvectors [T, k] of the covariance, and their share of the variance."""
    values, vectors = np.linalg.eigh(covariance(error, seconds))
    values, vectors = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
    total = float(values.sum())
    if total <= 0.0:
        return np.empty(0), np.empty((len(seconds), 0)), 0.0
    held = np.cumsum(values) / total
    count = min(int(np.searchsorted(held, _KEPT)) + 1, _MOST_SHAPES, len(values))
    return values[:count], vectors[:, :count], float(held[count - 1])
