"""Spells in which something holds from sample to sample."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def spells(flags: NDArray[np.bool_]) -> NDArray[np.int64]:
    """[K, 2] of each stretch of True in flags [T], in their order: its first index, and one past its last."""
    return np.flatnonzero(np.diff(flags, prepend=False, append=False)).reshape(-1, 2)
