"""Sensors that are broken by their own telemetry alone: stuck, repeating, held, or with a spike."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ..scenario import ICE_POINT
from ..simulator import FloatArray
from ..telemetry import spells
from ..words import moment, number
from .samples import noise_of, step_of
from .suspicion import Suspicion

_STUCK = 30
"""Equal samples that no sensor shows where the model moves."""
_RELEASED, _JUMPS, _THAN_ANY, _THAN_USUAL = 8, 3.0, 2.0, 10.0
"""Equal samples that are too many where the next one, without a gap, is so many K away, and so many times as far as any
other and as is usual."""
_MOVES = 1.0
"""K, by which the model has to move meanwhile."""
_STEPS, _BEFORE, _SLOWED, _THAN_OTHERS = 4.0, 8, 0.5, 2.0
"""Where there is no model: steps or noises that a motion which breaks off has to have, samples in whose halves it is
looked at, share of the first half's in the second that tells that it does not slow down, and times that a jump is
beyond nearly all other changes."""
_COPIED = 15
"""Changes that come again exactly, where they are no chance."""
_IN_A_ROW, _MOST_ALIKE = 8, 50
"""Changes in a row that come again where more may, and places of the same at most that are compared."""
_MOST_LAGS = 500
"""At which it is seen how often two readings are the same."""
_CHANCE, _ALIKE = 1e-9, 0.4
"""Probability of that by chance, and the least that is assumed of each change."""
_USUAL, _NO_NOISE = 0.9, 1e-3
"""Share of bends that noise makes, where others are the temperature's; steps of noise that are none."""
_HELD = 3
"""Samples, from which a reading that is held for so many is worth a word."""
_KNOTS, _MOST_BETWEEN = 8, 120
"""Readings at least, and samples between two at most, where lines are drawn between them;"""
_NEARER, _NEARLY_ALL = 15.0, 0.95
"""times that nearly all samples are nearer to these lines than readings to lines of others: a curve is four times."""
_FILLED, _FAR = 3, 5.0
"""Times that one number comes, and K that it is away from the samples around it, which stands for no reading."""
_BITS, _OF_WHOLE = (16, 14, 12, 10, 8), 0.25
"""Of a number that is sent; share of what these count up to, below which all other changes are, and of the changes."""
_SLOPE, _CLIPPED = 3, 1.0
"""Samples over which a slope is taken; K, by which a temperature goes on where readings stop."""
_RESTS = 10.0
"""Times that a motion slows more than a parabola, where it comes to rest."""
_MOST_SPIKES = 3
_SPIKE = (3.0, 12.0, 4.0, 2.0)
"""A spike is larger than so many K, so many deviations of the noise, so many times what is usual, and so many times
what the model has."""
_MOVED = 0.5
"""Share of a spike's height by which the temperature moves from sample to sample, from which it is none."""
_MANY = (0.03, 15.0)
"""Share of the samples that may be spikes, where they are so many times what is usual."""
_GAP = 2.5
"""Times the usual time between samples, from which two are no longer beside each other."""


@dataclass(frozen=True)
class Broken:
    """What is wrong with a channel, and which of its samples are of no use."""

    suspicion: Suspicion
    useless: NDArray[np.bool_]
    """[T]."""


def broken(channel: str, times: NDArray[np.datetime64], values: FloatArray, modelled: FloatArray) -> Broken | None:
    """What is wrong with a channel's samples [T] K; modelled: [T] K as the simulator has them, NaN: not known."""
    valid = np.flatnonzero(np.isfinite(values))
    for look in (_filled, _wrapped, _interpolated, _stuck_often, _spikes, _held, _stuck, _clipped, _repeating):
        found = look(channel, times[valid], values[valid], modelled[valid])
        if found is not None:
            useless = np.zeros(len(values), bool)
            useless[valid] = found.useless
            return replace(found, useless=useless)
    return None


def _filled(channel: str, times: NDArray[np.datetime64], values: FloatArray, modelled: FloatArray) -> Broken | None:
    """One number that comes again and again, far from what is read before and after: it stands for no reading."""
    numbers, counts = np.unique(values, return_counts=True)
    for number_of in numbers[(counts >= _FILLED) & (counts < 0.5 * len(values))]:
        is_it = values == number_of
        others = np.flatnonzero(~is_it)
        place = np.clip(np.searchsorted(others, np.flatnonzero(is_it)), 1, len(others) - 1)
        before, after = values[others[place - 1]] - number_of, values[others[place]] - number_of
        noises = _SPIKE[1]
        height = np.where(before * after > 0.0, np.minimum(np.abs(before), np.abs(after)), 0.0)
        limit = max(
            _FAR, noises * noise_of(values[others]), 4.0 * float(np.quantile(np.abs(np.diff(values[others])), 0.95))
        )
        if (height > limit).mean() > 0.8:
            suspicion = Suspicion(
                "filled", channel, f"{channel} has samples that are no readings",
                f"{number(float(number_of) - ICE_POINT, 4)} degC comes {int(is_it.sum())} times, each time "
                f"{number(float(np.median(height)), 2)} K away from the samples around it.",
                f"Write it as 'invalid' of {channel} in 'telemetry: channels'",
            )  # fmt: skip
            return Broken(suspicion, is_it)
    return None


def _wrapped(channel: str, times: NDArray[np.datetime64], values: FloatArray, modelled: FloatArray) -> Broken | None:
    """Counts that begin again: a negative number that is read as one without a sign, or a counter that overflows."""
    if len(values) < _STUCK:
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


def _clipped(channel: str, times: NDArray[np.datetime64], values: FloatArray, modelled: FloatArray) -> Broken | None:
    """Readings that stop at their highest or lowest, where the temperature goes on."""
    if len(values) < _STUCK:
        return None
    for extreme, word in ((values.max(), "above"), (values.min(), "below")):
        first, last = spells(values == extreme).T
        goes_on = _goes_on(modelled if word == "above" else -modelled, first, last)
        beyond = np.maximum(_turns_beyond(values, first, last), goes_on)
        if (beyond > _CLIPPED + 4.0 * step_of(values) + 4.0 * noise_of(values)).sum() < 2:
            continue
        suspicion = Suspicion(
            "clipped", channel, f"{channel} shows nothing {word} {number(float(extreme) - ICE_POINT, 4)} degC",
            f"It stops there {len(first)} times, for up to {int((last - first).max())} samples, where it would go on "
            f"by {number(float(beyond.max()), 2)} K.",
            f"Leave these samples out with a narrower 'valid_range' of {channel}",
        )  # fmt: skip
        return Broken(suspicion, values == extreme)
    return None


def _turns_beyond(values: FloatArray, first: NDArray[np.int64], last: NDArray[np.int64]) -> FloatArray:
    """K by which values [T] would go on in stretches [first, last), as a parabola does that has the slopes beside."""
    after = np.minimum(last, len(values) - 1)
    rise, before = _motion(values, first - 1, -_SLOPE, last - first)
    fall, later = _motion(values, after, _SLOPE, last - first)
    # At an end of the window one slope is known, and speaks for both.
    known = first > _SLOPE, last < len(values) - _SLOPE
    rise, fall = np.where(known[0], rise, np.inf), np.where(known[1], fall, np.inf)
    slope = np.minimum(rise, fall)
    beyond = np.where(np.isfinite(slope), slope, 0.0) * (last - first) / 4.0
    # On a parabola, readings a quarter of the stretch away are lower by that much. Those of a panel that leaves a
    # shadow fast, and then stays, are not.
    away, top = np.maximum((last - first) // 4, 1), values[first]
    lower = [
        np.where(side, np.abs(top - values[np.clip(place, 0, len(values) - 1)]), np.inf)
        for side, place in zip(known, (first - 1 - away, last + away), strict=True)
    ]
    beyond = np.where(np.minimum(*lower) < 0.5 * beyond, 0.0, beyond)
    # What comes to rest goes on by less.
    return np.minimum(beyond, np.minimum(np.where(known[0], before, np.inf), np.where(known[1], later, np.inf)))


def _goes_on(modelled: FloatArray, first: NDArray[np.int64], last: NDArray[np.int64]) -> FloatArray:
    """K by which the model rises in stretches [first, last) of `_SLOPE` samples or more, and falls again; else 0."""
    found = np.zeros(len(first))
    for k in np.flatnonzero(last - first >= _SLOPE):
        inside = modelled[first[k] : last[k]]
        found[k] = inside.max() - max(inside[0], inside[-1])
    return np.nan_to_num(found)


def _motion(
    values: FloatArray, places: NDArray[np.int64], step: int, lengths: NDArray[np.int64]
) -> tuple[FloatArray, FloatArray]:
    """K a sample by which values [t] move up to each place, and K by which they go on where they come to rest.

    step: samples back, or on where it is positive; lengths: samples that it then takes until they move again. They come
    to rest where they slow far more than a parabola does that turns in so long; elsewhere the second is infinite.
    """
    last, middle, first = (values[np.clip(places + k * step, 0, len(values) - 1)] for k in range(3))
    moved, earlier = np.abs(last - middle), np.abs(middle - first)
    slows = (earlier - moved) * lengths > _RESTS * 2.0 * abs(step) * moved
    goes_on = np.full(len(places), np.inf)
    goes_on[slows] = moved[slows] ** 2 / (earlier - moved)[slows]
    return moved / abs(step), goes_on


def _spikes(channel: str, times: NDArray[np.datetime64], values: FloatArray, modelled: FloatArray) -> Broken | None:
    if len(values) < 20:
        return None
    height = _heights(times, values)
    least, noises, usual, models = _SPIKE
    order = np.argsort(-height)
    many = max(_MOST_SPIKES, round(_MANY[0] * len(values)))
    beyond = min(usual * float(height[order[_MOST_SPIKES]]), _MANY[1] * float(height[order[many]]))
    limit = max(least, noises * noise_of(values), beyond)
    if np.isfinite(modelled).all():
        limit = max(limit, models * float(_heights(times, modelled).max()))
    high = height > limit
    if not high.any():
        return None
    first = order[0]
    what = "a spike" if high.sum() == 1 else f"{high.sum()} spikes"
    suspicion = Suspicion(
        "spike", channel, f"{channel} has {what}",
        f"At {moment(times[first])} UTC it reads {number(float(values[first]) - ICE_POINT, 3)} degC, "
        f"{number(float(height[first]), 2)} K away from the samples around it.",
        _leave_out(channel, times, high) if high.sum() <= _MOST_SPIKES
        else f"Leave them out with a narrower 'valid_range' of {channel}",
    )  # fmt: skip
    return Broken(suspicion, high)


def _heights(times: NDArray[np.datetime64], values: FloatArray) -> FloatArray:
    """[T] K by which one sample, or two in a row, are above those before and after, or below; else 0.

    Where the temperature moves by half as much before or after, they are the end of that motion, and no spike.
    """
    usual = np.median(np.diff(times))
    found = np.zeros(len(values))
    for wide in (1, 2):
        rows = sliding_window_view(values, wide + 4)
        apart = np.max(sliding_window_view(np.diff(times), wide + 3)[:, 1:-1], axis=1)
        before, inside, after = rows[:, [0, 1]], rows[:, 2:-2], rows[:, [-2, -1]]
        away = np.stack([inside - before[:, [1]], inside - after[:, [0]]])
        height = np.maximum(away.min(axis=(0, 2)), (-away).min(axis=(0, 2))).clip(0.0)
        moves = np.maximum(np.abs(np.diff(before)), np.abs(np.diff(after)))[:, 0]
        height[(apart >= _GAP * usual) | (moves > _MOVED * height)] = 0.0
        for k in range(wide):
            peak = found[2 + k : 2 + k + len(height)]
            np.maximum(peak, height, out=peak)
    return found


def _held(channel: str, times: NDArray[np.datetime64], values: FloatArray, modelled: FloatArray) -> Broken | None:
    changes = np.flatnonzero(np.diff(values) != 0.0) + 1
    if len(changes) < 10:
        return None
    stride = int(np.gcd.reduce(np.diff(changes)))
    if stride < _HELD:
        return None
    suspicion = Suspicion(
        "held", channel, f"{channel} holds each reading for {stride} samples",
        f"Its value changes every {stride} samples or a multiple of that, and never between: one of {stride} "
        "is a measurement.",
        f"Keep one of {stride} samples of {channel}",
    )  # fmt: skip
    return Broken(suspicion, np.diff(values, prepend=values[0]) == 0.0)


def _interpolated(
    channel: str, times: NDArray[np.datetime64], values: FloatArray, modelled: FloatArray
) -> Broken | None:
    """One reading of many, and straight lines between them."""
    if len(values) < _STUCK:
        return None
    seconds = (times - times[0]) / np.timedelta64(1, "s")
    places = np.rint(seconds / np.median(np.diff(seconds))).astype(np.int64)
    # The largest bend is at a reading.
    beside = np.diff(places, 2) == 0
    after = places - places[1:-1][np.argmax(np.abs(np.diff(values, 2)) * beside)]
    strides = range(min(_MOST_BETWEEN, len(values) // _KNOTS), _HELD - 1, -1)
    stride = next((k for k in strides if _on_lines(seconds, values, after % k == 0)), None)
    if stride is None:
        return None
    suspicion = Suspicion(
        "interpolated", channel, f"{channel} has straight lines between readings",
        f"One of {stride} samples is a reading, and those between are on the line from each to the next.",
        f"Keep one of {stride} samples of {channel}, or take them as they were sent",
    )  # fmt: skip
    return Broken(suspicion, after % stride != 0)


def _on_lines(seconds: FloatArray, values: FloatArray, kept: NDArray[np.bool_]) -> bool:
    """Whether values [T] are far nearer to the lines between some of them than these are to those of every second."""
    if kept.sum() < _KNOTS:
        return False
    at, known = seconds[kept], values[kept]
    off = np.abs(values - np.interp(seconds, at, known))[~kept]
    bends = known[1:-1:2] - np.interp(at[1:-1:2], at[::2], known[::2])
    return bool(_NEARER * np.quantile(off, _NEARLY_ALL) < np.median(np.abs(bends)))


def _stuck_often(
    channel: str, times: NDArray[np.datetime64], values: FloatArray, modelled: FloatArray
) -> Broken | None:
    """Stretches of equal samples, far longer than all others and not all of one number, that break off motions.

    A sample that is right between them is no spike.
    """
    starts, lengths = _runs(values)
    order = np.argsort(-lengths, kind="stable")
    ordered = lengths[order]
    apart = np.flatnonzero(ordered[:-1] >= np.maximum(_STUCK, 4 * ordered[1:]))
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
    useless = np.any([_between(values, first, end) for first, end in stretches], axis=0)
    suspicion = Suspicion(
        "stuck", channel, f"{channel} is stuck again and again",
        f"{len(stretches)} times it reads one number for {ordered[apart[-1]]} samples or more, the first time from "
        f"{moment(times[stretches[0][0]])} UTC on; meanwhile the model moves by {number(min(moved), 2)} K or more.",
        _leave_out(channel, times, useless),
    )  # fmt: skip
    return Broken(suspicion, useless)


def _stuck(channel: str, times: NDArray[np.datetime64], values: FloatArray, modelled: FloatArray) -> Broken | None:
    if not len(values):
        return None
    starts, lengths = _runs(values)
    longest = int(np.argmax(lengths))
    first, last = starts[longest], starts[longest] + lengths[longest] - 1
    others, steps = np.delete(lengths, longest), np.sort(np.abs(values[starts[1:]] - values[starts[1:] - 1]))
    jump = _jump(times, values, last + 1)
    least = max(_MOVES, 4.0 * float(steps[0])) if len(steps) else _MOVES
    moves = _moves(modelled, first, last + 1)
    long = lengths[longest] >= max(_STUCK, 4 * int(others.max(initial=0)))
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
    useless = _between(values, first, last + 1)
    whole = "throughout" if not len(others) else f"from {moment(times[first])} UTC to {moment(times[last])} UTC"
    suspicion = Suspicion(
        "stuck", channel, f"{channel} is stuck",
        f"It reads {number(float(values[first]) - ICE_POINT, 4)} degC in {lengths[longest]} samples, {whole}; {words}.",
        _leave_out(channel, times, useless) if len(others) else f"Leave {channel} out of 'observations'",
    )  # fmt: skip
    return Broken(suspicion, useless)


def _runs(values: FloatArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Where equal samples in a row [t] begin, and how many they are."""
    starts = np.concatenate([[0], np.flatnonzero(np.diff(values) != 0.0) + 1])
    return starts, np.diff(np.append(starts, len(values)))


def _jump(times: NDArray[np.datetime64], values: FloatArray, end: int) -> float:
    """K to the first of the samples [t] after a stretch; 0 where there is none, or a gap before it."""
    follows = end < len(values) and times[end] - times[end - 1] <= _GAP * np.median(np.diff(times))
    return abs(float(values[end] - values[end - 1])) if follows else 0.0


def _moves(modelled: FloatArray, first: int, end: int) -> float:
    """K by which the model [t] moves in a stretch; NaN where it is not known."""
    known = modelled[first:end][np.isfinite(modelled[first:end])]
    return float(np.ptp(known)) if len(known) else np.nan


def stuck_throughout(
    channel: str, times: NDArray[np.datetime64], values: FloatArray, elsewhere: FloatArray
) -> Broken | None:
    """A channel whose samples [T] K are all the same, where half as many of another window, `elsewhere` [S] K, move."""
    valid = np.isfinite(values)
    read, known = values[valid], elsewhere[np.isfinite(elsewhere)]
    if min(len(read), len(known)) < _STUCK or len(read) < len(known) // 2 or np.ptp(read) > 0.0:
        return None
    moves = min(float(np.ptp(half)) for half in np.array_split(known, 2))
    if moves < max(_MOVES, 4.0 * step_of(known)):
        return None
    at = times[valid]
    suspicion = Suspicion(
        "stuck", channel, f"{channel} is stuck",
        f"It reads {number(float(read[0]) - ICE_POINT, 4)} degC in all {len(read)} samples from {moment(at[0])} UTC to "
        f"{moment(at[-1])} UTC; in the window to train on it moves by {number(moves, 2)} K.",
        _leave_out(channel, at, valid[valid]),
    )  # fmt: skip
    return Broken(suspicion, valid)


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
    if first >= _BEFORE and away[first - _BEFORE : first].max() <= _GAP * np.median(away):
        earlier, middle, start = values[[first - _BEFORE, first - _BEFORE // 2, first]]
        if abs(start - middle) >= max(least, _SLOWED * abs(middle - earlier)):
            return True
    others = np.delete(steps, slice(first, end))
    return bool(jump >= max(least, _THAN_OTHERS * np.quantile(others, 0.95)))


def _repeating(channel: str, times: NDArray[np.datetime64], values: FloatArray, modelled: FloatArray) -> Broken | None:
    moves = np.append(False, np.diff(values) != 0.0)
    best = (0, 0, 0, 0)  # changes, lag, first, last
    for lag in _lags(values, moves):
        same = values[lag:] == values[:-lag]
        for first, last in spells(same):
            count = int(moves[lag + first : lag + last].sum())
            if count > best[0]:
                best = (count, lag, lag + int(first), lag + int(last))
    count, lag, first, last = best
    if count < _COPIED or len(np.unique(values[first:last])) < 6:
        return None
    # What comes again in every orbit, and is read in coarse steps, is often the same by chance.
    same = values[lag:] == values[:-lag]
    outside = np.concatenate([same[: first - lag], same[last - lag :]])
    # Where two curves come close they stay so, and then it is the noise alone that tells readings apart.
    lags = np.unique(np.linspace(2, len(values) // 2, _MOST_LAGS).round().astype(int))
    usual = float(np.median([np.mean(values[other:] == values[:-other]) for other in lags.tolist()]))
    likely = [_ALIKE, _alike(values), usual]
    likely += [float(outside.mean())] if len(outside) >= _COPIED else []
    if max(likely) ** count > _CHANCE:
        return None
    useless = _between(values, first, last)
    suspicion = Suspicion(
        "repeating", channel, f"{channel} repeats itself",
        f"{last - first} samples from {moment(times[first])} UTC on are exactly those of {lag} samples before.",
        _leave_out(channel, times, useless),
    )  # fmt: skip
    return Broken(suspicion, useless)


def _lags(values: FloatArray, moves: NDArray[np.bool_]) -> list[int]:
    """Lags in samples, up to half of all, at which some changes in a row of samples [T] come again; moves: [T].

    A change is told by what is read then and how many samples later the next one comes.
    """
    changes = np.flatnonzero(moves)
    if len(changes) <= _IN_A_ROW:
        return []
    told = np.stack([values[changes[:-1]], np.diff(changes).astype(float)], axis=1)
    kinds = np.unique(told, axis=0, return_inverse=True)[1].ravel()
    rows = sliding_window_view(kinds, _IN_A_ROW)
    order = np.lexsort(rows.T)
    alike = np.all(rows[order[1:]] == rows[order[:-1]], axis=1)
    found: set[int] = set()
    for group in np.split(changes[order], np.flatnonzero(~alike) + 1):
        lags = np.abs(np.subtract.outer(group[:_MOST_ALIKE], group[:_MOST_ALIKE]))
        found.update(lags[(lags >= 2) & (lags <= len(values) // 2)].tolist())
    return sorted(found)


def _leave_out(channel: str, times: NDArray[np.datetime64], useless: NDArray[np.bool_]) -> str:
    """Advice to leave samples out of a channel's at times [T]; half a sample longer, for a mean is of such a time."""
    first, end = spells(useless).T
    half = np.median(np.diff(times)) // 2
    ends = np.datetime_as_string(np.stack([times[first] - half, times[end - 1] + half], axis=1), unit="ms")
    texts = (tuple(str(name).removesuffix(".000") for name in pair) for pair in ends)
    spans = ", ".join(f"{{start: {start}, end: {end}}}" for start, end in texts)
    return f"Leave it out: 'leave_out: [{spans}]' of {channel} in 'telemetry: channels'"


def _between(values: FloatArray, first: int, end: int) -> NDArray[np.bool_]:
    """[t] which of the values are from the first on and before the end."""
    places = np.arange(len(values))
    return (places >= first) & (places < end)


def _alike(values: FloatArray) -> float:
    """How often a temperature that is read twice, in the steps of readings [T] and with their noise, is the same."""
    bends, step = np.abs(np.diff(values, 2)), step_of(values)
    square = float(np.mean(bends[bends <= np.quantile(bends, _USUAL)] ** 2)) / 6.0
    # Without that of the steps; of the difference of two readings, in steps.
    width = float(np.sqrt(2.0 * max(square - step**2 / 12.0, 0.0))) / step
    if width < _NO_NOISE:
        return 1.0
    inside = math.erf(1.0 / (width * math.sqrt(2.0)))
    return inside - width * math.sqrt(2.0 / math.pi) * (1.0 - math.exp(-0.5 / width**2))
