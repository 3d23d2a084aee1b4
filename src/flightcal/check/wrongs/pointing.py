"""Stretches in which the satellite was in another attitude than the scenario says, read from the telemetry."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray

from ...errors import FlightcalError
from ...scenario import AttitudeChange, AttitudeTimeline, spins_fast
from ...simulator import FloatArray
from ...words import listed
from ..network_view import View, pieces
from .wrong import Words, Wrong, attitude_of, driven_otherwise, elsewhere, shine, span_of

_PIECES = 96
"""Of a window, each of which may be in another attitude."""
_MOST = 4
"""Stretches that are told at most: more are another timeline."""
_FIRST = 2
"""Pieces at the beginning that no stretch is told of: what was before is told by the first temperatures."""
_ENDS = (2.0, 1.0, 0.5, 0.25)
"""Of a piece, by which the ends of a stretch are tried earlier and later."""

Nats = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""Of known effects [R, k] K that a simulation lacks, b [k] and G [k, k]: with those of u, 0 or 1 each, the telemetry is
more probable by b u - u G u / 2 nats."""


@dataclass(frozen=True)
class _Stretch:
    """A time in another attitude."""

    begin: datetime
    end: datetime
    attitude: str


def otherwise_pointed(view: View, z: FloatArray, nats: Nats) -> Iterator[Wrong]:
    """Stretches of the window in another attitude that has a name: a slew that the scenario lacks, or a safe mode.

    The effect of each attitude on each piece of the window is simulated around z [d], with heat that is the prior's
    median of what faces absorb; effects of neighbouring pieces add up. Raises SimulationFailure.
    """
    attitude = _timeline(view)
    if attitude is None:
        return
    names = tuple(dict.fromkeys([*attitude.named, *_written(attitude), "nadir", "sun_pointing"]))
    edges = np.linspace(0.0, view.network.drive.times[-1], _PIECES + 1)
    found = _effects(view, z, attitude, names, edges)
    if not found:
        return
    tries = 0.5 * len(found) * _PIECES**2
    times = view.utc(edges).astype("datetime64[s]").tolist()
    known = list(found)
    chosen = _likeliest(*nats(np.concatenate(list(found.values()), axis=1)), len(found), float(np.log(tries)))
    stretches = [_Stretch(times[first], times[last], known[which]) for which, first, last in chosen]
    for count in range(1, len(stretches) + 1):
        some = tuple(sorted(stretches[:count], key=_begin))
        yield from _flown(view, attitude, some, tries**count)


def _likeliest(b: FloatArray, inner: FloatArray, attitudes: int, least: float) -> list[tuple[int, int, int]]:
    """Stretches, one after another the likeliest beside those before: attitude, first piece and the one after the last.

    b, inner: see `Nats`, of the pieces of one attitude after those of another; least: nats that each gains.
    """
    left = b.copy()
    free = np.arange(_PIECES) >= _FIRST
    found: list[tuple[int, int, int]] = []
    for _ in range(_MOST):
        best = max(((*_best_of(left, inner, free, which), which) for which in range(attitudes)), default=None)
        if best is None or best[0] <= least:
            break
        _, first, last, which = best
        taken = slice(which * _PIECES + first, which * _PIECES + last)
        left -= inner[:, taken].sum(axis=1)
        free[first:last] = False
        found.append((which, first, last))
    return found


def _best_of(left: FloatArray, inner: FloatArray, free: NDArray[np.bool_], which: int) -> tuple[float, int, int]:
    """Nats of the likeliest stretch of an attitude, of free pieces only; its first piece and the one after its last."""
    piece = slice(which * _PIECES, (which + 1) * _PIECES)
    linear = np.concatenate([[0.0], np.cumsum(left[piece])])
    square = np.zeros((_PIECES + 1, _PIECES + 1))
    square[1:, 1:] = inner[piece, piece].cumsum(axis=0).cumsum(axis=1)
    diagonal = np.diag(square)
    occupied = np.concatenate([[0], np.cumsum(~free)])
    # [first, last]: a sum over a block of a matrix from its sums from the corner.
    nats = linear - linear[:, None] - 0.5 * (diagonal - 2.0 * square + diagonal[:, None])
    possible = np.triu(np.ones_like(square, np.bool_), 1) & (occupied == occupied[:, None])
    nats = np.where(possible, nats, -np.inf)
    first, last = np.unravel_index(int(np.argmax(nats)), nats.shape)
    return float(nats[first, last]), int(first), int(last)


def _timeline(view: View) -> AttitudeTimeline | None:
    """The scenario's attitudes one after another; None: there is none, or nothing depends on it."""
    attitude = attitude_of(view)
    if attitude is None or spins_fast(attitude):
        return None
    if isinstance(attitude, AttitudeTimeline):
        return attitude
    return AttitudeTimeline(timeline=(AttitudeChange(at=span_of(view)[0] - timedelta(days=1), attitude=attitude),))


def _written(attitude: AttitudeTimeline) -> list[str]:
    return [change.attitude for change in attitude.timeline if isinstance(change.attitude, str)]


def _begin(stretch: _Stretch) -> datetime:
    return stretch.begin


def _apart(stretches: Sequence[_Stretch]) -> bool:
    """Whether no two are at the same time."""
    return all(one.end <= other.begin for one, other in pairwise(sorted(stretches, key=_begin)))


def _effects(
    view: View, z: FloatArray, attitude: AttitudeTimeline, names: Sequence[str], edges: FloatArray
) -> dict[str, FloatArray]:
    """[R, k] K of each attitude in each piece alone, in the place of what the scenario says; of those that differ."""
    flown, each = _absorbed(view, attitude), pieces(view.window, edges)
    found = {}
    for name in names:
        change = attitude.timeline[0].model_copy(update={"attitude": name})
        with suppress(FlightcalError):  # its quaternions are not known so long
            more = _absorbed(view, attitude.model_copy(update={"timeline": (change,)})) - flown
            moved = np.flatnonzero(each @ np.abs(more).max(axis=0))
            if not len(moved):
                continue
            shares = np.concatenate([np.zeros((1, each.shape[1])), each[moved]])
            warmed = view.warmed(view.window, z, shares[:, None] * more)
            found[name] = np.zeros((len(warmed), len(each)))
            found[name][:, moved] = warmed
    return found


def _absorbed(view: View, attitude: AttitudeTimeline) -> FloatArray:
    """[h, 2 K] W that faces of heated nodes absorb in an attitude, in the steps of the view's window, all else apart.

    Raises OrbitError.
    """
    network, inputs = view.network.network, view.network.drive.inputs.copy()
    shine(view, elsewhere(view, attitude=attitude), inputs, view.network.drive.times)
    series = dict(zip(network.columns, inputs.reshape(-1, inputs.shape[2]).T, strict=True))
    absorbed = np.zeros((len(network.heated), 2 * len(inputs)))
    for gain in view.heat.gains:
        absorbed[network.heated.index(view.heat.nodes[gain.node])] += gain.flow(series)
    return absorbed


def _flown(view: View, attitude: AttitudeTimeline, stretches: tuple[_Stretch, ...], tries: float) -> Iterator[Wrong]:
    spans = [
        f"'{stretch.attitude}' from {stretch.begin.isoformat(timespec='seconds')} to "
        f"{stretch.end.isoformat(timespec='seconds')}"
        for stretch in stretches
    ]
    title = (
        f"The satellite was in {spans[0]}"
        if len(spans) == 1
        else f"The satellite was {len(spans)} times in another attitude than the scenario says"
    )
    words = Words(
        title,
        f"With {listed(spans)} (UTC), whatever the scenario says then, the model explains the telemetry.",
        "Check 'environment: attitude' against what was flown: a timeline says when it changes",
    )

    def near() -> Iterator[Wrong]:
        piece = timedelta(seconds=float(view.network.drive.times[-1])) / _PIECES
        for k, stretch in enumerate(stretches):
            for share, sign, end in product(_ENDS, (-1, 1), ("begin", "end")):
                moved = replace(stretch, **{end: getattr(stretch, end) + sign * share * piece})
                others = (*stretches[:k], moved, *stretches[k + 1 :])
                if all(one.begin < one.end for one in others) and _apart(others):
                    yield from _flown(view, attitude, others, tries)

    about = "stretch " + " ".join(dict.fromkeys(stretch.attitude for stretch in stretches))
    scenario = elsewhere(view, attitude=_with(attitude, stretches))
    yield from driven_otherwise("attitude", about, words, view, tries=tries, closer=near, scenario=scenario)


def _with(attitude: AttitudeTimeline, stretches: Sequence[_Stretch]) -> AttitudeTimeline:
    """Attitudes one after another with stretches in the place of what was there."""
    changes = list(attitude.timeline)
    for stretch in stretches:
        back = [change for change in changes if change.at <= stretch.end] or changes[:1]
        changes = [change for change in changes if not stretch.begin <= change.at <= stretch.end]
        changes += [
            AttitudeChange(at=stretch.begin, attitude=stretch.attitude),
            AttitudeChange(at=stretch.end, attitude=back[-1].attitude),
        ]
        changes.sort(key=lambda change: change.at)
    return attitude.model_copy(update={"timeline": tuple(changes)})
