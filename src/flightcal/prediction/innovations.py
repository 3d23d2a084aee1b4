"""What of a window's residuals should be white if its noise is what the scenario says."""

from __future__ import annotations

import numpy as np
from scipy.stats import truncnorm

from ..probability.noise import CORRELATED, CORRELATED_STUDENT, DEVIATION, ROUNDED, STEP, STUDENT, TIME, WHITE
from ..probability.residuals import ResidualModel
from ..simulator.system import FloatArray

_NOISE = {
    CORRELATED: "AR(1) noise",
    CORRELATED_STUDENT: "AR(1) noise with Student-t innovations",
    STUDENT: "independent Student-t noise",
    ROUNDED: "rounded iid noise",
}


def noise_in_words(model: ResidualModel) -> list[str]:
    """What is assumed of each channel's noise [N], for people."""
    return [_NOISE.get(int(kind), "iid noise") for kind in model.compiled.kinds]


def discrepancy_in_words(model: ResidualModel) -> list[str]:
    """The parts of each channel's discrepancy [N]: time, phase, both, or nothing."""
    parts = [name for name, part in (("time", model.time), ("phase", model.phase)) if part is not None]
    return [" and ".join(parts) if discrepant else "" for discrepant in model.compiled.discrepant]


def innovations(
    model: ResidualModel, residual: FloatArray, seconds: FloatArray, numbers: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Of residuals [T, N], K, at `seconds` [T] what the noise with `numbers` [N, 9] does not know from those before.

    Independent noise: the residuals. AR(1) noise: how far each is off what the ones before make expected (a Kalman
    filter), scaled to one standard deviation whatever the gap. Rounded telemetry: the noise before rounding, drawn
    within the step (the randomised quantile residuals of Dunn & Smyth 1996, J. Comput. Graph. Stat. 5, 236).
    """
    found = residual.copy()
    for k, kind in enumerate(model.compiled.kinds):
        if kind in (CORRELATED, CORRELATED_STUDENT):
            found[:, k] = _filtered(residual[:, k], seconds, *numbers[k, [DEVIATION, TIME, WHITE]])
        elif kind == ROUNDED:
            valid = np.isfinite(residual[:, k])
            scale, half = numbers[k, DEVIATION], 0.5 * numbers[k, STEP]
            low, high = (residual[valid, k] - half) / scale, (residual[valid, k] + half) / scale
            found[valid, k] = scale * truncnorm.rvs(low, high, random_state=rng)
    return found


def _filtered(residual: FloatArray, seconds: FloatArray, deviation: float, time: float, white: float) -> FloatArray:
    """Innovations [T] of an Ornstein-Uhlenbeck process beside white noise, in deviations of the first one's, K."""
    found = np.full(len(residual), np.nan)
    expected, variance, before = 0.0, 0.0, -np.inf
    for t in np.flatnonzero(np.isfinite(residual)):
        kept = np.exp(-(seconds[t] - before) / time)
        expected, variance = kept * expected, kept**2 * variance + (1.0 - kept**2) * deviation**2
        off, total = residual[t] - expected, variance + white**2
        found[t] = off * np.sqrt((deviation**2 + white**2) / total)
        gain = variance / total
        expected, variance, before = expected + gain * off, (1.0 - gain) * variance, seconds[t]
    return found
