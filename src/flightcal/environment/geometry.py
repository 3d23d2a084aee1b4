"""Where the spacecraft and the Sun are: the one place where an environment becomes vectors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import OrbitError
from ..scenario import Environment
from . import sun
from ._time import Floats, Times, seconds_since
from .orbit import angle_from, eccentricity_vector, orbital_period, propagator

_ECCENTRIC = 0.2
"""Eccentricity, from which on the height makes an orbit's course, and not the Sun."""


@dataclass(frozen=True)
class Geometry:
    """Spacecraft and Sun at times [T], Earth-centred, true equator and equinox of date."""

    times: Times
    position: Floats
    """Spacecraft, [T, 3] m."""
    velocity: Floats
    """Spacecraft, [T, 3] m/s."""
    sun: Floats
    """Sun, [T, 3] m."""

    def some(self, which: NDArray[np.intp]) -> Geometry:
        """At some of the times."""
        return Geometry(self.times[which], self.position[which], self.velocity[which], self.sun[which])

    @property
    def to_sun(self) -> Floats:
        """Vector from the spacecraft to the Sun, [T, 3] m."""
        return self.sun - self.position


def geometry_of(environment: Environment, folder: Path = Path()) -> Callable[[Times], Geometry]:
    """The function that gives the geometry at times [T]; OrbitError where the environment has no orbit."""
    if environment.orbit is None:
        raise OrbitError("environment: found no 'orbit', expected one: eclipses and heat fluxes follow from it")
    propagate = propagator(environment.orbit, folder)

    def geometry(times: Times) -> Geometry:
        if np.isnat(times).any():
            raise OrbitError("environment: found a missing time (NaT), expected UTC times")
        position, velocity = propagate(times)
        return Geometry(times, position, velocity, sun.sun_position(times))

    return geometry


def orbit_phase(
    environment: Environment, times: Times, folder: Path = Path(), origin: np.datetime64 | None = None
) -> Floats:
    """Place in the orbit at times, [T] in [0, 1).

    With an orbit: angle / 2 pi from where it is nearest to the Sun, so that eclipses of all seasons are around 0.5.
    Where the Sun stands above the plane (beta angle near 90 deg) that place turns quickly from day to day; then all of
    the orbit is much alike. On an eccentric orbit it is the true anomaly / 2 pi: what is switched, and the Earth's
    light, come again with the height and not with the Sun.
    Without an orbit: periods since `origin`, by default the first time; give the same origin wherever phases are to be
    compared. With neither orbit nor period: NaN, unknown.
    """
    if times.size == 0 or not environment.comes_again:
        return np.full(len(times), np.nan)
    if environment.orbit is None:
        elapsed = seconds_since(times, times[0] if origin is None else origin)
        phase = elapsed / orbital_period(environment) % 1.0
    else:
        at = geometry_of(environment, folder)(times)
        towards_perigee = eccentricity_vector(at.position, at.velocity)
        is_eccentric = np.median(np.linalg.norm(towards_perigee, axis=-1)) > _ECCENTRIC
        origins = towards_perigee if is_eccentric else at.sun
        phase = angle_from(origins, at.position, at.velocity) / (2 * np.pi) % 1.0
    # A phase a rounding error below 0 comes out of the remainder as exactly 1.
    return np.where(phase >= 1.0, 0.0, phase)
