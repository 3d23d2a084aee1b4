"""A system without the massless states that act linearly, and the derivative of that; see `simulator.elimination`."""

from __future__ import annotations

from typing import Any, NamedTuple

from ...compiled import kernel


class Plan(NamedTuple):
    """Elimination as additions: multiples of a state's row to each row that has the state.

    Entries are those of the packed system that is whole, and what is new.
    """

    multiplier: Any
    """[m] the entry of each such row in the state's column,"""
    pivot: Any
    """[m] and the state's own,"""
    first: Any
    """[m+1] and where the additions begin:"""
    source: Any
    """[a] entry of the state's row, added to"""
    target: Any
    """[a] that of the other row."""
    kept: Any
    """[P] the entries that are left, as a packed system has them."""


class EliminateCall(NamedTuple):
    """What `eliminate` takes: S rooms, of which the first ones are made."""

    simulations: Any
    """[1] how many."""
    plan: Plan
    whole: Any
    """[S, W] packed systems."""
    entries: Any
    """[E] workspace; `pull_back_elimination` finds in it what the last simulation left."""
    packed: Any
    """[S, P] what is left of them."""


@kernel
def eliminate(call):
    """Packed systems without the states that are eliminated."""
    plan, whole, entries, packed = call.plan, call.whole, call.entries, call.packed
    multiplier, pivot, first = plan.multiplier, plan.pivot, plan.first
    source, target, kept = plan.source, plan.target, plan.kept
    for s in range(call.simulations[0]):
        for p in range(whole.shape[1]):
            entries[p] = whole[s, p]
        for p in range(whole.shape[1], entries.shape[0]):
            entries[p] = 0.0
        for m in range(multiplier.shape[0]):
            times = -entries[multiplier[m]] / entries[pivot[m]]
            for p in range(first[m], first[m + 1]):
                entries[target[p]] += times * entries[source[p]]
        for p in range(kept.shape[0]):
            packed[s, p] = entries[kept[p]]
    return 0


class PullBackEliminationCall(NamedTuple):
    """What `pull_back_elimination` takes, after `eliminate` of a single simulation."""

    plan: Plan
    entries: Any
    entries_bar: Any
    """[E] workspace."""
    packed_bar: Any
    """[P]"""
    whole_bar: Any
    """[W] what is asked for."""


@kernel
def pull_back_elimination(call):
    """The adjoint of `eliminate`: whole_bar from packed_bar."""
    plan, entries, entries_bar, packed_bar, whole_bar = (
        call.plan, call.entries, call.entries_bar, call.packed_bar, call.whole_bar,
    )  # fmt: skip
    multiplier, pivot, first = plan.multiplier, plan.pivot, plan.first
    source, target, kept = plan.source, plan.target, plan.kept
    entries_bar[:] = 0.0
    for p in range(kept.shape[0]):
        entries_bar[kept[p]] = packed_bar[p]
    for back in range(multiplier.shape[0]):
        m = multiplier.shape[0] - 1 - back
        # A row is not changed after it was first added to others, so its entries are those that were added.
        inverse = 1.0 / entries[pivot[m]]
        times, times_bar = -entries[multiplier[m]] * inverse, 0.0
        for p in range(first[m], first[m + 1]):
            times_bar += entries_bar[target[p]] * entries[source[p]]
            entries_bar[source[p]] += times * entries_bar[target[p]]
        entries_bar[multiplier[m]] -= times_bar * inverse
        entries_bar[pivot[m]] -= times_bar * times * inverse
    for p in range(whole_bar.shape[0]):
        whole_bar[p] = entries_bar[p]
    return 0
