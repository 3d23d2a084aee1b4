"""A Matern process beyond what was seen: its state (value and derivatives) at an edge, and what follows from it.

Matern processes of smoothness 3/2 and 5/2 are Markov in their value and one or two derivatives (Hartikainen & Sarkka
2010, IEEE MLSP): beyond the edge of a window they depend on it through that state alone. All functions take amplitudes
[...] in K and lengthscales [...] in s, and gaps in s.
"""

from __future__ import annotations

import numpy as np

from ..simulator import FloatArray

ORDER = {1.5: 2, 2.5: 3}
"""Smoothness -> entries of the state."""
_ROUNDING = 1e-15
"""Of a variance at rest: what the difference of two such covariances is off by."""


def transition(smoothness: float, length: FloatArray | float, gap: FloatArray | float) -> FloatArray:
    """The expected state after a gap [...] or a number, over the state before it: [..., p, p]."""
    rate = np.asarray(np.sqrt(2.0 * smoothness) / length)
    x = rate * gap
    if smoothness == 1.5:
        rows = [[1.0 + x, gap + 0.0 * x], [-rate * x, 1.0 - x]]
    else:
        rows = [
            [1.0 + x + 0.5 * x**2, gap * (1.0 + x), 0.5 * gap**2 + 0.0 * x],
            [-0.5 * rate * x**2, 1.0 + x - x**2, gap * (1.0 - 0.5 * x)],
            [rate**2 * (0.5 * x**2 - x), rate * (x**2 - 3.0 * x), 1.0 - 2.0 * x + 0.5 * x**2],
        ]
    matrix = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    return np.asarray(np.exp(-x)[..., None, None] * matrix)


def fading(smoothness: float, length: float, gaps: FloatArray) -> FloatArray:
    """The expected value after each of the gaps [T], over the state before them: [T, p]."""
    return np.ascontiguousarray(transition(smoothness, length, gaps)[:, 0])


def stationary(smoothness: float, amplitude: FloatArray, length: FloatArray) -> FloatArray:
    """Covariance of the state, [..., p, p]."""
    square = np.asarray(amplitude, float) ** 2
    rate = np.sqrt(2.0 * smoothness) / length
    zero = 0.0 * square
    if smoothness == 1.5:
        rows = [[square, zero], [zero, square * rate**2]]
    else:
        slope = square * rate**2 / 3.0
        rows = [[square, zero, -slope], [zero, slope, zero], [-slope, zero, square * rate**4]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def covariance(smoothness: float, amplitude: float, length: float, gap: FloatArray) -> FloatArray:
    """Covariance of two values a gap apart, of the gaps' shape."""
    x = np.sqrt(2.0 * smoothness) / length * np.abs(gap)
    polynomial = 1.0 + x if smoothness == 1.5 else 1.0 + x + x**2 / 3.0
    return np.asarray(amplitude**2 * polynomial * np.exp(-x))


def continue_path(
    smoothness: float,
    amplitude: FloatArray,
    length: FloatArray,
    state: FloatArray,
    gaps: FloatArray,
    rng: np.random.Generator,
) -> FloatArray:
    """Values [T, ...] of processes that had `state` [..., p], drawn at times that follow each other by `gaps` [T]."""
    at_rest = stationary(smoothness, amplitude, length)
    moves: dict[float, tuple[FloatArray, FloatArray]] = {}
    values = np.empty((len(gaps), *state.shape[:-1]))
    for t, gap in enumerate(np.round(gaps, 6).tolist()):  # even times differ by rounding
        if gap not in moves:
            moved = transition(smoothness, length, gap)
            rest = at_rest - moved @ at_rest @ np.swapaxes(moved, -1, -2)
            moves[gap] = moved, _root(rest, _ROUNDING * np.einsum("...ii->...i", at_rest))
        moved, root = moves[gap]
        state = np.einsum("...ij,...j->...i", moved, state)
        state = state + np.einsum("...ij,...j->...i", root, rng.standard_normal(state.shape))
        values[t] = state[..., 0]
    return values


def _root(matrix: FloatArray, rounding: FloatArray) -> FloatArray:
    """A with A A^T a covariance [..., p, p] of widely differing scales, whose variances rounding [..., p] may drown."""
    scale = np.sqrt(np.maximum(np.einsum("...ii->...i", matrix), rounding))
    eigenvalues, directions = np.linalg.eigh(matrix / (scale[..., :, None] * scale[..., None, :]))
    return np.asarray(scale[..., :, None] * directions * np.sqrt(np.maximum(eigenvalues, 0.0))[..., None, :])
