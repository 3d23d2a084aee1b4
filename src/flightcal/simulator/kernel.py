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
*discrete* solution meets the threshold is found by Newton's method, the heater switches, and the rest of the step
follows. The derivative goes through tau by the implicit function theorem, so what `adjoint` returns is the exact
gradient of what `forward` computes. A piece of a step between such cuts is called a segment.

LU factorisation runs without pivoting: with conduction and radiation between nodes W is an M-matrix.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

_compiled: Any = njit(nogil=True, cache=True, error_model="numpy")

FINISHED = 0
NOT_FINITE = 1
TOO_MANY_SWITCHES = 2

_NEWTON_ITERATIONS = 40
_CROSSING_TOLERANCE = 1e-11  # K, on the sensor at the switch
_EIGHT_THIRDS = 8.0 / 3.0


@_compiled
def _factor(W):
    """LU in place (unit lower triangle); the diagonal is stored as its reciprocal."""
    n = W.shape[0]
    for k in range(n):
        pivot = 1.0 / W[k, k]
        W[k, k] = pivot
        for i in range(k + 1, n):
            if W[i, k] != 0.0:
                factor = W[i, k] * pivot
                W[i, k] = factor
                for j in range(k + 1, n):
                    W[i, j] -= factor * W[k, j]


@_compiled
def _solve(W, r):
    n = W.shape[0]
    for i in range(n):
        total = r[i]
        for j in range(i):
            total -= W[i, j] * r[j]
        r[i] = total
    for i in range(n - 1, -1, -1):
        total = r[i]
        for j in range(i + 1, n):
            total -= W[i, j] * r[j]
        r[i] = total * W[i, i]


@_compiled
def _solve_transposed(W, r):
    n = W.shape[0]
    for i in range(n):
        value = r[i] * W[i, i]
        r[i] = value
        for j in range(i + 1, n):
            r[j] -= W[i, j] * value
    for i in range(n - 1, -1, -1):
        value = r[i]
        for j in range(i):
            r[j] -= W[i, j] * value


@_compiled
def _mix(E, x, e):
    """e = E x; an E without rows is the identity."""
    if E.shape[0] == 0:
        for i in range(e.shape[0]):
            e[i] = x[i]
        return
    for i in range(E.shape[0]):
        total = 0.0
        for j in range(x.shape[0]):
            total += E[i, j] * x[j]
        e[i] = total


@_compiled
def _mix_transposed_add(E, e, x):
    """x += E^T e."""
    if E.shape[0] == 0:
        for i in range(e.shape[0]):
            x[i] += e[i]
        return
    for i in range(E.shape[0]):
        for j in range(x.shape[0]):
            x[j] += E[i, j] * e[i]


@_compiled
def _rate(A, N, E, x, b, gu, e, f):
    """f = A x + N (E x)^4 + b + gu; leaves E x in e."""
    n = x.shape[0]
    m = e.shape[0]
    _mix(E, x, e)
    for i in range(n):
        total = b[i] + gu[i]
        for j in range(n):
            total += A[i, j] * x[j]
        for j in range(m):
            square = e[j] * e[j]
            total += N[i, j] * square * square
        f[i] = total


@_compiled
def _jacobian(A, N, E, e, J):
    """J = A + N diag(4 e^3) E."""
    n = A.shape[0]
    m = e.shape[0]
    for i in range(n):
        for j in range(n):
            J[i, j] = A[i, j]
    if E.shape[0] == 0:
        for j in range(m):
            slope = 4.0 * e[j] ** 3
            for i in range(n):
                J[i, j] += N[i, j] * slope
        return
    for k in range(m):
        slope = 4.0 * e[k] ** 3
        for i in range(n):
            weight = N[i, k] * slope
            if weight != 0.0:
                for j in range(n):
                    J[i, j] += weight * E[k, j]


@_compiled
def _stages(A, N, E, mass, x0, h, b0, b1, gu, W, J, K, X, e, F):
    """The four stages of a step of length h from x0.

    Fills W (factored), J(x0), K [4, n], X [2, n] (arguments of stages 3 and 4), e [3, m] and F [3, n] (radiating
    temperatures and rates at x0 and at the two arguments).
    """
    n = x0.shape[0]
    half = 0.5 * h
    _rate(A, N, E, x0, b0, gu, e[0], F[0])
    _jacobian(A, N, E, e[0], J)
    for i in range(n):
        for j in range(n):
            W[i, j] = -half * J[i, j]
        W[i, i] += mass[i]
    _factor(W)
    for i in range(n):
        K[0, i] = half * (F[0, i] + 0.5 * (b1[i] - b0[i]))
    _solve(W, K[0])
    for i in range(n):
        K[1, i] = half * (F[0, i] + 1.5 * (b1[i] - b0[i])) + 2.0 * mass[i] * K[0, i]
    _solve(W, K[1])
    for i in range(n):
        X[0, i] = x0[i] + 2.0 * K[0, i]
    _rate(A, N, E, X[0], b1, gu, e[1], F[1])
    for i in range(n):
        K[2, i] = half * F[1, i] + 0.5 * mass[i] * (K[0, i] - K[1, i])
    _solve(W, K[2])
    for i in range(n):
        X[1, i] = X[0, i] + K[2, i]
    _rate(A, N, E, X[1], b1, gu, e[2], F[2])
    for i in range(n):
        K[3, i] = half * F[2, i] + 0.5 * mass[i] * (K[0, i] - K[1, i] - _EIGHT_THIRDS * K[2, i])
    _solve(W, K[3])


@_compiled
def _length_derivative(A, N, E, mass, h, b0, b1, slope, W, J, K, e, F, K_dot, velocity):
    """d x1 / d h of the step whose stages are given, with b1 moving along `slope` as the step's end moves."""
    n = A.shape[0]
    m = e.shape[1]
    half = 0.5 * h
    direction = np.empty(n)
    mixed = np.empty(m)

    for stage in range(4):
        for i in range(n):
            total = 0.0
            for j in range(n):
                total += J[i, j] * K[stage, j]
            K_dot[stage, i] = 0.5 * total  # W K_dot = d(rhs) - W_dot K with W_dot = -J/2
    for i in range(n):
        K_dot[0, i] += 0.5 * (F[0, i] + 0.5 * (b1[i] - b0[i])) + half * 0.5 * slope[i]
    _solve(W, K_dot[0])
    for i in range(n):
        K_dot[1, i] += 0.5 * (F[0, i] + 1.5 * (b1[i] - b0[i])) + half * 1.5 * slope[i] + 2.0 * mass[i] * K_dot[0, i]
    _solve(W, K_dot[1])
    for stage in range(2, 4):
        for i in range(n):
            direction[i] = 2.0 * K_dot[0, i]
            if stage == 3:
                direction[i] += K_dot[2, i]
        _mix(E, direction, mixed)
        for i in range(n):
            total = slope[i]
            for j in range(n):
                total += A[i, j] * direction[j]
            for j in range(m):
                total += N[i, j] * 4.0 * e[stage - 1, j] ** 3 * mixed[j]
            K_dot[stage, i] += 0.5 * F[stage - 1, i] + half * total
            carried = K_dot[0, i] - K_dot[1, i]
            if stage == 3:
                carried -= _EIGHT_THIRDS * K_dot[2, i]
            K_dot[stage, i] += 0.5 * mass[i] * carried
        _solve(W, K_dot[stage])
    for i in range(n):
        velocity[i] = 2.0 * K_dot[0, i] + K_dot[2, i] + K_dot[3, i]


@_compiled
def _combine_heaters(heating, state, gu):
    for i in range(gu.shape[0]):
        total = 0.0
        for k in range(heating.shape[0]):
            total += state[k] * heating[k, i]
        gu[i] = total


@_compiled
def _sensor(S, k, x):
    total = 0.0
    for j in range(x.shape[0]):
        total += S[k, j] * x[j]
    return total


@_compiled
def forward(
    A, N, B_inputs, heating, lower, upper, initial,
    times, mass, S, E, measured, initially_on,
    states, status, segment_step, segment_start, segment_length, segment_event, segment_state, segment_heater,
):  # fmt: skip
    """Integrate over the grid; returns (outcome, segments, switches).

    B_inputs [K+1, n] is b on the grid. Filled: states [K+1, n], status [K+1, H] after each grid point's switches, and
    for every segment: its grid step, start within the window (s), length (s), the heater that switches at its end
    (-1: none), initial state [., n] and heater status [., H].
    """
    n = A.shape[0]
    H = heating.shape[0]
    m = N.shape[1]
    steps = times.shape[0] - 1
    capacity = segment_step.shape[0]
    W = np.empty((n, n))
    J = np.empty((n, n))
    K = np.empty((4, n))
    K_dot = np.empty((4, n))
    X = np.empty((2, n))
    e = np.empty((3, m))
    F = np.empty((3, n))
    x = initial.copy()
    x1 = np.empty(n)
    velocity = np.empty(n)
    b0 = np.empty(n)
    b1 = np.empty(n)
    b_end = np.empty(n)
    slope = np.empty(n)
    gu = np.empty(n)
    u = np.empty(H)
    for k in range(H):
        u[k] = initially_on[k]
        sensor = _sensor(S, k, x)
        if sensor < lower[k]:
            u[k] = 1.0
        elif sensor > upper[k]:
            u[k] = 0.0
    states[0] = x
    segments = 0
    switches = 0
    for step in range(steps):
        t_start = times[step]
        t_end = times[step + 1]
        duration = t_end - t_start
        for k in range(H):
            if not np.isnan(measured[step, k]):
                u[k] = measured[step, k]
        if step == 0:
            status[0] = u
        if duration > 0.0:
            for i in range(n):
                slope[i] = (B_inputs[step + 1, i] - B_inputs[step, i]) / duration
                b0[i] = B_inputs[step, i]
            t = t_start
            while True:
                if segments >= capacity:
                    return TOO_MANY_SWITCHES, segments, switches
                h = t_end - t
                for i in range(n):
                    b_end[i] = B_inputs[step + 1, i]
                _combine_heaters(heating, u, gu)
                _stages(A, N, E, mass, x, h, b0, b_end, gu, W, J, K, X, e, F)
                for i in range(n):
                    x1[i] = X[1, i] + K[3, i]

                # The earliest of the thermostats that are past their threshold at the segment's end.
                event = -1
                tau = h
                for k in range(H):
                    if not np.isnan(measured[step, k]):
                        continue
                    threshold = upper[k] if u[k] > 0.5 else lower[k]
                    sign = 1.0 if u[k] > 0.5 else -1.0
                    end = sign * (_sensor(S, k, x1) - threshold)
                    if end <= 0.0:
                        continue
                    # Safeguarded Newton on the discrete solution: low is before the crossing, high after it.
                    start = sign * (_sensor(S, k, x) - threshold)
                    low, high = 0.0, h
                    trial = h * start / (start - end) if start < 0.0 else 0.0
                    for _ in range(_NEWTON_ITERATIONS):
                        for i in range(n):
                            b1[i] = b0[i] + slope[i] * trial
                        _stages(A, N, E, mass, x, trial, b0, b1, gu, W, J, K, X, e, F)
                        _length_derivative(A, N, E, mass, trial, b0, b1, slope, W, J, K, e, F, K_dot, velocity)
                        value = 0.0
                        rate = 0.0
                        for i in range(n):
                            value += S[k, i] * (X[1, i] + K[3, i])
                            rate += S[k, i] * velocity[i]
                        value = sign * (value - threshold)
                        rate = sign * rate
                        if abs(value) < _CROSSING_TOLERANCE:
                            break
                        if value > 0.0:
                            high = trial
                        else:
                            low = trial
                        trial = trial - value / rate if rate != 0.0 else -1.0
                        if not (low < trial < high):
                            trial = 0.5 * (low + high)
                        if high - low < 1e-12 * h:
                            break
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
                for i in range(n):
                    b1[i] = b0[i] + slope[i] * tau
                _stages(A, N, E, mass, x, tau, b0, b1, gu, W, J, K, X, e, F)
                for i in range(n):
                    x[i] = X[1, i] + K[3, i]
                    b0[i] = b1[i]
                u[event] = 1.0 - u[event]
                switches += 1
                t += tau
                if t >= t_end:
                    break
            for i in range(n):
                if not np.isfinite(x[i]):
                    return NOT_FINITE, segments, switches
        states[step + 1] = x
        status[step + 1] = u
    return FINISHED, segments, switches


@_compiled
def adjoint(
    A, N, B_inputs, heating, lower, upper,
    times, mass, S, E,
    segments, segment_step, segment_start, segment_length, segment_event, segment_state, segment_heater,
    states_bar, A_bar, N_bar, B_inputs_bar, heating_bar, lower_bar, upper_bar, initial_bar,
):  # fmt: skip
    """Pull the cotangent `states_bar` [K+1, n] of the states on the grid back to the system (arrays ending in _bar).

    The segments are those that `forward` recorded; each is recomputed from its initial state. The cotangents
    are added to what the arrays hold, initial_bar [n] is overwritten.
    """
    n = A.shape[0]
    H = heating.shape[0]
    m = N.shape[1]
    W = np.empty((n, n))
    J = np.empty((n, n))
    K = np.empty((4, n))
    K_dot = np.empty((4, n))
    X = np.empty((2, n))
    e = np.empty((3, m))
    F = np.empty((3, n))
    b0 = np.empty(n)
    b1 = np.empty(n)
    slope = np.empty(n)
    gu = np.empty(n)
    velocity = np.empty(n)
    x_bar = initial_bar  # the running cotangent of the state
    V = np.empty((4, n))  # adjoint stages W^-T K_bar
    K_bar = np.empty((4, n))
    X_bar = np.empty(n)
    F0_bar = np.empty(n)
    b0_bar = np.empty(n)
    b1_bar = np.empty(n)
    e_bar = np.empty(m)
    mixed = np.empty((4, m))
    pulled = np.empty((4, m))

    x_bar[:] = 0.0
    time_bar = 0.0  # cotangent of the time at which the current segment ends
    segment = segments - 1
    for step in range(times.shape[0] - 2, -1, -1):
        for i in range(n):
            x_bar[i] += states_bar[step + 1, i]
        time_bar = 0.0
        duration = times[step + 1] - times[step]
        if duration > 0.0:
            for i in range(n):
                slope[i] = (B_inputs[step + 1, i] - B_inputs[step, i]) / duration
        while segment >= 0 and segment_step[segment] == step:
            h = segment_length[segment]
            event = segment_event[segment]
            x0 = segment_state[segment]
            u = segment_heater[segment]
            begin = segment_start[segment] - times[step]
            for i in range(n):
                b0[i] = B_inputs[step, i] + slope[i] * begin
                b1[i] = b0[i] + slope[i] * h
            _combine_heaters(heating, u, gu)
            _stages(A, N, E, mass, x0, h, b0, b1, gu, W, J, K, X, e, F)
            half = 0.5 * h

            if event >= 0:
                # The segment's length solves S x1 = threshold: dL/dh must vanish in total.
                _length_derivative(A, N, E, mass, h, b0, b1, slope, W, J, K, e, F, K_dot, velocity)
                total = time_bar
                rate = 0.0
                for i in range(n):
                    total += x_bar[i] * velocity[i]
                    rate += S[event, i] * velocity[i]
                multiplier = total / rate
                for i in range(n):
                    x_bar[i] -= multiplier * S[event, i]
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
                _solve_transposed(W, V[stage])
                for i in range(n):
                    carried = 0.5 * mass[i] * V[stage, i]
                    K_bar[0, i] += carried
                    K_bar[1, i] -= carried
                    if stage == 3:
                        K_bar[2, i] -= _EIGHT_THIRDS * carried
                    b1_bar[i] += half * V[stage, i]
                for j in range(n):
                    total = 0.0
                    for i in range(n):
                        total += A[i, j] * V[stage, i]
                    X_bar[j] = half * total
                for j in range(m):
                    total = 0.0
                    for i in range(n):
                        total += N[i, j] * V[stage, i]
                    pulled[stage, j] = total
                    e_bar[j] = half * total * 4.0 * e[stage - 1, j] ** 3
                _mix_transposed_add(E, e_bar, X_bar)
                for i in range(n):
                    x_bar[i] += X_bar[i]
                    K_bar[0, i] += 2.0 * X_bar[i]
                    if stage == 3:
                        K_bar[2, i] += X_bar[i]
            V[1] = K_bar[1]
            _solve_transposed(W, V[1])
            for i in range(n):
                K_bar[0, i] += 2.0 * mass[i] * V[1, i]
            V[0] = K_bar[0]
            _solve_transposed(W, V[0])
            for i in range(n):
                F0_bar[i] = half * (V[0, i] + V[1, i])
                jump = half * (0.5 * V[0, i] + 1.5 * V[1, i])
                b1_bar[i] += jump
                b0_bar[i] = F0_bar[i] - jump
            for j in range(n):
                total = 0.0
                for i in range(n):
                    total += A[i, j] * F0_bar[i]
                x_bar[j] += total
            for j in range(m):
                for stage in range(2):
                    total = 0.0
                    for i in range(n):
                        total += N[i, j] * V[stage, i]
                    pulled[stage, j] = total
                e_bar[j] = half * (pulled[0, j] + pulled[1, j]) * 4.0 * e[0, j] ** 3
            # W depends on x0 through J = A + N diag(4 e0^3) E.
            for stage in range(4):
                _mix(E, K[stage], mixed[stage])
            for j in range(m):
                total = 0.0
                for stage in range(4):
                    total += pulled[stage, j] * mixed[stage, j]
                e_bar[j] += half * 12.0 * e[0, j] ** 2 * total
            _mix_transposed_add(E, e_bar, x_bar)

            for i in range(n):
                w0 = half * V[0, i]
                w1 = half * V[1, i]
                w2 = half * V[2, i]
                w3 = half * V[3, i]
                for j in range(n):
                    A_bar[i, j] += (
                        w0 * (x0[j] + K[0, j])
                        + w1 * (x0[j] + K[1, j])
                        + w2 * (X[0, j] + K[2, j])
                        + w3 * (X[1, j] + K[3, j])
                    )
                for j in range(m):
                    slope4 = 4.0 * e[0, j] ** 3
                    N_bar[i, j] += (
                        w0 * (e[0, j] ** 4 + slope4 * mixed[0, j])
                        + w1 * (e[0, j] ** 4 + slope4 * mixed[1, j])
                        + w2 * (e[1, j] ** 4 + slope4 * mixed[2, j])
                        + w3 * (e[2, j] ** 4 + slope4 * mixed[3, j])
                    )
                for k in range(H):
                    heating_bar[k, i] += u[k] * (w0 + w1 + w2 + w3)

            # b at the segment's ends back to the grid, and the cotangent of the segment's start.
            start_bar = 0.0
            for i in range(n):
                start_bar += slope[i] * b0_bar[i]
                if event >= 0:
                    start_bar += slope[i] * b1_bar[i]
            if event >= 0:
                start_bar += time_bar
                share1 = (begin + h) / duration
            else:
                share1 = 1.0
                for stage in range(4):
                    for i in range(n):
                        total = 0.0
                        for j in range(n):
                            total += J[i, j] * K[stage, j]
                        rate = F[max(stage - 1, 0), i]
                        if stage == 0:
                            rate += 0.5 * (b1[i] - b0[i])
                        elif stage == 1:
                            rate += 1.5 * (b1[i] - b0[i])
                        start_bar -= 0.5 * V[stage, i] * (rate + total)
            share0 = begin / duration
            for i in range(n):
                B_inputs_bar[step, i] += (1.0 - share0) * b0_bar[i] + (1.0 - share1) * b1_bar[i]
                B_inputs_bar[step + 1, i] += share0 * b0_bar[i] + share1 * b1_bar[i]
            time_bar = start_bar
            segment -= 1
    for i in range(n):
        x_bar[i] += states_bar[0, i]
