"""The posterior of the weights of known shapes, given what each part, a channel of a window, tells about them.

A part p has weights u_p of its own and shares weights v_p with others: those of a discrepancy in orbit phase with the
same channel of other windows, those of a simulator's error with the other channels of its window. All are N(0, 1) over
their prior deviations. Each part says, through its noise, exp(moment_p^T x - x^T gram_p x / 2) of x = (u_p, v_p). With
u_p integrated out this is a message about v_p of the same form. So the posterior of (u_p, v_p) is what the part says,
times the messages of the others, with all that it does not share integrated out.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ...compiled import inlined, kernel

_LOG_ROOT_2_PI = 0.5 * math.log(2.0 * math.pi)
_LEAST_VARIANCE = 1e-300
"""In the place of none: the derivative by it is then zero."""


class CloseCall(NamedTuple):
    """P parts of m weights each, of which the first `own` are the part's."""

    own: int
    shared: Any
    """[P, c] places of the others among the S weights that parts share."""
    root: Any
    """[P, m] prior standard deviations of the weights."""
    gram: Any
    """[P, m, m] upper triangles, and the next three, as `ShapesCall` has them."""
    scale: Any
    """[P, 1]"""
    moment: Any
    """[P, m]"""
    known: Any
    """[P, 3]"""
    weights: Any
    """[P, m] filled: expected weights over prior deviations; as all that follow."""
    shrunk: Any
    """[P, m] their variances over the prior ones."""
    mean: Any
    """[P, m] expected weights."""
    inverse: Any
    """[P, m, m] lower triangles X; X^T X is the covariance over prior deviations."""
    untold: Any
    """[P, 1] samples that tell nothing about the weights."""
    value: Any
    """[1] log likelihood of all parts."""
    upper: Any
    """[m, m] to work in, as all that follow."""
    messages: Any
    """[P, c, c] about the shared weights."""
    message_moments: Any
    """[P, c]"""
    others: Any
    """[S, S] what the others tell."""
    other_moments: Any
    """[S]"""
    order: Any
    """[S]"""


@kernel
def close(call):
    """The weights' posterior in each part, and the log likelihood."""
    gram, scale, moment, known, root, own = call.gram, call.scale, call.moment, call.known, call.root, call.own
    weights, shrunk, mean, inverse, untold = call.weights, call.shrunk, call.mean, call.inverse, call.untold
    messages, message_moments, upper = call.messages, call.message_moments, call.upper
    others, other_moments = call.others, call.other_moments
    parts, m = weights.shape
    # Where the weights that a part shares begin among its own, less where they begin among those of all.
    shift = m - others.shape[0]
    determinant, squares, samples = 0.0, 0.0, 0.0
    if parts > 1:
        for p in range(parts):
            log_determinant, explained = _tell(
                gram[p], scale[p, 0], root[p], moment[p], own, upper, weights[p], messages[p], message_moments[p]
            )
            if p > 0:
                determinant += log_determinant
                squares -= explained
    for p in range(parts):
        _add_others(p, call.shared, messages, message_moments, call.order, others, other_moments)
        log_determinant, explained = _eliminate(others, other_moments, own - shift)
        if p == 0:
            determinant += log_determinant
            squares -= explained
        log_determinant, explained = factorise(
            gram[p], scale[p, 0], root[p], moment[p], own, shift, others, other_moments,
            upper, inverse[p], shrunk[p], weights[p],
        )  # fmt: skip
        if p == 0:
            determinant += log_determinant
            squares -= explained
        determinant += known[p, 0]
        squares += known[p, 1]
        samples += known[p, 2]
        trace = known[p, 2] - m
        for j in range(m):
            mean[p, j] = root[p, j] * weights[p, j]
            trace += shrunk[p, j]
        # What the others tell is in `shrunk`, too.
        for row in range(own, m):
            for i in range(own, row + 1):
                for j in range(own, row + 1):
                    told = others[i - shift, j - shift] if i <= j else others[j - shift, i - shift]
                    trace += inverse[p, row, i] * inverse[p, row, j] * told
        untold[p, 0] = trace
    call.value[0] = -0.5 * (squares + determinant) - samples * _LOG_ROOT_2_PI
    return 0


@inlined
def _tell(gram, scale, root, moment, own, upper, half, message, message_moment):
    """What a part tells about the shared weights, its own integrated out: fills message [c, c] and its moment [c].

    Returns what `_eliminate` does. half: [m] of work.
    """
    m = root.shape[0]
    for i in range(m):
        left = scale * root[i]
        half[i] = left * moment[i]
        for j in range(i, m):
            upper[i, j] = left * gram[i, j] * root[j]
    log_determinant, explained = _eliminate(upper, half, own)
    for i in range(own, m):
        message_moment[i - own] = half[i]
        for j in range(i, m):
            message[i - own, j - own] = upper[i, j]
    return log_determinant, explained


@inlined
def _add_others(part, shared, messages, message_moments, order, others, other_moments):
    """The sum of all messages but a part's: of the weights that the part does not share first, then of those it does.

    Fills others [S, S], an upper triangle, and other_moments [S].
    """
    total, count = others.shape[0], shared.shape[1]
    for i in range(total):
        order[i] = -1
        other_moments[i] = 0.0
        for j in range(i, total):
            others[i, j] = 0.0
    for i in range(count):
        order[shared[part, i]] = total - count + i
    first = 0
    for i in range(total):
        if order[i] < 0:
            order[i] = first
            first += 1
    for other in range(shared.shape[0]):
        if other != part:
            for i in range(count):
                row = order[shared[other, i]]
                other_moments[row] += message_moments[other, i]
                for j in range(i, count):
                    column = order[shared[other, j]]
                    others[min(row, column), max(row, column)] += messages[other, i, j]


@inlined
def _eliminate(upper, half, count):
    """Integrate out the first weights, of prior N(0, 1), of what is told by an upper triangle and half, its moments.

    Returns the log determinant of their part, and by how much they explain the residuals' square.
    """
    m = half.shape[0]
    log_determinant, explained = 0.0, 0.0
    for i in range(count):
        pivot = 1.0 / math.sqrt(upper[i, i] + 1.0)
        log_determinant -= 2.0 * math.log(pivot)
        half[i] *= pivot
        explained += half[i] * half[i]
        for j in range(i + 1, m):
            upper[i, j] *= pivot
        for k in range(i + 1, m):
            left = upper[i, k]
            half[k] -= left * half[i]
            for j in range(k, m):
                upper[k, j] -= left * upper[i, j]
    return log_determinant, explained


@inlined
def factorise(gram, scale, root, moment, own, shift, added, added_moment, upper, inverse, scratch, weights):
    """Cholesky factor of 1 + scale root gram root + added, its inverse, and the weights' mean over `root`.

    added: from `own - shift` on, of the weights from `own` on.

    Fills inverse [m, m], a lower triangle X with X^T X the inverse of what is factorised, weights [m], and scratch [m],
    the diagonal of X^T X. Returns the log determinant, and by how much the residuals' square is explained.
    """
    m = root.shape[0]
    for i in range(m):
        left = scale * root[i]
        for j in range(i, m):
            upper[i, j] = left * gram[i, j] * root[j]
        upper[i, i] += 1.0
    for i in range(own, m):
        for j in range(i, m):
            upper[i, j] += added[i - shift, j - shift]
    log_determinant = 0.0
    for i in range(m):
        # In rows of their own while they are worked on, four others at a time: so a compiler can take entries together.
        for j in range(m):
            scratch[j] = upper[i, j]
            weights[j] = 0.0
        weights[i] = 1.0
        whole = i // 4 * 4
        for k in range(0, whole, 4):
            first, second, third, fourth = upper[k, i], upper[k + 1, i], upper[k + 2, i], upper[k + 3, i]
            for j in range(i, m):
                scratch[j] -= (
                    first * upper[k, j] + second * upper[k + 1, j] + third * upper[k + 2, j] + fourth * upper[k + 3, j]
                )
            for j in range(k + 4):
                weights[j] -= (
                    first * inverse[k, j]
                    + second * inverse[k + 1, j]
                    + third * inverse[k + 2, j]
                    + fourth * inverse[k + 3, j]
                )
        for k in range(whole, i):
            above = upper[k, i]
            for j in range(i, m):
                scratch[j] -= above * upper[k, j]
            for j in range(k + 1):
                weights[j] -= above * inverse[k, j]
        pivot = 1.0 / math.sqrt(scratch[i])
        log_determinant -= 2.0 * math.log(pivot)
        for j in range(i, m):
            upper[i, j] = scratch[j] * pivot
        for j in range(m):
            inverse[i, j] = weights[j] * pivot  # zero above the diagonal
    explained = 0.0
    for j in range(m):
        weights[j] = 0.0
        scratch[j] = scale * root[j] * moment[j]
    for j in range(own, m):
        scratch[j] += added_moment[j - shift]
    for i in range(m):
        total = 0.0
        for j in range(i + 1):
            total += inverse[i, j] * scratch[j]
        explained += total * total
        for j in range(i + 1):
            weights[j] += inverse[i, j] * total
    # Diagonal of the inverse of what was factorised.
    for j in range(m):
        scratch[j] = 0.0
    for i in range(m):
        for j in range(i + 1):
            scratch[j] += inverse[i, j] * inverse[i, j]
    return log_determinant, explained


# --- the error of a simulator that stands in for another ----------------------------------------------------------


class SpreadCall(NamedTuple):
    """The prior of a part's weights of a simulator's error, and what is known of them; see `CloseCall`."""

    variance: Any
    """[r] of all weights of the error."""
    which: Any
    """[e] those of them that the part has,"""
    first: int
    """which stand from here on among its own,"""
    counted: int
    """and how many of these `pull_back_spread` counts, the first: what channels share is counted in one of them."""
    root: Any
    """[m] filled by `spread`."""
    weights: Any
    """[m] read by `pull_back_spread`, as the next."""
    shrunk: Any
    variance_bar: Any
    """[r] filled."""


@kernel
def spread(call):
    """Prior standard deviations."""
    variance, which, root = call.variance, call.which, call.root
    for j in range(which.shape[0]):
        root[call.first + j] = math.sqrt(max(variance[which[j]], _LEAST_VARIANCE))
    return 0


@kernel
def pull_back_spread(call):
    """The derivative by the variances."""
    variance, which, variance_bar = call.variance, call.which, call.variance_bar
    weights, shrunk = call.weights, call.shrunk
    for j in range(call.counted):
        i = call.first + j
        by_log_variance = 0.5 * (weights[i] * weights[i] - 1.0 + shrunk[i])
        variance_bar[which[j]] = by_log_variance / max(variance[which[j]], _LEAST_VARIANCE)
    return 0
