"""One number that stands for no reading."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...scenario import ICE_POINT
from ...simulator import FloatArray
from ...words import number
from ..samples import noise_of
from ..suspicion import Suspicion
from .broken import Broken

_FILLED, _FAR, _NOISES = 3, 5.0, 12.0
"""Times that one number comes, and K and deviations of the noise that it is away from the samples around it."""


def filled(channel: str, times: NDArray[np.datetime64], values: FloatArray, modelled: FloatArray) -> Broken | None:
    """One number that comes again and again, far from what is read before and after: it stands for no reading."""
    numbers, counts = np.unique(values, return_counts=True)
    for number_of in numbers[(counts >= _FILLED) & (counts < 0.5 * len(values))]:
        is_it = values == number_of
        others = np.flatnonzero(~is_it)
        place = np.clip(np.searchsorted(others, np.flatnonzero(is_it)), 1, len(others) - 1)
        before, after = values[others[place - 1]] - number_of, values[others[place]] - number_of
        height = np.where(before * after > 0.0, np.minimum(np.abs(before), np.abs(after)), 0.0)
        limit = max(
            _FAR, _NOISES * noise_of(values[others]), 4.0 * float(np.quantile(np.abs(np.diff(values[others])), 0.95))
        )
        if (height > limit).mean() > 0.8:
            suspicion = Suspicion(
                "filled", channel, f"{channel} has samples that are no readings",
                f"{number(float(number_of) - ICE_POINT, 4)} degC comes {int(is_it.sum())} times, each time "
                f"{number(float(np.median(height)), 2)} K away from the samples around it.",
                f"Write it as 'invalid' of {channel} in 'telemetry: channels'",
            )  # fmt: skip
            return Broken(suspicion, is_it)
    return None
