"""Orbit and attitude: what they need of the rest of the scenario, and their files."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

from ..document import Problem
from ..environment import CircularOrbit, InertialAttitude, KeplerianOrbit, SampledAttitude, SampledOrbit
from ..reading import Reading
from .common import file_exists

_UNIT_LENGTH_TOLERANCE = 1e-3


def check(reading: Reading, folder: Path) -> Iterator[Problem]:
    """Files of samples are there, numbers are as they are meant; a reduced order model has no attitude offset."""
    environment = reading.blocks.environment
    if environment is None:
        return
    orbit, attitude = environment.orbit, environment.attitude
    if environment.attitude_offset is not None and reading.blocks.reduced is not None:
        message = "found an attitude offset, expected none: a reduced order model knows its faces' directions only"
        yield Problem(("environment", "attitude_offset"), message)
    if isinstance(orbit, (CircularOrbit, KeplerianOrbit)) and not 0 <= orbit.inclination <= math.pi:
        found = f"{math.degrees(orbit.inclination):g} deg"
        yield Problem(("environment", "orbit", "inclination"), f"found {found}, expected 0 deg to 180 deg")
    if isinstance(attitude, InertialAttitude):
        length = math.hypot(*attitude.inertial)
        if abs(length - 1) > _UNIT_LENGTH_TOLERANCE:
            message = f"found a quaternion of length {length:.4g}, expected length 1 (w, x, y, z)"
            yield Problem(("environment", "attitude", "inertial"), message)
    if isinstance(orbit, SampledOrbit):
        yield from file_exists(folder, orbit.positions, "a path", ("environment", "orbit", "positions"))
    if isinstance(attitude, SampledAttitude):
        yield from file_exists(folder, attitude.quaternions, "a path", ("environment", "attitude", "quaternions"))
