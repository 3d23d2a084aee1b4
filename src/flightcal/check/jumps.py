"""Temperatures that jump as no heat makes them: samples that are lost, of another time or not in order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..simulator import FloatArray
from ..words import listed, moment, number
from .samples import noise_of
from .suspicion import Suspicion

_APART = np.timedelta64(120, "s")
"""Between two samples at most: in more time a light node may go far."""
_USUALLY = 1.5
"""Usual times between two samples of a channel, up to which none is missing."""
_LEAST, _NOISES, _TIMES = 1.5, 12.0, 4.0
"""A jump is more than so many K, deviations of the noise, and times what the model or the samples beside it move."""
_STAYS, _BESIDE = 0.7, 3
"""Share of a jump that means of so many samples before and after have to be apart: else it is a spike."""
_TOO, _NOISES_TOO = 2.0, 6.0
"""Another channel jumps too by so many times what is usual of it, and so many deviations of its noise."""
_USUAL = 0.95
"""Quantile."""
_FEW = 20
"""Samples, of which nothing is said of how they go to and fro."""
_SENT_AGAIN = 3
"""Equal samples of all that jumps after them: old telemetry was sent again, and its end is no matter of order."""


@dataclass(frozen=True)
class Jump:
    """A moment at which channels jump."""

    time: np.datetime64
    channels: tuple[str, ...]
    """The one that jumps most clearly first."""
    height: float
    """K, of that one."""


def jumps(
    channels: Sequence[str], times: NDArray[np.datetime64], observed: FloatArray, modelled: FloatArray
) -> list[Jump]:
    """All of them in samples [T, N] K; modelled: [T, N] K as the simulator has them, NaN: not known."""
    # Each packet has times of its own, at which the others have nothing: places are among a channel's own samples.
    valid = [np.flatnonzero(np.isfinite(column)) for column in observed.T]
    found = [
        (int(rows[place + 1]), k, place)
        for k, rows in enumerate(valid)
        for place in _of_channel(times[rows], observed[rows, k], modelled[rows, k], np.diff(rows) == 1).tolist()
    ]
    leaps = {(k, place) for _, k, place in found}
    result: list[Jump] = []
    told: set[tuple[int, int]] = set()
    for after, first, place in sorted(found):
        if (first, place) in told:
            continue
        places = {k: int(np.searchsorted(rows, after)) - 1 for k, rows in enumerate(valid)}
        jumping = [first, *(k for k, row in places.items() if k != first and (k, row) in leaps)]
        jumping += [
            k
            for k, rows in enumerate(valid)
            if k not in jumping and 0 <= places[k] < len(rows) - 1 and _jumps_too(observed[rows, k], places[k])
        ]
        told |= {(k, places[k]) for k in jumping}
        before = [observed[valid[k][: places[k] + 1][-_SENT_AGAIN:], k] for k in jumping]
        if len(jumping) > 1 and all(len(jump) == _SENT_AGAIN and (jump == jump[0]).all() for jump in before):
            continue
        height = observed[after, first] - observed[valid[first][place], first]
        result.append(Jump(times[after], tuple(channels[k] for k in jumping), float(height)))
    return result


def in_turns(channels: Sequence[str], observed: FloatArray, modelled: FloatArray) -> list[str]:
    """Channels whose samples [T, N] K go to and fro between two courses, from each to the next; modelled: see `jumps`.

    Rows of two satellites or units in one file do, in several channels at once.
    """
    found = []
    for name, values, model in zip(channels, observed.T, modelled.T, strict=True):
        known = np.isfinite(values)
        to_next, to_second = (np.abs(values[known][k:] - values[known][:-k]) for k in (1, 2))
        if len(to_second) < _FEW or not np.isfinite(model[known]).all():
            continue
        others = (float(np.median(moves)) for moves in (to_second, np.abs(np.diff(model[known]))))
        if float(np.median(to_next)) > max(_LEAST, *(_TIMES * other for other in others)):
            found.append(name)
    return found if len(found) > 1 else []


def _of_channel(
    times: NDArray[np.datetime64], values: FloatArray, modelled: FloatArray, adjoining: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """After which of its samples [T] a channel jumps; adjoining: [T - 1] whether no sample is between two."""
    apart = np.diff(times)
    seconds = apart / np.timedelta64(1, "s")
    near = adjoining | (seconds <= _USUALLY * np.median(seconds)) if len(seconds) else adjoining
    move = np.where((apart <= _APART) & near, np.diff(values), np.nan)
    height = np.nan_to_num(np.abs(move))
    padded = np.pad(height, 1)
    beside = np.maximum(padded[:-2], padded[2:])
    model = np.abs(np.diff(modelled))
    if not np.isfinite(model).any():
        return np.empty(0, np.int64)
    limit = max(_LEAST, _NOISES * noise_of(values), _TIMES * float(np.nanmax(model)))
    high = np.flatnonzero((height > limit) & (height > _TIMES * beside))
    return np.array([k for k in high.tolist() if abs(_apart(values, k)) > _STAYS * height[k]], np.int64)


def _apart(values: FloatArray, place: int) -> float:
    """K from the samples up to a place to those after it, in means."""
    before, after = values[max(place + 1 - _BESIDE, 0) : place + 1], values[place + 1 : place + 1 + _BESIDE]
    return float(np.nanmean(after) - np.nanmean(before))


def _jumps_too(values: FloatArray, place: int) -> bool:
    """Whether a channel moves more than usual after a place, where another jumps."""
    moves = np.abs(np.diff(values))
    usual = float(np.nanquantile(moves, _USUAL)) if np.isfinite(moves).any() else np.inf
    return bool(moves[place] > max(_TOO * usual, _NOISES_TOO * noise_of(values)))


def in_words(found: Sequence[Jump], turning: Sequence[str] = ()) -> list[Suspicion]:
    """What is said of all that jumps at once, else of each channel that jumps.

    turning: channels that go to and fro, see `in_turns`.
    """
    if turning:
        suspicion = Suspicion(
            "order",
            "rows",
            "Rows of two sources take turns",
            f"{listed(list(turning))} go to and fro by kelvins from each sample to the next, and every second sample "
            "is close to the one before it. No heat does that: rows of two satellites, units or sensors are in one "
            "file.",
            "Part them by the column that says whose a row is, such as a tag that was left out of an export",
        )
        return [suspicion]
    together = [jump for jump in found if len(jump.channels) > 1]
    if together:
        first, more = _largest(together)
        suspicion = Suspicion(
            "order",
            "time",
            "The telemetry jumps in time",
            f"At {moment(first.time)} UTC {listed(list(first.channels))} jump at once, {first.channels[0]} by "
            f"{number(abs(first.height), 2)} K from one sample to the next{more}. No heat does that: samples are lost, "
            "of another time, or not in order.",
            "Check the time column there, and how packets and files are put together",
        )
        return [suspicion]
    told = []
    for channel in dict.fromkeys(jump.channels[0] for jump in found):
        first, more = _largest([jump for jump in found if jump.channels[0] == channel])
        suspicion = Suspicion(
            "jump",
            channel,
            f"{channel} jumps",
            f"At {moment(first.time)} UTC it goes by {number(abs(first.height), 2)} K from one sample to the next"
            f"{more}. No heat does that to its node: the sensor, or what reads it, changed; or samples are lost there, "
            "which slower nodes do not show.",
            f"Check {channel} there; leave that time out of the window",
        )
        told.append(suspicion)
    return told


def _largest(found: Sequence[Jump]) -> tuple[Jump, str]:
    """The largest jump, and in words how many others there are."""
    others = len(found) - 1
    more = f"; so it does at {others} other moment{'s' if others > 1 else ''}" if others else ""
    return max(found, key=lambda jump: abs(jump.height)), more
