"""Orbit and attitude: elements, directions and files that can be used."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path

from ..document import Location, Problem
from ..environment import (
    CircularOrbit,
    InertialAttitude,
    KeplerianOrbit,
    SampledAttitude,
    SampledOrbit,
    SpinningAttitude,
    TleOrbit,
)
from ..reading import Reading
from ..units import show
from .common import file_exists

EARTH_RADIUS = 6378.137e3  # m, equatorial (WGS 84)
_LOCAL_TIME = re.compile(r"([01]\d|2[0-3]):[0-5]\d")
_UNIT_LENGTH_TOLERANCE = 1e-3
_ORBIT: Location = ("environment", "orbit")
_ATTITUDE: Location = ("environment", "attitude")


def check(reading: Reading, folder: Path) -> Iterator[Problem]:
    """Orbit and attitude describe one that exists."""
    environment = reading.blocks.environment
    if environment is None:
        return
    orbit, attitude = environment.orbit, environment.attitude
    if environment.attitude_offset is not None and reading.blocks.reduced is not None:
        message = "found an attitude offset, expected none: a reduced order model knows its faces' directions only"
        yield Problem(("environment", "attitude_offset"), message)
    if isinstance(orbit, CircularOrbit):
        yield from _check_circular(orbit)
    if isinstance(orbit, (CircularOrbit, KeplerianOrbit)) and not 0 <= orbit.inclination <= math.pi:
        found = f"{math.degrees(orbit.inclination):g} deg"
        yield Problem((*_ORBIT, "inclination"), f"found {found}, expected 0 deg to 180 deg")
    if isinstance(orbit, KeplerianOrbit):
        perigee = orbit.semi_major_axis * (1 - orbit.eccentricity) - EARTH_RADIUS
        if perigee <= 0:
            message = f"found a perigee {-perigee / 1e3:.0f} km below the Earth's surface, expected one above it"
            yield Problem((*_ORBIT, "semi_major_axis"), message)
    if isinstance(orbit, TleOrbit):
        yield from _check_tle(orbit)
    if isinstance(orbit, SampledOrbit):
        yield from file_exists(folder, orbit.positions, "a path", (*_ORBIT, "positions"))
    if isinstance(attitude, SampledAttitude):
        yield from file_exists(folder, attitude.quaternions, "a path", (*_ATTITUDE, "quaternions"))
    if isinstance(attitude, InertialAttitude):
        length = math.hypot(*attitude.inertial)
        if abs(length - 1) > _UNIT_LENGTH_TOLERANCE:
            message = f"found a quaternion of length {length:.4g}, expected length 1 (w, x, y, z)"
            yield Problem((*_ATTITUDE, "inertial"), message)
    if isinstance(attitude, SpinningAttitude):
        for name in ("spin_axis", "direction"):
            if not any(getattr(attitude, name)):
                yield Problem((*_ATTITUDE, name), "found a vector of length zero, expected a direction")


def _check_circular(orbit: CircularOrbit) -> Iterator[Problem]:
    if (orbit.ltan is None) == (orbit.raan is None):
        found = "neither" if orbit.ltan is None else "both"
        message = f"found {found}, expected exactly one of 'ltan' (local time) and 'raan' (right ascension)"
        yield Problem(_ORBIT, message)
    if orbit.ltan is not None and not _LOCAL_TIME.fullmatch(orbit.ltan):
        yield Problem((*_ORBIT, "ltan"), f"found {show(orbit.ltan)}, expected a local time HH:MM such as 18:00")


def _check_tle(orbit: TleOrbit) -> Iterator[Problem]:
    from sgp4.earth_gravity import wgs72
    from sgp4.io import compute_checksum, twoline2rv

    location = (*_ORBIT, "tle")
    lines = [line.strip() for line in orbit.tle]
    problems = []
    for k, line in enumerate(lines):
        if not line.startswith(f"{k + 1} ") or len(line) != 69 or not line.isascii():
            message = f"found {len(line)} characters, {show(line[:20])}..., expected 69 that begin with '{k + 1} '"
            problems.append(Problem((*location, k), message))
        elif line[68] != str(compute_checksum(line)):
            message = f"found the checksum {line[68]}, expected {compute_checksum(line)}: a character is wrong"
            problems.append(Problem((*location, k), message))
    if not problems:
        try:
            twoline2rv(*lines, wgs72)
        except (ValueError, ArithmeticError) as error:
            reason = str(error).splitlines()[0]
            problems.append(Problem(location, f"found lines that are not two-line elements: {reason}"))
    yield from problems
