"""The posterior of the weights of known shapes, given what each window tells about them.

A window w has weights u_w of its own and shares weights v with the others; all are N(0, 1) over their prior deviations.
Each window says, through its noise, exp(moment_w^T x - x^T gram_w x / 2) of x = (u_w, v). With u_w integrated out this
is a message about v of the same form. So the posterior of (u_w, v) is what window w says, times the others' messages:
one Cholesky factor of a window's size per window, and nothing but today's numbers where there is one window.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ...compiled import inlined, kernel

_LOG_ROOT_2_PI = 0.5 * math.log(2.0 * math.pi)


class CloseCall(NamedTuple):
    """A channel's m weights in W windows, of which the first `own` are the window's."""

    own: int
    root: Any
    """[W, m] prior standard deviations of the weights."""
    gram: Any
    """[W, m, m] upper triangles, and the next three, as `ShapesCall` has them."""
    scale: Any
    """[W, 1]"""
    moment: Any
    """[W, m]"""
    known: Any
    """[W, 3]"""
    weights: Any
    """[W, m] filled: expected weights over prior deviations; as all that follow."""
    shrunk: Any
    """[W, m] their variances over the prior ones."""
    mean: Any
    """[W, m] expected weights."""
    inverse: Any
    """[W, m, m] lower triangles X; X^T X is the covariance over prior deviations."""
    untold: Any
    """[W, 1] samples that tell nothing about the weights."""
    value: Any
    """[1] log likelihood of all windows."""
    upper: Any
    """[m, m] to work in, as the next."""
    messages: Any
    """[W + 1, s, s] about the s shared weights; the last: the sum of those of others."""
    message_moments: Any
    """[W + 1, s]"""


@kernel
def close(call):
    """The weights' posterior in each window, and the log likelihood."""
    gram, scale, moment, known, root, own = call.gram, call.scale, call.moment, call.known, call.root, call.own
    weights, shrunk, mean, inverse, untold = call.weights, call.shrunk, call.mean, call.inverse, call.untold
    messages, message_moments, upper = call.messages, call.message_moments, call.upper
    windows, m = weights.shape
    added, added_moment = messages[windows], message_moments[windows]
    determinant, squares, samples = 0.0, 0.0, 0.0
    if windows == 1:
        own = m  # nothing is shared
    else:
        for w in range(windows):
            log_determinant, explained = _tell(
                gram[w], scale[w, 0], root[w], moment[w], own, upper, weights[w], messages[w], message_moments[w]
            )
            if w > 0:
                determinant += log_determinant
                squares -= explained
    for w in range(windows):
        for i in range(m - own):
            added_moment[i] = 0.0
            for j in range(i, m - own):
                added[i, j] = 0.0
        for other in range(windows):
            if other != w:
                for i in range(m - own):
                    added_moment[i] += message_moments[other, i]
                    for j in range(i, m - own):
                        added[i, j] += messages[other, i, j]
        log_determinant, explained = _factorise(
            gram[w], scale[w, 0], root[w], moment[w], own, added, added_moment,
            upper, inverse[w], shrunk[w], weights[w],
        )  # fmt: skip
        if w == 0:
            determinant += log_determinant
            squares -= explained
        determinant += known[w, 0]
        squares += known[w, 1]
        samples += known[w, 2]
        trace = known[w, 2] - m
        for j in range(m):
            mean[w, j] = root[w, j] * weights[w, j]
            trace += shrunk[w, j]
        # What the others tell is in `shrunk`, too.
        for row in range(own, m):
            for i in range(own, row + 1):
                for j in range(own, row + 1):
                    told = added[i - own, j - own] if i <= j else added[j - own, i - own]
                    trace += inverse[w, row, i] * inverse[w, row, j] * told
        untold[w, 0] = trace
    call.value[0] = -0.5 * (squares + determinant) - samples * _LOG_ROOT_2_PI
    return 0


@inlined
def _tell(gram, scale, root, moment, own, upper, half, message, message_moment):
    """What a window tells about the shared weights, its own integrated out: fills message [s, s] and its moment [s].

    Returns the log determinant of the own weights' part, and by how much they explain the residuals' square. half: [m]
    of work.
    """
    m = root.shape[0]
    for i in range(m):
        left = scale * root[i]
        half[i] = left * moment[i]
        for j in range(i, m):
            upper[i, j] = left * gram[i, j] * root[j]
    log_determinant, explained = 0.0, 0.0
    for i in range(own):
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
    for i in range(own, m):
        message_moment[i - own] = half[i]
        for j in range(i, m):
            message[i - own, j - own] = upper[i, j]
    return log_determinant, explained


@inlined
def _factorise(gram, scale, root, moment, own, added, added_moment, upper, inverse, scratch, weights):
    """Cholesky factor of 1 + scale root gram root + added, its inverse, and the weights' mean over `root`.

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
            upper[i, j] += added[i - own, j - own]
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
        scratch[j] += added_moment[j - own]
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
