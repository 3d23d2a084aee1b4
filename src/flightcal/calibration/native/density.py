"""The log density of a thermal network, and its gradient, as one C function.

Nothing of Python is in it: chains run side by side without a common lock, and no time goes into handing arrays to
compiled functions. What it reads and works in is stored once for each chain.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numba import types

from ...compiled import Program, callback, inlined, run_rows, store, stored
from ...probability.kernels.switching import NO_STATUS, StatusCall, StatusData, StatusWork, status_work, switching
from ...probability.likelihood import Residuals, likelihood_calls, window_memory
from ...probability.priors import Priors
from ...simulator import NetworkSimulator, simulate
from ...simulator.forward import FINISHED, NOT_FINITE, TOO_MANY_SWITCHES
from ...simulator.system import FloatArray
from ...simulator.whole import Window, Workspace, linearise_compiled, make_window, make_workspace, simulate_compiled
from ..whitening import Whitening

FOLDERS = [Path(file).parent for file in (__file__, simulate.__file__)]
"""Of all code that is compiled into the functions."""

STOP, GRADIENTS, FAILURES, REASON, DRAWS = range(5)
"""Places in a density's `control`: whether it is to stop, counts, and why the last failure was one."""

DENSITY_NOT_FINITE = 3
REASONS = {
    NOT_FINITE: "a temperature is not finite",
    TOO_MANY_SWITCHES: "heaters switch too often: a thermostat chatters",
    DENSITY_NOT_FINITE: "the log density or its gradient is not finite",
}

STOPPED = -1e300
"""Log density everywhere once a chain is to stop: it ends a trajectory at once. nutpie panics when the point that a
chain stands on has an infinite density or no gradient, so it is finite and the gradient is not zero."""

DIVERGENCE = 1
"""Returned where there is no density; nutpie takes it as a divergence."""


class Posterior(NamedTuple):
    """What the density is made of; only read."""

    window: Window
    simulated: Any
    """Positions in theta of what the simulator takes."""
    channel: Any
    """Of the residuals' numbers that are entries of theta: channels, columns and positions in theta, [q] each."""
    column: Any
    position: Any
    numbers: Any
    """[N, n] of the residuals, where they are not inferred."""
    settings: Any
    """[P] of the likelihood of heaters' status; empty: there is none."""
    setting: Any
    """Those that are inferred, and their positions in theta."""
    setting_position: Any
    mean: Any
    """[d] z where w is zero."""
    factor: Any
    """[d, d] z = mean + factor w."""


class _Call(NamedTuple):
    posterior: Posterior
    work: Workspace
    control: Any
    z: Any
    """[1, d], as the next three."""
    theta: Any
    slope: Any
    prior_gradient: Any
    prior_density: Any
    """[1]"""
    numbers: Any
    """[N, n], as the next."""
    numbers_bar: Any
    status: StatusWork
    priors: Any
    """[R, 2] rows of a `Program`, as the next two."""
    likelihood: Any
    switching: Any
    likelihood_value: Any
    """[1], as the next."""
    switching_value: Any


@dataclass(frozen=True)
class NativeDensity:
    """A density of its own memory, for one thread at a time."""

    function: Any
    """(d, w, gradient, log density, `address`) -> 0, or another number where there is no density."""
    record: Any
    """(d, d, w, copy of w, `address`) -> 0; called for every draw."""
    address: int
    control: Any
    kept: Any
    """What lies at the address, and the arrays that it refers to."""
    dimensions: int

    def __call__(self, w: FloatArray) -> tuple[float, FloatArray]:
        """Log density at w [d] and its gradient [d]; (-inf, 0) where there is none."""
        w, gradient, value = np.ascontiguousarray(w, float), np.zeros(self.dimensions), np.empty(1)
        if _c_function(self.function.address)(
            self.dimensions, w.ctypes.data, gradient.ctypes.data, value.ctypes.data, self.address
        ):
            return -np.inf, np.zeros(self.dimensions)
        return float(value[0]), gradient

    @property
    def draws(self) -> int:
        """Draws recorded."""
        return int(self.control[DRAWS])

    @property
    def gradients(self) -> int:
        """Evaluations."""
        return int(self.control[GRADIENTS])

    @property
    def failures(self) -> int:
        """Evaluations without a density."""
        return int(self.control[FAILURES])

    @property
    def last_failure(self) -> str | None:
        """Why the last of these had none."""
        return REASONS.get(int(self.control[REASON]))

    def stop(self) -> None:
        """From now on every trajectory ends at once."""
        self.control[STOP] = 1


def native_density(
    simulator: NetworkSimulator,
    priors: Priors,
    observed: FloatArray,
    residuals: Residuals,
    numbers: FloatArray,
    places: tuple[Any, Any, Any, Any],
    coordinates: Whitening,
    status: tuple[StatusData, Any, Any, Any] | None = None,
) -> NativeDensity:
    """The log density at w, up to a constant.

    observed: [T, N] K; numbers: [N, n] of the residuals, anything where one is inferred; places: positions in theta of
    what the simulator takes, and channels, columns and positions in theta of the numbers that are inferred; status:
    what is measured of the heaters, settings [P], which of them are inferred, and the positions in theta of these.
    """
    d = len(priors.names)
    simulated, channel, column, position = (np.array(place, np.int64) for place in places)
    data, settings, *rest = status or (NO_STATUS, np.empty(0), np.empty(0), np.empty(0))
    setting, setting_position = (np.array(part, np.int64) for part in rest)
    posterior = Posterior(
        make_window(simulator), simulated, channel, column, position, np.array(numbers), np.array(settings), setting,
        setting_position, np.array(coordinates.mean), np.array(coordinates.factor, order="C"),
    )  # fmt: skip
    control, row = np.zeros(5, np.int64), np.empty((4, 1, d))
    work = make_workspace(simulator)
    outputs, density = work.outputs, np.empty(1)
    memory = window_memory(
        np.array(observed, order="C"), outputs.temperatures[0], np.empty_like(numbers), work.temperatures_bar
    )
    of_status = status_work(data, len(settings), len(work.switches_bar))
    switched = StatusCall(
        data, of_status, outputs.switches, outputs.switch_time, outputs.switch_heater, outputs.switch_on,
        outputs.status[0], work.switches_bar, np.empty(1),
    )  # fmt: skip
    programs = (
        Program([priors.row(row[0], row[1], row[2], row[3], density)]),
        Program(likelihood_calls([residuals], [memory]).rows),
        Program([switching.row(switched)] if len(settings) else []),
    )
    call = _Call(
        posterior, work, control, row[0], row[1], row[2], row[3], density, memory.numbers, memory.numbers_bar,
        of_status, programs[0].table, programs[1].table, programs[2].table, memory.value, switched.value,
    )  # fmt: skip
    stored_call = store(call)
    density_function, record = c_functions(_density, _record)
    kept = (stored_call, call, programs)
    return NativeDensity(density_function, record, stored_call.ctypes.data, call.control, kept, d)


@cache
def c_functions(density: Any, record: Any) -> tuple[Any, Any]:
    """Both as C functions, of what is stored when they are first asked for."""
    double, size = types.CPointer(types.double), types.uint64
    return (
        callback(density, types.int64(size, double, double, double, types.voidptr), FOLDERS),
        callback(record, types.int64(size, size, double, double, types.voidptr), FOLDERS),
    )


@cache
def _c_function(address: int) -> Any:
    pointers = [ctypes.c_void_p] * 4
    return ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_uint64, *pointers)(address)


@inlined
def unwhiten(mean, factor, w, z):
    """z [d] = mean + factor w."""
    for i in range(mean.shape[0]):
        total = mean[i]
        for j in range(mean.shape[0]):
            total += factor[i, j] * w[j]
        z[i] = total


@inlined
def pull_back_to_whitened(factor, z_bar, gradient):
    """gradient [d] = factor^T z_bar; whether it is finite."""
    finite = True
    for j in range(factor.shape[1]):
        total = 0.0
        for i in range(factor.shape[0]):
            total += factor[i, j] * z_bar[i]
        gradient[j] = total
        finite = finite and np.isfinite(total)
    return finite


@inlined
def _log_density(posterior, work, call, w, gradient, value):
    """Fill gradient [d] and value [1]; returns FINISHED, or why it could not."""
    d = posterior.mean.shape[0]
    finite = True
    unwhiten(posterior.mean, posterior.factor, w, call.z[0])
    run_rows(call.priors)
    for i in range(d):
        finite = finite and np.isfinite(call.theta[0, i])
    if not finite:
        return DENSITY_NOT_FINITE
    for k in range(posterior.simulated.shape[0]):
        work.theta[0, k] = call.theta[0, posterior.simulated[k]]
    outcome = simulate_compiled(posterior.window, work)
    if outcome != FINISHED:
        return outcome
    for k in range(posterior.numbers.shape[0]):
        for j in range(posterior.numbers.shape[1]):
            call.numbers[k, j] = posterior.numbers[k, j]
    for k in range(posterior.position.shape[0]):
        call.numbers[posterior.channel[k], posterior.column[k]] = call.theta[0, posterior.position[k]]
    run_rows(call.likelihood)
    value[0] = call.prior_density[0] + call.likelihood_value[0]
    if posterior.settings.shape[0] > 0:
        for k in range(posterior.settings.shape[0]):
            call.status.settings[k] = posterior.settings[k]
        for k in range(posterior.setting.shape[0]):
            call.status.settings[posterior.setting[k]] = call.theta[0, posterior.setting_position[k]]
        run_rows(call.switching)
        value[0] += call.switching_value[0]
    linearise_compiled(posterior.window, work)
    # From here on z holds the cotangent of z.
    for i in range(d):
        call.z[0, i] = call.prior_gradient[0, i]
    for k in range(posterior.simulated.shape[0]):
        i = posterior.simulated[k]
        call.z[0, i] += call.slope[0, i] * work.theta_bar[k]
    for k in range(posterior.position.shape[0]):
        i = posterior.position[k]
        call.z[0, i] += call.slope[0, i] * call.numbers_bar[posterior.channel[k], posterior.column[k]]
    for k in range(posterior.setting.shape[0]):
        i = posterior.setting_position[k]
        call.z[0, i] += call.slope[0, i] * call.status.settings_bar[posterior.setting[k]]
    finite = pull_back_to_whitened(posterior.factor, call.z[0], gradient) and np.isfinite(value[0])
    return FINISHED if finite else DENSITY_NOT_FINITE


def _density(dimensions, w, gradient, value, address):
    call = stored(address)
    posterior, work, control = call.posterior, call.work, call.control
    d = posterior.mean.shape[0]
    if control[STOP] != 0:
        value[0] = STOPPED
        for j in range(d):
            gradient[j] = 1.0
        return 0
    control[GRADIENTS] += 1
    outcome = _log_density(posterior, work, call, w, gradient, value)
    if outcome != FINISHED:
        control[FAILURES] += 1
        control[REASON] = outcome
        return DIVERGENCE
    return 0


def _record(dimensions, expanded, w, copy, address):
    call = stored(address)
    call.control[DRAWS] += 1
    for j in range(call.posterior.mean.shape[0]):
        copy[j] = w[j]
    return 0
