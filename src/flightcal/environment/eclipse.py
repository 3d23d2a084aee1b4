"""Eclipses by the Earth: sunlit share of the solar disc, and the exact times of penumbra and umbra."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize.elementwise import find_root

from ..errors import OrbitError
from ..scenario import Earth, Environment
from ._time import Floats, Times, seconds_later
from .geometry import Geometry, geometry_of
from .orbit import EARTH_RADIUS, orbital_period
from .sun import SUN_RADIUS

_STEPS_PER_ORBIT = 360
_REFINEMENT = 64
"""Parts of the step next to a near miss of the shadow: in low orbit, contacts 0.5 s apart can stay unseen."""
_TOLERANCE = 1e-6
"""s, of a zero."""


def sunlit_fraction(
    position: Floats, sun_position: Floats, earth_radius: float = EARTH_RADIUS, flattening: float = 0.0
) -> Floats:
    """Sunlit share of the solar disc [T], 0 (umbra) to 1.

    position, sun_position: [T, 3] m, Earth-centred, z to the north pole; earth_radius: m, at the equator of
    an Earth without atmosphere. Conical shadow, overlap of two discs: Montenbruck & Gill (2000), Satellite
    Orbits, sec. 3.4.2. With a flattening, space is stretched along the poles until the Earth is a sphere: what
    is behind it stays behind it.
    """
    sun, earth, separation = _apparent(position, sun_position, earth_radius, flattening)
    apart = np.clip(separation, np.maximum(np.abs(earth - sun), 1e-12), earth + sun)
    x = (apart**2 + sun**2 - earth**2) / (2 * apart)
    # Half the chord that both discs share, by Heron's formula, which keeps its digits where they touch.
    sides = (apart + sun + earth) * (apart + sun - earth) * (apart - sun + earth) * (sun + earth - apart)
    y = np.sqrt(np.maximum(sides, 0.0)) / (2 * apart)
    covered = sun**2 * np.arctan2(y, x) + earth**2 * np.arctan2(y, apart - x) - apart * y
    share: Floats = np.clip(1.0 - covered / (np.pi * sun**2), 0.0, 1.0)
    # Rounding leaves some parts in a million million: make full light and full shadow exact.
    share = np.where(separation >= earth + sun, 1.0, share)
    return np.where(separation <= earth - sun, 0.0, share)


def sunlit_share(environment: Environment, times: Times, folder: Path = Path()) -> Floats:
    """Sunlit share of the solar disc at times [T], 0 (umbra) to 1; NaN, unknown, without an orbit.

    See `sunlit_fraction`.
    """
    if environment.orbit is None:
        return np.full(len(times), np.nan)
    at = geometry_of(environment, folder)(times)
    return sunlit_fraction(at.position, at.sun, environment.earth.radius, environment.earth.flattening)


def shadow_edges(environment: Environment, start: np.datetime64, end: np.datetime64, folder: Path = Path()) -> Times:
    """Times in [start, end] at which the spacecraft enters or leaves penumbra or umbra, in order, to 1 ms.

    The orbit is searched in steps of 1/360 period, finer near a grazing passage. Raises OrbitError.
    """
    if end < start:
        raise OrbitError(f"shadow_edges: found end {end}, expected a time not before start {start}")
    geometry, coarse = geometry_of(environment, folder), search_times(environment, start, end, folder)

    def contacts(seconds: Floats) -> Floats:
        return _contacts(geometry(seconds_later(start, seconds)), environment.earth)

    return np.sort(seconds_later(start, zeros(contacts, coarse)))


def search_times(environment: Environment, start: np.datetime64, end: np.datetime64, folder: Path) -> Floats:
    """Times, s from `start` to `end`, between which nothing in an orbit changes its sign twice, but for near misses."""
    duration = float((end - start) / np.timedelta64(1, "s"))
    step = orbital_period(environment.model_copy(update={"period": None}), folder) / _STEPS_PER_ORBIT
    return np.linspace(0.0, duration, max(2, int(np.ceil(duration / step)) + 1))


def _apparent(
    position: Floats, sun_position: Floats, earth_radius: float, flattening: float
) -> tuple[Floats, Floats, Floats]:
    """Apparent radius of the Sun and of the Earth, and the angle between their centres, [T] rad."""
    stretch = np.array([1.0, 1.0, 1.0 / (1.0 - flattening)])
    position, sun_position = position * stretch, sun_position * stretch
    to_sun = sun_position - position
    distance, height = np.linalg.norm(to_sun, axis=-1), np.linalg.norm(position, axis=-1)
    sun, earth = np.arcsin(SUN_RADIUS / distance), np.arcsin(np.minimum(earth_radius / height, 1.0))
    across = np.linalg.norm(np.cross(position, to_sun), axis=-1)
    return sun, earth, np.arctan2(across, -np.sum(position * to_sun, axis=-1))


def _contacts(at: Geometry, figure: Earth) -> Floats:
    """Two angles [T, 2] rad that are zero at the outer (penumbra) and at the inner (umbra) contacts."""
    sun, earth, separation = _apparent(at.position, at.sun, figure.radius, figure.flattening)
    return np.stack([separation - (earth + sun), separation - np.abs(earth - sun)], axis=-1)


def zeros(functions: Callable[[Floats], Floats], coarse: Floats) -> Floats:
    """Zeros of each of K functions, [T] to [T, K], between the points of the grid `coarse`, s, to `_TOLERANCE`.

    All are sought together, by Chandrupatla's method (1997, Adv. Eng. Softw. 28, 145).
    """
    values = functions(coarse)
    brackets: list[tuple[Floats, Floats, NDArray[np.intp]]] = []
    for k in range(values.shape[1]):
        grid, value = _near_misses_refined(coarse, values[:, k], functions, k)
        crossing = np.flatnonzero((value[:-1] > 0) != (value[1:] > 0))
        brackets.append((grid[crossing], grid[crossing + 1], np.full(len(crossing), k)))
    low, high, which = (np.concatenate(values) for values in zip(*brackets, strict=True))
    if not len(low):
        return low

    def own(times: Floats, which: NDArray[np.intp]) -> Floats:
        return functions(times)[np.arange(len(times)), which]

    tolerances = {"xatol": _TOLERANCE, "xrtol": 0.0, "fatol": 0.0, "frtol": 0.0}
    return np.asarray(find_root(own, (low, high), args=(which,), tolerances=tolerances).x)


def _near_misses_refined(
    grid: Floats, value: Floats, functions: Callable[[Floats], Floats], k: int
) -> tuple[Floats, Floats]:
    """Grid and values of one function with the steps around local minima above zero cut finer: short passages."""
    dip = np.flatnonzero((value[1:-1] > 0) & (value[1:-1] <= value[:-2]) & (value[1:-1] <= value[2:])) + 1
    if not dip.size:
        return grid, value
    finer = np.linspace(grid[dip - 1], grid[dip + 1], 2 * _REFINEMENT + 1)[1:-1].ravel()
    grid = np.concatenate([grid, finer])
    order = np.argsort(grid, kind="stable")
    return grid[order], np.concatenate([value, functions(finer)[:, k]])[order]
