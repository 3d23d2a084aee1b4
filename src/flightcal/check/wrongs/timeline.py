"""What the timeline of modes says, and was not flown: a stretch at another time, or another mode for a while."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime, timedelta
from functools import partial
from itertools import pairwise
from typing import Any

from ...scenario import ModeChange
from ...simulator import FloatArray
from ..network_view import View
from .stretches import Flown, Nats, Stretch, flown_otherwise, with_stretches
from .wrong import Words, Wrong, brought, closer, driven_otherwise, minutes, off, span_of

_LATE = tuple(sign * 60.0 * m for m in (4, 8, 12, 16, 20, 25, 30, 40, 50, 60, 90, 120) for sign in (-1.0, 1.0))
"""s, by which a stretch may be late or early."""


def stretches(view: View) -> Iterator[Wrong]:
    """One mode is at another time than the timeline says, or never."""
    timeline = view.window.scenario.network.timeline
    begin, end = span_of(view)
    usual = _usual(timeline)
    # Between two of the same mode, so that its time may be another and nothing else is.
    inside = [
        k
        for k in range(1, len(timeline) - 1)
        if timeline[k - 1].mode == timeline[k + 1].mode
        and timeline[k].mode != usual
        and timeline[k].at < end
        and timeline[k + 1].at > begin
    ]
    tries = len(inside) * (len(_LATE) + 1)
    for k in inside:
        yield from _cancelled(view, k, tries)
        yield from _moved(view, k, tries)


def otherwise_in_mode(view: View, z: FloatArray, nats: Nats) -> Iterator[Wrong]:
    """Stretches of the window in another mode than the timeline says: a safe mode, or a timeline of another satellite.

    Heat is the prior's median of what modes bring, z [d] where its effects are simulated. Raises SimulationFailure.
    """
    model, columns = view.window.scenario.network, view.network.network.columns
    if not model.timeline:
        return
    inputs = view.network.drive.inputs
    of_modes = [k for k, column in enumerate(columns) if column.startswith("mode.")]
    flown, more = brought(view, inputs), {}
    for mode in model.modes:
        other = inputs.copy()
        other[:, :, of_modes] = [float(columns[k] == f"mode.{mode}") for k in of_modes]
        more[mode] = brought(view, other) - flown
    was = Flown(
        "mode",
        "The satellite was in mode",
        "in another mode",
        "Check 'simulator: timeline' against what was flown",
        partial(_with_stretches, model.timeline),
    )
    yield from flown_otherwise(view, z, more, nats, was)


def _with_stretches(timeline: Sequence[ModeChange], stretches: Sequence[Stretch]) -> dict[str, Any]:
    """A timeline with stretches in the place of what it says then."""
    return {"timeline": with_stretches(timeline, stretches, ModeChange, "mode")}


def _usual(timeline: Sequence[ModeChange]) -> str | None:
    """The mode that lasts longest in all; None: there is no timeline."""
    lasted: dict[str, float] = {}
    for change, after in pairwise(timeline):
        lasted[change.mode] = lasted.get(change.mode, 0.0) + (after.at - change.at).total_seconds()
    return max(lasted, key=lambda mode: lasted[mode], default=None)


def _cancelled(view: View, k: int, tries: int) -> Iterator[Wrong]:
    timeline = view.window.scenario.network.timeline
    before, mode = timeline[k - 1].mode, _named(view, k)
    words = Words(
        f"{mode} did not take place",
        f"With '{before}' in its place, the model explains the telemetry.",
        "Check it in 'simulator: timeline' against what was flown",
    )
    others = (*timeline[:k], *timeline[k + 2 :])
    yield from driven_otherwise("mode", f"timeline {k}", words, view, tries=tries, timeline=others)


def _moved(view: View, k: int, tries: int, seconds: Sequence[float] | FloatArray = _LATE) -> Iterator[Wrong]:
    timeline = view.window.scenario.network.timeline
    last = timeline[k + 2].at if k + 2 < len(timeline) else datetime.max
    for late in map(float, seconds):
        moved = [
            change.model_copy(update={"at": change.at + timedelta(seconds=late)})
            for change in (timeline[k], timeline[k + 1])
        ]
        if not timeline[k - 1].at < moved[0].at < moved[1].at < last:
            continue
        words = Words(
            f"{_named(view, k)} is {off(-late)}",
            f"Begun {minutes(late)} {'later' if late > 0 else 'earlier'}, it explains the telemetry.",
            "Check it in 'simulator: timeline' against what was flown",
        )
        near = partial(_moved, view, k, tries, closer(late, 0.2 * abs(late)))
        others = (*timeline[:k], *moved, *timeline[k + 2 :])
        yield from driven_otherwise("mode", f"timeline {k}", words, view, tries=tries, closer=near, timeline=others)


def _named(view: View, k: int) -> str:
    change = view.window.scenario.network.timeline[k]
    return f"'{change.mode}' of {change.at.isoformat(timespec='seconds')} in the timeline"


WRONGS = (stretches,)
"""What looks for them."""
