"""Whole matrices for systems in which nearly every state is linked to every other; see `kernels.dense`."""

from __future__ import annotations

import numpy as np

from .kernels.dense import Dense
from .kernels.lanes import WIDTH, aligned
from .system import Structure

_FEWEST, _MOST = 12, 80
"""States. Fewer gain less than it takes to compile kernels of their own; more were not measured."""
_FULL = 0.5
"""Share of the factors that has entries, from which on whole matrices are quicker."""


def whole_matrices(structure: Structure) -> Dense | None:
    """Memory for the whole matrices of a system; None: it is quicker by its pattern."""
    n = len(structure.mass)
    full = len(structure.factor_column) >= _FULL * n * n
    if not (_FEWEST <= n <= _MOST and full) or len(structure.quadratic_row):
        return None
    radiating = np.unique(structure.radiative_column)
    r, width, few = len(radiating), _eights(n), _eights(len(radiating))
    sizes = (n * width, n * width, r * width, n * few, n * width, n * width, r * width, 5 * width)
    made = [aligned(size) for size in (*sizes, WIDTH**2, WIDTH**2)]
    for memory in made:
        memory[:] = 0.0
    made[-2][:: WIDTH + 1] = 1.0
    made[-1][:] = 1.0 - made[-2]
    return Dense(width, few, radiating, *made)


def _eights(count: int) -> int:
    """The next multiple of eight."""
    return -(-count // WIDTH) * WIDTH
