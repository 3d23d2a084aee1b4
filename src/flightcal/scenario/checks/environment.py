"""Orbit and attitude: what they need of the rest of the scenario, and their files."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

from ..attitude import AttitudeTimeline, InertialAttitude, OneAttitude, SampledAttitude, spins_fast
from ..blocks import readable
from ..document import Issue, Location
from ..environment import (
    EARTH_RADII,
    OF_EARTH_AND_SUN,
    CircularOrbit,
    Environment,
    KeplerianOrbit,
    SampledOrbit,
)
from ..network import SunTracking
from ..reading import Reading
from .common import channel_of_kind, file_exists

_UNIT_LENGTH_TOLERANCE = 1e-3
_FRESH = 30.0
"""Days, after which drag has moved a low satellite by a good part of its orbit."""


def check(reading: Reading, folder: Path) -> Iterator[Issue]:
    """Files of samples are there, numbers are as they are meant; a reduced order model has no attitude offset."""
    environment = reading.blocks.environment
    if environment is None:
        return
    yield from _orbit(environment, reading, folder)
    yield from _earth_and_sun(environment)
    yield from _attitudes(environment, reading, folder)
    if environment.eclipse is not None:
        place = ("environment", "eclipse", "measured_by")
        yield from channel_of_kind(reading.blocks, environment.eclipse.measured_by, "status", place)
        if environment.orbit is None:
            yield Issue(place, "found a measured eclipse without an 'orbit', expected one: sunlight follows from it")


def _orbit(environment: Environment, reading: Reading, folder: Path) -> Iterator[Issue]:
    orbit, here = environment.orbit, ("environment", "orbit")
    if isinstance(orbit, SampledOrbit):
        yield from file_exists(folder, orbit.positions, "a path", (*here, "positions"))
    if not isinstance(orbit, (CircularOrbit, KeplerianOrbit)):
        return
    if not 0 <= orbit.inclination <= math.pi:
        found = f"{math.degrees(orbit.inclination):g} deg"
        yield Issue((*here, "inclination"), f"found {found}, expected 0 deg to 180 deg")
    starts = [window.start for window in readable(reading.blocks.windows).values()]
    days = max((abs((start - orbit.epoch).total_seconds()) / 86400.0 for start in starts), default=0.0)
    if days > _FRESH:
        message = f"found elements that are {days:.0f} days from a window, expected at most {_FRESH:.0f}: orbits change"
        yield Issue((*here, "epoch"), message, warning=True)


def _earth_and_sun(environment: Environment) -> Iterator[Issue]:
    for field, (low, high) in OF_EARTH_AND_SUN.items():
        value = float(getattr(environment, field))
        if value and not low <= value <= high:
            message = f"found {value:g} (SI), expected {low:g} to {high:g}, as the Earth and the Sun have it"
            yield Issue(("environment", field), message, warning=True)
    low, high = EARTH_RADII
    if not low <= environment.earth.radius <= high:
        found = f"found {environment.earth.radius / 1e3:g} km, expected {low / 1e3:g} to {high / 1e3:g} km"
        yield Issue(("environment", "earth", "radius"), f"{found}, as the Earth has it with its air", warning=True)


def _attitudes(environment: Environment, reading: Reading, folder: Path) -> Iterator[Issue]:
    if environment.attitude_offset is not None and reading.blocks.reduced is not None:
        message = "found an attitude offset, expected none: a reduced order model knows its faces' directions only"
        yield Issue(("environment", "attitude_offset"), message)
    attitude = environment.attitude
    if spins_fast(attitude):
        for name, face in readable(reading.blocks.faces).items():
            if isinstance(face.normal, SunTracking):
                message = (
                    "found a face that tracks the Sun, expected none: the body spins so fast that only means count"
                )
                yield Issue(("simulator", "faces", name, "normal"), message)
    here: Location = ("environment", "attitude")
    if not isinstance(attitude, AttitudeTimeline):
        yield from _one_attitude(attitude, folder, here)
        return
    for name, kind in attitude.named.items():
        yield from _one_attitude(kind, folder, (*here, "named", name))
    for k, change in enumerate(attitude.timeline):
        if not isinstance(change.attitude, str):
            yield from _one_attitude(change.attitude, folder, (*here, "timeline", k, "attitude"))


def _one_attitude(attitude: OneAttitude, folder: Path, here: Location) -> Iterator[Issue]:
    if isinstance(attitude, InertialAttitude):
        length = math.hypot(*attitude.inertial)
        if abs(length - 1) > _UNIT_LENGTH_TOLERANCE:
            message = f"found a quaternion of length {length:.4g}, expected length 1 (w, x, y, z)"
            yield Issue((*here, "inertial"), message)
    if isinstance(attitude, SampledAttitude):
        yield from file_exists(folder, attitude.quaternions, "a path", (*here, "quaternions"))
