"""A reduced model's error as a Gaussian process in time for each sensor, and its shapes on a window.

The error of a run has a constant part and one that varies; over held-out runs each has a standard deviation, and the
varying one a correlation time. The likelihood takes the error as a sum of shapes with independent weights: the
leading eigenvectors of the covariance at the window's samples.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..simulator.system import FloatArray
from .candidate import Errors

_KEPT = 0.995
"""Share of the variance that the shapes of a sensor hold; the rest is spread over them."""
_MOST_SHAPES = 40
"""Of a sensor on a window."""
_MATERN_AT_ONE_OVER_E = 2.146
"""(1 + a) exp(-a) = 1/e."""


@dataclass(frozen=True)
class SensorError:
    """Covariance offset^2 + deviation^2 (1 + a) exp(-a), a = 2.146 lag / correlation_time (Matern 3/2), of a sensor."""

    offset: float
    """K, standard deviation of what is constant in a run."""
    deviation: float
    """K, of what varies."""
    correlation_time: float
    """s, after which the correlation has fallen to 1/e."""

    def covariance(self, seconds: FloatArray) -> FloatArray:
        """[T, T] K^2 at times [T] s."""
        a = _MATERN_AT_ONE_OVER_E * np.abs(seconds[:, None] - seconds) / self.correlation_time
        return np.asarray(self.offset**2 + self.deviation**2 * (1.0 + a) * np.exp(-a))


def estimate(errors: Sequence[Errors], channels: Sequence[str], sampling: float) -> dict[str, SensorError]:
    """From errors on held-out runs, sampled every `sampling` s. Windows may have different lengths."""
    found = {}
    for k, channel in enumerate(channels):
        means = np.concatenate([item.temperatures[..., k].mean(axis=1) for item in errors])
        rest = [item.temperatures[..., k] - item.temperatures[..., k].mean(axis=1, keepdims=True) for item in errors]
        variance = float(np.mean(np.concatenate([(part**2).ravel() for part in rest])))
        found[channel] = SensorError(
            float(np.sqrt(np.mean(means**2))), math.sqrt(variance), _correlation_time(rest, variance, sampling)
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
    model: Mapping[str, SensorError], channels: Sequence[str], seconds: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The `error_basis` [T, N, r] K of a simulator sampled at `seconds` [T], and the weights' variances [r].

    Channels that the model does not name have no error. A sensor's mean variance over the samples is kept.
    """
    columns: list[tuple[int, FloatArray, float]] = []
    for n, channel in enumerate(channels):
        if channel not in model:
            continue
        values, vectors = np.linalg.eigh(model[channel].covariance(seconds))
        values, vectors = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
        held = np.cumsum(values)
        if held[-1] <= 0.0:
            continue
        count = min(int(np.searchsorted(held, _KEPT * held[-1])) + 1, _MOST_SHAPES, len(values))
        scale = held[-1] / held[count - 1]
        root = math.sqrt(len(seconds))
        columns += [(n, root * vectors[:, k], scale * values[k] / len(seconds)) for k in range(count)]
    basis = np.zeros((len(seconds), len(channels), len(columns)))
    for r, (n, shape, _) in enumerate(columns):
        basis[:, n, r] = shape
    return basis, np.array([variance for *_, variance in columns])


def left_out(model: SensorError, seconds: FloatArray) -> float:
    """Share of the variance that is spread over the shapes instead of having ones of its own."""
    values = np.sort(np.linalg.eigvalsh(model.covariance(seconds)))[::-1]
    held = np.cumsum(np.maximum(values, 0.0))
    if held[-1] <= 0.0:
        return 0.0
    count = min(int(np.searchsorted(held, _KEPT * held[-1])) + 1, _MOST_SHAPES, len(values))
    return float(1.0 - held[count - 1] / held[-1])
