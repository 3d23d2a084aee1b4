"""What of a window's residuals should be white if its noise is what the scenario says."""

from __future__ import annotations

import numpy as np

from ..probability import ResidualModel
from ..simulator import FloatArray


def noise_in_words(model: ResidualModel) -> list[str]:
    """What is assumed of each channel's noise [N], for people."""
    return [kind.words for kind in model.terms.kinds]


def innovations(
    model: ResidualModel, residual: FloatArray, seconds: FloatArray, numbers: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Of residuals [T, N], K, at `seconds` [T] what the noise with `numbers` [N, n] does not know from those before."""
    kinds = model.terms.kinds
    found = [kind.innovations(residual[:, k], seconds, numbers[k], rng) for k, kind in enumerate(kinds)]
    return np.stack(found, axis=1)
