"""Ways that faces look: which are alike or opposite, how they are written, and what shines there."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from ...scenario import FaceNormal, SunTracking
from ...simulator import FloatArray
from ..network_view import View
from .wrong import put

AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
WAYS = tuple((sign * x, sign * y, sign * z) for x, y, z in AXES for sign in (1.0, -1.0))
"""Along the axes of the body."""
ALONG = 0.99
"""Cosine from which two ways are about the same."""
_ANY = "face"
SAME = 1e-6
"""One less a cosine, below which two ways are the same."""
_LEAST = 5.0
"""deg, by which a way is tilted at least."""

Shone = Mapping[str, FloatArray]
"""What shines on a face at some times [M] (W/m^2), by kind, such as ``solar``."""


def turnable(view: View) -> dict[str, FaceNormal]:
    """Which way faces look that look some way, where there is an orbit."""
    scenario = view.window.scenario
    known = scenario.network.faces if scenario.environment.orbit is not None else {}
    return {name: face.normal for name, face in known.items() if face.normal != "all"}


def times_of(view: View) -> FloatArray:
    """[M] s from the window's start, at which it is looked up what shines."""
    times = view.network.drive.times
    return np.union1d(view.sunlight.times(view.window.scenario, 0.0, times[-1]), times)


def shone_on(view: View, way: FaceNormal, seconds: FloatArray) -> Shone:
    """What shines on a face that looks one way at seconds [M]."""
    scenario = view.window.scenario
    model = scenario.network
    face = next(iter(model.faces.values())).model_copy(update={"normal": way})
    alone = scenario.model_copy(update={"simulator": model.model_copy(update={"faces": {_ANY: face}})})
    lit = view.sunlight.on_faces(alone, seconds)
    return {column.partition(".")[0]: values for column, values in lit.items()}


def put_on(
    inputs: FloatArray, columns: Sequence[str], seconds: FloatArray, shone: Mapping[str, Shone], grid: FloatArray
) -> None:
    """Put what shines on some faces at seconds [M] into the inputs [K, 2, q] of a grid's steps, in place."""
    for face, of_way in shone.items():
        put(inputs, columns, seconds, {f"{kind}.{face}": values for kind, values in of_way.items()}, grid)


def alike(one: FaceNormal, other: FaceNormal) -> float:
    """Cosine of the angle between two ways, or between the axes of two drives; 0 of a way and a drive.

    Of the two sides of what a drive turns it has the sign of opposite ways.
    """
    if isinstance(one, SunTracking) != isinstance(other, SunTracking):
        return 0.0
    a, b = (
        np.array(normal.tracks_sun_about if isinstance(normal, SunTracking) else normal, float)
        for normal in (one, other)
    )
    cosine = float(a @ b / np.linalg.norm(a) / np.linalg.norm(b))
    if isinstance(one, SunTracking) and isinstance(other, SunTracking):
        return abs(cosine) if one.back == other.back else -abs(cosine)
    return cosine


def looking(view: View, normals: Mapping[str, FaceNormal], node: str, way: FaceNormal) -> tuple[str, ...]:
    """Faces of a node, of those whose normals are known, that look a way."""
    faces = view.window.scenario.network.faces
    return tuple(name for name, normal in normals.items() if faces[name].node == node and alike(normal, way) > ALONG)


def behind(way: FaceNormal) -> FaceNormal:
    """How the other side of a plate looks."""
    if isinstance(way, SunTracking):
        return way.model_copy(update={"back": not way.back})
    x, y, z = (-float(number) if number else 0.0 for number in way)
    return x, y, z


def tilted(way: FaceNormal, angle: float) -> list[FaceNormal]:
    """Ways that are turned by an angle (deg), or half of it, about the axes of the body; none for a drive."""
    if isinstance(way, SunTracking) or angle < _LEAST:
        return []
    found = []
    for axis, turn in product(np.eye(3), (-angle, -0.5 * angle, 0.5 * angle, angle)):
        x, y, z = Rotation.from_rotvec(turn * axis, degrees=True).apply(np.array(way, float)).tolist()
        found.append((x, y, z))
    return [normal for normal in found if alike(way, normal) < 1.0 - SAME]


def named(axis: Sequence[float]) -> str:
    """An axis of the body as it is called, such as +x."""
    k = int(np.argmax(np.abs(axis)))
    return f"{'-' if axis[k] < 0.0 else '+'}{'xyz'[k]}"


def written(way: FaceNormal) -> str:
    """A normal as a user writes it, such as "[0, 0, 1]"."""
    if isinstance(way, SunTracking):
        return f"{{tracks_sun_about: {_numbers(way.tracks_sun_about)}{', back: true' if way.back else ''}}}"
    return _numbers(way)


def _numbers(axis: Iterable[float | str]) -> str:
    return f"[{', '.join(f'{float(number) + 0.0:.3g}' for number in axis)}]"
