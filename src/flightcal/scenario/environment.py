"""Orbit, attitude and what shines on the spacecraft: the blocks of `environment`."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from .fields import Block, FileName, Number, OneOf, Quaternion, Time, TleLines, Vector
from .units import Angle, Duration, Quantity


class CircularOrbit(Block):
    """Circular orbit by altitude, inclination, and local time or right ascension of the ascending node."""

    altitude: Annotated[float, Quantity("m", above=100e3, at_most=1e9)]
    inclination: Angle
    ltan: str | None = None
    """Local time of the ascending node, ``"HH:MM"``."""
    raan: Angle | None = None
    argument_of_latitude: Angle = 0.0
    """Angle from the ascending node at `epoch`."""
    epoch: Time


class KeplerianOrbit(Block):
    """Keplerian elements at an epoch, true equator of date; J2 moves node and perigee."""

    semi_major_axis: Annotated[float, Quantity("m", above=6.4e6, at_most=1e9)]
    eccentricity: Annotated[Number, Field(ge=0, lt=1)]
    inclination: Angle
    raan: Angle
    argument_of_perigee: Angle
    mean_anomaly: Angle
    epoch: Time


class TleOrbit(Block):
    """Two-line elements, propagated with SGP4."""

    tle: TleLines


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


class SampledAttitude(Block):
    """Quaternions from a CSV file with columns time, w, x, y, z (body to inertial)."""

    quaternions: FileName


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
    if isinstance(value, str):
        return _NamedAttitude
    if not isinstance(value, dict):
        return None
    if "inertial" in value:
        return InertialAttitude
    return SampledAttitude if "quaternions" in value else SpinningAttitude


_NamedAttitude = Literal["nadir", "sun_pointing"]
Orbit = Annotated[
    CircularOrbit | KeplerianOrbit | TleOrbit | SampledOrbit,
    OneOf(_orbit_kind, "an orbit: altitude and inclination, Keplerian elements, 'tle' or 'positions'"),
]
Attitude = Annotated[
    _NamedAttitude | InertialAttitude | SpinningAttitude | SampledAttitude,
    OneOf(
        _attitude_kind,
        "an attitude: nadir, sun_pointing, or a mapping with 'inertial', 'spin_axis' or 'quaternions'",
    ),
]


class AttitudeOffset(Block):
    """Small rotation of the body against its attitude, about its own axes; heat fluxes are taken as linear in it."""

    x: Annotated[float, Quantity("rad", at_least=-0.1, at_most=0.1)] = 0.0
    y: Annotated[float, Quantity("rad", at_least=-0.1, at_most=0.1)] = 0.0
    z: Annotated[float, Quantity("rad", at_least=-0.1, at_most=0.1)] = 0.0


class Environment(Block):
    """Orbit and attitude, from which heat fluxes follow; or only a period, where drivers replace the Sun."""

    orbit: Orbit | None = None
    period: Duration | None = None
    """Orbital period for windows and orbit phase; null: from the orbit."""
    attitude: Attitude = "nadir"
    attitude_offset: AttitudeOffset | None = None
    """null: none; where it is written, a parameter may set it."""
    albedo: Annotated[float, Quantity("", at_least=0, at_most=1)] = 0.3
    earth_infrared: Annotated[float, Quantity("W/m^2", at_least=0)] = 237.0
    solar_constant: Annotated[float, Quantity("W/m^2", at_least=0)] = 1361.0
    """At one astronomical unit (Kopp & Lean 2011: 1360.8 W/m2)."""
