"""Channels that read the temperature of a while, not of a moment: slow sensors, and means of many samples."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np

from ...simulator import FloatArray
from ..network_view import Memory, View
from .wrong import Kind, Words, Wrong, as_long, minutes

_LAGS = (300.0, 900.0, 2700.0)
"""s"""
_WIDTHS = (600.0, 1200.0, 2400.0)
"""s"""
_BEFORE = (0.5, 1.0)
"""Share of the time of a mean that is before its sample."""
_LONGEST = 5400.0
"""s: what is slower is no sensor, and no mean that somebody takes."""
_AROUND = (0.5, 0.7, 0.85, 1.2, 1.4, 2.0)
_BEGUN = 25.0
"""K, deviation of where a node begins that a slow sensor has not reached, and of what the sensor then reads."""
_PIECES = 2
"""Of the time before a window that means hold some of, and of that after it."""


def lags(view: View, seconds: Sequence[float] = _LAGS, only: str | None = None) -> Iterator[Wrong]:
    """A sensor follows its node with a lag that the scenario does not have."""

    def words(channel: str, lag: float) -> Words:
        return Words(
            f"{channel} follows its node with a lag of {minutes(lag)}",
            f"With a sensor that is so slow, {channel} agrees with the model.",
            f"Write 'observations: {{{channel}: {{lag: {lag:.0f} s}}}}', or check which sensor it is",
        )

    known = {name for name, observation in view.window.scenario.observations.items() if observation.lag is not None}
    chosen = [channel for channel in _chosen(view, only) if channel not in known]
    for size in seconds:
        for wrong in _slow(view, chosen, size, _share_of_lag, words, lags):
            assert wrong.memory is not None
            yield replace(wrong, columns=_begun(view, wrong.memory), tries=as_long(size) * wrong.tries)


def _chosen(view: View, only: str | None) -> list[str]:
    """Channels whose nodes' temperatures are known from minute to minute: not where a heater may be on at any time."""
    model = view.window.scenario
    silent = {model.network.heaters[name].node for name in view.unknown}
    return [name for name in view.channels if only in (None, name) and model.observations[name].node not in silent]


def _begun(view: View, memory: Memory) -> FloatArray:
    """[R, 2] K that a slow channel's first sample does not tell: where its node begins, and where the sensor does."""
    seen, place = replace(view, memory=memory), memory.channel
    # What is left of the beginning at each row is the weight of the window's first time.
    left = view.of_channel(place, memory.weights[:, :1])
    return _BEGUN * np.concatenate([seen.begun_of(place)[:, None], left], axis=1)


def means(
    view: View, seconds: Sequence[float] = _WIDTHS, only: str | None = None, shares: Sequence[float] = _BEFORE
) -> Iterator[Wrong]:
    """A channel has means over the time around each sample, or before it. shares: of that time, those before."""
    chosen = _chosen(view, only)
    for before, size in product(shares, seconds):

        def words(channel: str, width: float, before: float = before) -> Words:
            what = f"smoothed over {minutes(width)}" if before < 1.0 else f"the mean of the {minutes(width)} before"
            return Words(
                f"{channel} is {what}",
                f"{channel} agrees with means of the model over {minutes(width)}, and not with the model itself.",
                f"Take the samples of {channel} as they were sent",
            )

        for wrong in _slow(
            view, chosen, size, partial(_share_of_mean, before), words, partial(means, shares=(before,))
        ):
            assert wrong.memory is not None
            kind: Kind = "slow" if before < 1.0 else "earlier mean"
            yield replace(wrong, kind=kind, columns=_not_told(view, wrong.memory, size, before))


def _not_told(view: View, memory: Memory, width: float, before: float) -> FloatArray:
    """[R, k] K that the first mean does not tell: where its node begins, and what means hold of pieces of the time
    before the window, and after it. All are off by about what the node changes in half such a time.
    """
    channel = memory.channel
    first, last = view.seconds[[0, -1]]
    reach = width * np.linspace(0.0, 1.0, _PIECES + 1)
    edges = [first - before * reach[::-1]] + ([last + (1.0 - before) * reach] if before < 1.0 else [])
    shares = [np.diff(_share_of_mean(before, width, edge - view.rows.seconds[:, None]), axis=1) for edge in edges]
    known, later = view.modelled_of(channel), np.clip(view.rows.seconds + 0.5 * width, None, view.rows.seconds[-1])
    change = float(np.sqrt(np.mean((np.interp(later, view.rows.seconds, known) - known) ** 2)))
    begun = replace(view, memory=memory).begun_of(channel)[:, None]
    return change * np.concatenate([begun, view.of_channel(channel, np.concatenate(shares, axis=1))], axis=1)


def _slow(
    view: View,
    channels: Sequence[str],
    size: float,
    share: Callable[[float, FloatArray], FloatArray],
    words: Callable[[str, float], Words],
    again: Callable[[View, Sequence[float], str], Iterator[Wrong]],
) -> Iterator[Wrong]:
    """Each of the channels with such a time, s. again: looks at other times of a channel."""
    weights = _weights(view, partial(share, size))
    for channel in channels:
        memory = Memory(view.channels.index(channel), weights)
        near = partial(again, view, [size * more for more in _AROUND if size * more <= _LONGEST], channel)
        tries = len(_LAGS) * len(view.channels)
        yield Wrong("slow", channel, words(channel, size), memory=memory, tries=tries, closer=near)


def _share_of_lag(lag: float, later: FloatArray) -> FloatArray:
    """Of what a slow sensor reads, that from before so many s after a sample."""
    return np.asarray(np.exp(np.minimum(later, 0.0) / lag))


def _share_of_mean(before: float, width: float, later: FloatArray) -> FloatArray:
    """The same of a mean of which such a share is of the time before the sample."""
    return np.asarray(np.clip(later / width + before, 0.0, 1.0))


def _weights(view: View, share: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """[t, T] of what is read at each row, from times around each of the window's samples; the first and last go on."""
    seconds = view.seconds
    edges = np.concatenate([[-np.inf], 0.5 * (seconds[1:] + seconds[:-1]), [np.inf]])
    return np.diff(share(edges - view.rows.seconds[:, None]), axis=1)


WRONGS = (lags, means)
"""What looks for them."""
