"""Channels whose samples come in steps, as of a converter with few bits."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

_FEWEST = 20
_REPEATED = 0.1
"""Share of neighbouring samples that are equal where steps are not small beside the noise. Of white noise of a standard
deviation of two steps it is a seventh, of ten steps 3%."""


def quantisation_step(values: ArrayLike) -> float | None:
    """The usual step between the values that a channel takes, in its unit, where it is seen; None where it is not.

    values: [T], NaN where missing. A channel that never changes has none.
    """
    samples = np.asarray(values, float)
    samples = samples[np.isfinite(samples)]
    taken = np.unique(samples)
    if samples.size < _FEWEST or taken.size < 2 or np.mean(np.diff(samples) == 0.0) < _REPEATED:
        return None
    return float(np.median(np.diff(taken)))
