"""How probable the telemetry is, given simulated temperatures.

Channels are independent of each other given theta. Each one's residuals are noise (`noise`) and, where the scenario has
one, a discrepancy (`discrepancy`) whose weights are integrated out. A surrogate's error, which channels share, comes on
top (`surrogate_error`).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..compiled import compiled, inlined
from ..simulator.system import FloatArray
from .discrepancy import combine, factorise, project, pull_back_spectrum, spectrum
from .noise import (
    CORRELATED,
    CORRELATED_STUDENT,
    DEVIATION,
    INDEPENDENT,
    LOG_ROOT_2_PI,
    NUMBERS,
    ROUNDED,
    filter_gains,
    normal,
    pull_back_filter,
    rounded,
    student,
    whiten,
)

_PIECE = 64
"""Samples whose part of the basis stays in the nearest cache while all channels are gone through."""


class Residuals(NamedTuple):
    """What the residuals of a window's N channels are made of, as compiled code reads it."""

    seconds: Any
    """[T] times."""
    valid: Any
    """[N, T] whether there is a sample."""
    kinds: Any
    """[N] of noise."""
    discrepant: Any
    """[N] whether there is a discrepancy."""
    basis: Any
    """[T, m] of the discrepancy, those in time first."""
    transposed: Any
    """[m, T]."""
    products: Any
    """[N, m, m] of the basis with itself, at each channel's valid samples."""
    frequency: Any
    """[m], and the next two, as `discrepancy.spectrum` takes them."""
    in_time: Any
    """[1] how many of the basis are in time."""
    smoothness: Any
    factor: Any


class ResidualMemory(NamedTuple):
    """What the likelihood works in."""

    residual: Any
    """[N, T], as the next."""
    fitted: Any
    projected: Any
    """[N, m], and then the expected weights."""
    residual_bar: Any
    """[T], as the next three."""
    decay: Any
    gain: Any
    root: Any
    vectors: Any
    """[8, m + 1]."""
    gram: Any
    """[m, m], as the next three."""
    upper: Any
    inverse: Any
    covariance: Any
    columns: Any
    """[T, m + 1], as the next three, where there is a discrepancy with correlated noise; else [T, 1]: the residuals."""
    whitened: Any
    whitened_bar: Any
    columns_bar: Any


def residual_memory(residuals: Residuals) -> ResidualMemory:
    """Memory for the likelihood of one thread."""
    samples, m = residuals.basis.shape
    together = bool((residuals.discrepant & (residuals.kinds == CORRELATED)).any())
    wide = (samples, m + 1 if together else 1)
    channels = len(residuals.kinds)
    by_channel = (np.empty((channels, samples)), np.empty((channels, samples)), np.empty((channels, m)))
    vectors, square = (np.empty(samples) for _ in range(4)), (np.empty((m, m)) for _ in range(4))
    wides = (np.empty(wide) for _ in range(4))
    return ResidualMemory._make([*by_channel, *vectors, np.empty((8, m + 1)), *square, *wides])


def log_likelihood(
    residuals: Residuals, observed: FloatArray, simulated: FloatArray, numbers: FloatArray
) -> tuple[float, FloatArray, FloatArray]:
    """Log likelihood of temperatures observed and simulated [T, N], K, and its derivatives.

    observed: valid where `residuals.valid` says; numbers: [N, 9] of noise and discrepancy (see `noise`). The
    derivatives are by `simulated` [T, N] and by `numbers` [N, 9].
    """
    simulated_bar, numbers_bar = np.empty(simulated.shape), np.empty(numbers.shape)
    memory = residual_memory(residuals)
    value = log_likelihood_compiled(residuals, memory, observed, simulated, numbers, simulated_bar, numbers_bar)
    return value, simulated_bar, numbers_bar


def weights_given(
    residuals: Residuals, observed: FloatArray, simulated: FloatArray, numbers: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The discrepancy's weights given residuals: mean [N, m], and F [N, m, m] with their covariance F F^T.

    Arguments as in `log_likelihood`; zero for a channel without discrepancy.
    """
    m = residuals.basis.shape[1]
    mean, factor = np.zeros((len(numbers), m)), np.zeros((len(numbers), m, m))
    weights_compiled(residuals, residual_memory(residuals), observed, simulated, numbers, mean, factor)
    return mean, factor


@compiled
def log_likelihood_compiled(residuals, memory, observed, simulated, numbers, simulated_bar, numbers_bar):
    """`log_likelihood` in compiled code: fills the derivatives, returns the value."""
    value, residual_bar = 0.0, memory.residual_bar
    _start(residuals, memory, observed, simulated)
    for k in range(numbers.shape[0]):
        valid, residual = residuals.valid[k], memory.residual[k]
        for j in range(NUMBERS):
            numbers_bar[k, j] = 0.0
        kind = residuals.kinds[k]
        if residuals.discrepant[k]:
            value += _discrepant(residuals, memory, k, numbers[k], numbers_bar[k])
            if kind == INDEPENDENT:
                continue
        elif kind == INDEPENDENT:
            value += normal(valid, residual, numbers[k], residual_bar, numbers_bar[k])
        elif kind == CORRELATED:
            value += _correlated(residuals, memory, k, numbers[k], numbers_bar[k])
        elif kind == ROUNDED:
            value += rounded(valid, residual, numbers[k], residual_bar, numbers_bar[k])
        else:
            value += student(
                kind == CORRELATED_STUDENT, residuals.seconds, valid, residual, numbers[k], residual_bar, numbers_bar[k]
            )
        for t in range(residual_bar.shape[0]):
            simulated_bar[t, k] = -residual_bar[t] if valid[t] else 0.0
    _finish(residuals, memory, numbers, simulated_bar, numbers_bar)
    return value


@inlined
def _start(residuals, memory, observed, simulated):
    """Residuals of all channels, and their products with the basis where it needs no whitening.

    A piece of the window at a time for all channels, so that the basis comes from memory once.
    """
    samples = memory.residual.shape[1]
    for k in range(memory.residual.shape[0]):
        for t in range(samples):
            memory.residual[k, t] = observed[t, k] - simulated[t, k] if residuals.valid[k, t] else 0.0
        for j in range(memory.projected.shape[1]):
            memory.projected[k, j] = 0.0
    for start in range(0, samples, _PIECE):
        end = min(start + _PIECE, samples)
        for k in range(memory.residual.shape[0]):
            if residuals.discrepant[k] and residuals.kinds[k] == INDEPENDENT:
                project(residuals.basis, start, end, memory.residual[k], memory.projected[k])


@inlined
def _finish(residuals, memory, numbers, simulated_bar, numbers_bar):
    """The derivatives by the simulated, and by the noise, of channels with a discrepancy in independent noise."""
    samples = memory.residual.shape[1]
    for k in range(memory.residual.shape[0]):
        if not (residuals.discrepant[k] and residuals.kinds[k] == INDEPENDENT):
            continue
        combine(residuals.transposed, memory.projected[k], memory.fitted[k])
        precision = 1.0 / (numbers[k, DEVIATION] * numbers[k, DEVIATION])
        left = 0.0
        for t in range(samples):
            scaled = (memory.residual[k, t] - memory.fitted[k, t]) * precision if residuals.valid[k, t] else 0.0
            simulated_bar[t, k] = scaled
            left += scaled * scaled
        numbers_bar[k, DEVIATION] += numbers[k, DEVIATION] * left


@inlined
def _correlated(residuals, memory, k, numbers, numbers_bar):
    """Correlated noise alone."""
    valid, seconds = residuals.valid[k], residuals.seconds
    log_determinant = filter_gains(seconds, valid, numbers, memory.decay, memory.gain, memory.root)
    columns, whitened = memory.columns[:, :1], memory.whitened[:, :1]
    whitened_bar, columns_bar = memory.whitened_bar[:, :1], memory.columns_bar[:, :1]
    for t in range(columns.shape[0]):
        columns[t, 0] = memory.residual[k, t]
    state = memory.vectors[0, :1]
    whiten(valid, memory.decay, memory.gain, memory.root, columns, whitened, state)
    squares, samples = 0.0, 0
    for t in range(columns.shape[0]):
        squares += whitened[t, 0] * whitened[t, 0]
        samples += 1 if valid[t] else 0
        whitened_bar[t, 0] = -whitened[t, 0]
    pull_back_filter(
        seconds, valid, numbers, memory.decay, memory.gain, memory.root,
        columns, whitened, whitened_bar, columns_bar, state, numbers_bar,
    )  # fmt: skip
    for t in range(columns.shape[0]):
        memory.residual_bar[t] = columns_bar[t, 0]
    return -0.5 * (squares + log_determinant) - samples * LOG_ROOT_2_PI


@inlined
def _infer_weights(residuals, memory, k, numbers):
    """Weights of a channel's discrepancy given its residuals: in the rows of memory.vectors and in memory.inverse.

    Returns the log determinant of the residuals' covariance and their square in standard deviations.
    """
    root, slope, weights, shrunk = _rows(memory)
    projected = memory.projected[k]
    spectrum(residuals.frequency, residuals.in_time[0], residuals.smoothness, residuals.factor, numbers, root, slope)
    valid, m, samples = residuals.valid[k], root.shape[0], 0
    squares = 0.0
    if residuals.kinds[k] == INDEPENDENT:
        precision = 1.0 / (numbers[DEVIATION] * numbers[DEVIATION])
        for t in range(memory.residual.shape[1]):
            squares += memory.residual[k, t] * memory.residual[k, t]
            samples += 1 if valid[t] else 0
        determinant, explained = factorise(
            residuals.products[k], precision, root, projected, memory.upper, memory.inverse, shrunk, weights
        )
        return determinant + 2.0 * samples * math.log(numbers[DEVIATION]), squares * precision - explained
    determinant = filter_gains(residuals.seconds, valid, numbers, memory.decay, memory.gain, memory.root)
    columns, whitened = memory.columns, memory.whitened
    for t in range(columns.shape[0]):
        for j in range(m):
            columns[t, j] = residuals.basis[t, j]
        columns[t, m] = memory.residual[k, t]
    whiten(valid, memory.decay, memory.gain, memory.root, columns, whitened, memory.vectors[7])
    for i in range(m):
        for j in range(i, m):
            memory.gram[i, j] = 0.0
    for t in range(columns.shape[0]):
        if not valid[t]:
            continue
        last = whitened[t, m]
        squares += last * last
        for i in range(m):
            projected[i] += whitened[t, i] * last
        for i in range(m):
            left = whitened[t, i]
            for j in range(i, m):
                memory.gram[i, j] += left * whitened[t, j]
    second, explained = factorise(memory.gram, 1.0, root, projected, memory.upper, memory.inverse, shrunk, weights)
    return determinant + second, squares - explained


@inlined
def _rows(memory):
    """Rows of memory.vectors: prior deviations and log slopes, weights over deviations, shrinkage [m]."""
    m = memory.gram.shape[0]
    vectors = memory.vectors
    return vectors[0, :m], vectors[1, :m], vectors[2, :m], vectors[3, :m]


@inlined
def _discrepant(residuals, memory, k, numbers, numbers_bar):
    """Noise and a discrepancy; what of its derivatives takes a pass over the basis is left to `_finish`."""
    valid = residuals.valid[k]
    log_determinant, squares = _infer_weights(residuals, memory, k, numbers)
    root, slope, weights, shrunk = _rows(memory)
    expected = memory.projected[k]
    m, samples = root.shape[0], 0
    for t in range(valid.shape[0]):
        samples += 1 if valid[t] else 0
    pull_back_spectrum(residuals.in_time[0], weights, shrunk, slope, numbers, numbers_bar)
    for j in range(m):
        expected[j] = root[j] * weights[j]
    if residuals.kinds[k] == INDEPENDENT:
        trace = float(samples - m)
        for j in range(m):
            trace += shrunk[j]
        numbers_bar[DEVIATION] -= trace / numbers[DEVIATION]
    else:
        _pull_back_whitened(residuals, memory, k, numbers, root, expected, numbers_bar)
    return -0.5 * (squares + log_determinant) - samples * LOG_ROOT_2_PI


@inlined
def _pull_back_whitened(residuals, memory, k, numbers, root, expected, numbers_bar):
    """The derivatives by residuals and by the noise's numbers, of correlated noise with a discrepancy."""
    valid, covariance, m = residuals.valid[k], memory.covariance, root.shape[0]
    for i in range(m):
        for j in range(m):
            covariance[i, j] = 0.0
    for k_row in range(m):
        for i in range(k_row + 1):
            left = memory.inverse[k_row, i] * root[i]
            for j in range(k_row + 1):
                covariance[i, j] += left * memory.inverse[k_row, j]
    for i in range(m):
        for j in range(m):
            covariance[i, j] *= root[j]
    whitened, whitened_bar = memory.whitened, memory.whitened_bar
    for t in range(whitened.shape[0]):
        if not valid[t]:
            continue
        left = whitened[t, m]
        for j in range(m):
            left -= whitened[t, j] * expected[j]
        for j in range(m):
            whitened_bar[t, j] = left * expected[j]
        for i in range(m):
            one = whitened[t, i]
            for j in range(m):
                whitened_bar[t, j] -= one * covariance[i, j]
        whitened_bar[t, m] = -left
    pull_back_filter(
        residuals.seconds, valid, numbers, memory.decay, memory.gain, memory.root,
        memory.columns, whitened, whitened_bar, memory.columns_bar, memory.vectors[7], numbers_bar,
    )  # fmt: skip
    for t in range(whitened.shape[0]):
        memory.residual_bar[t] = memory.columns_bar[t, m]


@compiled
def weights_compiled(residuals, memory, observed, simulated, numbers, mean, factor):
    """`weights_given` in compiled code."""
    _start(residuals, memory, observed, simulated)
    for k in range(numbers.shape[0]):
        if not residuals.discrepant[k]:
            continue
        _infer_weights(residuals, memory, k, numbers[k])
        root, _, weights, _ = _rows(memory)
        for i in range(root.shape[0]):
            mean[k, i] = root[i] * weights[i]
            for j in range(root.shape[0]):
                factor[k, i, j] = root[i] * memory.inverse[j, i]


# --- independent noise alone ----------------------------------------------------------------------------------


def iid_log_likelihood(
    observed: FloatArray, simulated: FloatArray, noise: FloatArray
) -> tuple[float, FloatArray, FloatArray]:
    """Independent Gaussian noise, as published: y ~ N(y(theta), sigma^2) with one sigma per channel.

    observed: [T, N] K, NaN where there is no valid sample; simulated: [T, N] K; noise: [N] K.
    Returns the log likelihood and its derivatives by `simulated` [T, N] and by `noise` [N].
    """
    simulated_bar, noise_bar = np.empty(simulated.shape), np.empty(noise.shape)
    return iid_compiled(observed, simulated, noise, simulated_bar, noise_bar), simulated_bar, noise_bar


@compiled
def iid_compiled(observed, simulated, noise, simulated_bar, noise_bar):
    """`iid_log_likelihood` in compiled code: fills the derivatives, returns the value."""
    value = 0.0
    for k in range(noise.shape[0]):
        precision = 1.0 / noise[k]
        squares, samples = 0.0, 0
        for t in range(observed.shape[0]):
            scaled = (observed[t, k] - simulated[t, k]) * precision
            if np.isfinite(observed[t, k]):
                squares += scaled * scaled
                samples += 1
                simulated_bar[t, k] = scaled * precision
            else:
                simulated_bar[t, k] = 0.0
        value -= 0.5 * squares + samples * (np.log(noise[k]) + 0.5 * np.log(2.0 * np.pi))
        noise_bar[k] = (squares - samples) * precision
    return value


def precision_times(residuals: Residuals, columns: FloatArray, numbers: FloatArray) -> FloatArray:
    """C^-1 times columns [T, N, c], with C the covariance of the residuals of normal noise and discrepancy.

    What the discrepancy is expected to explain of a column is taken off it, and the rest weighed by the noise.
    """
    alone = residuals._replace(discrepant=np.zeros_like(residuals.discrepant))
    none = np.zeros(columns.shape[:2])

    def weighed(columns: FloatArray) -> FloatArray:
        parts = [
            log_likelihood(alone, np.ascontiguousarray(columns[..., c]), none, numbers)[1]
            for c in range(columns.shape[-1])
        ]
        return np.stack(parts, axis=-1) if parts else np.empty(columns.shape)

    solved = weighed(columns)
    if not residuals.discrepant.any():
        return solved
    _, factor = weights_given(residuals, none, none, numbers)
    # Not products of BLAS: as in the Hessian that this is for, its threads would spin when the cores are busy.
    projected = np.einsum("tm,tnc->nmc", residuals.basis, solved)
    weights = np.einsum("nij,njc->nic", factor, np.einsum("nji,njc->nic", factor, projected))
    return weighed(columns - np.einsum("tm,nmc->tnc", residuals.basis, weights))
