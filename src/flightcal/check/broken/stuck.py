"""Equal samples in a row, where the temperature moves."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ...scenario import ICE_POINT
from ...simulator import FloatArray
from ...words import moment, number
from ..samples import noise_of, step_of
from ..suspicion import Suspicion
from .broken import GAP, STUCK, Broken, between, leave_out

_RELEASED, _JUMPS, _THAN_ANY, _THAN_USUAL = 8, 3.0, 2.0, 10.0
"""Equal samples that are too many where the next one, without a gap, is so many K away, and so many times as far as any
other and as is usual."""
_MOVES = 1.0
"""K, by which the model has to move meanwhile."""
_STEPS, _BEFORE, _SLOWED, _THAN_OTHERS = 4.0, 8, 0.5, 2.0
"""Where there is no model: steps or noises that a motion which breaks off has to have, samples in whose halves it is
looked at, share of the first half's in the second that tells that it does not slow down, and times that a jump is
beyond nearly all other changes."""


def stuck(channel: str, times: NDArray[np.datetime64], values: FloatArray, modelled: FloatArray) -> Broken | None:
    """Equal samples in one stretch, longer than any other."""
    if not len(values):
        return None
    starts, lengths = _runs(values)
    longest = int(np.argmax(lengths))
    first, last = starts[longest], starts[longest] + lengths[longest] - 1
    others, steps = np.delete(lengths, longest), np.sort(np.abs(values[starts[1:]] - values[starts[1:] - 1]))
    jump = _jump(times, values, last + 1)
    least = max(_MOVES, 4.0 * float(steps[0])) if len(steps) else _MOVES
    moves = _moves(modelled, first, last + 1)
    long = lengths[longest] >= max(STUCK, 4 * int(others.max(initial=0)))
    half = int(lengths[longest]) // 2
    elsewhere = _usual_move(values, first, last + 1, half) if long and np.isnan(moves) else 0.0
    if long and moves >= least:
        words = f"meanwhile the model moves by {number(moves, 2)} K"
    elif elsewhere >= least and _breaks_off(times, values, first, last + 1, jump):
        words = f"its other samples move by {number(elsewhere, 2)} K in half as many, as a rule"
    elif (
        len(steps) > 2
        and lengths[longest] >= _RELEASED
        and jump >= max(_JUMPS, _THAN_ANY * steps[-2], _THAN_USUAL * steps[len(steps) // 2])
    ):
        words = f"then it jumps by {number(jump, 2)} K"
    else:
        return None
    useless = between(values, first, last + 1)
    whole = "throughout" if not len(others) else f"from {moment(times[first])} UTC to {moment(times[last])} UTC"
    suspicion = Suspicion(
        "stuck", channel, f"{channel} is stuck",
        f"It reads {number(float(values[first]) - ICE_POINT, 4)} degC in {lengths[longest]} samples, {whole}; {words}.",
        leave_out(channel, times, useless) if len(others) else f"Leave {channel} out of 'observations'",
    )  # fmt: skip
    return Broken(suspicion, useless)


def stuck_often(channel: str, times: NDArray[np.datetime64], values: FloatArray, modelled: FloatArray) -> Broken | None:
    """Stretches of equal samples, far longer than all others and not all of one number, that break off motions.

    A sample that is right between them is no spike.
    """
    starts, lengths = _runs(values)
    order = np.argsort(-lengths, kind="stable")
    ordered = lengths[order]
    apart = np.flatnonzero(ordered[:-1] >= np.maximum(STUCK, 4 * ordered[1:]))
    if not len(apart) or apart[-1] == 0:
        return None
    stretches = [(int(starts[k]), int(starts[k] + lengths[k])) for k in sorted(order[: apart[-1] + 1])]
    if len({values[first] for first, _ in stretches}) == 1:
        return None
    moved = [_moves(modelled, first, end) for first, end in stretches]
    jumps = [_jump(times, values, end) for _, end in stretches]
    breaks = [_breaks_off(times, values, *place, jump) for place, jump in zip(stretches, jumps, strict=True)]
    if not (min(moved) >= max(_MOVES, 4.0 * step_of(values)) and all(breaks)):
        return None
    useless = np.any([between(values, first, end) for first, end in stretches], axis=0)
    suspicion = Suspicion(
        "stuck", channel, f"{channel} is stuck again and again",
        f"{len(stretches)} times it reads one number for {ordered[apart[-1]]} samples or more, the first time from "
        f"{moment(times[stretches[0][0]])} UTC on; meanwhile the model moves by {number(min(moved), 2)} K or more.",
        leave_out(channel, times, useless),
    )  # fmt: skip
    return Broken(suspicion, useless)


def stuck_throughout(
    channel: str, times: NDArray[np.datetime64], values: FloatArray, elsewhere: FloatArray
) -> Broken | None:
    """A channel whose samples [T] K are all the same, where half as many of another window, `elsewhere` [S] K, move."""
    valid = np.isfinite(values)
    read, known = values[valid], elsewhere[np.isfinite(elsewhere)]
    if min(len(read), len(known)) < STUCK or len(read) < len(known) // 2 or np.ptp(read) > 0.0:
        return None
    moves = min(float(np.ptp(half)) for half in np.array_split(known, 2))
    if moves < max(_MOVES, 4.0 * step_of(known)):
        return None
    at = times[valid]
    suspicion = Suspicion(
        "stuck", channel, f"{channel} is stuck",
        f"It reads {number(float(read[0]) - ICE_POINT, 4)} degC in all {len(read)} samples from {moment(at[0])} UTC to "
        f"{moment(at[-1])} UTC; in the window to train on it moves by {number(moves, 2)} K.",
        leave_out(channel, at, valid[valid]),
    )  # fmt: skip
    return Broken(suspicion, valid)


def _runs(values: FloatArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Where equal samples in a row [t] begin, and how many they are."""
    starts = np.concatenate([[0], np.flatnonzero(np.diff(values) != 0.0) + 1])
    return starts, np.diff(np.append(starts, len(values)))


def _jump(times: NDArray[np.datetime64], values: FloatArray, end: int) -> float:
    """K to the first of the samples [t] after a stretch; 0 where there is none, or a gap before it."""
    follows = end < len(values) and times[end] - times[end - 1] <= GAP * np.median(np.diff(times))
    return abs(float(values[end] - values[end - 1])) if follows else 0.0


def _moves(modelled: FloatArray, first: int, end: int) -> float:
    """K by which the model [t] moves in a stretch; NaN where it is not known."""
    known = modelled[first:end][np.isfinite(modelled[first:end])]
    return float(np.ptp(known)) if len(known) else np.nan


def _usual_move(values: FloatArray, first: int, end: int, count: int) -> float:
    """K, by which a channel [t] moves in `count` samples beside a stretch; 0 where it rests or the stretch is most."""
    sides = [side for side in (values[:first], values[end:]) if len(side) >= count]
    if not sides or end - first > len(values) // 2:
        return 0.0
    moves = np.concatenate([np.ptp(sliding_window_view(side, count), axis=1) for side in sides])
    return float(np.median(moves)) if moves.min() >= _STEPS * step_of(values) else 0.0


def _breaks_off(times: NDArray[np.datetime64], values: FloatArray, first: int, end: int, jump: float) -> bool:
    """Whether a stretch of equal samples [t] begins in the midst of a motion, or ends with a jump of so many K.

    A temperature that comes to rest slows down before, and it sets out again with steps as any other.
    """
    away, steps = np.diff(times), np.abs(np.diff(values))
    # The usual one: means of coarse readings are a small step apart now and then.
    least = _STEPS * max(float(np.median(steps[steps > 0.0])), noise_of(values))
    if first >= _BEFORE and away[first - _BEFORE : first].max() <= GAP * np.median(away):
        earlier, middle, start = values[[first - _BEFORE, first - _BEFORE // 2, first]]
        if abs(start - middle) >= max(least, _SLOWED * abs(middle - earlier)):
            return True
    others = np.delete(steps, slice(first, end))
    return bool(jump >= max(least, _THAN_OTHERS * np.quantile(others, 0.95)))
