"""How probable the telemetry is, given simulated temperatures."""

from __future__ import annotations

import numpy as np

from ..simulator.system import FloatArray


def iid_log_likelihood(
    observed: FloatArray, simulated: FloatArray, noise: FloatArray
) -> tuple[float, FloatArray, FloatArray]:
    """Independent Gaussian noise, as published: y ~ N(y(theta), sigma^2) with one sigma per channel.

    observed: [T, N] K, NaN where there is no valid sample; simulated: [T, N] K; noise: [N] K.
    Returns the log likelihood and its derivatives by `simulated` [T, N] and by `noise` [N].
    """
    valid = np.isfinite(observed)
    scaled = np.where(valid, observed - simulated, 0.0) / noise
    samples = valid.sum(axis=0)
    squares = (scaled**2).sum(axis=0)
    value = -0.5 * squares.sum() - samples @ np.log(noise) - 0.5 * samples.sum() * np.log(2.0 * np.pi)
    return float(value), scaled / noise, (squares - samples) / noise
