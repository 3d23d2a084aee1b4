"""The ends of a log density's Program, and what links a window's theta with the problem's."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...compiled import inlined, kernel, run_rows
from ...probability.likelihood import log_likelihood_compiled
from ...probability.priors import evaluate
from ...probability.switching import status_compiled

STOP, GRADIENTS, FAILURES, REASON, DRAWS = range(5)
"""Places in a density's `control`: whether it is to stop, counts, and why the last failure was one."""

DENSITY_NOT_FINITE = 3
"""A reason beside the simulator's."""

STOPPED = -1e300
"""Log density everywhere once a chain is to stop: it ends a trajectory at once. nutpie panics when the point that a
chain stands on has an infinite density or no gradient, so it is finite and the gradient is not zero."""

DIVERGENCE = 1
"""Returned where there is no density; nutpie takes it as a divergence."""


class Coordinates(NamedTuple):
    """Where the density is asked for: w [d], z = mean + factor w, and theta with its slopes."""

    mean: Any
    factor: Any
    """[d, d]"""
    w: Any
    z: Any
    """[1, d], as the next three."""
    theta: Any
    slope: Any
    z_bar: Any
    """Cotangent of z: the prior's part, then the windows' too."""
    value: Any
    """[1] log density so far."""
    gradient: Any
    """[d] by w."""


class PriorCall(NamedTuple):
    """What `begin` takes."""

    at: Coordinates
    kinds: Any
    arguments: Any
    quantile: int
    """Address of the normal quantile function."""


@kernel
def begin(call):
    """From w to theta, and what the priors say."""
    at = call.at
    d, w, z, theta = at.mean.shape[0], at.w, at.z, at.theta
    for i in range(d):
        total = at.mean[i]
        for j in range(d):
            total += at.factor[i, j] * w[j]
        z[0, i] = total
    evaluate(call.kinds, call.arguments, call.quantile, z, theta, at.slope, at.z_bar, at.value)
    for i in range(d):
        if not np.isfinite(theta[0, i]):
            return DENSITY_NOT_FINITE
    return 0


class EndCall(NamedTuple):
    """What `end` takes."""

    at: Coordinates


@kernel
def end(call):
    """The gradient by w."""
    at = call.at
    factor, z_bar, gradient = at.factor, at.z_bar, at.gradient
    finite = np.isfinite(at.value[0])
    for j in range(factor.shape[1]):
        total = 0.0
        for i in range(factor.shape[0]):
            total += factor[i, j] * z_bar[0, i]
        gradient[j] = total
        finite = finite and np.isfinite(total)
    return 0 if finite else DENSITY_NOT_FINITE


# --- a window ---------------------------------------------------------------------------------------------------


class Link(NamedTuple):
    """Where a window's theta [m] comes from, and where its numbers come from in turn."""

    columns: Any
    """[m] place of each entry in the problem's theta."""
    drifting: Any
    """[p] entries that drift: in z they are z + tau xi, with a prior's transform of the window's own,"""
    deviation: Any
    """[m] places of tau and"""
    score: Any
    """[m] of xi in the problem's theta; -1: it does not drift."""
    kinds: Any
    """[p]"""
    arguments: Any
    quantile: int
    simulated: Any
    """Entries that the simulator takes, in its order."""
    channel: Any
    """Of the residuals' numbers [N, 9] that are entries: channels, columns and entries, [q] each."""
    column: Any
    position: Any
    numbers: Any
    """[N, 9] as they are where they are not inferred."""
    settings: Any
    """[P] of the likelihood of heaters' status."""
    setting: Any
    """Those that are inferred, and their entries."""
    setting_position: Any


class WindowMemory(NamedTuple):
    """What is found of a window."""

    theta: Any
    """[m], and its slopes by z."""
    slope: Any
    drifted: Any
    """[1, p] z of what drifts, and the next three."""
    drifted_theta: Any
    drifted_slope: Any
    unused: Any
    value: Any
    """[1], not used."""
    simulated: Any
    """[1, .] theta of the simulator."""
    simulated_bar: Any
    """[.]"""
    numbers: Any
    """[N, 9]"""
    numbers_bar: Any
    settings: Any
    """[P]"""
    settings_bar: Any


class LinkCall(NamedTuple):
    """What `gather` and `scatter` take."""

    at: Coordinates
    link: Link
    memory: WindowMemory


@kernel
def gather(call):
    """A window's theta from the problem's, and the numbers that are entries of it."""
    link, memory, at = call.link, call.memory, call.at
    z, theta = at.z, at.theta
    for i in range(link.columns.shape[0]):
        memory.theta[i] = theta[0, link.columns[i]]
        memory.slope[i] = at.slope[0, link.columns[i]]
    for k in range(link.drifting.shape[0]):
        i = link.drifting[k]
        memory.drifted[0, k] = z[0, link.columns[i]] + theta[0, link.deviation[i]] * z[0, link.score[i]]
    evaluate(
        link.kinds, link.arguments, link.quantile,
        memory.drifted, memory.drifted_theta, memory.drifted_slope, memory.unused, memory.value,
    )  # fmt: skip
    for k in range(link.drifting.shape[0]):
        memory.theta[link.drifting[k]] = memory.drifted_theta[0, k]
        memory.slope[link.drifting[k]] = memory.drifted_slope[0, k]
    for k in range(link.simulated.shape[0]):
        memory.simulated[0, k] = memory.theta[link.simulated[k]]
    for k in range(link.numbers.shape[0]):
        for j in range(link.numbers.shape[1]):
            memory.numbers[k, j] = link.numbers[k, j]
    for k in range(link.position.shape[0]):
        memory.numbers[link.channel[k], link.column[k]] = memory.theta[link.position[k]]
    for k in range(link.settings.shape[0]):
        memory.settings[k] = link.settings[k]
    for k in range(link.setting.shape[0]):
        memory.settings[link.setting[k]] = memory.theta[link.setting_position[k]]
    return 0


@kernel
def scatter(call):
    """The derivative of `gather` backwards, onto the cotangent of z."""
    link, memory, at = call.link, call.memory, call.at
    for k in range(link.simulated.shape[0]):
        _pull_back(at, link, memory, link.simulated[k], memory.simulated_bar[k])
    for k in range(link.position.shape[0]):
        bar = memory.numbers_bar[link.channel[k], link.column[k]]
        _pull_back(at, link, memory, link.position[k], bar)
    for k in range(link.setting.shape[0]):
        _pull_back(at, link, memory, link.setting_position[k], memory.settings_bar[link.setting[k]])
    return 0


@inlined
def _pull_back(at, link, memory, i, theta_bar):
    """The cotangent of entry i of a window's theta."""
    cotangent = memory.slope[i] * theta_bar
    at.z_bar[0, link.columns[i]] += cotangent
    if link.score[i] >= 0:
        tau, xi = link.deviation[i], link.score[i]
        at.z_bar[0, xi] += cotangent * at.theta[0, tau]
        at.z_bar[0, tau] += cotangent * at.z[0, xi] * at.slope[0, tau]


class LikelihoodCall(NamedTuple):
    """What `likelihood` takes."""

    residuals: Any
    memory: Any
    observed: Any
    outputs: Any
    numbers: Any
    temperatures_bar: Any
    numbers_bar: Any
    value: Any


@kernel
def likelihood(call):
    """Add the log likelihood of the temperatures."""
    call.value[0] += log_likelihood_compiled(
        call.residuals, call.memory, call.observed, call.outputs.temperatures[0], call.numbers,
        call.temperatures_bar, call.numbers_bar,
    )  # fmt: skip
    return 0


class StatusCall(NamedTuple):
    """What `status` takes."""

    data: Any
    outputs: Any
    work: Any
    switches_bar: Any
    value: Any


@kernel
def status(call):
    """Add the log likelihood of the heaters' status."""
    outputs = call.outputs
    switches = outputs.switches[0]
    call.value[0] += status_compiled(
        call.data, outputs.switch_time[:switches], outputs.switch_heater[:switches], outputs.switch_on[:switches],
        outputs.status[0], call.work, call.switches_bar[:switches],
    )  # fmt: skip
    return 0


# --- what nutpie calls ------------------------------------------------------------------------------------------


class DensityCall(NamedTuple):
    """What `density` and `record` take."""

    rows: Any
    """[R, 2] the Program."""
    control: Any
    w: Any
    """[d]"""
    value: Any
    gradient: Any


def density(dimensions, w, gradient, value, call):
    """Log density and gradient [d] at w [d]; another number than 0 where there is none."""
    control = call.control
    d = call.w.shape[0]
    if control[STOP] != 0:
        value[0] = STOPPED
        for j in range(d):
            gradient[j] = 1.0
        return 0
    control[GRADIENTS] += 1
    for j in range(d):
        call.w[j] = w[j]
    outcome = run_rows(call.rows)
    if outcome != 0:
        control[FAILURES] += 1
        control[REASON] = outcome
        return DIVERGENCE
    value[0] = call.value[0]
    for j in range(d):
        gradient[j] = call.gradient[j]
    return 0


def record(dimensions, expanded, w, copy, call):
    """Count a draw, and copy it."""
    call.control[DRAWS] += 1
    for j in range(call.w.shape[0]):
        copy[j] = w[j]
    return 0
