"""Compiled steps of a packed system under given heat, for those who decide step by step what acts on it."""

from __future__ import annotations

from ..compiled import compiled_long
from .step import advance, make_step


@compiled_long
def march(structure, packed, x, b0, b1, duration, count, memory):
    """Advance x [n] by `count` equal steps over `duration` (s); heat [n] moves linearly from b0 to b1 (K/s, or W).

    memory: [step_size(structure)].
    """
    n = structure.mass.shape[0]
    entries = structure.linear_column.shape[0]
    A, N = packed[:entries], packed[entries : entries + structure.radiative_column.shape[0]]
    step = make_step(structure, memory)
    for k in range(count):
        for i in range(n):
            step.b0[i] = b0[i] + (b1[i] - b0[i]) * (k / count)
            step.b1[i] = b0[i] + (b1[i] - b0[i]) * ((k + 1) / count)
        advance(structure, A, N, x, duration / count, step)
        for i in range(n):
            x[i] = step.x1[i]
