"""Stretches of the window in which something else was flown than the scenario says, read from the telemetry.

The effect of each attitude, or mode, on each piece of the window is simulated once; effects of neighbouring pieces add
up. So the likeliest stretches are found among all beginnings and ends, and those alone are simulated.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from itertools import chain, pairwise, product
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...scenario import AttitudeChange, ModeChange
from ...simulator import FloatArray
from ...words import listed
from ..network_view import View, pieces
from .wrong import Kind, Words, Wrong, driven_otherwise

_PIECES = 96
"""Of a window, each of which may be flown otherwise."""
_MOST = 4
"""Stretches that are told at most: more are another timeline."""
_FIRST = 2
"""Pieces at the beginning that no stretch is told of: what was before is told by the first temperatures."""
_MANY, _FREELY = 12, 0.25
"""Stretches in a first search, and by how much less each has to gain."""
_MOVES, _NO_MORE, _TOO_MANY = 60, 1e-6, 1e6
"""Of a search, at most; nats below which there is nothing to gain; nats that a stretch costs that is one too many."""
_AS_WRITTEN = -1
_ENDS = (2.0, 1.0, 0.5, 0.25)
"""Of a piece, by which the ends of a stretch are tried earlier and later."""

Change = TypeVar("Change", AttitudeChange, ModeChange)
Nats = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""Of known effects [R, k] K that a simulation lacks, b [k] and G [k, k]: with those of u, 0 or 1 each, the telemetry is
more probable by b u - u G u / 2 nats."""


@dataclass(frozen=True)
class Stretch:
    """A time in another state, an attitude or a mode, than the scenario says."""

    begin: datetime
    end: datetime
    state: str


@dataclass(frozen=True)
class Flown:
    """What may have been flown otherwise."""

    kind: Kind
    was: str
    """Of one stretch: "The satellite was in"."""
    another: str
    """Of several: "in another attitude"."""
    advice: str
    driven: Callable[[Sequence[Stretch]], dict[str, Any]]
    """How the window is driven with stretches in the place of what the scenario says; see `driven`."""


def flown_otherwise(
    view: View, z: FloatArray, more: Mapping[str, FloatArray], nats: Nats, flown: Flown
) -> Iterator[Wrong]:
    """Stretches in another state that make the telemetry likelier.

    more: of each state [h, 2 K] W, heat that it brings to heated nodes beside what the scenario says, in the steps of
    the view's window. z: [d] where its effects are simulated. Raises SimulationFailure.
    """
    edges = np.linspace(0.0, view.network.drive.times[-1], _PIECES + 1)
    found = _effects(view, z, more, pieces(view.window, edges))
    if not found:
        return
    tries = 0.5 * len(found) * _PIECES**2
    times = view.utc(edges).astype("datetime64[s]").tolist()
    known = list(found)
    chosen = likeliest(*nats(np.concatenate(list(found.values()), axis=1)), len(found), float(np.log(tries)))
    for some in chosen:
        stretches = tuple(Stretch(times[first], times[last], known[which]) for which, first, last in some)
        yield from _told(view, flown, stretches, tries ** len(stretches))


def _effects(view: View, z: FloatArray, more: Mapping[str, FloatArray], each: FloatArray) -> dict[str, FloatArray]:
    """[R, k] K of each state in each piece alone, in the place of what the scenario says; of those that differ."""
    found = {}
    for state, heat in more.items():
        moved = np.flatnonzero(each @ np.abs(heat).max(axis=0))
        if not len(moved):
            continue
        shares = np.concatenate([np.zeros((1, each.shape[1])), each[moved]])
        warmed = view.warmed(view.window, z, shares[:, None] * heat)
        found[state] = np.zeros((len(warmed), len(each)))
        found[state][:, moved] = warmed
    return found


def likeliest(b: FloatArray, inner: FloatArray, states: int, least: float) -> list[list[tuple[int, int, int]]]:
    """The likeliest stretches, of each number of them that was found: state, first piece and the one after the last.

    Any stretch is set to another state, or back to what is written, as long as that makes the telemetry likelier. Once
    more are allowed first, at less each: of a few at once each alone may explain little.
    b, inner: see `Nats`, of the pieces of one state after those of another; least: nats that each stretch has to gain.
    """
    found: dict[int, tuple[float, list[tuple[int, int, int]]]] = {}
    for state in (_AS_WRITTEN, *range(states)):
        flown = _that_differs(inner, np.where(np.arange(_PIECES) < _FIRST, _AS_WRITTEN, state))
        freely = _moves(b, inner, states, flown, _FREELY * least, _MANY)
        for gained in chain(freely, _moves(b, inner, states, flown, least, _MOST)):
            stretches = _runs(flown)
            if len(stretches) <= _MOST and gained > found.get(len(stretches), (0.0, []))[0]:
                found[len(stretches)] = gained, stretches
    return [stretches for count, (_, stretches) in sorted(found.items()) if count]


def _moves(
    b: FloatArray, inner: FloatArray, states: int, flown: NDArray[np.int64], least: float, most: int
) -> Iterator[float]:
    """Set stretches of `flown` [P] to the state that gains most, one by one, in place; nats of all after each."""
    on = _on(flown, states)
    for _ in range(_MOVES):
        gradient = b - inner @ on
        tried = [
            (*_best_of(gradient, inner, flown, state, least, most), state) for state in (_AS_WRITTEN, *range(states))
        ]
        gained, first, last, state = max(tried)
        if gained <= _NO_MORE:
            break
        flown[first:last] = state
        flown[:] = _that_differs(inner, flown)
        on = _on(flown, states)
        yield float(on @ b - 0.5 * on @ inner @ on)


def _on(flown: NDArray[np.int64], states: int) -> FloatArray:
    """1 where a piece is in a state, of the pieces of one state after those of another; else 0."""
    return (flown == np.arange(states)[:, None]).astype(float).ravel()


def _that_differs(inner: FloatArray, flown: NDArray[np.int64]) -> NDArray[np.int64]:
    """States [P] that do something which what is written does not; the others as written."""
    effect = np.diag(inner).reshape(-1, _PIECES)[flown, np.arange(_PIECES)]
    return np.where(effect > 0.0, flown, _AS_WRITTEN)


def _best_of(
    gradient: FloatArray, inner: FloatArray, flown: NDArray[np.int64], state: int, least: float, most: int
) -> tuple[float, int, int]:
    """Nats of the likeliest stretch to be set to a state; its first piece and the one after its last.

    gradient: by what is on of each state and piece, where `flown` [P] is on.
    """
    pieces_of = np.arange(_PIECES)
    change = np.zeros((len(gradient), _PIECES))
    other, off = flown != state, flown != _AS_WRITTEN
    if state != _AS_WRITTEN:
        change[state * _PIECES + pieces_of[other], pieces_of[other]] += 1.0
    change[flown[other & off] * _PIECES + pieces_of[other & off], pieces_of[other & off]] -= 1.0
    linear = np.concatenate([[0.0], np.cumsum(gradient @ change)])
    square = np.zeros((_PIECES + 1, _PIECES + 1))
    square[1:, 1:] = (change.T @ inner @ change).cumsum(axis=0).cumsum(axis=1)
    diagonal = np.diag(square)
    # [first, last]: a sum over a block of a matrix from its sums from the corner.
    nats = linear - linear[:, None] - 0.5 * (diagonal - 2.0 * square + diagonal[:, None])
    count = _count_with(flown, state)
    possible = np.triu(np.ones_like(square, np.bool_), 1)
    possible[:_FIRST] = False
    now = len(_runs(flown))
    too_many = np.maximum(count - most, 0) - max(now - most, 0)
    nats = np.where(possible, nats - least * (count - now) - _TOO_MANY * too_many, -np.inf)
    first, last = np.unravel_index(int(np.argmax(nats)), nats.shape)
    return float(nats[first, last]), int(first), int(last)


def _runs(flown: NDArray[np.int64]) -> list[tuple[int, int, int]]:
    """Stretches that are not as written: state, first piece and the one after the last."""
    edges = [0, *(np.flatnonzero(np.diff(flown)) + 1).tolist(), len(flown)]
    return [
        (int(flown[first]), first, last)
        for first, last in pairwise(edges)
        if last > first and flown[first] != _AS_WRITTEN
    ]


def _count_with(flown: NDArray[np.int64], state: int) -> NDArray[np.int64]:
    """[first, last] how many stretches there are where these pieces are in a state."""
    off = flown != _AS_WRITTEN
    begins = off & np.append(True, flown[1:] != flown[:-1])
    before = np.concatenate([[0], np.cumsum(begins)])
    ends = off & np.append(flown[1:] != flown[:-1], True)
    after = np.concatenate([np.cumsum(ends[::-1])[::-1], [0]])
    if state == _AS_WRITTEN:
        return np.asarray(before[:, None] + after)
    same = flown == state
    return np.asarray(
        before[:, None] + after + 1 - np.append(False, same)[:, None].astype(int) - np.append(same, False).astype(int)
    )


def _begin(stretch: Stretch) -> datetime:
    return stretch.begin


def _apart(stretches: Sequence[Stretch]) -> bool:
    """Whether no two are at the same time."""
    return all(one.end <= other.begin for one, other in pairwise(sorted(stretches, key=_begin)))


def _told(view: View, flown: Flown, stretches: tuple[Stretch, ...], tries: float) -> Iterator[Wrong]:
    spans = [
        f"'{stretch.state}' from {stretch.begin.isoformat(timespec='seconds')} to "
        f"{stretch.end.isoformat(timespec='seconds')}"
        for stretch in stretches
    ]
    title = (
        f"{flown.was} {spans[0]}"
        if len(spans) == 1
        else f"The satellite was {len(spans)} times {flown.another} than the scenario says"
    )
    words = Words(
        title,
        f"With {listed(spans)} (UTC), whatever the scenario says then, the model explains the telemetry.",
        flown.advice,
    )

    def near() -> Iterator[Wrong]:
        piece = timedelta(seconds=float(view.network.drive.times[-1])) / _PIECES
        for k, stretch in enumerate(stretches):
            for share, sign, end in product(_ENDS, (-1, 1), ("begin", "end")):
                moved = replace(stretch, **{end: getattr(stretch, end) + sign * share * piece})
                others = (*stretches[:k], moved, *stretches[k + 1 :])
                if all(one.begin < one.end for one in others) and _apart(others):
                    yield from _told(view, flown, others, tries)

    about = "stretch " + " ".join(dict.fromkeys(stretch.state for stretch in stretches))
    yield from driven_otherwise(flown.kind, about, words, view, tries=tries, closer=near, **flown.driven(stretches))


def with_stretches(
    timeline: Sequence[Change], stretches: Sequence[Stretch], kind: type[Change], key: str
) -> tuple[Change, ...]:
    """A timeline with stretches in the place of what it says. kind: of its changes, whose state is called `key`."""
    changes = list(timeline)
    for stretch in stretches:
        back = [change for change in changes if change.at <= stretch.end] or changes[:1]
        changes = [change for change in changes if not stretch.begin <= change.at <= stretch.end]
        changes.append(kind(**{"at": stretch.begin, key: stretch.state}))
        changes.append(kind(**{"at": stretch.end, key: getattr(back[-1], key)}))
        changes.sort(key=lambda change: change.at)
    return tuple(changes)
