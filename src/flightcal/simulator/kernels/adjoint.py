"""Compiled derivative of the integration: the adjoint of `forward`, step by step backwards.

The derivative goes through a heater's switching time by the implicit function theorem, so what `adjoint` returns is
the exact gradient of what `forward` computes. Where the steps were not kept, each is computed again from its segment's
noted initial state, so the memory is one state a segment.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ...compiled import inlined, kernel, short_loops
from .sampling import Looks, Observed, finish_errors, in_balance, observe_end_back, observe_segment_back
from .step import (
    THIRD,
    add_stages,
    advance,
    bends,
    clear_bars,
    finish_bars,
    growth,
    length_derivative,
    make_step,
    prepare_transposed,
    radiative_transposed,
    solve_transposed,
    transposed_products,
)


class AdjointCall(NamedTuple):
    """What `adjoint` takes, after `forward` of a single simulation."""

    dense: Any
    """See `step`."""
    structure: Any
    packed: Any
    """[1, P]"""
    times: Any
    series: Any
    record: Any
    looks: Looks
    temperatures: Any
    """[1, T, N] K, what the sensors say,"""
    temperatures_bar: Any
    """[T, N] and its cotangent."""
    states_bar: Any
    """[K+1, n] cotangent of the states on the grid."""
    switches: Any
    """[1] number of the thermostats' switches E,"""
    switches_bar: Any
    """and the cotangents of their times in order of time: [at least E]."""
    memory: Any
    """[adjoint_memory_size(structure)]"""
    heat_bar: Any
    """[n, 2 K]"""
    errors_bar: Any
    """[3, N] what is asked for, of the sensors,"""
    packed_bar: Any
    """[P] and of the system."""


@kernel(long=True)
def adjoint(call):
    """Pull the cotangents back to packed_bar and errors_bar."""
    short_loops()
    dense = call.dense
    structure, packed, times, series, record = call.structure, call.packed[0], call.times, call.series, call.record
    states_bar, switches_bar, memory = call.states_bar, call.switches_bar[: call.switches[0]], call.memory
    heat_bar, packed_bar, errors_bar = call.heat_bar, call.packed_bar, call.errors_bar
    looks, errors, temperatures_bar = call.looks, call.looks.errors[0], call.temperatures_bar
    n, H = structure.mass.shape[0], structure.sensor.shape[0]
    a, m = structure.linear_column.shape[0], structure.radiative_column.shape[0]
    forcings, heatings = structure.forcing_row.shape[0], structure.heating_row.shape[0]
    mass = structure.mass
    first_forcing = a + m + structure.quadratic_column.shape[0]
    first_heating = first_forcing + forcings
    first_threshold = first_heating + heatings
    A, N, heating = packed[:a], packed[a : a + m], packed[first_heating:first_threshold]
    Q, Q_bar = packed[a + m : first_forcing], packed_bar[a + m : first_forcing]
    packed_bar[:] = 0.0
    A_bar, N_bar = packed_bar[:a], packed_bar[a : a + m]
    forcing_bar = packed_bar[first_forcing:first_heating]
    heating_bar = packed_bar[first_heating:first_threshold]
    lower_bar = packed_bar[first_threshold : first_threshold + H]
    upper_bar = packed_bar[first_threshold + H : first_threshold + 2 * H]
    x_bar = packed_bar[first_threshold + 2 * H :]

    last = record.steps.shape[0] - 1  # the place of all steps that were not kept
    workspace, u, ends = memory[: 6 * n], memory[6 * n : 6 * n + H], memory[6 * n + H : 6 * n + H + 2]
    vectors = memory[6 * n + H + 2 :].reshape(-1, n)
    x0, velocity, linear, radiative = vectors[0], vectors[1], vectors[2], vectors[3]
    left, ramp = vectors[4], vectors[5]  # heat of the inputs at the step's start, and its change per second
    left_bar, right_bar, b0_bar, b1_bar, f1_bar = vectors[6], vectors[7], vectors[8], vectors[9], vectors[10]
    v1, v2, v3, v4 = vectors[11], vectors[12], vectors[13], vectors[14]  # W^-T of the stages' cotangents
    radiative1, radiative2, radiative3, radiative4 = vectors[15], vectors[16], vectors[17], vectors[18]
    seen = Observed(
        vectors[19], vectors[20], vectors[21], vectors[22], vectors[23], vectors[24], ends[:1], ends[1:]
    )  # fmt: skip
    x0_seen, f1_seen, k1_seen, k2_seen = seen.x0, seen.f1, seen.k1, seen.k2
    k3_seen, k4_seen, start_seen, length_seen = seen.k3, seen.k4, seen.start, seen.length

    clear_bars(dense)
    heat_bar[:] = 0.0
    errors_bar[:] = 0.0
    last_point = times.shape[0] - 1
    temperatures = call.temperatures[0]
    segment = record.segments[0] - 1
    is_last = record.event[0, segment] < 0 and record.step[0, segment] + 2 == times.shape[0]
    observe_end_back(looks, errors, times[last_point], is_last, temperatures, temperatures_bar, x_bar, errors_bar)
    switch = switches_bar.shape[0] - 1
    for back in range(times.shape[0] - 1):
        step = times.shape[0] - 2 - back
        for i in range(n):
            x_bar[i] += states_bar[step + 1, i]
        duration = times[step + 1] - times[step]
        rate = 1.0 / duration
        for i in range(n):
            left[i] = record.heat[0, i, 2 * step]
            ramp[i] = (record.heat[0, i, 2 * step + 1] - left[i]) * rate
            left_bar[i] = 0.0
            right_bar[i] = 0.0
        time_bar = 0.0  # cotangent of the time at which the current segment ends
        while segment >= 0 and record.step[0, segment] == step:
            now = make_step(dense, structure, record.steps[min(segment, last)])
            slope, b0, b1 = now.slope, now.b0, now.b1
            k1, k2, k3, k4 = now.k1, now.k2, now.k3, now.k4
            h = record.length[0, segment]
            half = 0.5 * h
            event = record.event[0, segment]
            begin = record.start[0, segment] - times[step]
            for i in range(n):
                x0[i] = record.state[0, segment, i]
            for k in range(H):
                u[k] = record.heater[0, segment, k]
            if segment >= last:
                for i in range(n):
                    b0[i] = left[i] + ramp[i] * begin
                for p in range(heatings):
                    b0[structure.heating_row[p]] += u[structure.heating_heater[p]] * heating[p]
                for i in range(n):
                    b1[i] = b0[i] + ramp[i] * h
                advance(dense, structure, A, N, Q, x0, h, now)

            observed = observe_segment_back(
                structure, looks, errors, x0, now, record.start[0, segment], h, segment == 0, event >= 0 or begin > 0.0,
                in_balance(looks, record.heater, 0, segment), seen, temperatures, temperatures_bar, errors_bar,
            )  # fmt: skip

            if event >= 0:
                # The segment's length solves x1[sensor] = threshold: dL/dh must vanish in total.
                length_derivative(dense, structure, N, Q, x0, h, ramp, now, workspace, velocity)
                time_bar += switches_bar[switch]
                switch -= 1
                total = time_bar
                for i in range(n):
                    total += x_bar[i] * velocity[i]
                if observed:
                    total += length_seen[0]
                    d1, d2, d3, d4 = (
                        workspace[:n],
                        workspace[n : 2 * n],
                        workspace[2 * n : 3 * n],
                        workspace[3 * n : 4 * n],
                    )
                    for i in range(n):
                        total += k1_seen[i] * d1[i] + k2_seen[i] * d2[i] + k3_seen[i] * d3[i] + k4_seen[i] * d4[i]
                multiplier = total / velocity[structure.sensor[event]]
                x_bar[structure.sensor[event]] -= multiplier
                if u[event] > 0.5:
                    upper_bar[event] += multiplier
                else:
                    lower_bar[event] += multiplier

            # From the last stage to the first: v = W^-T k_bar, then on to what its right side is made of.
            for i in range(n):
                v4[i] = x_bar[i]
                v3[i] = x_bar[i]
                v2[i] = 0.0
                v1[i] = 2.0 * x_bar[i]
            if observed:
                for i in range(n):
                    v4[i] += k4_seen[i]
                    v3[i] += k3_seen[i]
                    v2[i] += k2_seen[i]
                    v1[i] += k1_seen[i]
            prepare_transposed(dense, structure, now.W)
            solve_transposed(dense, structure, now.W, v4)
            radiative_transposed(dense, structure, N, v4, radiative4)
            for i in range(n):
                by = half * radiative4[i]
                of_y3, of_x3 = bends(x0[i], slope[i], 2.0 * k1[i])
                of_y4, of_x4 = bends(x0[i], slope[i], 2.0 * k1[i] + k3[i])
                v1[i] += 2.0 * by * (of_y4 - of_y3)
                v3[i] += by * of_y4 - THIRD * mass[i] * v4[i]
                x_bar[i] += by * (of_x4 - of_x3)
            for p in range(structure.quadratic_row.shape[0]):
                by, j = h * Q[p] * v4[structure.quadratic_row[p]], structure.quadratic_column[p]
                v1[j] += 2.0 * by * k3[j]
                v3[j] += by * (2.0 * k1[j] + k3[j])
            solve_transposed(dense, structure, now.W, v3)
            radiative_transposed(dense, structure, N, v3, radiative3)
            for i in range(n):
                by = half * radiative3[i]
                of_y3, of_x3 = bends(x0[i], slope[i], 2.0 * k1[i])
                v1[i] += 2.0 * by * of_y3 + 2.5 * mass[i] * v3[i]
                v2[i] -= 0.5 * mass[i] * v3[i]
                x_bar[i] += by * of_x3
            for p in range(structure.quadratic_row.shape[0]):
                j = structure.quadratic_column[p]
                v1[j] += 4.0 * h * Q[p] * v3[structure.quadratic_row[p]] * k1[j]
            solve_transposed(dense, structure, now.W, v2)
            for i in range(n):
                v1[i] += 2.0 * mass[i] * v2[i]
            solve_transposed(dense, structure, now.W, v1)
            radiative_transposed(dense, structure, N, v2, radiative2)
            radiative_transposed(dense, structure, N, v1, radiative1)
            for i in range(n):
                f1_bar[i] = half * (v1[i] + v2[i] - v3[i])
                # W depends on x0 through J = A + 2 Q diag(x0) + N diag(4 x0^3).
                curved = radiative1[i] * k1[i] + radiative2[i] * k2[i] + radiative3[i] * k3[i] + radiative4[i] * k4[i]
                x_bar[i] += half * 12.0 * x0[i] * x0[i] * curved
            if observed:
                for i in range(n):
                    f1_bar[i] += f1_seen[i]
                    x_bar[i] += x0_seen[i]
            transposed_products(dense, structure, A, N, Q, x0, f1_bar, linear, radiative)
            for i in range(n):
                x_bar[i] += linear[i] + radiative[i] * slope[i]
                jump_bar = half * (0.5 * v1[i] + 1.5 * v2[i])
                b0_bar[i] = f1_bar[i] - jump_bar
                b1_bar[i] = jump_bar
            for p in range(structure.quadratic_row.shape[0]):
                i, j = structure.quadratic_row[p], structure.quadratic_column[p]
                y3, y4 = 2.0 * k1[j], 2.0 * k1[j] + k3[j]
                curved = v1[i] * k1[j] + v2[i] * k2[j] + v3[i] * k3[j] + v4[i] * k4[j]
                x_bar[j] += h * Q[p] * curved
                bent = v3[i] * y3 * y3 + v4[i] * (y4 * y4 - y3 * y3)
                Q_bar[p] += f1_bar[i] * x0[j] * x0[j] + half * bent + h * x0[j] * curved
            add_stages(dense, structure, x0, half, f1_bar, v1, v2, v3, v4, now, A_bar, N_bar)
            for p in range(heatings):
                heating_bar[p] += u[structure.heating_heater[p]] * f1_bar[structure.heating_row[p]]

            # Heat at the segment's ends back to the step's ends, and the cotangent of the segment's start.
            share0 = begin / duration
            share1 = (begin + h) / duration if event >= 0 else 1.0
            start_bar = start_seen[0] if observed else 0.0
            for i in range(n):
                start_bar += ramp[i] * b0_bar[i]
                left_bar[i] += (1.0 - share0) * b0_bar[i] + (1.0 - share1) * b1_bar[i]
                right_bar[i] += share0 * b0_bar[i] + share1 * b1_bar[i]
            if event >= 0:
                start_bar += time_bar
                for i in range(n):
                    start_bar += ramp[i] * b1_bar[i]
            elif begin > 0.0:
                # The segment ends at the grid point, so its length shrinks as its start moves.
                if observed:
                    start_bar -= length_seen[0]
                g1, g2, g3, g4 = workspace[:n], workspace[n : 2 * n], workspace[2 * n : 3 * n], workspace[3 * n : 4 * n]
                growth(structure, h, now, g1, g2, g3, g4)
                for i in range(n):
                    start_bar -= g1[i] * v1[i] + g2[i] * v2[i] + g3[i] * v3[i] + g4[i] * v4[i]
            time_bar = start_bar
            segment -= 1
        for i in range(n):
            heat_bar[i, 2 * step] = left_bar[i]
            heat_bar[i, 2 * step + 1] = right_bar[i]
    finish_errors(errors, errors_bar)
    finish_bars(dense, structure, packed_bar)
    for i in range(n):
        x_bar[i] += states_bar[0, i]
    _add_up_forcing(structure, heat_bar, series, forcing_bar)
    return 0


@inlined
def _add_up_forcing(structure, heat_bar, series, forcing_bar):
    """forcing_bar [p] = heat_bar of its row times its series: four sums at once, for one waits for itself."""
    row, column, forcings = structure.forcing_row, structure.forcing_column, forcing_bar.shape[0]
    fours = forcings - forcings % 4
    for p in range(0, fours, 4):
        i1, i2, i3, i4 = row[p], row[p + 1], row[p + 2], row[p + 3]
        j1, j2, j3, j4 = column[p], column[p + 1], column[p + 2], column[p + 3]
        total1, total2, total3, total4 = 0.0, 0.0, 0.0, 0.0
        for k in range(series.shape[1]):
            total1 += heat_bar[i1, k] * series[j1, k]
            total2 += heat_bar[i2, k] * series[j2, k]
            total3 += heat_bar[i3, k] * series[j3, k]
            total4 += heat_bar[i4, k] * series[j4, k]
        forcing_bar[p], forcing_bar[p + 1], forcing_bar[p + 2], forcing_bar[p + 3] = total1, total2, total3, total4
    for p in range(fours, forcings):
        total = 0.0
        for k in range(series.shape[1]):
            total += heat_bar[row[p], k] * series[column[p], k]
        forcing_bar[p] = total


def adjoint_memory_size(structure):
    """Length of the memory that `adjoint` works in."""
    return 31 * structure.mass.shape[0] + structure.sensor.shape[0] + 2
