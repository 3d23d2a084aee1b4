"""Windows: one or several to train on, all others apart from them, of known length."""

from __future__ import annotations

import math
from collections.abc import Iterator
from datetime import datetime, timedelta
from pathlib import Path

from ..blocks import readable
from ..document import Issue
from ..environment import EARTH_RADIUS, CircularOrbit, Environment, KeplerianOrbit, TleOrbit
from ..reading import Reading
from ..units import did_you_mean
from ..windows import Window, is_trained

_EARTH_MU = 3.986004418e14  # m3/s2 (WGS 84)
_TOLERANCE = timedelta(minutes=1)
"""Of an end that follows from a number of orbits: the period here is that of two bodies, without J2."""


def check(reading: Reading, folder: Path) -> Iterator[Issue]:
    """`train` exists, no other window overlaps it, and orbits can be counted."""
    blocks = reading.blocks
    trained = [name for name in blocks.windows if is_trained(name)]
    if "windows" in reading.document.data and not trained:
        message = f"missing window 'train', expected the stretch to calibrate on{did_you_mean('train', blocks.windows)}"
        yield Issue(("windows",), message)
    for name in trained:
        if name in readable(blocks.windows) and readable(blocks.windows)[name].planned:
            yield Issue(("windows", name, "planned"), "found true, expected telemetry to train on: no plan")
    environment = blocks.environment
    if environment is None:
        return
    if not environment.comes_again:
        in_orbits = [name for name, window in readable(blocks.windows).items() if window.orbits is not None]
        for name in in_orbits:
            message = "found a length in orbits, expected 'orbit' or 'period' in environment to know how long one is"
            yield Issue(("windows", name, "orbits"), message)
        if not in_orbits and blocks.windows:
            message = (
                "found neither 'orbit' nor 'period': what the model lacks comes again with no orbit. Right of a probe; "
                "else write an orbit, or after how long temperatures come again, such as 'period: 95 min'"
            )
            yield Issue(("environment",), message, warning=True)
    yield from _check_overlap(readable(blocks.windows), environment)


def _check_overlap(windows: dict[str, Window], environment: Environment) -> Iterator[Issue]:
    spans = {name: _span(window, environment) for name, window in windows.items()}
    trained = {name: span for name, span in spans.items() if is_trained(name) and span is not None}
    seen: dict[str, tuple[datetime, datetime]] = {}
    for name, other in [*trained.items(), *((name, span) for name, span in spans.items() if name not in trained)]:
        for train, span in seen.items():
            if other is not None and other[0] < span[1] and span[0] < other[1]:
                until = f"{train!r} lasts from {span[0]:%Y-%m-%dT%H:%M} to {span[1]:%Y-%m-%dT%H:%M}"
                if orbits := windows[train].orbits:
                    until += f"; an orbit takes {(span[1] - span[0]).total_seconds() / orbits / 60.0:.0f} min"
                yield Issue(("windows", name), f"found an overlap with {train!r}, expected unseen telemetry: {until}")
        if name in trained:
            seen[name] = trained[name]


def _span(window: Window, environment: Environment) -> tuple[datetime, datetime] | None:
    """First and last time of the window; None where it is not known without propagating the orbit."""
    if window.end is not None:
        return window.start, window.end
    period = environment.period or _two_body_period(environment)
    if period is None or window.orbits is None:
        return None
    try:
        return window.start, max(window.start, window.start + timedelta(seconds=window.orbits * period) - _TOLERANCE)
    except OverflowError:
        return window.start, datetime.max


def _two_body_period(environment: Environment) -> float | None:
    orbit = environment.orbit
    if isinstance(orbit, TleOrbit):
        period = 86400.0 / float(orbit.tle[1][52:63])  # the schema has seen that it is a number
        return period if math.isfinite(period) else None
    if isinstance(orbit, CircularOrbit):
        semi_major_axis = EARTH_RADIUS + orbit.altitude
    elif isinstance(orbit, KeplerianOrbit):
        semi_major_axis = orbit.semi_major_axis
    else:
        return None
    return 2 * math.pi * math.sqrt(semi_major_axis**3 / _EARTH_MU)
