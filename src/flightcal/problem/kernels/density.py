"""The ends of a log density's Program, and what links a window's theta with the problem's."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...compiled import inlined, kernel, run_rows

STOP, GRADIENTS, FAILURES, REASON, DRAWS = range(5)
"""Places in a density's `control`: whether it is to stop, counts, and why the last failure was one."""

DENSITY_NOT_FINITE = 3
"""A reason beside those of `forward`."""

STOPPED = -1e300
"""Log density everywhere once a chain is to stop: it ends a trajectory at once. nutpie panics when the point that a
chain stands on has an infinite density or no gradient, so it is finite and the gradient is not zero."""

DIVERGENCE = 1
"""Returned where there is no density; nutpie takes it as a divergence."""


class Place(NamedTuple):
    """Where the density is asked for, and what it is."""

    mean: Any
    """[d] z = mean + factor w"""
    factor: Any
    """[d, d]"""
    w: Any
    """[d]"""
    z: Any
    """[1, d], as the next three."""
    theta: Any
    slope: Any
    z_bar: Any
    """Derivative by z: first the prior's, then the windows' on top."""
    values: Any
    """[1 + 2 W] parts of the log density: the prior, and each window's temperatures and heater status."""
    value: Any
    """[1] their sum, and"""
    gradient: Any
    """[d] its derivative by w: the result."""


@kernel
def begin(call):
    """From w to z."""
    mean, factor, w, z = call.mean, call.factor, call.w, call.z
    for i in range(mean.shape[0]):
        total = mean[i]
        for j in range(mean.shape[0]):
            total += factor[i, j] * w[j]
        z[0, i] = total
    return 0


@kernel
def end(call):
    """The sum of the parts, and the derivative by w."""
    factor, z_bar, values, gradient = call.factor, call.z_bar, call.values, call.gradient
    value = values[0]
    for k in range(1, values.shape[0]):
        value += values[k]
    call.value[0] = value
    finite = np.isfinite(value)
    for j in range(factor.shape[1]):
        total = 0.0
        for i in range(factor.shape[0]):
            total += factor[i, j] * z_bar[0, i]
        gradient[j] = total
        finite = finite and np.isfinite(total)
    return 0 if finite else DENSITY_NOT_FINITE


# --- a window ---------------------------------------------------------------------------------------------------


class LinkCall(NamedTuple):
    """A window's theta [m] among the problem's [d], and what of the window is an entry of it."""

    place: Place
    columns: Any
    """[m] places in the problem's theta."""
    parameter: Any
    """[t] which of the entries that move a term moves,"""
    factor: Any
    """[t] place of its factor in the problem's theta,"""
    score: Any
    """[t] and of what it is multiplied by; -1: that is"""
    by: Any
    """[t] this number."""
    moving: Any
    """[p] entries that move, and of these, after the priors' transform:"""
    moving_z: Any
    """[1, p] and the next two."""
    moving_theta: Any
    moving_slope: Any
    theta: Any
    """[m] filled, and its derivative by z."""
    slope: Any
    simulated: Any
    """[k] entries that the simulator takes."""
    simulator_theta: Any
    """[1, k]"""
    simulator_bar: Any
    """[k]"""
    number: Any
    """[q] of the numbers of residuals and heaters' status [P] that are entries: which, and entries."""
    position: Any
    fixed_numbers: Any
    """[P] as the next two; these are copied where they are no entries."""
    numbers: Any
    numbers_bar: Any


@kernel
def move(call):
    """z of what moves: that of all windows, and what its terms add."""
    z, theta = call.place.z, call.place.theta
    for k in range(call.moving.shape[0]):
        place = call.columns[call.moving[k]]
        # The common value is not seen again where the window's own takes its place.
        if not np.isfinite(theta[0, place]):
            return DENSITY_NOT_FINITE
        call.moving_z[0, k] = z[0, place]
    for t in range(call.parameter.shape[0]):
        factor = theta[0, call.factor[t]]
        if not np.isfinite(factor):
            return DENSITY_NOT_FINITE
        call.moving_z[0, call.parameter[t]] += factor * _times(call, t)
    return 0


@inlined
def _times(call, t):
    """What the factor of a term is multiplied by."""
    return call.place.z[0, call.score[t]] if call.score[t] >= 0 else call.by[t]


@kernel
def gather(call):
    """A window's theta from the problem's, and to all that is an entry of it."""
    all_theta, all_slope, theta, slope = call.place.theta, call.place.slope, call.theta, call.slope
    for i in range(all_theta.shape[1]):
        if not np.isfinite(all_theta[0, i]):
            return DENSITY_NOT_FINITE
    for i in range(call.columns.shape[0]):
        theta[i], slope[i] = all_theta[0, call.columns[i]], all_slope[0, call.columns[i]]
    for k in range(call.moving.shape[0]):
        i = call.moving[k]
        theta[i], slope[i] = call.moving_theta[0, k], call.moving_slope[0, k]
    for i in range(theta.shape[0]):
        if not np.isfinite(theta[i]):
            return DENSITY_NOT_FINITE
    for k in range(call.simulated.shape[0]):
        call.simulator_theta[0, k] = theta[call.simulated[k]]
    for k in range(call.numbers.shape[0]):
        call.numbers[k] = call.fixed_numbers[k]
    for k in range(call.position.shape[0]):
        call.numbers[call.number[k]] = theta[call.position[k]]
    return 0


@kernel
def scatter(call):
    """The same backwards: to the derivative by the problem's z."""
    for k in range(call.simulated.shape[0]):
        _add(call, call.simulated[k], call.simulator_bar[k])
    for k in range(call.position.shape[0]):
        _add(call, call.position[k], call.numbers_bar[call.number[k]])
    return 0


@inlined
def _add(call, i, theta_bar):
    """What entry i of a window's theta adds."""
    place = call.place
    cotangent = call.slope[i] * theta_bar
    place.z_bar[0, call.columns[i]] += cotangent
    for t in range(call.parameter.shape[0]):
        if call.moving[call.parameter[t]] == i:
            factor = call.factor[t]
            place.z_bar[0, factor] += cotangent * _times(call, t) * place.slope[0, factor]
            if call.score[t] >= 0:
                place.z_bar[0, call.score[t]] += cotangent * place.theta[0, factor]


# --- what nutpie calls ------------------------------------------------------------------------------------------


class DensityCall(NamedTuple):
    """What `density` and `record` take."""

    rows: Any
    """[R, 2] of the Program."""
    control: Any
    place: Place


def density(dimensions, w, gradient, value, call):
    """Log density [1] and gradient [d] at w [d]; returns DIVERGENCE where there is none."""
    control, place = call.control, call.place
    if control[STOP] != 0:
        value[0] = STOPPED
        for j in range(place.w.shape[0]):
            gradient[j] = 1.0
        return 0
    control[GRADIENTS] += 1
    for j in range(place.w.shape[0]):
        place.w[j] = w[j]
    outcome = run_rows(call.rows)
    if outcome != 0:
        control[FAILURES] += 1
        control[REASON] = outcome
        return DIVERGENCE
    value[0] = place.value[0]
    for j in range(place.w.shape[0]):
        gradient[j] = place.gradient[j]
    return 0


def record(dimensions, expanded, w, copy, call):
    """Count a draw w [d], and copy it."""
    call.control[DRAWS] += 1
    for j in range(call.place.w.shape[0]):
        copy[j] = w[j]
    return 0
