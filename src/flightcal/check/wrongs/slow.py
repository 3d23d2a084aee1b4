"""Channels that read the temperature of a while, not of a moment: slow sensors, and means of many samples."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
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


def lags(view: View, seconds: Sequence[float] = _LAGS, only: str | None = None) -> Iterator[Wrong]:
    """A sensor follows its node with a lag that the scenario does not have."""
    for lag in seconds:
        share = partial(_share_of_lag, lag)
        for k, channel in enumerate(view.channels):
            if only not in (None, channel) or view.window.scenario.observations[channel].lag is not None:
                continue
            words = Words(
                f"{channel} follows its node with a lag of {duration(lag)}",
                f"With a sensor that is so slow, {channel} agrees with the model.",
                f"Write 'observations: {{{channel}: {{lag: {lag:.0f} s}}}}', or check which sensor it is",
            )
            near = partial(lags, view, [lag * more for more in _AROUND], channel)
            memory = Memory(k, _weights(view, share))
            tries = len(_LAGS) * len(view.channels)
            yield Wrong("slow", channel, words, memory=memory, tries=tries, closer=near)


def means(view: View, seconds: Sequence[float] = _WIDTHS, only: str | None = None) -> Iterator[Wrong]:
    """A channel has means over the time before and after each sample."""
    for width in seconds:
        share = partial(_share_of_mean, width)
        for k, channel in enumerate(view.channels):
            if only not in (None, channel):
                continue
            words = Words(
                f"{channel} is smoothed over {duration(width)}",
                f"{channel} agrees with means of the model over {duration(width)}, and not with the model itself.",
                f"Take the samples of {channel} as they were sent",
            )
            near = partial(means, view, [width * more for more in _AROUND], channel)
            memory = Memory(k, _weights(view, share))
            tries = len(_WIDTHS) * len(view.channels)
            yield Wrong("slow", channel, words, memory=memory, tries=tries, closer=near)


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
