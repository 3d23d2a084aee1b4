"""Time tags that are late or early: of all telemetry, of the status, of one channel."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from ...report import listed
from ...simulator import FloatArray
from ..evidence import View
from .wrong import SHIFT, SHIFTS, Words, Wrong, driven_otherwise, duration, status_channels

_FEW_SHIFTS = tuple(shift for m in (3, 5, 7, 10, 15, 20, 30, 40) for shift in (-60.0 * m, 60.0 * m))


def closer(shift: float, apart: float) -> FloatArray:
    """s, around a shift that is about right."""
    return shift + np.linspace(-1.0, 1.0, 13) * apart


def clocks(view: View, seconds: Sequence[float] | FloatArray = SHIFTS) -> Iterator[Wrong]:
    """All time tags are late (positive) or early."""
    for late in map(float, seconds):
        how = "late" if late > 0 else "early"
        words = Words(
            f"The telemetry's clock is {duration(late)} {how}",
            f"Moved {duration(late)} {'back' if late > 0 else 'on'}, the telemetry agrees with sunlight, eclipses and "
            "modes; whole orbits more or less may be as good.",
            f"Check the time column: its zone, its leap seconds, the epoch of the orbit; shift it by {-late:+.0f} s",
        )
        near = partial(clocks, view, closer(late, SHIFT))
        yield from driven_otherwise(
            "clock", "time", words, view, tries=len(SHIFTS), closer=near, sunlight=late, modes=late
        )


def status_clocks(view: View, seconds: Sequence[float] | FloatArray = _FEW_SHIFTS) -> Iterator[Wrong]:
    """The heaters' status is late or early beside the temperatures."""
    channels = status_channels(view)
    if not channels:
        return
    for late in map(float, seconds):
        data = view.telemetry.assign({name: ("time", _shifted(view, name, late)) for name in channels.values()})
        how = "late" if late > 0 else "early"
        words = Words(
            f"The heaters' status is {duration(late)} {how} beside the temperatures",
            f"Temperatures rise {duration(late)} {'before' if late > 0 else 'after'} the status says that a heater is "
            "on.",
            f"Check the time tags of {listed(list(channels.values()))}",
        )
        near = partial(status_clocks, view, closer(late, 240.0))
        yield from driven_otherwise(
            "status clock", "status", words, view, tries=len(_FEW_SHIFTS), closer=near, telemetry=data
        )


def _shifted(view: View, channel: str, late: float) -> FloatArray:
    """A status [T] as it is so much later."""
    times = view.telemetry["time"].to_numpy()
    values = view.telemetry[channel].to_numpy()
    valid = np.isfinite(values)
    if not valid.any():
        return np.asarray(values)
    at = times + np.timedelta64(round(1e3 * late), "ms")
    place = np.clip(np.searchsorted(times[valid], at, side="right") - 1, 0, valid.sum() - 1)
    return np.asarray(values[valid][place])


def channel_clocks(
    view: View, seconds: Sequence[float] | FloatArray = _FEW_SHIFTS, only: str | None = None
) -> Iterator[Wrong]:
    """One channel's time tags are late or early."""
    for late in map(float, seconds):
        moved = view.readings(late)
        for k, channel in enumerate(view.channels):
            if only not in (None, channel):
                continue
            observed = view.observed.copy()
            observed[:, k] = moved[:, k]
            if len(view.channels) == 1 or np.isfinite(observed[:, k]).sum() < 0.7 * np.isfinite(moved).sum(0).max():
                continue
            how = "late" if late > 0 else "early"
            words = Words(
                f"{channel} is {duration(late)} {how}",
                f"Moved by {duration(late)}, {channel} alone, all channels agree with the model.",
                f"Check the time tags of {channel}; or write 'observations: {{{channel}: {{time_offset: {-late:.0f} "
                "s}}'",
            )
            yield Wrong(
                "channel clock", channel, words, observed, tries=len(_FEW_SHIFTS) * len(view.channels),
                closer=partial(channel_clocks, view, closer(late, 240.0), channel),
            )  # fmt: skip


WRONGS = (clocks, status_clocks, channel_clocks)
"""What looks for them."""
