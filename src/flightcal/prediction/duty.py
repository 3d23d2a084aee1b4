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
_KNOWN = 0.5
"""Share of an orbit in which the status must be known."""
_WHOLE = 0.99
"""Share of an orbit that is taken for a whole one."""
_USUAL = 0.9
"""Share of a heater's samples that are followed by the next within its usual interval; after others it is unknown."""


def sampled_duty_cycle(simulated: FloatArray, observed: FloatArray) -> FloatArray:
    """Share of the samples with a known status in which heaters are simulated on [..., H]; NaN without any.

    This is what a measured duty cycle compares with: telemetry's gaps may lie where a heater is on. simulated: status
    or probability [..., T, H] of on; observed: status [T, H], NaN where unknown.
    """
    known = np.isfinite(observed)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.where(known, simulated, 0.0).sum(axis=-2) / known.sum(axis=0))


def unknown_share(observed: FloatArray, seconds: FloatArray, length: float) -> FloatArray:
    """Share of a window of this length (s) in which telemetry does not tell each heater's status [H].

    observed: status [T, H], NaN where unknown; seconds: [T] from the window's start.
    """
    return np.array([1.0 - min(_known_seconds(column, seconds).sum() / length, 1.0) for column in observed.T])


def _known_seconds(observed: FloatArray, seconds: FloatArray) -> FloatArray:
    """For how long each sample [T] tells a heater's status, s: up to the next that does, but no longer than usual."""
    known = np.flatnonzero(np.isfinite(observed))
    found = np.zeros(len(observed))
    if len(known) > 1:
        steps = np.diff(seconds[known])
        usual = float(np.quantile(steps, _USUAL, method="lower"))
        found[known] = np.minimum(np.append(steps, usual), usual)
    return found


def duty_errors(
    observed: FloatArray, simulated: FloatArray, seconds: FloatArray, period: float, length: float
) -> FloatArray:
    """Telemetry's duty cycle minus the simulation's in each whole orbit of a window [K, H].

    NaN where the status is known in less than half of an orbit. observed: status [T, H], NaN where unknown; simulated:
    probability [T, H] of being on; seconds: [T] from the window's start, at intervals of any kind; period: of the
    orbit, s; length: of the window, s.
    """
    orbits = math.floor(length / period + 1.0 - _WHOLE)
    orbit = seconds // period
    errors = np.full((orbits, observed.shape[1]), np.nan)
    for heater, column in enumerate(observed.T):
        lasting = _known_seconds(column, seconds)
        for k in range(orbits):
            known = (orbit == k) & np.isfinite(column)
            if lasting[known].sum() >= _KNOWN * period * (1.0 - 1e-9):
                errors[k, heater] = (column - simulated[:, heater])[known].mean()
    return errors


def draw_duty_errors(errors: FloatArray, orbits: float, count: int, rng: np.random.Generator) -> FloatArray:
    """Errors [count, H] of the duty cycles of a window that is `orbits` long, given those of orbits [K, H].

    Of a heater with fewer than `FEWEST_ORBITS` they are zero: nothing is known of them.
    """
    drawn = np.zeros((count, errors.shape[1]))
    for heater, column in enumerate(errors.T):
        known = column[np.isfinite(column)]
        if len(known) < FEWEST_ORBITS:
            continue
        scale = known.std(ddof=1) * math.sqrt(1 / len(known) + 1 / orbits)
        drawn[:, heater] = known.mean() + scale * rng.standard_t(len(known) - 1, count)
    return drawn
