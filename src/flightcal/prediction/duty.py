"""By how much duty cycles may be off, as the training window shows.

An error of a tenth of a kelvin moves a thermostat's switches, and no discrepancy that is added to temperatures tells
the heater. So what is learnt is the error of the duty cycle itself: in each orbit of the training window, telemetry
minus simulation. These are taken for independent draws of one normal distribution whose mean and variance are unknown,
so that the error over another window has Student's t distribution (Gelman et al. 2013, section 3.2).
"""

from __future__ import annotations

import math

import numpy as np

from ..simulator import FloatArray

FEWEST_ORBITS = 3
"""Of the training window: fewer do not tell how far errors differ."""
_KNOWN = 0.5  # share of an orbit's samples that must have a status


def duty_errors(observed: FloatArray, simulated: FloatArray, seconds: FloatArray, period: float) -> FloatArray:
    """Telemetry's duty cycle minus the simulation's in each whole orbit of a window [K, H].

    NaN where fewer than half of an orbit's samples have a status. observed: status [T, H], NaN where unknown;
    simulated: probability [T, H] of being on; seconds: [T] from the window's start; period: of the orbit, s.
    """
    if len(seconds) < 2:
        return np.empty((0, observed.shape[1]))
    step = float(np.median(np.diff(seconds)))
    orbits = math.floor((seconds[-1] - seconds[0] + step) / period)
    orbit = (seconds - seconds[0]) // period
    errors = np.full((orbits, observed.shape[1]), np.nan)
    for k, heater in np.ndindex(errors.shape):
        known = (orbit == k) & np.isfinite(observed[:, heater])
        if known.sum() >= _KNOWN * period / step:
            errors[k, heater] = (observed - simulated)[known, heater].mean()
    return errors


def draw_duty_errors(errors: FloatArray, orbits: float, count: int, rng: np.random.Generator) -> FloatArray:
    """Errors [count, H] of the duty cycles of a window that is `orbits` long, given those of orbits [K, H].

    Of a heater with fewer than `FEWEST_ORBITS` they are zero: nothing is known of them.
    """
    drawn = np.zeros((count, errors.shape[1]))
    for heater, column in enumerate(errors.T):
        own = column[np.isfinite(column)]
        if len(own) < FEWEST_ORBITS:
            continue
        scale = own.std(ddof=1) * math.sqrt(1 / len(own) + 1 / orbits)
        drawn[:, heater] = own.mean() + scale * rng.standard_t(len(own) - 1, count)
    return drawn
