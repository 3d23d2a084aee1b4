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

The rates f3 and f4 are not evaluated, for J k follows from each stage's own equation: h/2 J k = mass k - right side.
What J at x0 lacks of them is by how much the powers are bent: with y3 = 2 k1 and y4 = 2 k1 + k3 the same stages are

    W k3 = mass (5 k1 - k2)/2 - h/2 f1 + h/2 B(y3)
    W k4 = -mass k3/3 + h/2 (B(y4) - B(y3))        B(y) = N (x^4 - x0^4 - 4 x0^3 y) + Q y^2,  x = x0 + y
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ...compiled import inlined, short_loops
from .dense import (
    dense_add_radiation,
    dense_add_stages,
    dense_clear,
    dense_factor,
    dense_finish,
    dense_load,
    dense_radiative_transposed,
    dense_rate,
    dense_solve,
    dense_transpose,
    dense_transposed_products,
)
from .lanes import elements

THIRD, EIGHT_THIRDS = 1.0 / 3.0, 8.0 / 3.0


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
    x1: Any
    fourth1: Any
    """x0^4."""
    bent3: Any
    """Of the fourth power up to x3, and from there to x4, what its slope at x0 does not say."""
    bent4: Any


@inlined
def step_size(dense, structure):
    """Memory of a `Step`: of whole matrices a multiple of eight, so that lines stay where vectors like them."""
    n = structure.mass.shape[0]
    if dense is None:
        return structure.factor_column.shape[0] + 13 * n
    return dense.width * n + (13 * n + 7) // 8 * 8


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
    )


@inlined
def advance(dense, structure, A, N, Q, x0, h, step):
    """Fill `step`, whose b0 and b1 are given, with the step of length h from x0."""
    short_loops()
    n, mass = structure.mass.shape[0], structure.mass
    half = 0.5 * h
    W, slope, b0, b1, f1 = step.W, step.slope, step.b0, step.b1, step.f1
    k1, k2, k3, k4 = step.k1, step.k2, step.k3, step.k4
    x1, bent3, bent4 = step.x1, step.bent3, step.bent4
    for i in range(n):
        slope[i] = 4.0 * x0[i] * x0[i] * x0[i]
    rate(dense, structure, A, N, Q, x0, step.fourth1, b0, f1)
    factor(dense, structure, A, N, Q, x0, h, step)
    for i in range(n):
        k1[i] = half * (f1[i] + 0.5 * (b1[i] - b0[i]))
    solve(dense, structure, W, k1)
    for i in range(n):
        k2[i] = half * (f1[i] + 1.5 * (b1[i] - b0[i])) + 2.0 * mass[i] * k1[i]
        bent3[i] = bent(x0[i], 2.0 * k1[i])
    solve(dense, structure, W, k2)
    for i in range(n):
        k3[i] = mass[i] * (2.5 * k1[i] - 0.5 * k2[i]) - half * f1[i]
    add_radiation(dense, structure, N, bent3, half, k3)
    for p in range(structure.quadratic_row.shape[0]):
        j = structure.quadratic_column[p]
        k3[structure.quadratic_row[p]] += 4.0 * half * Q[p] * k1[j] * k1[j]
    solve(dense, structure, W, k3)
    for i in range(n):
        k4[i] = -THIRD * mass[i] * k3[i]
        bent4[i] = bent(x0[i], 2.0 * k1[i] + k3[i]) - bent3[i]
    add_radiation(dense, structure, N, bent4, half, k4)
    for p in range(structure.quadratic_row.shape[0]):
        j = structure.quadratic_column[p]
        k4[structure.quadratic_row[p]] += half * Q[p] * k3[j] * (4.0 * k1[j] + k3[j])
    solve(dense, structure, W, k4)
    for i in range(n):
        x1[i] = x0[i] + 2.0 * k1[i] + k3[i] + k4[i]


@inlined
def growth(structure, h, step, g1, g2, g3, g4):
    """How the right side of each stage grows with the step's length, less what W's change takes of it.

    Both are the right side over h, without the stages in it.
    """
    short_loops()
    k1, k2, k3, k4 = step.k1, step.k2, step.k3, step.k4
    inverse, still = (1.0 / h, 0.0) if h > 0.0 else (0.0, 0.5)
    for i in range(structure.mass.shape[0]):
        share, rest = inverse * structure.mass[i], still * step.f1[i]
        g1[i] = share * k1[i] + rest
        g2[i] = share * (k2[i] - 2.0 * k1[i]) + rest
        g3[i] = share * (k3[i] - 2.5 * k1[i] + 0.5 * k2[i]) - rest
        g4[i] = share * (k4[i] + THIRD * k3[i])


@inlined
def bent(x0, y):
    """x^4 - x0^4 - 4 x0^3 y with x = x0 + y."""
    return y * y * (6.0 * x0 * x0 + y * (4.0 * x0 + y))


@inlined
def bends(x0, slope, y):
    """The derivatives of `bent` by y and by x0; slope: 4 x0^3."""
    x = x0 + y
    by_y = 4.0 * x * x * x - slope
    return by_y, by_y - 12.0 * x0 * x0 * y


@inlined
def length_derivative(dense, structure, N, Q, x0, h, ramp, step, memory, velocity):
    """velocity = d x1 / d h of a step from x0, with b1 moving along `ramp` [n] (K/s^2) as the step's end moves.

    memory: workspace [6 n].
    """
    short_loops()
    n, mass, slope, k1, k3 = structure.mass.shape[0], structure.mass, step.slope, step.k1, step.k3
    half = 0.5 * h
    d1, d2, d3, d4 = memory[:n], memory[n : 2 * n], memory[2 * n : 3 * n], memory[3 * n : 4 * n]
    bent3, bent4 = memory[4 * n : 5 * n], memory[5 * n : 6 * n]
    growth(structure, h, step, d1, d2, d3, d4)
    for i in range(n):
        d1[i] += 0.25 * h * ramp[i]
    solve(dense, structure, step.W, d1)
    for i in range(n):
        d2[i] += 0.75 * h * ramp[i] + 2.0 * mass[i] * d1[i]
        bent3[i] = bends(x0[i], slope[i], 2.0 * k1[i])[0] * 2.0 * d1[i]
    solve(dense, structure, step.W, d2)
    for i in range(n):
        d3[i] += mass[i] * (2.5 * d1[i] - 0.5 * d2[i])
    add_radiation(dense, structure, N, bent3, half, d3)
    for p in range(structure.quadratic_row.shape[0]):
        j = structure.quadratic_column[p]
        d3[structure.quadratic_row[p]] += 4.0 * h * Q[p] * k1[j] * d1[j]
    solve(dense, structure, step.W, d3)
    for i in range(n):
        d4[i] -= THIRD * mass[i] * d3[i]
        y = 2.0 * k1[i] + k3[i]
        bent4[i] = bends(x0[i], slope[i], y)[0] * (2.0 * d1[i] + d3[i]) - bent3[i]
    add_radiation(dense, structure, N, bent4, half, d4)
    for p in range(structure.quadratic_row.shape[0]):
        j = structure.quadratic_column[p]
        both = (2.0 * k1[j] + k3[j]) * (2.0 * d1[j] + d3[j]) - 4.0 * k1[j] * d1[j]
        d4[structure.quadratic_row[p]] += h * Q[p] * both
    solve(dense, structure, step.W, d4)
    for i in range(n):
        velocity[i] = 2.0 * d1[i] + d3[i] + d4[i]


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
def add_radiation(dense, structure, N, v, by, r):
    """r += by N v."""
    if dense is None:
        _add_radiation(structure, N, v, by, r)
    else:
        dense_add_radiation(dense, structure, v, by, r)


@inlined
def transposed_products(dense, structure, A, N, Q, x, v, linear, radiative):
    """linear = (A + 2 Q diag(x))^T v, radiative = N^T v."""
    if dense is None:
        _transposed_products(structure, A, N, Q, x, v, linear, radiative)
    else:
        dense_transposed_products(dense, structure, v, linear, radiative)


@inlined
def radiative_transposed(dense, structure, N, v, radiative):
    """radiative = N^T v."""
    if dense is None:
        _radiative_transposed(structure, N, v, radiative)
    else:
        dense_radiative_transposed(dense, structure, v, radiative)


@inlined
def add_stages(dense, structure, x0, half, f1_bar, v1, v2, v3, v4, step, A_bar, N_bar):
    """Add to the cotangents of A and N what those of f1 and, by W^-T, of the four stages say of them."""
    if dense is None:
        _add_stages(structure, x0, half, f1_bar, v1, v2, v3, v4, step, A_bar, N_bar)
    else:
        dense_add_stages(dense, structure, x0, half, f1_bar, v1, v2, v3, v4, step)


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
    short_loops()
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
    short_loops()
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
    short_loops()
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
    short_loops()
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
def _add_radiation(structure, N, v, by, r):
    short_loops()
    for i in range(structure.mass.shape[0]):
        total = r[i]
        for p in range(structure.radiative_start[i], structure.radiative_start[i + 1]):
            total += by * (N[p] * v[structure.radiative_column[p]])
        r[i] = total


@inlined
def _transposed_products(structure, A, N, Q, x, v, linear, radiative):
    short_loops()
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
def _radiative_transposed(structure, N, v, radiative):
    short_loops()
    n = structure.mass.shape[0]
    for i in range(n):
        radiative[i] = 0.0
    for i in range(n):
        value = v[i]
        for p in range(structure.radiative_start[i], structure.radiative_start[i + 1]):
            radiative[structure.radiative_column[p]] += N[p] * value


@inlined
def _add_stages(structure, x0, half, f1_bar, v1, v2, v3, v4, step, A_bar, N_bar):
    short_loops()
    slope, k1, k2, k3, k4 = step.slope, step.k1, step.k2, step.k3, step.k4
    for i in range(structure.mass.shape[0]):
        w0, w1, w2, w3, w4 = f1_bar[i], half * v1[i], half * v2[i], half * v3[i], half * v4[i]
        for p in range(structure.linear_start[i], structure.linear_start[i + 1]):
            j = structure.linear_column[p]
            A_bar[p] += w0 * x0[j] + (w1 * k1[j] + w2 * k2[j] + w3 * k3[j] + w4 * k4[j])
        for p in range(structure.radiative_start[i], structure.radiative_start[i + 1]):
            j = structure.radiative_column[p]
            straight = slope[j] * (w1 * k1[j] + w2 * k2[j] + w3 * k3[j] + w4 * k4[j])
            N_bar[p] += w0 * step.fourth1[j] + straight + (w3 * step.bent3[j] + w4 * step.bent4[j])
