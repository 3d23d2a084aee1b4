"""How probable the telemetry is, given simulated temperatures."""

from __future__ import annotations

import numpy as np

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
    return _iid(observed, simulated, noise, simulated_bar, noise_bar), simulated_bar, noise_bar


@compiled
def _iid(observed, simulated, noise, simulated_bar, noise_bar):
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
