"""The log density of several windows, and its gradient, as one C function: it calls those of the windows.

See `calibration/joint.py` for what is put together, and `density` for why.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from ...compiled import Program, inlined, make_stored, run_rows, store
from ...probability.priors import Priors
from ...simulator.system import IntArray
from ..whitening import Whitening
from .density import (
    DENSITY_NOT_FINITE,
    DIVERGENCE,
    DRAWS,
    FAILURES,
    GRADIENTS,
    REASON,
    STOP,
    STOPPED,
    NativeDensity,
    c_functions,
    pull_back_to_whitened,
    unwhiten,
)

stored = make_stored()


class _JointCall(NamedTuple):
    windows: Any
    """[W, 6] addresses: of the window's density, of what it works on, of its coordinates, gradient and value here, and
    of the reason of its last failure."""
    sizes: Any
    """[W] how many coordinates it has."""
    columns: Any
    """[m] where the coordinates of all windows come from in z."""
    deviation: Any
    """[m] position of a drifting coordinate's tau, and"""
    score: Any
    """[m] of its xi; -1: it does not drift."""
    priors: Any
    """[1, 2] row of a `Program`, as the next."""
    own_priors: Any
    """Of the priors that the windows' densities count."""
    mean: Any
    factor: Any
    control: Any
    z: Any
    """[1, d], as the next three."""
    theta: Any
    slope: Any
    gradient: Any
    inside: Any
    """[1, m], as the next four."""
    inside_theta: Any
    inside_slope: Any
    inside_prior: Any
    inside_gradient: Any
    value: Any
    """[1]"""


def joint_density(
    windows: list[NativeDensity],
    columns: list[IntArray],
    drifts: list[tuple[IntArray, IntArray]],
    own: list[Priors],
    priors: Priors,
    coordinates: Whitening,
) -> NativeDensity:
    """The joint log density at w [d], up to a constant.

    windows: each window's density at its own coordinates; columns: where each of them comes from; drifts: positions of
    tau and xi of each coordinate, -1 where it does not drift; own: the windows' priors; priors: the joint ones.
    """
    d, sizes = len(priors.names), [len(column) for column in columns]
    control, rows, inside, value = np.zeros(5, np.int64), np.empty((4, 1, d)), np.empty((5, 1, sum(sizes))), np.empty(1)
    places = []
    for window, first in zip(windows, np.cumsum([0, *sizes]), strict=False):
        at, gradient = (inside[row, 0, first:].ctypes.data for row in (0, 4))
        reason = window.control[REASON:].ctypes.data
        places.append((window.function.address, window.address, at, gradient, value.ctypes.data, reason))
    of_windows = tuple(prior for of_window in own for prior in of_window.priors)
    programs = (
        Program([priors.row(rows[0], rows[1], rows[2], rows[3], value)]),
        Program([Priors(("",) * len(of_windows), of_windows).row(inside[0], inside[1], inside[2], inside[3], value)]),
    )
    call = _JointCall(
        np.array(places, np.int64),
        np.array(sizes, np.int64),
        np.concatenate(columns).astype(np.int64),
        np.concatenate([deviation for deviation, _ in drifts]).astype(np.int64),
        np.concatenate([score for _, score in drifts]).astype(np.int64),
        programs[0].table,
        programs[1].table,
        np.array(coordinates.mean),
        np.array(coordinates.factor, order="C"),
        control,
        rows[0], rows[1], rows[2], rows[3],
        inside[0], inside[1], inside[2], inside[3], inside[4],
        value,
    )  # fmt: skip
    memory = store(call)
    density, record = c_functions(_density, _record)
    return NativeDensity(density, record, memory.ctypes.data, control, (memory, call, windows, programs), d)


@intrinsic
def _call(typing_context: Any, function: Any, size: Any, w: Any, gradient: Any, value: Any, address: Any) -> Any:
    """The density at an address, of arrays given by their addresses."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        word = ir.IntType(64)
        kind = ir.FunctionType(word, [word] * 5)
        return builder.call(builder.inttoptr(args[0], kind.as_pointer()), args[1:])

    return types.int64(*[types.int64] * 6), generate


@intrinsic
def _word(typing_context: Any, address: Any) -> Any:
    """The integer at an address."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.load(builder.inttoptr(args[0], ir.IntType(64).as_pointer()))

    return types.int64(types.int64), generate


@inlined
def _log_density(call, w, gradient, value):
    """Fill gradient [d] and value [1]; returns 0, or why it could not."""
    d, m = call.mean.shape[0], call.columns.shape[0]
    finite = True
    unwhiten(call.mean, call.factor, w, call.z[0])
    run_rows(call.priors)
    for i in range(d):
        finite = finite and np.isfinite(call.theta[0, i])
    if not finite:
        return DENSITY_NOT_FINITE
    result = call.value[0]
    for k in range(m):
        call.inside[0, k] = call.z[0, call.columns[k]]
        if call.score[k] >= 0:
            call.inside[0, k] += call.theta[0, call.deviation[k]] * call.z[0, call.score[k]]
    run_rows(call.own_priors)
    # The windows' densities count their own priors, which are not these.
    result -= call.value[0]
    for k in range(call.sizes.shape[0]):
        place = call.windows[k]
        if _call(place[0], call.sizes[k], place[2], place[3], place[4], place[1]) != 0:
            return _word(place[5])
        result += call.value[0]
    for k in range(m):
        cotangent = call.inside_gradient[0, k] - call.inside_prior[0, k]
        call.gradient[0, call.columns[k]] += cotangent
        if call.score[k] >= 0:
            tau, xi = call.deviation[k], call.score[k]
            call.gradient[0, xi] += cotangent * call.theta[0, tau]
            call.gradient[0, tau] += cotangent * call.z[0, xi] * call.slope[0, tau]
    value[0] = result
    finite = pull_back_to_whitened(call.factor, call.gradient[0], gradient) and np.isfinite(result)
    return 0 if finite else DENSITY_NOT_FINITE


def _density(dimensions, w, gradient, value, address):
    call = stored(address)
    if call.control[STOP] != 0:
        value[0] = STOPPED
        for j in range(call.mean.shape[0]):
            gradient[j] = 1.0
        return 0
    call.control[GRADIENTS] += 1
    outcome = _log_density(call, w, gradient, value)
    if outcome != 0:
        call.control[FAILURES] += 1
        call.control[REASON] = outcome
        return DIVERGENCE
    return 0


def _record(dimensions, expanded, w, copy, address):
    call = stored(address)
    call.control[DRAWS] += 1
    for j in range(call.mean.shape[0]):
        copy[j] = w[j]
    return 0
