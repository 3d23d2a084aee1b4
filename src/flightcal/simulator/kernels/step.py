"""One step of the integration, and its derivative by the step's length.

Scheme: RODAS3 (Sandu et al. 1997, Atmos. Environ. 31, 3459-3472), a four-stage Rosenbrock method of order 3. It is
L-stable and stiffly accurate, so a small node behind a large conductance, or a massless one, never limits the step;
and it needs no iteration, so its derivative is that of a fixed sequence of linear solves. The step from x0 is

    W k1 = h/2 (f1 + (b1 - b0)/2)            W = mass - h/2 J(x0),  f1 = f(x0, b0)
    W k2 = h/2 (f1 + 3 (b1 - b0)/2) + 2 mass k1
    W k3 = h/2 f3 + mass (k1 - k2)/2         f3 = f(x3, b1),  x3 = x0 + 2 k1
    W k4 = h/2 f4 + mass (k1 - k2 - 8/3 k3)/2    f4 = f(x4, b1),  x4 = x3 + k3
    x1 = x4 + k4

with f(x, b) = A x + Q x^2 + N x^4 + b, J its Jacobian, and b0, b1 all heat at the step's ends. W is factorised by rows
on the fixed pattern of `Structure`, without pivoting: with conduction and radiation between nodes it is an M-matrix.
Everything costs as much as the network has links. Where nearly every state is linked to every other, `dense` is a
`Dense`, and whole matrices are reckoned with instead (see `dense`); else it is None. Which of the two is known when
this is compiled.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ...compiled import inlined
from .dense import (
    dense_add_rate,
    dense_add_stages,
    dense_clear,
    dense_factor,
    dense_finish,
    dense_jacobian_product,
    dense_load,
    dense_rate,
    dense_solve,
    dense_transpose,
    dense_transposed_products,
)
from .lanes import elements

EIGHT_THIRDS = 8.0 / 3.0


class Step(NamedTuple):
    """What a step computes, each [n] (W: one per entry of the factorised matrix); see the module's equations."""

    W: Any
    """Factorised; the reciprocals of the diagonal stand in its place."""
    row: Any
    """Workspace of the factorisation."""
    slope: Any
    """4 x0^3."""
    b0: Any
    b1: Any
    k1: Any
    k2: Any
    k3: Any
    k4: Any
    f1: Any
    f3: Any
    f4: Any
    x3: Any
    x4: Any
    x1: Any
    fourth1: Any
    """x0^4, and so on."""
    fourth3: Any
    fourth4: Any


@inlined
def step_size(dense, structure):
    """Memory of a `Step`: of whole matrices a multiple of eight, so that lines stay where vectors like them."""
    n = structure.mass.shape[0]
    if dense is None:
        return structure.factor_column.shape[0] + 17 * n
    return dense.width * n + (17 * n + 7) // 8 * 8


@inlined
def make_step(dense, structure, memory):
    """A `Step` in memory of `step_size`."""
    m, n = matrix_size(dense, structure), structure.mass.shape[0]
    return Step(
        elements(memory[:m]),
        elements(memory[m : m + n]),
        elements(memory[m + n : m + 2 * n]),
        elements(memory[m + 2 * n : m + 3 * n]),
        elements(memory[m + 3 * n : m + 4 * n]),
        elements(memory[m + 4 * n : m + 5 * n]),
        elements(memory[m + 5 * n : m + 6 * n]),
        elements(memory[m + 6 * n : m + 7 * n]),
        elements(memory[m + 7 * n : m + 8 * n]),
        elements(memory[m + 8 * n : m + 9 * n]),
        elements(memory[m + 9 * n : m + 10 * n]),
        elements(memory[m + 10 * n : m + 11 * n]),
        elements(memory[m + 11 * n : m + 12 * n]),
        elements(memory[m + 12 * n : m + 13 * n]),
        elements(memory[m + 13 * n : m + 14 * n]),
        elements(memory[m + 14 * n : m + 15 * n]),
        elements(memory[m + 15 * n : m + 16 * n]),
        elements(memory[m + 16 * n : m + 17 * n]),
    )


@inlined
def advance(dense, structure, A, N, Q, x0, h, step):
    """Fill `step`, whose b0 and b1 are given, with the step of length h from x0."""
    n, mass = structure.mass.shape[0], structure.mass
    half = 0.5 * h
    W, slope, b0, b1 = step.W, step.slope, step.b0, step.b1
    k1, k2, k3, k4 = step.k1, step.k2, step.k3, step.k4
    f1, f3, f4 = step.f1, step.f3, step.f4
    x3, x4, x1 = step.x3, step.x4, step.x1
    for i in range(n):
        slope[i] = 4.0 * x0[i] * x0[i] * x0[i]
    rate(dense, structure, A, N, Q, x0, step.fourth1, b0, f1)
    factor(dense, structure, A, N, Q, x0, h, step)
    for i in range(n):
        k1[i] = half * (f1[i] + 0.5 * (b1[i] - b0[i]))
    solve(dense, structure, W, k1)
    for i in range(n):
        k2[i] = half * (f1[i] + 1.5 * (b1[i] - b0[i])) + 2.0 * mass[i] * k1[i]
        x3[i] = x0[i] + 2.0 * k1[i]
    solve(dense, structure, W, k2)
    rate(dense, structure, A, N, Q, x3, step.fourth3, b1, f3)
    for i in range(n):
        k3[i] = half * f3[i] + 0.5 * mass[i] * (k1[i] - k2[i])
    solve(dense, structure, W, k3)
    for i in range(n):
        x4[i] = x3[i] + k3[i]
    rate(dense, structure, A, N, Q, x4, step.fourth4, b1, f4)
    for i in range(n):
        k4[i] = half * f4[i] + 0.5 * mass[i] * (k1[i] - k2[i] - EIGHT_THIRDS * k3[i])
    solve(dense, structure, W, k4)
    for i in range(n):
        x1[i] = x4[i] + k4[i]


@inlined
def length_derivative(dense, structure, A, N, Q, x0, h, ramp, step, memory, velocity):
    """velocity = d x1 / d h of a step from x0, with b1 moving along `ramp` [n] (K/s^2) as the step's end moves.

    memory: workspace [6 n].
    """
    n, mass = structure.mass.shape[0], structure.mass
    half = 0.5 * h
    b0, b1 = step.b0, step.b1
    d1, d2, d3, d4 = memory[:n], memory[n : 2 * n], memory[2 * n : 3 * n], memory[3 * n : 4 * n]
    work, cubes = memory[4 * n : 5 * n], memory[5 * n : 6 * n]
    # W d = d(right side) - dW k, with dW / dh = -J/2.
    jacobian_product(dense, structure, A, N, Q, x0, step.slope, step.k1, d1)
    for i in range(n):
        d1[i] = 0.5 * (d1[i] + step.f1[i] + 0.5 * (b1[i] - b0[i])) + half * 0.5 * ramp[i]
    solve(dense, structure, step.W, d1)
    jacobian_product(dense, structure, A, N, Q, x0, step.slope, step.k2, d2)
    for i in range(n):
        d2[i] = 0.5 * (d2[i] + step.f1[i] + 1.5 * (b1[i] - b0[i])) + half * 1.5 * ramp[i] + 2.0 * mass[i] * d1[i]
        velocity[i] = 2.0 * d1[i]
        cubes[i] = 4.0 * step.x3[i] * step.x3[i] * step.x3[i]
    solve(dense, structure, step.W, d2)
    jacobian_product(dense, structure, A, N, Q, step.x3, cubes, velocity, work)
    jacobian_product(dense, structure, A, N, Q, x0, step.slope, step.k3, d3)
    for i in range(n):
        d3[i] = 0.5 * (d3[i] + step.f3[i] + mass[i] * (d1[i] - d2[i])) + half * (work[i] + ramp[i])
    solve(dense, structure, step.W, d3)
    for i in range(n):
        velocity[i] += d3[i]
        cubes[i] = 4.0 * step.x4[i] * step.x4[i] * step.x4[i]
    jacobian_product(dense, structure, A, N, Q, step.x4, cubes, velocity, work)
    jacobian_product(dense, structure, A, N, Q, x0, step.slope, step.k4, d4)
    for i in range(n):
        d4[i] = 0.5 * (d4[i] + step.f4[i] + mass[i] * (d1[i] - d2[i] - EIGHT_THIRDS * d3[i]))
        d4[i] += half * (work[i] + ramp[i])
    solve(dense, structure, step.W, d4)
    for i in range(n):
        velocity[i] += d4[i]


@inlined
def matrix_size(dense, structure):
    """How many numbers W takes."""
    if dense is None:
        return structure.factor_column.shape[0]
    return dense.width * structure.mass.shape[0]


@inlined
def rate(dense, structure, A, N, Q, x, fourth, b, f):
    """f = A x + Q x^2 + N x^4 + b; leaves x^4 in `fourth`."""
    if dense is None:
        _rate(structure, A, N, Q, x, fourth, b, f)
    else:
        dense_rate(dense, structure, x, fourth, b, f)


@inlined
def factor(dense, structure, A, N, Q, x0, h, step):
    """Make W from x0, h and the step's slope, to `solve` with."""
    if dense is None:
        _factor(structure, A, N, Q, x0, h, step.slope, step.W, step.row)
    else:
        dense_factor(dense, structure, step.slope, h, step.W)


@inlined
def solve(dense, structure, W, r):
    """r = W^-1 r."""
    if dense is None:
        _solve(structure, W, r)
    else:
        dense_solve(dense, W, structure.mass.shape[0], r)


@inlined
def prepare_transposed(dense, structure, W):
    """Before `solve_transposed` with another W."""
    if dense is not None:
        dense_transpose(dense, structure, W)


@inlined
def solve_transposed(dense, structure, W, r):
    """r = W^-T r."""
    if dense is None:
        _solve_transposed(structure, W, r)
    else:
        dense_solve(dense, dense.W_rows, structure.mass.shape[0], r)


@inlined
def jacobian_product(dense, structure, A, N, Q, x, slope, v, out):
    """out = (A + 2 Q diag(x) + N diag(slope)) v."""
    if dense is None:
        _jacobian_product(structure, A, N, Q, x, slope, v, out)
    else:
        dense_jacobian_product(dense, structure, slope, v, out)


@inlined
def transposed_products(dense, structure, A, N, Q, x, v, linear, radiative):
    """linear = (A + 2 Q diag(x))^T v, radiative = N^T v."""
    if dense is None:
        _transposed_products(structure, A, N, Q, x, v, linear, radiative)
    else:
        dense_transposed_products(dense, structure, v, linear, radiative)


@inlined
def add_stages(dense, structure, x0, half, v1, v2, v3, v4, step, A_bar, N_bar):
    """Add to the cotangents of A and N what W^-T of the four stages' cotangents say of them."""
    if dense is None:
        _add_stages(structure, x0, half, v1, v2, v3, v4, step, A_bar, N_bar)
    else:
        dense_add_stages(dense, structure, x0, half, v1, v2, v3, v4, step)


@inlined
def add_rate(dense, structure, x, fourth, f_bar, A_bar, N_bar):
    """Add to the cotangents of A and N what that of the rate at x says of them."""
    if dense is None:
        _add_rate(structure, x, fourth, f_bar, A_bar, N_bar)
    else:
        dense_add_rate(dense, structure, x, fourth, f_bar)


@inlined
def load_matrices(dense, structure, packed):
    """Before a simulation of a packed system [P]."""
    if dense is not None:
        dense_load(dense, structure, packed)


@inlined
def clear_bars(dense):
    """Before anything is added to the cotangents of A and N,"""
    if dense is not None:
        dense_clear(dense)


@inlined
def finish_bars(dense, structure, packed_bar):
    """and after all has been."""
    if dense is not None:
        dense_finish(dense, structure, packed_bar)


@inlined
def _rate(structure, A, N, Q, x, fourth, b, f):
    n = structure.mass.shape[0]
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
    for p in range(structure.quadratic_row.shape[0]):
        j = structure.quadratic_column[p]
        f[structure.quadratic_row[p]] += Q[p] * x[j] * x[j]


@inlined
def _factor(structure, A, N, Q, x0, h, slope, W, row):
    """LU of W in place (unit lower triangle), row by row."""
    half = 0.5 * h
    for p in range(structure.factor_column.shape[0]):
        W[p] = 0.0
    for p in range(structure.linear_slot.shape[0]):
        W[structure.linear_slot[p]] = -1.0 * half * A[p]
    for p in range(structure.radiative_slot.shape[0]):
        W[structure.radiative_slot[p]] -= half * N[p] * slope[structure.radiative_column[p]]
    for p in range(structure.quadratic_slot.shape[0]):
        W[structure.quadratic_slot[p]] -= h * Q[p] * x0[structure.quadratic_column[p]]
    for i in range(structure.mass.shape[0]):
        W[structure.factor_diagonal[i]] += structure.mass[i]
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


@inlined
def _solve(structure, W, r):
    start, column, diagonal = structure.factor_start, structure.factor_column, structure.factor_diagonal
    n = diagonal.shape[0]
    for i in range(n):
        total = r[i]
        for p in range(start[i], diagonal[i]):
            total -= W[p] * r[column[p]]
        r[i] = total
    for back in range(n):
        i = n - 1 - back
        total = r[i]
        for p in range(diagonal[i] + 1, start[i + 1]):
            total -= W[p] * r[column[p]]
        r[i] = total * W[diagonal[i]]


@inlined
def _solve_transposed(structure, W, r):
    start, column, diagonal = structure.factor_start, structure.factor_column, structure.factor_diagonal
    n = diagonal.shape[0]
    for i in range(n):
        value = r[i] * W[diagonal[i]]
        r[i] = value
        for p in range(diagonal[i] + 1, start[i + 1]):
            r[column[p]] -= W[p] * value
    for back in range(n):
        i = n - 1 - back
        value = r[i]
        for p in range(start[i], diagonal[i]):
            r[column[p]] -= W[p] * value


@inlined
def _jacobian_product(structure, A, N, Q, x, slope, v, out):
    for i in range(structure.mass.shape[0]):
        total = 0.0
        for p in range(structure.linear_start[i], structure.linear_start[i + 1]):
            total += A[p] * v[structure.linear_column[p]]
        for p in range(structure.radiative_start[i], structure.radiative_start[i + 1]):
            j = structure.radiative_column[p]
            total += N[p] * slope[j] * v[j]
        out[i] = total
    for p in range(structure.quadratic_row.shape[0]):
        j = structure.quadratic_column[p]
        out[structure.quadratic_row[p]] += 2.0 * Q[p] * x[j] * v[j]


@inlined
def _transposed_products(structure, A, N, Q, x, v, linear, radiative):
    n = structure.mass.shape[0]
    for i in range(n):
        linear[i] = 0.0
        radiative[i] = 0.0
    for i in range(n):
        value = v[i]
        for p in range(structure.linear_start[i], structure.linear_start[i + 1]):
            linear[structure.linear_column[p]] += A[p] * value
        for p in range(structure.radiative_start[i], structure.radiative_start[i + 1]):
            radiative[structure.radiative_column[p]] += N[p] * value
    for p in range(structure.quadratic_row.shape[0]):
        j = structure.quadratic_column[p]
        linear[j] += 2.0 * Q[p] * x[j] * v[structure.quadratic_row[p]]


@inlined
def _add_stages(structure, x0, half, v1, v2, v3, v4, step, A_bar, N_bar):
    slope, x3, x4 = step.slope, step.x3, step.x4
    k1, k2, k3, k4 = step.k1, step.k2, step.k3, step.k4
    for i in range(structure.mass.shape[0]):
        w1, w2, w3, w4 = half * v1[i], half * v2[i], half * v3[i], half * v4[i]
        for p in range(structure.linear_start[i], structure.linear_start[i + 1]):
            j = structure.linear_column[p]
            A_bar[p] += w1 * (x0[j] + k1[j]) + w2 * (x0[j] + k2[j]) + w3 * (x3[j] + k3[j]) + w4 * (x4[j] + k4[j])
        for p in range(structure.radiative_start[i], structure.radiative_start[i + 1]):
            j = structure.radiative_column[p]
            N_bar[p] += (
                w1 * (step.fourth1[j] + slope[j] * k1[j])
                + w2 * (step.fourth1[j] + slope[j] * k2[j])
                + w3 * (step.fourth3[j] + slope[j] * k3[j])
                + w4 * (step.fourth4[j] + slope[j] * k4[j])
            )


@inlined
def _add_rate(structure, x, fourth, f_bar, A_bar, N_bar):
    for i in range(structure.mass.shape[0]):
        for p in range(structure.linear_start[i], structure.linear_start[i + 1]):
            A_bar[p] += f_bar[i] * x[structure.linear_column[p]]
        for p in range(structure.radiative_start[i], structure.radiative_start[i + 1]):
            N_bar[p] += f_bar[i] * fourth[structure.radiative_column[p]]
