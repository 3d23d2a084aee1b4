"""Compiled integration of the canonical form, forward and adjoint.

Scheme: RODAS3 (Sandu et al. 1997, Atmos. Environ. 31, 3459-3472), a four-stage Rosenbrock method of order 3. It is
L-stable and stiffly accurate, so a small node behind a large conductance, or a massless one, never limits the step;
and it needs no iteration, so its derivative is that of a fixed sequence of linear solves. The step is

    W K1 = h/2 (f0 + db/2)              W = mass - h/2 J(x0),   db = b1 - b0
    W K2 = h/2 (f0 + 3 db/2) + 2 mass K1
    W K3 = h/2 f(x0 + 2 K1, b1) + mass (K1 - K2)/2
    W K4 = h/2 f(x0 + 2 K1 + K3, b1) + mass (K1 - K2 - 8/3 K3)/2
    x1 = x0 + 2 K1 + K3 + K4

A thermostat that has crossed its threshold at the step's end cuts the step: the length tau at which the sensor of the
*discrete* solution meets the threshold is found by secant steps, the heater switches, and the rest of the step
follows. The derivative goes through tau by the implicit function theorem, so what `adjoint` returns is the exact
gradient of what `forward` computes. A piece of a step between such cuts is called a segment.

W is factorised by rows on the fixed pattern of `Structure`, without pivoting: with conduction and radiation between
nodes it is an M-matrix. Everything costs as much as the network has links.

All compiled functions that call each other stand in this file: Numba's cache does not notice a change in another.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

_compiled: Any = njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract", "nsz", "arcp"})

FINISHED = 0
NOT_FINITE = 1
TOO_MANY_SWITCHES = 2

_LOCATION_ITERATIONS = 60
_CROSSING_TOLERANCE = 1e-11  # K, on the sensor at the switch
_EIGHT_THIRDS = 8.0 / 3.0


@_compiled
def _factor(structure, W, row):
    """LU of W in place (unit lower triangle), row by row; the diagonal is stored as its reciprocal.

    row [n] is workspace.
    """
    start, column, diagonal = structure.factor_start, structure.factor_column, structure.factor_diagonal
    for i in range(diagonal.shape[0]):
        for p in range(start[i], start[i + 1]):
            row[column[p]] = W[p]
        for p in range(start[i], diagonal[i]):
            k = column[p]
            factor = row[k] * W[diagonal[k]]
            row[k] = factor
            for q in range(diagonal[k] + 1, start[k + 1]):
                row[column[q]] -= factor * W[q]
        for p in range(start[i], start[i + 1]):
            W[p] = row[column[p]]
        W[diagonal[i]] = 1.0 / W[diagonal[i]]


@_compiled
def _solve(structure, W, r):
    start, column, diagonal = structure.factor_start, structure.factor_column, structure.factor_diagonal
    n = diagonal.shape[0]
    for i in range(n):
        total = r[i]
        for p in range(start[i], diagonal[i]):
            total -= W[p] * r[column[p]]
        r[i] = total
    for i in range(n - 1, -1, -1):
        total = r[i]
        for p in range(diagonal[i] + 1, start[i + 1]):
            total -= W[p] * r[column[p]]
        r[i] = total * W[diagonal[i]]


@_compiled
def _solve_transposed(structure, W, r):
    start, column, diagonal = structure.factor_start, structure.factor_column, structure.factor_diagonal
    n = diagonal.shape[0]
    for i in range(n):
        value = r[i] * W[diagonal[i]]
        r[i] = value
        for p in range(diagonal[i] + 1, start[i + 1]):
            r[column[p]] -= W[p] * value
    for i in range(n - 1, -1, -1):
        value = r[i]
        for p in range(start[i], diagonal[i]):
            r[column[p]] -= W[p] * value


@_compiled
def _rate(structure, A, N, x, fourth, b, f):
    """f = A x + N x^4 + b; leaves x^4 in `fourth`."""
    n = x.shape[0]
    for i in range(n):
        square = x[i] * x[i]
        fourth[i] = square * square
    for i in range(n):
        total = b[i]
        for p in range(structure.linear_start[i], structure.linear_start[i + 1]):
            total += A[p] * x[structure.linear_column[p]]
        for p in range(structure.radiative_start[i], structure.radiative_start[i + 1]):
            total += N[p] * fourth[structure.radiative_column[p]]
        f[i] = total


@_compiled
def _cubes(x, slope):
    """d (x^4) / dx."""
    for i in range(x.shape[0]):
        slope[i] = 4.0 * x[i] * x[i] * x[i]


@_compiled
def _jacobian_product(structure, A, N, slope, v, out):
    """out = (A + N diag(slope)) v."""
    for i in range(v.shape[0]):
        total = 0.0
        for p in range(structure.linear_start[i], structure.linear_start[i + 1]):
            total += A[p] * v[structure.linear_column[p]]
        for p in range(structure.radiative_start[i], structure.radiative_start[i + 1]):
            j = structure.radiative_column[p]
            total += N[p] * slope[j] * v[j]
        out[i] = total


@_compiled
def _transposed_products(structure, A, N, v, linear, radiative):
    """linear = A^T v, radiative = N^T v."""
    for i in range(v.shape[0]):
        linear[i] = 0.0
        radiative[i] = 0.0
    for i in range(v.shape[0]):
        value = v[i]
        for p in range(structure.linear_start[i], structure.linear_start[i + 1]):
            linear[structure.linear_column[p]] += A[p] * value
        for p in range(structure.radiative_start[i], structure.radiative_start[i + 1]):
            radiative[structure.radiative_column[p]] += N[p] * value


@_compiled
def _stages(structure, A, N, x0, h, b0, b1, W, row, K, X, fourth, slope, F):
    """The four stages of a step of length h from x0; b0 and b1 [n] are all heat inputs at its ends.

    Fills W (factored), K [4, n], X [2, n] (arguments of stages 3 and 4), F and fourth [3, n] (rates and fourth powers
    at x0 and at the two arguments), slope [n] (4 x0^3).
    """
    n = x0.shape[0]
    mass = structure.mass
    half = 0.5 * h
    _rate(structure, A, N, x0, fourth[0], b0, F[0])
    _cubes(x0, slope)
    for p in range(W.shape[0]):
        W[p] = 0.0
    for p in range(A.shape[0]):
        W[structure.linear_slot[p]] = -half * A[p]
    for p in range(N.shape[0]):
        W[structure.radiative_slot[p]] -= half * N[p] * slope[structure.radiative_column[p]]
    for i in range(n):
        W[structure.factor_diagonal[i]] += mass[i]
    _factor(structure, W, row)
    for i in range(n):
        K[0, i] = half * (F[0, i] + 0.5 * (b1[i] - b0[i]))
    _solve(structure, W, K[0])
    for i in range(n):
        K[1, i] = half * (F[0, i] + 1.5 * (b1[i] - b0[i])) + 2.0 * mass[i] * K[0, i]
        X[0, i] = x0[i] + 2.0 * K[0, i]
    _solve(structure, W, K[1])
    _rate(structure, A, N, X[0], fourth[1], b1, F[1])
    for i in range(n):
        K[2, i] = half * F[1, i] + 0.5 * mass[i] * (K[0, i] - K[1, i])
    _solve(structure, W, K[2])
    for i in range(n):
        X[1, i] = X[0, i] + K[2, i]
    _rate(structure, A, N, X[1], fourth[2], b1, F[2])
    for i in range(n):
        K[3, i] = half * F[2, i] + 0.5 * mass[i] * (K[0, i] - K[1, i] - _EIGHT_THIRDS * K[2, i])
    _solve(structure, W, K[3])


@_compiled
def _length_derivative(structure, A, N, h, b0, b1, b_slope, W, K, X, slope, F, K_dot, work, cubes, velocity):
    """d x1 / d h of the step whose stages are given, with b1 moving along `b_slope` as the step's end moves."""
    n = velocity.shape[0]
    mass = structure.mass
    half = 0.5 * h
    # W K_dot = d(rhs) - W_dot K, with W_dot = -J/2.
    _jacobian_product(structure, A, N, slope, K[0], K_dot[0])
    for i in range(n):
        K_dot[0, i] = 0.5 * (K_dot[0, i] + F[0, i] + 0.5 * (b1[i] - b0[i])) + half * 0.5 * b_slope[i]
    _solve(structure, W, K_dot[0])
    _jacobian_product(structure, A, N, slope, K[1], K_dot[1])
    for i in range(n):
        K_dot[1, i] = 0.5 * (K_dot[1, i] + F[0, i] + 1.5 * (b1[i] - b0[i])) + half * 1.5 * b_slope[i]
        K_dot[1, i] += 2.0 * mass[i] * K_dot[0, i]
    _solve(structure, W, K_dot[1])
    for stage in range(2, 4):
        for i in range(n):
            velocity[i] = 2.0 * K_dot[0, i]
            if stage == 3:
                velocity[i] += K_dot[2, i]
        _cubes(X[stage - 2], cubes)
        _jacobian_product(structure, A, N, cubes, velocity, work)
        _jacobian_product(structure, A, N, slope, K[stage], K_dot[stage])
        for i in range(n):
            carried = K_dot[0, i] - K_dot[1, i]
            if stage == 3:
                carried -= _EIGHT_THIRDS * K_dot[2, i]
            K_dot[stage, i] = 0.5 * (K_dot[stage, i] + F[stage - 1, i] + mass[i] * carried)
            K_dot[stage, i] += half * (work[i] + b_slope[i])
        _solve(structure, W, K_dot[stage])
    for i in range(n):
        velocity[i] = 2.0 * K_dot[0, i] + K_dot[2, i] + K_dot[3, i]


@_compiled
def _heat_inputs(structure, forcing, inputs, b):
    """b = B w."""
    b[:] = 0.0
    for p in range(forcing.shape[0]):
        b[structure.forcing_row[p]] += forcing[p] * inputs[structure.forcing_column[p]]


@_compiled
def _add_heaters(structure, heating, status, b):
    for p in range(heating.shape[0]):
        b[structure.heating_row[p]] += status[structure.heating_heater[p]] * heating[p]


@_compiled
def _rate_of_row(structure, A, N, x, b, i):
    """The rate of one state."""
    total = b
    for p in range(structure.linear_start[i], structure.linear_start[i + 1]):
        total += A[p] * x[structure.linear_column[p]]
    for p in range(structure.radiative_start[i], structure.radiative_start[i + 1]):
        total += N[p] * x[structure.radiative_column[p]] ** 4
    return total


@_compiled
def _cubic_crossing(before, end, first, last):
    """Where in 0..1 the cubic from before < 0 to end > 0, with end slopes first and last, is zero; its slope there."""
    low, high = 0.0, 1.0
    share = before / (before - end)
    rate = end - before
    for _ in range(20):
        rest = 1.0 - share
        value = (
            before * (1.0 + 2.0 * share) * rest * rest
            + end * share * share * (3.0 - 2.0 * share)
            + first * share * rest * rest
            - last * share * share * rest
        )
        rate = (
            6.0 * share * rest * (end - before)
            + first * rest * (1.0 - 3.0 * share)
            + last * share * (3.0 * share - 2.0)
        )
        if abs(value) < 1e-9 * (end - before):
            break
        if value > 0.0:
            high = share
        else:
            low = share
        share = share - value / rate if rate > 0.0 else -1.0
        if not (low < share < high):
            share = 0.5 * (low + high)
    return share, rate


@_compiled
def _started(temperature, status, lower, upper):
    """Status with which a thermostat begins to act."""
    if temperature < lower:
        return 1.0
    if temperature > upper:
        return 0.0
    return 1.0 if status > 0.5 else 0.0


@_compiled
def forward(
    structure, A, N, forcing, heating, lower, upper, initial,
    times, inputs, measured, initially_on,
    states, status, segment_step, segment_start, segment_length, segment_event, segment_state, segment_heater,
):  # fmt: skip
    """Integrate over the grid; returns (outcome, segments).

    Filled: states [K+1, n], status [K+1, H] just after each grid point, and for every segment: its grid step, start
    within the window (s), length (s), the heater that switches at its end (-1: none), initial state [., n] and heater
    status [., H].
    """
    n = initial.shape[0]
    H = lower.shape[0]
    steps = times.shape[0] - 1
    W = np.empty(structure.factor_column.shape[0])
    K = np.empty((4, n))
    X = np.empty((2, n))
    fourth = np.empty((3, n))
    F = np.empty((3, n))
    row, slope = np.empty(n), np.empty(n)
    b_left, b_right, b_slope = np.empty(n), np.empty(n), np.empty(n)  # input heat on the step's ends
    b0, b1 = np.empty(n), np.empty(n)  # all heat on the segment's ends
    u_heat, rate_before = np.empty(n), np.empty(n)  # heat of the heaters; rate at the segment's start
    x, x1 = initial.copy(), np.empty(n)
    u = np.empty(H)
    driven = np.empty(H, np.bool_)  # by its measured status, in the step before
    for k in range(H):
        u[k] = measured[0, k]
        driven[k] = not np.isnan(measured[0, k])
        if not driven[k]:
            u[k] = _started(x[structure.sensor[k]], initially_on[k], lower[k], upper[k])
    states[0] = x
    status[0] = u
    _heat_inputs(structure, forcing, inputs[0], b_right)
    segments = 0
    for step in range(steps):
        t_end = times[step + 1]
        duration = t_end - times[step]
        b_left[:] = b_right
        _heat_inputs(structure, forcing, inputs[step + 1], b_right)
        if duration > 0.0:
            for k in range(H):
                if not np.isnan(measured[step, k]):
                    u[k] = measured[step, k]
                    driven[k] = True
                elif driven[k]:
                    u[k] = _started(x[structure.sensor[k]], u[k], lower[k], upper[k])
                    driven[k] = False
            for i in range(n):
                b_slope[i] = (b_right[i] - b_left[i]) / duration
            t = times[step]
            while True:
                if segments >= segment_step.shape[0]:
                    return TOO_MANY_SWITCHES, segments
                h = t_end - t
                begin = t - times[step]
                for i in range(n):
                    b0[i] = b_left[i] + b_slope[i] * begin
                    b1[i] = b_right[i]
                _add_heaters(structure, heating, u, b0)
                _add_heaters(structure, heating, u, b1)
                _stages(structure, A, N, x, h, b0, b1, W, row, K, X, fourth, slope, F)
                for i in range(n):
                    x1[i] = X[1, i] + K[3, i]

                for i in range(n):
                    rate_before[i] = F[0, i]
                    u_heat[i] = b1[i] - b_right[i]
                # The earliest of the thermostats that are past their threshold at the segment's end.
                event = -1
                tau = h
                trial = h
                for k in range(H):
                    if not np.isnan(measured[step, k]):
                        continue
                    sensor = structure.sensor[k]
                    threshold = upper[k] if u[k] > 0.5 else lower[k]
                    sign = 1.0 if u[k] > 0.5 else -1.0
                    end = sign * (x1[sensor] - threshold)
                    if not end > 0.0:
                        continue
                    # Safeguarded secant steps on the discrete solution: low is before the crossing, high after it. They
                    # start at the crossing of the cubic through the step's ends, which is nearly there.
                    before = sign * (x[sensor] - threshold)
                    low, high = 0.0, h
                    trial, rate = 0.0, 0.0
                    if before < 0.0:
                        first = sign * rate_before[sensor] * h
                        last = sign * _rate_of_row(structure, A, N, x1, b_right[sensor] + u_heat[sensor], sensor) * h
                        share, rate = _cubic_crossing(before, end, first, last)
                        trial, rate = share * h, rate / h
                    previous, previous_value = trial, 0.0
                    for iteration in range(_LOCATION_ITERATIONS):
                        for i in range(n):
                            b1[i] = b0[i] + b_slope[i] * trial
                        _stages(structure, A, N, x, trial, b0, b1, W, row, K, X, fourth, slope, F)
                        value = sign * (X[1, sensor] + K[3, sensor] - threshold)
                        if abs(value) < _CROSSING_TOLERANCE or high - low < 1e-12 * h:
                            break
                        if value > 0.0:
                            high = trial
                        else:
                            low = trial
                        if iteration > 0 and value != previous_value:
                            rate = (value - previous_value) / (trial - previous)
                        previous, previous_value = trial, value
                        trial = trial - value / rate if rate > 0.0 else -1.0
                        if not (low < trial < high):
                            trial = 0.5 * (low + high)
                    if trial < tau:
                        tau = trial
                        event = k

                segment_step[segments] = step
                segment_start[segments] = t
                segment_length[segments] = tau
                segment_event[segments] = event
                segment_state[segments] = x
                segment_heater[segments] = u
                segments += 1
                if event < 0:
                    x[:] = x1
                    break
                if trial != tau:
                    for i in range(n):
                        b1[i] = b0[i] + b_slope[i] * tau
                    _stages(structure, A, N, x, tau, b0, b1, W, row, K, X, fourth, slope, F)
                for i in range(n):
                    x[i] = X[1, i] + K[3, i]
                u[event] = 1.0 - u[event]
                t += tau
                if t >= t_end:
                    break
            for i in range(n):
                if not np.isfinite(x[i]):
                    return NOT_FINITE, segments
        states[step + 1] = x
        status[step + 1] = u
    return FINISHED, segments


@_compiled
def adjoint(
    structure, A, N, forcing, heating, times, inputs,
    segment_step, segment_start, segment_length, segment_event, segment_state, segment_heater,
    states_bar, A_bar, N_bar, forcing_bar, heating_bar, lower_bar, upper_bar, x_bar,
):  # fmt: skip
    """Pull the cotangent `states_bar` [K+1, n] of the states on the grid back to the system (arrays ending in _bar).

    The segments are those that `forward` recorded; each is recomputed from its initial state. The cotangents are
    added to what the arrays hold, except x_bar [n], that of the initial state, which is overwritten.
    """
    n = x_bar.shape[0]
    mass = structure.mass
    W = np.empty(structure.factor_column.shape[0])
    K = np.empty((4, n))
    K_dot = np.empty((4, n))
    X = np.empty((2, n))
    fourth = np.empty((3, n))
    F = np.empty((3, n))
    row, slope, work, cubes, velocity = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    b_left, b_right, b_slope = np.empty(n), np.empty(n), np.empty(n)
    b0, b1 = np.empty(n), np.empty(n)
    V = np.empty((4, n))  # adjoint stages W^-T K_bar
    K_bar = np.empty((4, n))
    linear, radiative = np.empty(n), np.empty((4, n))
    F0_bar, b0_bar, b1_bar = np.empty(n), np.empty(n), np.empty(n)
    left_bar, right_bar = np.empty(n), np.empty(n)  # of the input heat on the step's ends
    heat_bar = np.empty(n)

    x_bar[:] = 0.0
    segment = segment_step.shape[0] - 1
    _heat_inputs(structure, forcing, inputs[times.shape[0] - 1], b_left)
    for step in range(times.shape[0] - 2, -1, -1):
        for i in range(n):
            x_bar[i] += states_bar[step + 1, i]
        b_right[:] = b_left
        _heat_inputs(structure, forcing, inputs[step], b_left)
        duration = times[step + 1] - times[step]
        if duration <= 0.0:
            continue
        for i in range(n):
            b_slope[i] = (b_right[i] - b_left[i]) / duration
            left_bar[i] = 0.0
            right_bar[i] = 0.0
        time_bar = 0.0  # cotangent of the time at which the current segment ends
        while segment >= 0 and segment_step[segment] == step:
            h = segment_length[segment]
            half = 0.5 * h
            event = segment_event[segment]
            x0 = segment_state[segment]
            u = segment_heater[segment]
            begin = segment_start[segment] - times[step]
            for i in range(n):
                b0[i] = b_left[i] + b_slope[i] * begin
                b1[i] = b_left[i] + b_slope[i] * (begin + h)
            _add_heaters(structure, heating, u, b0)
            _add_heaters(structure, heating, u, b1)
            _stages(structure, A, N, x0, h, b0, b1, W, row, K, X, fourth, slope, F)

            if event >= 0:
                # The segment's length solves x1[sensor] = threshold: dL/dh must vanish in total.
                _length_derivative(structure, A, N, h, b0, b1, b_slope, W, K, X, slope, F, K_dot, work, cubes, velocity)
                total = time_bar
                for i in range(n):
                    total += x_bar[i] * velocity[i]
                multiplier = total / velocity[structure.sensor[event]]
                x_bar[structure.sensor[event]] -= multiplier
                if u[event] > 0.5:
                    upper_bar[event] += multiplier
                else:
                    lower_bar[event] += multiplier

            for i in range(n):
                K_bar[0, i] = 2.0 * x_bar[i]
                K_bar[1, i] = 0.0
                K_bar[2, i] = x_bar[i]
                K_bar[3, i] = x_bar[i]
                b1_bar[i] = 0.0
            # Stages 4 and 3: V = W^-T K_bar, then through the rate at the stage's argument.
            for stage in range(3, 1, -1):
                V[stage] = K_bar[stage]
                _solve_transposed(structure, W, V[stage])
                _transposed_products(structure, A, N, V[stage], linear, radiative[stage])
                _cubes(X[stage - 2], cubes)
                for i in range(n):
                    carried = 0.5 * mass[i] * V[stage, i]
                    argument_bar = half * (linear[i] + radiative[stage, i] * cubes[i])
                    b1_bar[i] += half * V[stage, i]
                    x_bar[i] += argument_bar
                    K_bar[0, i] += carried + 2.0 * argument_bar
                    K_bar[1, i] -= carried
                    if stage == 3:
                        K_bar[2, i] += argument_bar - _EIGHT_THIRDS * carried
            V[1] = K_bar[1]
            _solve_transposed(structure, W, V[1])
            for i in range(n):
                K_bar[0, i] += 2.0 * mass[i] * V[1, i]
            V[0] = K_bar[0]
            _solve_transposed(structure, W, V[0])
            for i in range(n):
                F0_bar[i] = half * (V[0, i] + V[1, i])
                jump = half * (0.5 * V[0, i] + 1.5 * V[1, i])
                b1_bar[i] += jump
                b0_bar[i] = F0_bar[i] - jump
            _transposed_products(structure, A, N, V[0], linear, radiative[0])
            _transposed_products(structure, A, N, V[1], work, radiative[1])
            for i in range(n):
                x_bar[i] += half * (linear[i] + work[i] + (radiative[0, i] + radiative[1, i]) * slope[i])
                # W depends on x0 through J = A + N diag(4 x0^3).
                total = 0.0
                for stage in range(4):
                    total += radiative[stage, i] * K[stage, i]
                x_bar[i] += half * 12.0 * x0[i] * x0[i] * total

            for i in range(n):
                v0, v1, v2, v3 = half * V[0, i], half * V[1, i], half * V[2, i], half * V[3, i]
                for p in range(structure.linear_start[i], structure.linear_start[i + 1]):
                    j = structure.linear_column[p]
                    A_bar[p] += (
                        v0 * (x0[j] + K[0, j])
                        + v1 * (x0[j] + K[1, j])
                        + v2 * (X[0, j] + K[2, j])
                        + v3 * (X[1, j] + K[3, j])
                    )
                for p in range(structure.radiative_start[i], structure.radiative_start[i + 1]):
                    j = structure.radiative_column[p]
                    N_bar[p] += (
                        v0 * (fourth[0, j] + slope[j] * K[0, j])
                        + v1 * (fourth[0, j] + slope[j] * K[1, j])
                        + v2 * (fourth[1, j] + slope[j] * K[2, j])
                        + v3 * (fourth[2, j] + slope[j] * K[3, j])
                    )
                heat_bar[i] = v0 + v1 + v2 + v3
            for p in range(heating.shape[0]):
                heating_bar[p] += u[structure.heating_heater[p]] * heat_bar[structure.heating_row[p]]

            # Heat at the segment's ends back to the step's ends, and the cotangent of the segment's start.
            share0 = begin / duration
            share1 = (begin + h) / duration if event >= 0 else 1.0
            start_bar = 0.0
            for i in range(n):
                start_bar += b_slope[i] * b0_bar[i]
                left_bar[i] += (1.0 - share0) * b0_bar[i] + (1.0 - share1) * b1_bar[i]
                right_bar[i] += share0 * b0_bar[i] + share1 * b1_bar[i]
            if event >= 0:
                start_bar += time_bar
                for i in range(n):
                    start_bar += b_slope[i] * b1_bar[i]
            elif begin > 0.0:
                # The segment ends at the grid point, so its length shrinks as its start moves.
                for stage in range(4):
                    _jacobian_product(structure, A, N, slope, K[stage], work)
                    for i in range(n):
                        rate = F[max(stage - 1, 0), i]
                        if stage == 0:
                            rate += 0.5 * (b1[i] - b0[i])
                        elif stage == 1:
                            rate += 1.5 * (b1[i] - b0[i])
                        start_bar -= 0.5 * V[stage, i] * (rate + work[i])
            time_bar = start_bar
            segment -= 1
        for p in range(forcing.shape[0]):
            i, j = structure.forcing_row[p], structure.forcing_column[p]
            forcing_bar[p] += left_bar[i] * inputs[step, j] + right_bar[i] * inputs[step + 1, j]
    for i in range(n):
        x_bar[i] += states_bar[0, i]


@_compiled
def interpolate(index, weight, on_grid, states, offsets, at_samples):
    """Fill at_samples [T, N] with the grid's [K+1, n] `states` [N], linear between points, plus offsets [N]."""
    for t in range(at_samples.shape[0]):
        k, share = index[t], weight[t]
        for c in range(states.shape[0]):
            left, right = on_grid[k, states[c]], on_grid[k + 1, states[c]]
            at_samples[t, c] = (1.0 - share) * left + share * right + offsets[c]


@_compiled
def spread(index, weight, at_samples, states, on_grid):
    """Add the transpose of `interpolate` to on_grid [K+1, n]."""
    for t in range(at_samples.shape[0]):
        k, share = index[t], weight[t]
        for c in range(states.shape[0]):
            on_grid[k, states[c]] += (1.0 - share) * at_samples[t, c]
            on_grid[k + 1, states[c]] += share * at_samples[t, c]
