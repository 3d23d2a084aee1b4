"""From straight coordinates to z and back; see `probability/straight.py`."""

from __future__ import annotations

from typing import Any, NamedTuple

from ...compiled import kernel
from .priors import scaled


class StraightCall(NamedTuple):
    """Of d coordinates at S points, p of which are of bounded priors."""

    order: Any
    """[d] places, the bounded ones first."""
    slopes: Any
    """[d, p] by how much a coordinate is moved, of how far each earlier bounded one is from straight."""
    kinds: Any
    """[p] families of the bounded ones,"""
    arguments: Any
    """[p, most] and what they compute with."""
    quantile: int
    """Address of the normal quantile function."""
    centre: Any
    """[p, 3] z, theta and its slope where both coordinates agree."""
    z: Any
    """[S, d] changed in place."""
    bends: Any
    """[S, p] filled: how far each bounded one is from straight,"""
    rates: Any
    """[S, p] and its derivative."""
    z_bar: Any
    """[S, d] changed in place, backwards."""


@kernel
def straight_forward(call):
    """From straight coordinates to z."""
    order, slopes, centre, z = call.order, call.slopes, call.centre, call.z
    bends, rates = call.bends, call.rates
    p = slopes.shape[1]
    for s in range(z.shape[0]):
        for r in range(order.shape[0]):
            i = order[r]
            moved = z[s, i]
            for k in range(min(r, p)):
                moved += slopes[i, k] * bends[s, k]
            z[s, i] = moved
            if r < p:
                theta, rate = scaled(call.kinds[r], call.arguments[r], call.quantile, moved)
                bends[s, r] = (theta - centre[r, 1]) / centre[r, 2] - (moved - centre[r, 0])
                rates[s, r] = rate / centre[r, 2] - 1.0
    return 0


@kernel
def straight_backward(call):
    """The derivative by z to that by straight coordinates."""
    order, slopes, rates, z_bar = call.order, call.slopes, call.rates, call.z_bar
    for s in range(z_bar.shape[0]):
        for k in range(slopes.shape[1] - 1, -1, -1):
            total = 0.0
            for r in range(k + 1, order.shape[0]):
                total += slopes[order[r], k] * z_bar[s, order[r]]
            z_bar[s, order[k]] += rates[s, k] * total
    return 0
