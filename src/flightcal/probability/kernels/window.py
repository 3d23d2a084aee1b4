"""What the likelihood of a window begins and ends with."""

from __future__ import annotations

from typing import Any, NamedTuple

from ...compiled import inlined, kernel

_PIECE = 64
"""Samples whose part of the basis stays in the nearest cache while all channels are gone through."""


class WindowCall(NamedTuple):
    """A window's N channels."""

    valid: Any
    """[N, T] whether there is a sample."""
    observed: Any
    """[T, N] K, as the next."""
    simulated: Any
    residual: Any
    """[N, T] K, filled by `start`."""
    values: Any
    """[N] of each channel, emptied by `start`, as the next."""
    numbers_bar: Any
    """[N, n]"""
    residual_bar: Any
    """[N, T], read by `finish`."""
    simulated_bar: Any
    """[T, N], filled by `finish`, as the next."""
    value: Any
    """[1]"""


class ProjectCall(NamedTuple):
    """Some of a window's channels, beside which there are shapes."""

    channels: Any
    basis: Any
    """[T, m]"""
    residual: Any
    """[N, T]"""
    projected: Any
    """[N, m], filled: the basis transposed times residuals."""


@kernel
def start(call):
    """Residuals, zero where there is no sample, and nothing in what is added to."""
    valid, observed, simulated, residual = call.valid, call.observed, call.simulated, call.residual
    values, numbers_bar = call.values, call.numbers_bar
    for k in range(residual.shape[0]):
        values[k] = 0.0
        for j in range(numbers_bar.shape[1]):
            numbers_bar[k, j] = 0.0
        for t in range(residual.shape[1]):
            residual[k, t] = observed[t, k] - simulated[t, k] if valid[k, t] else 0.0
    return 0


@kernel
def finish(call):
    """The sum of the channels' values, and the derivative by what is simulated."""
    residual_bar, simulated_bar, values = call.residual_bar, call.simulated_bar, call.values
    total = 0.0
    for k in range(values.shape[0]):
        total += values[k]
        for t in range(simulated_bar.shape[0]):
            simulated_bar[t, k] = -residual_bar[k, t]
    call.value[0] = total
    return 0


@kernel
def project(call):
    """A piece of the window at a time for all channels, so that the basis comes from memory once."""
    channels, basis, residual, projected = call.channels, call.basis, call.residual, call.projected
    for c in range(channels.shape[0]):
        for j in range(projected.shape[1]):
            projected[channels[c], j] = 0.0
    samples = basis.shape[0]
    for first in range(0, samples, _PIECE):
        for c in range(channels.shape[0]):
            add_products(basis, first, min(first + _PIECE, samples), residual[channels[c]], projected[channels[c]])
    return 0


@inlined
def add_products(basis, start, end, residual, projected):
    """Add to projected [m] the samples from start to end of the basis [T, m] transposed times residuals [T]."""
    m = basis.shape[1]
    whole = start + (end - start) // 4 * 4
    for t in range(start, whole, 4):
        first, second, third, fourth = residual[t], residual[t + 1], residual[t + 2], residual[t + 3]
        for j in range(m):
            projected[j] += (
                basis[t, j] * first + basis[t + 1, j] * second + basis[t + 2, j] * third + basis[t + 3, j] * fourth
            )
    for t in range(whole, end):
        for j in range(m):
            projected[j] += basis[t, j] * residual[t]
