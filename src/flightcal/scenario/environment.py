"""Orbit, attitude and what shines on the spacecraft: the blocks of `environment`."""

from __future__ import annotations

import math
import re
from typing import Annotated, Any, Final

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from .attitude import Attitude, AttitudeOffset
from .document import Issue
from .fields import Block, FileName, Number, OneOf, Time, exactly_one
from .units import Angle, Duration, Quantity, show
from .wording import refusal

EARTH_RADIUS = 6378.137e3
"""m, equatorial (WGS 84)."""
_LOCAL_TIME = re.compile(r"([01]\d|2[0-3]):[0-5]\d")


def _check_local_time(text: str) -> str:
    if not _LOCAL_TIME.fullmatch(text):
        raise ValueError(f"found {show(text)}, expected a local time HH:MM such as 18:00")
    return text


def _check_elements(lines: tuple[str, ...]) -> tuple[str, ...]:
    from sgp4.earth_gravity import wgs72
    from sgp4.io import compute_checksum, twoline2rv

    lines = tuple(line.strip() for line in lines)
    problems = []
    for k, line in enumerate(lines):
        wanted = f"{k % 2 + 1} "
        if not line.startswith(wanted) or len(line) != 69 or not line.isascii():
            message = f"found {len(line)} characters, {show(line[:20])}..., expected 69 that begin with '{wanted}'"
            problems.append(Issue((k,), message))
        elif line[68] != str(compute_checksum(line)):
            message = f"found the checksum {line[68]}, expected {compute_checksum(line)}: a character is wrong"
            problems.append(Issue((k,), message))
    if problems:
        raise refusal(*problems)
    for first, second in zip(lines[::2], lines[1::2], strict=True):
        try:
            twoline2rv(first, second, wgs72)
        except (ValueError, ArithmeticError) as error:
            raise ValueError(f"found lines that are not two-line elements: {str(error).splitlines()[0]}") from None
    return lines


def _in_pairs(value: Any) -> Any:
    if not isinstance(value, (list, tuple)) or not value or len(value) % 2:
        raise ValueError(f"found {show(value)}, expected the two lines of a TLE [first, second], or several such pairs")
    return value


LocalTime = Annotated[str, AfterValidator(_check_local_time)]
TleLines = Annotated[tuple[str, ...], BeforeValidator(_in_pairs), AfterValidator(_check_elements)]


class CircularOrbit(Block):
    """Circular orbit by altitude, inclination, and the ascending node: local time, right ascension or beta angle."""

    altitude: Annotated[float, Quantity("m", above=100e3, at_most=1e9)]
    inclination: Angle
    ltan: LocalTime | None = None
    """Local time of the ascending node, ``"HH:MM"``."""
    raan: Angle | None = None
    beta_angle: Angle | None = None
    """Of the Sun above the orbit's plane at `epoch`, on the side of its momentum. Of the two nodes that have it, that
    on the day side is meant (local time from 6 to 18 h)."""
    argument_of_latitude: Angle = 0.0
    """Angle from the ascending node at `epoch`."""
    epoch: Time

    @model_validator(mode="after")
    def _one_node(self) -> CircularOrbit:
        if self.beta_angle is not None and abs(self.beta_angle) > 0.5 * math.pi:
            message = f"found {math.degrees(self.beta_angle):g} deg, expected -90 to 90 deg"
            raise refusal(Issue(("beta_angle",), message))
        wanted = "exactly one of 'ltan' (local time), 'raan' (right ascension) and 'beta_angle'"
        return exactly_one(self, ("ltan", "raan", "beta_angle"), wanted)


class KeplerianOrbit(Block):
    """Keplerian elements at an epoch, true equator of date; J2 moves node, perigee and mean anomaly."""

    semi_major_axis: Annotated[float, Quantity("m", above=6.4e6, at_most=1e9)]
    eccentricity: Annotated[Number, Field(ge=0, lt=1)]
    inclination: Angle
    raan: Angle
    argument_of_perigee: Angle
    mean_anomaly: Angle
    epoch: Time

    @model_validator(mode="after")
    def _above_ground(self) -> KeplerianOrbit:
        perigee = self.semi_major_axis * (1 - self.eccentricity) - EARTH_RADIUS
        if perigee <= 0:
            message = f"found a perigee {-perigee / 1e3:.0f} km below the Earth's surface, expected one above it"
            raise refusal(Issue(("semi_major_axis",), message))
        return self


class TleOrbit(Block):
    """Two-line elements, propagated with SGP4."""

    tle: TleLines
    """First and second line, of one epoch or of several; each time is reached from the nearest one."""


class SampledOrbit(Block):
    """Positions from a CSV file: columns time (ISO 8601 UTC), x, y, z in metres, Earth-centred inertial."""

    positions: FileName


def _orbit_kind(value: Any) -> type[Block] | None:
    if not isinstance(value, dict):
        return None
    if "tle" in value:
        return TleOrbit
    if "positions" in value:
        return SampledOrbit
    elements = {"semi_major_axis", "eccentricity", "argument_of_perigee", "mean_anomaly"}
    return KeplerianOrbit if elements & set(value) else CircularOrbit


Orbit = Annotated[
    CircularOrbit | KeplerianOrbit | TleOrbit | SampledOrbit,
    OneOf(_orbit_kind, "an orbit: altitude and inclination, Keplerian elements, 'tle' or 'positions'"),
]


OF_EARTH_AND_SUN = {
    "albedo": (0.05, 0.9),
    "earth_infrared": (100.0, 400.0),
    "solar_constant": (1300.0, 1420.0),
}
"""Fields of the environment -> between what the Earth and the Sun have, SI; zero leaves it out."""


EARTH_RADII: Final = (6.3e6, 6.5e6)
"""m, between which the radius of what casts the shadow is."""


class Earth(Block):
    """The Earth's figure, as it casts its shadow and is seen; orbits have their own."""

    radius: Annotated[float, Quantity("m", above=1e6, at_most=1e8)] = EARTH_RADIUS
    """At the equator."""
    flattening: Annotated[Number, Field(ge=0, lt=0.5)] = 0.0
    """By how much the radius at the poles is smaller, as a share; of the shadow alone. WGS 84: 1 / 298.257."""


class Eclipse(Block):
    """The shadow as it was flown, in the place of the one that is computed."""

    measured_by: str
    """Status channel that is on in the shadow. Where it has no samples, the shadow is computed."""


class Environment(Block):
    """Orbit and attitude, from which heat fluxes follow; or only a period, where drivers replace the Sun."""

    orbit: Orbit | None = None
    period: Duration | None = None
    """Orbital period for windows and orbit phase; null: from the orbit."""
    attitude: Attitude = "nadir"
    eclipse: Eclipse | None = None
    """null: the shadow follows from the orbit."""
    earth: Earth = Earth()
    attitude_offset: AttitudeOffset | None = None
    """null: none; where it is written, a parameter may set it."""
    albedo: Annotated[float, Quantity("", at_least=0, at_most=1)] = 0.3
    earth_infrared: Annotated[float, Quantity("W/m^2", at_least=0, believable=1e4)] = 237.0
    solar_constant: Annotated[float, Quantity("W/m^2", at_least=0, believable=1e5)] = 1361.0
    """At one astronomical unit (Kopp & Lean 2011: 1360.8 W/m2)."""

    @property
    def comes_again(self) -> bool:
        """Whether an orbit or a period says after how long everything comes again; of a probe nothing does."""
        return self.orbit is not None or self.period is not None
