"""The likelihood beside unmodelled heat: its weights, which all channels and windows share, are integrated out.

A channel k of a window is a part: its residuals, whitened for a noise of deviation one, and the temperature's response
to the weights, whitened alike, do not change while the noise keeps its shape. So what a part tells of the weights is
its products over the square of the noise's deviation, and one factorisation of m weights closes all.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import get_cython_function_address, intrinsic

from ...compiled import inlined, kernel
from .window import add_products

_LOG_2_PI = math.log(2.0 * math.pi)
LOG_MOST_GROWTH = 3.0
"""Of a response, up or down: far from where it was looked at."""
LAPACK = tuple(int(get_cython_function_address("scipy.linalg.cython_lapack", name)) for name in ("dpotrf", "dpotri"))
"""Cholesky factor of a symmetric matrix, and its inverse from that."""


class HeatWindowCall(NamedTuple):
    """A window's N channels, which are parts from `first` on."""

    valid: Any
    """[N, T] whether there is a sample."""
    observed: Any
    """[T, N] K, as the next."""
    simulated: Any
    numbers: Any
    """[N, n]: the first is the noise's deviation, K."""
    decay: Any
    """[N, T] of the filter that whitens noise of deviation one, as the next two; see `noise.ar1`."""
    gain: Any
    root: Any
    response: Any
    """[N, T, m] of the temperature to the weights, whitened."""
    first: int
    white: Any
    """[N, T] whitened residuals, filled."""
    squares: Any
    """[P] of all parts, as the next two: sums of their squares, filled."""
    precision: Any
    projected: Any
    """[P, m] products with the response."""
    shown: Any
    """[m] expected weights less those that simulations have, read by `returns`, as the next."""
    trace: Any
    """[P] of what is uncertain in the whitened response."""
    simulated_bar: Any
    """[T, N], filled by `returns`, as the next."""
    numbers_bar: Any
    """[N, n]"""
    samples: Any
    """[P] of each part."""


class HeatCloseCall(NamedTuple):
    """All parts together."""

    squares: Any
    """[P]"""
    precision: Any
    projected: Any
    samples: Any
    determinant: Any
    """[P] log determinants of the noise of deviation one."""
    products: Any
    """[P, m, m] of the whitened response with itself; upper triangles."""
    group: Any
    """[m] whose scale each weight has."""
    scales: Any
    """[g + c] prior deviations of the weights, and entries that the response follows (`Follows`)."""
    logarithmic: Any
    """[c] of these, as the next two."""
    at: Any
    slope: Any
    """[m, c]"""
    centre: Any
    """[m]"""
    growth: Any
    """[m] to work in, as the next nine."""
    shift: Any
    shifted: Any
    root: Any
    moment: Any
    weights: Any
    mean: Any
    shown: Any
    """[m], filled."""
    gram: Any
    """[m, m] to work in, as the next; upper triangles."""
    covariance: Any
    """Filled."""
    lapack: Any
    """[2] `LAPACK`, which so does not end up in the cache,"""
    triangle: Any
    """[1] and what they take: which triangle,"""
    lengths: Any
    """[2] m, and whether it failed."""
    trace: Any
    """[P] filled."""
    scales_bar: Any
    """[g + c] filled."""
    value: Any
    """[1] filled: the log likelihood."""


@intrinsic
def _lapack(typing_context: Any, address: Any, triangle: Any, length: Any, matrix: Any, failed: Any) -> Any:
    """The LAPACK function (triangle, length, matrix, leading length, failed) at an address; all are addresses."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [pointer] * 5)
        given = [builder.inttoptr(args[k], pointer) for k in (1, 2, 3, 2, 4)]
        builder.call(builder.inttoptr(args[0], kind.as_pointer()), given)
        return context.get_dummy_value()

    return types.void(types.int64, *[types.uintp] * 4), generate


@kernel
def opens(call):
    """Whitened residuals of each channel, and what they tell of the weights."""
    valid, observed, simulated, numbers = call.valid, call.observed, call.simulated, call.numbers
    decay, gain, root, response, white = call.decay, call.gain, call.root, call.response, call.white
    squares, precision, projected, first = call.squares, call.precision, call.projected, call.first
    channels, samples = valid.shape
    for k in range(channels):
        p = first + k
        squares[p] = _whiten(valid, observed, simulated, decay, gain, root, k, white, 0.0)
        precision[p] = 1.0 / (numbers[k, 0] * numbers[k, 0])
        for j in range(projected.shape[1]):
            projected[p, j] = 0.0
        add_products(response[k], 0, samples, white[k], projected[p])
    return 0


@kernel
def close(call):
    """The weights' posterior, the log likelihood, and its derivatives by the scales."""
    squares, precision, projected, samples = call.squares, call.precision, call.projected, call.samples
    products, group, scales, root, moment = call.products, call.group, call.scales, call.root, call.moment
    gram, weights, mean = call.gram, call.weights, call.mean
    covariance, trace, scales_bar, determinant = call.covariance, call.trace, call.scales_bar, call.determinant
    parts, m = projected.shape
    _grow(call)
    total = 0.0
    for i in range(m):
        root[i] = scales[group[i]] * call.growth[i]
        moment[i] = 0.0
        for j in range(i, m):
            gram[i, j] = 0.0
    for p in range(parts):
        weight = precision[p]
        _shift(call, p)
        total += weight * squares[p] + determinant[p] + samples[p] * (_LOG_2_PI - math.log(weight))
        for i in range(m):
            moment[i] += weight * projected[p, i]
            for j in range(i, m):
                gram[i, j] += weight * products[p, i, j]
    log_determinant, explained = _invert(call)
    call.value[0] = -0.5 * (total + log_determinant - explained)
    for k in range(scales.shape[0]):
        scales_bar[k] = 0.0
    for i in range(m):
        mean[i] = root[i] * weights[i]
        call.shown[i] = mean[i] - call.shift[i]
        by_log_root = weights[i] * weights[i] - 1.0 + covariance[i, i]
        scales_bar[group[i]] += by_log_root / scales[group[i]]
        _add_growth_bar(call, i, by_log_root - weights[i] / root[i] * call.centre[i] * call.growth[i])
    for i in range(m):
        for j in range(i, m):
            covariance[i, j] *= root[i] * root[j] * (1.0 if i == j else 2.0)
    for p in range(parts):
        trace[p] = 0.0
        for i in range(m):
            trace[p] += _product(covariance[i], products[p, i], i)
    return 0


@inlined
def _invert(call):
    """Fill the covariance with the inverse of 1 + root gram root, and the weights with what is expected, over root.

    Returns the log determinant, infinite where it has no inverse, and by how much the residuals' square is explained.
    """
    gram, root, moment, inner, weights = call.gram, call.root, call.moment, call.covariance, call.weights
    lengths, m = call.lengths, call.root.shape[0]
    for i in range(m):
        weights[i] = root[i] * moment[i]
        for j in range(i, m):
            inner[i, j] = root[i] * gram[i, j] * root[j]
        inner[i, i] += 1.0
    triangle, length, matrix = call.triangle.ctypes.data, lengths[:1].ctypes.data, inner.ctypes.data
    failed = lengths[1:].ctypes.data
    _lapack(call.lapack[0], triangle, length, matrix, failed)
    if lengths[1] != 0:
        return np.inf, 0.0
    log_determinant, explained = 0.0, 0.0
    for i in range(m):
        log_determinant += 2.0 * math.log(inner[i, i])
        weights[i] /= inner[i, i]
        explained += weights[i] * weights[i]
        for j in range(i + 1, m):
            weights[j] -= inner[i, j] * weights[i]
    for back in range(m):
        i = m - 1 - back
        for j in range(i + 1, m):
            weights[i] -= inner[i, j] * weights[j]
        weights[i] /= inner[i, i]
    _lapack(call.lapack[1], triangle, length, matrix, failed)
    return log_determinant if lengths[1] == 0 else np.inf, explained


@inlined
def _grow(call):
    """How much more each weight does here, and what the heat that simulations have does more."""
    scales, slope, growth = call.scales, call.slope, call.growth
    m, c = slope.shape
    first = scales.shape[0] - c
    for i in range(m):
        total = 0.0
        for j in range(c):
            total += slope[i, j] * (_coordinate(call, j, scales[first + j]) - call.at[j])
        growth[i] = math.exp(min(max(total, -LOG_MOST_GROWTH), LOG_MOST_GROWTH))
        call.shift[i] = (growth[i] - 1.0) * call.centre[i]


@inlined
def _coordinate(call, j, entry):
    return math.log(entry) if call.logarithmic[j] else entry


@inlined
def _shift(call, p):
    """The same in what part p tells."""
    squares, projected, products, shift, shifted = call.squares, call.projected, call.products, call.shift, call.shifted
    m, c = call.slope.shape
    if c == 0:
        return
    for i in range(m):
        shifted[i] = 0.0
    for i in range(m):
        shifted[i] += products[p, i, i] * shift[i]
        for j in range(i + 1, m):
            shifted[i] += products[p, i, j] * shift[j]
            shifted[j] += products[p, i, j] * shift[i]
    for i in range(m):
        squares[p] += shift[i] * (2.0 * projected[p, i] + shifted[i])
        projected[p, i] += shifted[i]


@inlined
def _add_growth_bar(call, i, bar):
    """Derivatives by what the response follows, from that by the logarithm of a weight's growth."""
    scales, slope = call.scales, call.slope
    c = slope.shape[1]
    first = scales.shape[0] - c
    if abs(math.log(call.growth[i])) >= LOG_MOST_GROWTH:
        return
    for j in range(c):
        by_entry = 1.0 / scales[first + j] if call.logarithmic[j] else 1.0
        call.scales_bar[first + j] += bar * slope[i, j] * by_entry


@kernel
def returns(call):
    """Derivatives by what is simulated, and by the noise's deviations."""
    valid, numbers, decay, gain, root = call.valid, call.numbers, call.decay, call.gain, call.root
    response, white, precision, shown, trace = call.response, call.white, call.precision, call.shown, call.trace
    simulated_bar, numbers_bar, samples, first = call.simulated_bar, call.numbers_bar, call.samples, call.first
    channels, count = valid.shape
    for k in range(channels):
        p = first + k
        weight, squares, state_bar = precision[p], 0.0, 0.0
        for j in range(numbers_bar.shape[1]):
            numbers_bar[k, j] = 0.0
        for back in range(count):
            t = count - 1 - back
            simulated_bar[t, k] = 0.0
            if valid[k, t]:
                left = white[k, t] - _product(response[k, t], shown, 0)
                squares += left * left
                new_bar = root[k, t] * weight * left + gain[k, t] * state_bar
                simulated_bar[t, k] = new_bar
                state_bar = decay[k, t] * (state_bar - new_bar)
        numbers_bar[k, 0] = (weight * (squares + trace[p]) - samples[p]) / numbers[k, 0]
    return 0


@inlined
def _whiten(valid, observed, simulated, decay, gain, root, k, white, total):
    """The total, and the sum of squares of the whitened residuals of channel k, which this fills."""
    state = 0.0
    for t in range(valid.shape[1]):
        white[k, t] = 0.0
        if valid[k, t]:
            expected = decay[k, t] * state
            new = observed[t, k] - simulated[t, k] - expected
            state = expected + gain[k, t] * new
            white[k, t] = root[k, t] * new
            total += white[k, t] * white[k, t]
    return total


@inlined
def _product(first, second, start):
    """Of two vectors from `start` on, in eight sums: the processor adds them up side by side."""
    end = first.shape[0]
    whole = start + (end - start) // 8 * 8
    a, b, c, d, e, f, g, h = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(start, whole, 8):
        a += first[j] * second[j]
        b += first[j + 1] * second[j + 1]
        c += first[j + 2] * second[j + 2]
        d += first[j + 3] * second[j + 3]
        e += first[j + 4] * second[j + 4]
        f += first[j + 5] * second[j + 5]
        g += first[j + 6] * second[j + 6]
        h += first[j + 7] * second[j + 7]
    total = ((a + e) + (c + g)) + ((b + f) + (d + h))
    for j in range(whole, end):
        total += first[j] * second[j]
    return total


# --- with sizes of noise and heat that are known ----------------------------------------------------------------


class KnownWindowCall(NamedTuple):
    """A window's N channels where the sizes of noise and heat are known, so that all but the residuals is."""

    valid: Any
    """[N, T] whether there is a sample."""
    observed: Any
    """[T, N] K, as the next."""
    simulated: Any
    decay: Any
    """[N, T] of the filter that whitens the noise, as the next two."""
    gain: Any
    root: Any
    explaining: Any
    """[N, T, m] whose products with the whitened residuals of all windows are `projected`."""
    first: int
    """1: of the windows the first."""
    white: Any
    """[N, T] whitened residuals, filled."""
    squares: Any
    """[1] sum of their squares in all windows."""
    projected: Any
    """[m] what the heat explains of them: its square is less."""
    simulated_bar: Any
    """[T, N], filled by `returns_known`, as the next."""
    numbers_bar: Any
    """[N, n]"""


class KnownCloseCall(NamedTuple):
    """All windows together."""

    squares: Any
    projected: Any
    determinant: float
    """Log determinant of the covariance of all residuals, and samples log 2 pi."""
    value: Any
    """[1] filled: the log likelihood."""


@kernel
def opens_known(call):
    """Whitened residuals, and what heat explains of them."""
    valid, observed, simulated = call.valid, call.observed, call.simulated
    decay, gain, root, explaining, white = call.decay, call.gain, call.root, call.explaining, call.white
    squares, projected = call.squares, call.projected
    channels, samples = valid.shape
    if call.first == 1:
        squares[0] = 0.0
        for j in range(projected.shape[0]):
            projected[j] = 0.0
    for k in range(channels):
        squares[0] = _whiten(valid, observed, simulated, decay, gain, root, k, white, squares[0])
        add_products(explaining[k], 0, samples, white[k], projected)
    return 0


@kernel
def close_known(call):
    """The log likelihood."""
    total = call.squares[0] + call.determinant
    for j in range(call.projected.shape[0]):
        total -= call.projected[j] * call.projected[j]
    call.value[0] = -0.5 * total
    return 0


@kernel
def returns_known(call):
    """Derivatives by what is simulated."""
    valid, decay, gain, root = call.valid, call.decay, call.gain, call.root
    explaining, white, projected = call.explaining, call.white, call.projected
    simulated_bar, numbers_bar = call.simulated_bar, call.numbers_bar
    channels, count = valid.shape
    for k in range(channels):
        for j in range(numbers_bar.shape[1]):
            numbers_bar[k, j] = 0.0
        state_bar = 0.0
        for back in range(count):
            t = count - 1 - back
            simulated_bar[t, k] = 0.0
            if valid[k, t]:
                left = white[k, t] - _product(explaining[k, t], projected, 0)
                new_bar = root[k, t] * left + gain[k, t] * state_bar
                simulated_bar[t, k] = new_bar
                state_bar = decay[k, t] * (state_bar - new_bar)
    return 0
