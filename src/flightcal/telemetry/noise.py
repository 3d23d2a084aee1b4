"""How noisy a channel's samples are, without a model of what they follow."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_RUGGED = 1.4826
"""Of a normal distribution, deviation over the median of absolute deviations."""


def quiet_noise(values: NDArray[np.float64]) -> float:
    """Standard deviation of samples [T] from what is smooth, in their unit; NaN where missing. Slower errors are none.

    Of neighbouring samples: a second difference of independent noise has six times its variance.
    """
    bends = np.diff(values[np.isfinite(values)], 2)
    return float(_RUGGED * np.median(np.abs(bends)) / np.sqrt(6.0)) if len(bends) else 0.0
