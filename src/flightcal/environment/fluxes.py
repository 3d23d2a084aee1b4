"""What the simulator gets from the environment: heat flux incident on each face at each time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import OrbitError
from ..scenario import Environment, FaceNormal, SunTracking, Vector, spins_fast
from ._time import Floats, Times
from .attitude import body_to_inertial, unit
from .eclipse import sunlit_fraction
from .faces import RINGS, AllDirections, Faces, Flat, Spun, albedo_view, infrared_view
from .geometry import Geometry, geometry_of
from .sun import solar_flux

_ON_AXIS = 1e-9
"""Sine of the angle between the Sun and a drive's axis that leaves a face without a direction to turn to."""


@dataclass(frozen=True)
class FaceFluxes:
    """Heat flux incident on faces; what a face of area A absorbs is

    A [absorptivity (solar + albedo coefficient x albedo) + emissivity x earth_infrared x infrared].

    Albedo coefficient and Earth infrared stay outside because they may be calibrated.
    """

    names: tuple[str, ...]
    """Faces [F], in the order given."""
    solar: Floats
    """Direct sunlight, [T, F] W/m2; zero in umbra, reduced in penumbra."""
    albedo: Floats
    """Sunlight reflected by the Earth, [T, F] W/m2 per unit of the albedo coefficient."""
    infrared: Floats
    """View factor to the Earth, [T, F]: W/m2 per W/m2 that the Earth emits."""


def face_fluxes(
    environment: Environment,
    faces: Mapping[str, FaceNormal],
    times: Times,
    folder: Path = Path(),
    *,
    sunlit: Floats | None = None,
    rings: int = RINGS,
) -> FaceFluxes:
    """Heat flux on `faces` (name -> normal) at `times` [T]; sample files are read from `folder`.

    Times may come in any order and repeat. Faces do not shade each other. Those that track the Sun do so in the
    shadow too. For "all", and where the body spins fast (SpinningAttitude without a period), fluxes are means over the
    directions of the normal. The Earth is a diffuse sphere of equatorial radius, of uniform albedo and infrared; its
    shadow may be flattened.
    sunlit: [T] share of the solar disc that is seen, where it is known otherwise; NaN: it is not.
    rings: of the quadrature of albedo. Raises OrbitError.
    """
    at = geometry_of(environment, folder)(times)
    names = tuple(faces)
    normals = [normal for normal in faces.values() if not isinstance(normal, str)]
    averaged = np.array([normal == "all" for normal in faces.values()], dtype=bool)
    flux = solar_flux(np.linalg.norm(at.to_sun, axis=-1), environment.solar_constant)
    earth = environment.earth
    share = sunlit_fraction(at.position, at.sun, earth.radius, earth.flattening)
    direct = flux * (share if sunlit is None else np.where(np.isnan(sunlit), share, sunlit))

    groups: list[tuple[NDArray[np.bool_], Faces]] = []
    if averaged.any():
        groups.append((averaged, AllDirections()))
    if normals:
        groups.append((~averaged, _oriented(environment, normals, at, folder)))

    to_sun = (at.to_sun / np.linalg.norm(at.to_sun, axis=-1, keepdims=True))[:, None]
    solar, albedo, infrared = (np.empty((len(times), len(names))) for _ in range(3))
    for columns, group in groups:
        solar[:, columns] = direct[:, None] * group.cosine(to_sun)[:, 0]
        albedo[:, columns] = flux[:, None] * albedo_view(group, at.position, at.sun, earth.radius, rings)
        infrared[:, columns] = infrared_view(group, at.position, earth.radius)
    return FaceFluxes(names, solar, albedo, infrared)


def _oriented(environment: Environment, normals: Sequence[Vector | SunTracking], at: Geometry, folder: Path) -> Faces:
    """Raises OrbitError: a face tracks the Sun on a body that spins fast."""
    attitude = environment.attitude
    tracking = np.array([isinstance(normal, SunTracking) for normal in normals])
    # Of a face that tracks the Sun, its axis.
    ways = np.array(
        [unit(normal.tracks_sun_about if isinstance(normal, SunTracking) else normal) for normal in normals]
    )
    if spins_fast(attitude):
        if tracking.any():
            message = "found a face that tracks the Sun, expected none: the body spins so fast that only means count"
            raise OrbitError(f"simulator.faces: {message}")
        return Spun(unit(attitude.direction), ways @ unit(attitude.spin_axis))
    # Body axes are the matrices' columns: row vector times transpose turns every normal at once.
    turned = ways @ np.swapaxes(body_to_inertial(attitude, at, folder), 1, 2)
    if tracking.any():
        sides = [-1.0 if normal.back else 1.0 for normal in normals if isinstance(normal, SunTracking)]
        turned[:, tracking] = np.array(sides)[:, None] * _facing(turned[:, tracking], unit(at.to_sun))
    return Flat(turned)


def _facing(axes: Floats, to_sun: Floats) -> Floats:
    """Unit vectors [T, F, 3] across axes [T, F, 3], as near as they can be to the Sun's direction [T, 3].

    Where the Sun stands on an axis, some direction across it.
    """
    towards = np.broadcast_to(to_sun[:, None], axes.shape)
    across = towards - np.sum(towards * axes, axis=-1, keepdims=True) * axes
    length = np.linalg.norm(across, axis=-1, keepdims=True)
    spare = np.cross(axes, np.eye(3)[np.argmin(np.abs(axes), axis=-1)])
    return unit(np.where(length > _ON_AXIS, across, spare))
