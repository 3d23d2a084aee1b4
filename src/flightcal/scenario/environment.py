"""Orbit, attitude and what shines on the spacecraft: the blocks of `environment`."""

from __future__ import annotations

import math
import re
from datetime import datetime
from typing import Annotated, Any, Final, Literal, TypeGuard, cast, get_args

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from .document import Problem
from .fields import Block, FileName, Number, OneOf, Time, Vector, exactly_one, of_length
from .units import Angle, Duration, Quantity, did_you_mean, show
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
            problems.append(Problem((k,), message))
        elif line[68] != str(compute_checksum(line)):
            message = f"found the checksum {line[68]}, expected {compute_checksum(line)}: a character is wrong"
            problems.append(Problem((k,), message))
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


def _check_length(quaternion: tuple[float, ...]) -> tuple[float, ...]:
    if not any(quaternion):
        raise ValueError("found a quaternion of length 0, expected length 1 (w, x, y, z)")
    return quaternion


LocalTime = Annotated[str, AfterValidator(_check_local_time)]
TleLines = Annotated[tuple[str, ...], BeforeValidator(_in_pairs), AfterValidator(_check_elements)]
Quaternion = Annotated[
    tuple[Number, Number, Number, Number], of_length(4, "four numbers [w, x, y, z]"), AfterValidator(_check_length)
]


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
            raise refusal(Problem(("beta_angle",), message))
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
            raise refusal(Problem(("semi_major_axis",), message))
        return self


class TleOrbit(Block):
    """Two-line elements, propagated with SGP4."""

    tle: TleLines
    """First and second line, of one epoch or of several; each time is reached from the nearest one."""


class SampledOrbit(Block):
    """Positions from a CSV file: columns time (ISO 8601 UTC), x, y, z in metres, Earth-centred inertial."""

    positions: FileName


class InertialAttitude(Block):
    """Body axes fixed in inertial space: unit quaternion (w, x, y, z), from body to inertial vectors."""

    inertial: Quaternion


class SpinningAttitude(Block):
    """Spin about a body axis that points along an inertial direction."""

    spin_axis: Vector
    """In the body."""
    direction: Vector
    """Inertial direction that the spin axis points to."""
    period: Duration | None = None
    """null: fast spin; fluxes are averaged over one turn."""
    phase: Annotated[float, Quantity("rad")] = 0.0
    """Turned by at `epoch`, from where the shortest turn from `spin_axis` to `direction` leaves the body."""
    epoch: Time = datetime(2000, 1, 1, 12)


def spins_fast(attitude: object) -> TypeGuard[SpinningAttitude]:
    """Whether the body turns so fast that fluxes are means over a turn."""
    return isinstance(attitude, SpinningAttitude) and attitude.period is None


class SampledAttitude(Block):
    """Quaternions from a CSV file with a column time (ISO 8601 UTC) and one for each component."""

    quaternions: FileName
    columns: tuple[str, str, str, str] = ("w", "x", "y", "z")
    """What the file calls the real part and the other three."""
    turns: Literal["body_to_inertial", "inertial_to_body"] = "body_to_inertial"
    """Which vectors the quaternions turn into which."""


NamedAttitude = Literal["nadir", "sun_pointing"]


def _one_kind(value: Any) -> Any:
    if isinstance(value, str):
        return NamedAttitude
    if not isinstance(value, dict):
        return None
    if "inertial" in value:
        return InertialAttitude
    return SampledAttitude if "quaternions" in value else SpinningAttitude


_KINDS = "an attitude: nadir, sun_pointing, or a mapping with 'inertial', 'spin_axis'"
OneAttitude = Annotated[
    NamedAttitude | InertialAttitude | SpinningAttitude | SampledAttitude,
    OneOf(_one_kind, f"{_KINDS} or 'quaternions'"),
]


class AttitudeChange(Block):
    """From a time on the body is turned to another attitude."""

    at: Time
    attitude: Annotated[str | OneAttitude, OneOf(lambda value: str if isinstance(value, str) else OneAttitude, _KINDS)]
    """An attitude, or the name of one of those that the timeline names."""


class AttitudeTimeline(Block):
    """One attitude after another; before the first change the first one holds."""

    named: dict[str, OneAttitude] = Field(default_factory=dict)
    """Attitudes by the names that the timeline gives them."""
    timeline: tuple[AttitudeChange, ...] = ()
    timeline_file: FileName | None = None
    """CSV file with columns at (UTC) and attitude, in the place of `timeline`: a row for each change or sample."""
    slew: Annotated[float, Quantity("s", at_least=1.0)] = 120.0
    """How long each change takes, from its time on: a turn about one axis, at a constant rate."""

    @model_validator(mode="after")
    def _one_after_another(self) -> AttitudeTimeline:
        if not self.timeline and self.timeline_file is None:
            raise ValueError("found no change, expected at least one in 'timeline', or a 'timeline_file'")
        problems = []
        for k, change in enumerate(self.timeline):
            kind = self.attitude_of(change)
            place = ("timeline", k, "attitude")
            if kind is None:
                names = [*self.named, *get_args(NamedAttitude)]
                hint = did_you_mean(str(change.attitude), names)
                problems.append(
                    Problem(place, f"found {show(change.attitude)}, expected one of {', '.join(names)}{hint}")
                )
            elif spins_fast(kind):
                problems.append(Problem(place, "found a spin without period, expected one: the body slews from it"))
            before = self.timeline[k - 1].at if k else None
            if before is not None and (change.at - before).total_seconds() < self.slew:
                message = (
                    f"found {change.at.isoformat()}, expected a time after the slew of {self.slew:g} s that begins"
                )
                problems.append(Problem(("timeline", k, "at"), f"{message} at {before.isoformat()}"))
        if problems:
            raise refusal(*problems)
        return self

    def attitude_of(self, change: AttitudeChange) -> OneAttitude | None:
        """What the body is turned to; None: the name is not known."""
        if not isinstance(change.attitude, str):
            return change.attitude
        if change.attitude in self.named:
            return self.named[change.attitude]
        return cast("OneAttitude", change.attitude) if change.attitude in get_args(NamedAttitude) else None

    @property
    def attitudes(self) -> tuple[OneAttitude, ...]:
        """After each change."""
        found = [self.attitude_of(change) for change in self.timeline]
        return tuple(kind for kind in found if kind is not None)


def _orbit_kind(value: Any) -> type[Block] | None:
    if not isinstance(value, dict):
        return None
    if "tle" in value:
        return TleOrbit
    if "positions" in value:
        return SampledOrbit
    elements = {"semi_major_axis", "eccentricity", "argument_of_perigee", "mean_anomaly"}
    return KeplerianOrbit if elements & set(value) else CircularOrbit


def _attitude_kind(value: Any) -> Any:
    if isinstance(value, dict) and {"timeline", "timeline_file", "named", "slew"} & set(value):
        return AttitudeTimeline
    return _one_kind(value) and OneAttitude


Attitude = Annotated[
    NamedAttitude | InertialAttitude | SpinningAttitude | SampledAttitude | AttitudeTimeline,
    OneOf(_attitude_kind, f"{_KINDS}, 'quaternions' or 'timeline'"),
]
Orbit = Annotated[
    CircularOrbit | KeplerianOrbit | TleOrbit | SampledOrbit,
    OneOf(_orbit_kind, "an orbit: altitude and inclination, Keplerian elements, 'tle' or 'positions'"),
]


class AttitudeOffset(Block):
    """Small rotation of the body against its attitude, about its own axes; heat fluxes are taken as linear in it."""

    x: Annotated[float, Quantity("rad", at_least=-0.1, at_most=0.1)] = 0.0
    y: Annotated[float, Quantity("rad", at_least=-0.1, at_most=0.1)] = 0.0
    z: Annotated[float, Quantity("rad", at_least=-0.1, at_most=0.1)] = 0.0


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
