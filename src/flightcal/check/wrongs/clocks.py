"""Time tags that are late or early: of all telemetry, of the status, of one channel."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import product

import numpy as np

from ...report import listed, number
from ...simulator import FloatArray
from ..view import REACH, ZONES, View
from .wrong import SHIFT, SHIFTS, Words, Wrong, closer, driven_otherwise, duration, status_channels

_ZONES = tuple(h for k in range(1, round(ZONES / 1800.0) + 1) for h in (-1800.0 * k, 1800.0 * k) if abs(h) > REACH)
"""s, between a time zone and UTC."""
_WHOLE_ORBITS = 4.0
"""Times less likely is a clock that is off by more than half an orbit: the same with an orbit less fits as well."""
_RATES = tuple(sign * share for share in (0.005, 0.01, 0.02, 0.04, 0.08) for sign in (-1.0, 1.0))
_FEW_SHIFTS = tuple(shift for m in (3, 5, 7, 10, 15, 20, 30, 40) for shift in (-60.0 * m, 60.0 * m))
_HOURS = (-7200.0, -3600.0, 3600.0, 7200.0)
"""s, by which a packet may be of another zone; of one channel so much explains what is slow."""


def clocks(view: View, seconds: Sequence[float] | FloatArray = SHIFTS) -> Iterator[Wrong]:
    """All time tags are late (positive) or early, by more than what lies between two samples of a driver."""
    least = view.apart(load.driver for load in view.window.scenario.network.loads.values())
    for late in map(float, seconds):
        if abs(late) < least:
            continue
        how = "late" if late > 0 else "early"
        words = Words(
            f"The telemetry's clock is {duration(late)} {how}",
            f"Moved {duration(late)} {'back' if late > 0 else 'on'}, the telemetry agrees with sunlight, eclipses and "
            "modes; whole orbits more or less may be as good.",
            f"Check the time column: its zone, its leap seconds, the epoch of the orbit; shift it by {-late:+.0f} s",
        )
        less = late - round(late / view.window.period) * view.window.period
        near = partial(clocks, view, np.union1d(closer(late, SHIFT), closer(less, SHIFT)))
        tries = len(SHIFTS) * (_WHOLE_ORBITS if abs(late) > 0.5 * view.window.period else 1.0)
        yield from driven_otherwise("clock", "time", words, view, tries=tries, closer=near, sunlight=late, modes=late)


def zones(view: View, seconds: Sequence[float] | FloatArray = _ZONES) -> Iterator[Wrong]:
    """All time tags are of another time zone, farther off than `clocks` looks."""
    for late in map(float, seconds):
        words = Words(
            f"The telemetry's clock is {abs(late) / 3600.0:g} h {'late' if late > 0 else 'early'}",
            f"Moved {abs(late) / 3600.0:g} h {'back' if late > 0 else 'on'}, as from another time zone, the telemetry "
            "agrees with sunlight, eclipses and modes.",
            f"Check the zone of the time column; shift it by {-late:+.0f} s",
        )
        yield from driven_otherwise("clock", "zone", words, view, tries=len(_ZONES), sunlight=late, modes=late)


def rates(view: View, shares: Sequence[float] | FloatArray = _RATES, late: float = 0.0) -> Iterator[Wrong]:
    """All time tags go too fast (positive) or too slowly, and are right, or `late` by some s, at the beginning."""
    for share in map(float, shares):
        how = "fast" if share > 0 else "slowly"
        words = Words(
            f"The telemetry's clock goes {number(abs(100.0 * share), 2)}% too {how}",
            f"With times {number(abs(share) * 3600.0, 3)} s an hour {'shorter' if share > 0 else 'longer'}, the "
            "telemetry agrees with sunlight, eclipses and modes.",
            "Check how the time column counts, and its unit",
        )
        yield from driven_otherwise(
            "clock", "rate", words, view, tries=len(_RATES), closer=partial(_about_rate, view, share),
            sunlight=late, modes=late, gaining=share,
        )  # fmt: skip


def _about_rate(view: View, share: float) -> Iterator[Wrong]:
    """Clocks that go about so fast, and were set right before or after the window's beginning."""
    for late in np.linspace(-600.0, 600.0, 11):
        yield from rates(view, share * np.array([0.6, 0.8, 1.0, 1.25, 1.6]), float(late))


def status_clocks(view: View, seconds: Sequence[float] | FloatArray = _FEW_SHIFTS) -> Iterator[Wrong]:
    """The heaters' status is late or early beside the temperatures, by more than what lies between two samples."""
    channels = status_channels(view)
    if not channels:
        return
    least = view.apart(channels.values())
    for late in map(float, seconds):
        if abs(late) < least:
            continue
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
    view: View, seconds: Sequence[float] | FloatArray = (*_FEW_SHIFTS, *_HOURS), only: str | None = None
) -> Iterator[Wrong]:
    """Time tags of a channel, or of a packet's, are late or early, by more than what lies between two samples."""
    groups = {channel: [k] for k, channel in enumerate(view.channels)}
    of_packets = [view.window.scenario.telemetry.channels[channel].packet for channel in view.channels]
    for packet in {own for own in of_packets if own and of_packets.count(own) > 1}:
        groups[f"packet {packet}"] = [k for k, other in enumerate(of_packets) if other == packet]
    tried = {name: own for name, own in groups.items() if only in (None, name) and len(own) < len(view.channels)}
    channels = {name: [view.channels[k] for k in own] for name, own in tried.items()}
    least = {name: view.apart(named) for name, named in channels.items()}
    readings = {late: view.readings(late) for late in map(float, seconds)}
    for (late, moved), (name, own) in product(readings.items(), tried.items()):
        if abs(late) < least[name] or (len(own) == 1 and abs(late) >= min(map(abs, _HOURS))):
            continue
        observed = view.observed.copy()
        observed[:, own] = moved[:, own]
        if np.isfinite(moved[:, own]).sum(0).min() < 0.7 * np.isfinite(moved).sum(0).max():
            continue
        words = Words(
            f"{name} is {duration(late)} {'late' if late > 0 else 'early'}",
            f"Moved by {duration(late)}, {name} alone, all channels agree with the model.",
            f"Check the time tags of {name}; or write 'time_offset: {-late:.0f} s' in 'observations' of each channel",
        )
        yield Wrong(
            "channel clock", " ".join(channels[name]), words, observed, tries=len(_FEW_SHIFTS) * len(groups),
            closer=partial(channel_clocks, view, closer(late, 240.0), name),
        )  # fmt: skip


WRONGS = (clocks, zones, rates, status_clocks, channel_clocks)
"""What looks for them."""
