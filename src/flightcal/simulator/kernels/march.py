"""Compiled steps of a packed system under given heat, for those who decide step by step what acts on it."""

from __future__ import annotations

from typing import Any, NamedTuple

from ...compiled import kernel
from .step import advance, make_step


class MarchCall(NamedTuple):
    """What `march` takes."""

    structure: Any
    packed: Any
    """[P]"""
    x: Any
    """[n] states, before and then after."""
    b0: Any
    """[n] heat (K/s, or W) at the beginning and,"""
    b1: Any
    """linearly, at the end."""
    duration: float
    """s"""
    steps: int
    """How many equal steps."""
    memory: Any
    """[step_size(structure)]"""


@kernel(long=True)
def march(call):
    """Advance x by equal steps."""
    structure, packed, x, b0, b1 = call.structure, call.packed, call.x, call.b0, call.b1
    duration, count = call.duration, call.steps
    n = structure.mass.shape[0]
    a, m = structure.linear_column.shape[0], structure.radiative_column.shape[0]
    A, N, Q = packed[:a], packed[a : a + m], packed[a + m : a + m + structure.quadratic_column.shape[0]]
    step = make_step(None, structure, call.memory)
    for k in range(count):
        for i in range(n):
            step.b0[i] = b0[i] + (b1[i] - b0[i]) * (k / count)
            step.b1[i] = b0[i] + (b1[i] - b0[i]) * ((k + 1) / count)
        advance(None, structure, A, N, Q, x, duration / count, step)
        for i in range(n):
            x[i] = step.x1[i]
    return 0
