"""The linear algebra of a step where nearly every state is linked to every other: whole matrices, eight rows at once.

A matrix is a list of lines, each padded with zeros to a whole number of eights. `A` has a line for each column of A, so
A x is a sum of lines; `A_rows` has a line for each row, for what goes backwards. N has lines for the columns alone that
have an entry. In the place of the factors of a step's W stands its inverse (Gauss-Jordan without pivoting, for W has
the form that needs none).
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ...compiled import inlined
from .lanes import WIDTH
from .vectors import eight, set_eight


class Dense(NamedTuple):
    """Whole matrices of the one system that is integrated. Lines are of `width` numbers, or of `few` by rows of N."""

    width: int
    few: int
    radiating: Any
    """[r] columns of N."""
    A: Any
    """[n, width], by columns;"""
    A_rows: Any
    N: Any
    """[r, width];"""
    N_rows: Any
    """[n, few]."""
    W_rows: Any
    """[n, width] the inverse of a step's W, by rows."""
    A_bar: Any
    """Cotangents of A and N."""
    N_bar: Any
    work: Any
    """[5, width]"""
    units: Any
    """[8, 8] the unit matrix, and ones where it has none."""
    others: Any


@inlined
def dense_load(dense, structure, packed):
    """Fill A and N from the entries."""
    width, few, radiating = dense.width, dense.few, dense.radiating
    a = structure.linear_column.shape[0]
    A, A_rows, N, N_rows = dense.A, dense.A_rows, dense.N, dense.N_rows
    for i in range(structure.mass.shape[0]):
        for p in range(structure.linear_start[i], structure.linear_start[i + 1]):
            j = structure.linear_column[p]
            A[j * width + i] = packed[p]
            A_rows[i * width + j] = packed[p]
        k = 0
        for p in range(structure.radiative_start[i], structure.radiative_start[i + 1]):
            while radiating[k] < structure.radiative_column[p]:
                k += 1
            N[k * width + i] = packed[a + p]
            N_rows[i * few + k] = packed[a + p]


@inlined
def dense_rate(dense, structure, x, fourth, b, f):
    """f = A x + N x^4 + b; leaves x^4 in `fourth`."""
    n, width, A, N, work = structure.mass.shape[0], dense.width, dense.A, dense.N, dense.work
    radiating = dense.radiating
    for i in range(n):
        square = x[i] * x[i]
        fourth[i] = square * square
    for at in range(0, width, WIDTH):
        total = eight(A, at) * x[0]
        for j in range(1, n):
            total += eight(A, j * width + at) * x[j]
        for k in range(radiating.shape[0]):
            total += eight(N, k * width + at) * fourth[radiating[k]]
        set_eight(work, at, total)
    for i in range(n):
        f[i] = b[i] + work[i]


@inlined
def dense_factor(dense, structure, slope, h, W):
    """The inverse of mass - h/2 (A + N diag(slope)), by columns."""
    n, width, A, N, work = structure.mass.shape[0], dense.width, dense.A, dense.N, dense.work
    radiating = dense.radiating
    minus = -0.5 * h
    for at in range(0, n * width, WIDTH):
        set_eight(W, at, eight(A, at) * minus)
    for k in range(radiating.shape[0]):
        j = radiating[k]
        by = minus * slope[j]
        for at in range(0, width, WIDTH):
            set_eight(W, j * width + at, eight(W, j * width + at) + eight(N, k * width + at) * by)
    for i in range(n):
        W[i * width + i] += structure.mass[i]
    for k in range(n):
        line, unit = k * width, k % WIDTH * WIDTH
        pivot = 1.0 / W[line + k]
        for i in range(n):
            work[i] = W[i * width + k]
        work[k] = 0.0
        for at in range(0, width, WIDTH):
            if at == k - k % WIDTH:
                # Column k becomes that of the inverse. To set single numbers would hold up the next loads.
                others, own = eight(dense.others, unit), eight(dense.units, unit)
                own = (eight(W, line + at) * others + own) * pivot
                for i in range(n):
                    set_eight(W, i * width + at, eight(W, i * width + at) * others - own * work[i])
            else:
                own = eight(W, line + at) * pivot
                for i in range(n):
                    set_eight(W, i * width + at, eight(W, i * width + at) - own * work[i])
            set_eight(W, line + at, own)


@inlined
def _sum_lines(lines, width, n, v, out):
    """out [width] = the sum of n lines, each times its number of v."""
    for at in range(0, width, WIDTH):
        total = eight(lines, at) * v[0]
        for i in range(1, n):
            total += eight(lines, i * width + at) * v[i]
        set_eight(out, at, total)


@inlined
def dense_solve(dense, lines, n, r):
    """r = the sum of the lines of an inverse times r."""
    work = dense.work
    _sum_lines(lines, dense.width, n, r, work)
    for i in range(n):
        r[i] = work[i]


@inlined
def dense_transpose(dense, structure, W):
    """Fill W_rows."""
    n, width, W_rows = structure.mass.shape[0], dense.width, dense.W_rows
    for i in range(n):
        for j in range(n):
            W_rows[i * width + j] = W[j * width + i]


@inlined
def dense_add_radiation(dense, structure, v, by, r):
    """r += by N v."""
    n, width, N, work = structure.mass.shape[0], dense.width, dense.N, dense.work
    radiating = dense.radiating
    if radiating.shape[0] == 0:
        return
    for at in range(0, width, WIDTH):
        total = eight(N, at) * (by * v[radiating[0]])
        for k in range(1, radiating.shape[0]):
            total += eight(N, k * width + at) * (by * v[radiating[k]])
        set_eight(work, at, total)
    for i in range(n):
        r[i] += work[i]


@inlined
def dense_transposed_products(dense, structure, v, linear, radiative):
    """linear = A^T v, radiative = N^T v."""
    n, work = structure.mass.shape[0], dense.work
    _sum_lines(dense.A_rows, dense.width, n, v, work)
    for i in range(n):
        linear[i] = work[i]
    dense_radiative_transposed(dense, structure, v, radiative)


@inlined
def dense_radiative_transposed(dense, structure, v, radiative):
    """radiative = N^T v."""
    n, work, radiating = structure.mass.shape[0], dense.work, dense.radiating
    for i in range(n):
        radiative[i] = 0.0
    _sum_lines(dense.N_rows, dense.few, n, v, work)
    for k in range(radiating.shape[0]):
        radiative[radiating[k]] = work[k]


@inlined
def dense_add_stages(dense, structure, x0, half, f1_bar, v1, v2, v3, v4, step):
    """Add what f1 and the four stages say of A and N to their cotangents."""
    n, width, work, radiating = structure.mass.shape[0], dense.width, dense.work, dense.radiating
    A_bar, N_bar, slope = dense.A_bar, dense.N_bar, step.slope
    fourth1, bent3, bent4 = step.fourth1, step.bent3, step.bent4
    k1, k2, k3, k4 = step.k1, step.k2, step.k3, step.k4
    for i in range(n):
        work[i], work[width + i] = half * v1[i], half * v2[i]
        work[2 * width + i], work[3 * width + i] = half * v3[i], half * v4[i]
        work[4 * width + i] = f1_bar[i]
    for at in range(0, width, WIDTH):
        w1, w2 = eight(work, at), eight(work, width + at)
        w3, w4 = eight(work, 2 * width + at), eight(work, 3 * width + at)
        w0 = eight(work, 4 * width + at)
        for j in range(n):
            place = j * width + at
            total = eight(A_bar, place) + w0 * x0[j]
            total += w1 * k1[j]
            total += w2 * k2[j]
            total += w3 * k3[j]
            total += w4 * k4[j]
            set_eight(A_bar, place, total)
        for k in range(radiating.shape[0]):
            j, place = radiating[k], k * width + at
            total = eight(N_bar, place) + w0 * fourth1[j]
            total += w1 * (slope[j] * k1[j])
            total += w2 * (slope[j] * k2[j])
            total += w3 * (slope[j] * k3[j] + bent3[j])
            total += w4 * (slope[j] * k4[j] + bent4[j])
            set_eight(N_bar, place, total)


@inlined
def dense_clear(dense):
    """No cotangents so far."""
    dense.A_bar[:] = 0.0
    dense.N_bar[:] = 0.0


@inlined
def dense_finish(dense, structure, packed_bar):
    """The cotangents of A and N to those of their entries."""
    width, radiating, a = dense.width, dense.radiating, structure.linear_column.shape[0]
    for i in range(structure.mass.shape[0]):
        for p in range(structure.linear_start[i], structure.linear_start[i + 1]):
            packed_bar[p] = dense.A_bar[structure.linear_column[p] * width + i]
        k = 0
        for p in range(structure.radiative_start[i], structure.radiative_start[i + 1]):
            while radiating[k] < structure.radiative_column[p]:
                k += 1
            packed_bar[a + p] = dense.N_bar[k * width + i]
