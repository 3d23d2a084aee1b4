"""Channels that read the temperature of a while, not of a moment: slow sensors, and means of many samples."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ...simulator import FloatArray
from ..view import Memory, View
from .wrong import Words, Wrong, duration

_LAGS = (300.0, 900.0, 2700.0)
"""s"""
_WIDTHS = (600.0, 1200.0, 2400.0)
"""s"""
_AROUND = (0.5, 0.7, 0.85, 1.2, 1.4, 2.0)
_BEGUN = 25.0
"""K, deviation of where a node begins that a slow sensor has not reached, and of what the sensor then reads."""


def lags(view: View, seconds: Sequence[float] = _LAGS, only: str | None = None) -> Iterator[Wrong]:
    """A sensor follows its node with a lag that the scenario does not have."""

    def words(channel: str, lag: float) -> Words:
        return Words(
            f"{channel} follows its node with a lag of {duration(lag)}",
            f"With a sensor that is so slow, {channel} agrees with the model.",
            f"Write 'observations: {{{channel}: {{lag: {lag:.0f} s}}}}', or check which sensor it is",
        )

    known = {name for name, own in view.window.scenario.observations.items() if own.lag is not None}
    chosen = [channel for channel in view.channels if channel not in known and only in (None, channel)]
    for wrong in _slow(view, chosen, seconds, _share_of_lag, words, lags):
        assert wrong.memory is not None
        yield replace(wrong, columns=_begun(view, wrong.memory))


def _begun(view: View, memory: Memory) -> FloatArray:
    """[R, 2] K that a slow channel's first sample does not tell: where its node begins, and where the sensor does."""
    seen, place = replace(view, memory=memory), memory.channel
    # What is left of the beginning at each row is the weight of the window's first time.
    left = view.of_channel(place, memory.weights[:, :1])
    return _BEGUN * np.concatenate([seen.begun_of(place)[:, None], left], axis=1)


def means(view: View, seconds: Sequence[float] = _WIDTHS, only: str | None = None) -> Iterator[Wrong]:
    """A channel has means over the time before and after each sample."""

    def words(channel: str, width: float) -> Words:
        return Words(
            f"{channel} is smoothed over {duration(width)}",
            f"{channel} agrees with means of the model over {duration(width)}, and not with the model itself.",
            f"Take the samples of {channel} as they were sent",
        )

    chosen = [channel for channel in view.channels if only in (None, channel)]
    yield from _slow(view, chosen, seconds, _share_of_mean, words, means)


def _slow(
    view: View,
    channels: Sequence[str],
    seconds: Sequence[float],
    share: Callable[[float, FloatArray], FloatArray],
    words: Callable[[str, float], Words],
    again: Callable[[View, Sequence[float], str], Iterator[Wrong]],
) -> Iterator[Wrong]:
    """Each of the channels with each of the times. again: looks at other times of a channel."""
    for size in seconds:
        weights = _weights(view, partial(share, size))
        for channel in channels:
            memory = Memory(view.channels.index(channel), weights)
            near = partial(again, view, [size * more for more in _AROUND], channel)
            tries = len(_LAGS) * len(view.channels)
            yield Wrong("slow", channel, words(channel, size), memory=memory, tries=tries, closer=near)


def _share_of_lag(lag: float, later: FloatArray) -> FloatArray:
    """Of what a slow sensor reads, that from before so many s after a sample."""
    return np.asarray(np.exp(np.minimum(later, 0.0) / lag))


def _share_of_mean(width: float, later: FloatArray) -> FloatArray:
    """The same of a mean around the sample."""
    return np.asarray(np.clip(later / width + 0.5, 0.0, 1.0))


def _weights(view: View, share: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """[t, T] of what is read at each row, from times around each of the window's samples; the first and last go on."""
    seconds = (view.window.times - view.window.times[view.rows.kept[0]]) / np.timedelta64(1, "s")
    edges = np.concatenate([[-np.inf], 0.5 * (seconds[1:] + seconds[:-1]), [np.inf]])
    return np.diff(share(edges - view.rows.seconds[:, None]), axis=1)


WRONGS = (lags, means)
"""What looks for them."""
