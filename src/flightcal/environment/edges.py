"""When the sunlight on flat faces begins or ends, and when samples of orbit and attitude have corners."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..scenario import (
    AttitudeTimeline,
    Environment,
    FaceNormal,
    SampledAttitude,
    SampledOrbit,
    SunTracking,
    spins_fast,
)
from ._samples import read_samples
from ._time import Floats, Times, seconds_later, seconds_since
from .attitude import body_to_inertial, slew_begins, unit
from .eclipse import search_times, sunlit_fraction, zeros
from .geometry import Geometry, geometry_of
from .orbit import propagator

_EDGE_ON = 1e-9
"""Cosine of a face's normal to the Sun that counts as none."""
_OF_SLEW = 16
"""Parts of a slew: so many turns of up to 11 deg."""


def sun_edges(
    environment: Environment,
    normals: Sequence[FaceNormal],
    start: np.datetime64,
    end: np.datetime64,
    folder: Path = Path(),
) -> Times:
    """Times in [start, end] at which the Sun passes through the plane of a face with one of these normals, in order.

    To 1 ms, and only where the Sun is not behind the Earth. A face that tracks the Sun has no such times, nor
    has a body whose sunlight is a mean over directions. Raises OrbitError.
    """
    attitude = environment.attitude
    flat = [unit(normal) for normal in normals if not isinstance(normal, (str, SunTracking))]
    if not flat or spins_fast(attitude):
        return np.empty(0, "datetime64[ns]")
    geometry, coarse = geometry_of(environment, folder), search_times(environment, start, end, folder)
    turning = seconds_since(slew_edges(environment, _OF_SLEW), start)
    coarse = np.union1d(coarse, turning[(turning > 0.0) & (turning < coarse[-1])])
    sun = geometry(seconds_later(start, coarse)).sun
    assert environment.orbit is not None  # else there is no geometry
    propagate = propagator(environment.orbit, folder)

    def cosines(seconds: Floats) -> Floats:
        """Of the angles between all normals and the direction to the Sun, [T, F]."""
        times = seconds_later(start, seconds)
        # In the minutes between two of these times the Sun's path is straight to a kilometre.
        at = Geometry(times, *propagate(times), np.stack([np.interp(seconds, coarse, axis) for axis in sun.T], axis=1))
        to_sun = at.to_sun / np.linalg.norm(at.to_sun, axis=-1, keepdims=True)
        found = np.einsum("tij,ti->tj", body_to_inertial(attitude, at, folder), to_sun) @ np.array(flat).T
        # A face that stays edge on to the Sun is not turned by rounding.
        return np.where(np.abs(found) < _EDGE_ON, 0.0, found)

    times = np.unique(seconds_later(start, zeros(cosines, coarse)))
    at = geometry(times)
    earth = environment.earth
    lit = sunlit_fraction(at.position, at.sun, earth.radius, earth.flattening) > 0.0
    return times[lit] if len(times) else times


def slew_edges(environment: Environment, parts: int = 1) -> Times:
    """When slews begin and end, in order; and when so many parts of each do."""
    if not isinstance(environment.attitude, AttitudeTimeline):
        return np.empty(0, "datetime64[ns]")
    share = np.round(np.linspace(0.0, environment.attitude.slew, parts + 1) * 1e9).astype("timedelta64[ns]")
    return (slew_begins(environment.attitude)[:, None] + share).ravel()


def sample_times(environment: Environment, folder: Path = Path()) -> Times:
    """Times of the samples of orbit and attitude, where these come from files, and of slews. Raises OrbitError."""
    attitude = environment.attitude
    kinds = attitude.attitudes if isinstance(attitude, AttitudeTimeline) else (attitude,)
    files: list[tuple[str, tuple[str, ...], str]] = []
    if isinstance(environment.orbit, SampledOrbit):
        files.append((environment.orbit.positions, ("x", "y", "z"), "environment.orbit.positions"))
    for kind in dict.fromkeys(kinds):
        if isinstance(kind, SampledAttitude):
            files.append((kind.quaternions, kind.columns, "environment.attitude.quaternions"))
    found = [read_samples(folder / name, columns, f"{place}: {name}", 2)[0] for name, columns, place in files]
    return np.unique(np.concatenate([slew_edges(environment, _OF_SLEW), *found]))
