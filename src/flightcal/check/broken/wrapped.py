"""Counts that begin again where their bits end."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...simulator import FloatArray
from ...words import moment, number
from ..samples import step_of
from ..suspicion import Suspicion
from .broken import STUCK, Broken

_BITS, _OF_WHOLE = (16, 14, 12, 10, 8), 0.25
"""Of a number that is sent; share of what these count up to, below which all other changes are, and of the changes."""
_USUAL = 0.9
"""Quantile of the changes that are none of the counter's."""


def wrapped(channel: str, times: NDArray[np.datetime64], values: FloatArray, modelled: FloatArray) -> Broken | None:
    """Counts that begin again: a negative number that is read as one without a sign, or a counter that overflows."""
    if len(values) < STUCK:
        return None
    step, moves = step_of(values), np.diff(values)
    for bits in _BITS:
        whole = step * 2.0**bits
        jumps = np.abs(moves) > 0.5 * whole
        others = np.abs(moves[~jumps]).max(initial=0.0)
        if not 2 <= jumps.sum() <= _OF_WHOLE * len(moves) or others > _OF_WHOLE * whole:
            continue
        usual = max(2.0 * step, 2.0 * float(np.quantile(np.abs(moves[~jumps]), _USUAL)))
        far = np.abs(np.abs(moves[jumps]) - whole) > usual
        if far.any() or np.abs(np.cumsum(np.sign(moves[jumps]))).max() > 1:
            continue
        high = np.concatenate([[0.0], np.cumsum(np.where(jumps, np.sign(moves), 0.0))])
        ends = [high == end for end in (high.min(), high.max())]
        apart = [float(np.abs(values - modelled)[end].mean()) for end in ends]
        if not np.isfinite(apart).all():
            apart = [-float(end.sum()) for end in ends]
        wrong = ends[int(np.argmax(apart))]
        if wrong.sum() < 2:  # that is a spike
            continue
        first = int(np.flatnonzero(jumps)[0]) + 1
        suspicion = Suspicion(
            "wrapped", channel, f"{channel} begins again where its counts end",
            f"It jumps by {number(whole, 3)} K, {2**bits} of its steps, and back, {int(jumps.sum())} times in all, "
            f"first at {moment(times[first])} UTC: a negative number does that which is read as one without a sign.",
            f"Read {channel} as a number of {bits} bits with a sign where it is decoded; else leave these samples out",
        )  # fmt: skip
        return Broken(suspicion, wrong)
    return None
