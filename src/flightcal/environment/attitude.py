"""Attitudes: how the body axes stand in the inertial frame.

nadir           +z to the Earth's centre, +y against the orbital angular momentum, +x completes: along the
                velocity on a circular orbit, in the orbit plane and forward on every one.
sun_pointing    +z to the Sun, +y as near as possible to the ecliptic's north pole (the Sun never comes near
                it, so the frame never degenerates), +x completes.
aligned         one axis of the body points towards one thing, a second one as near as it can towards another:
                how most pointing is told, such as yaw steering (+z to nadir, +x to the Sun).
inertial        fixed; the unit quaternion (w, x, y, z) turns body vectors into inertial ones.
spinning        the body's `spin_axis` points along the inertial `direction` and the body turns
                right-handedly about it. At its `epoch` (2000-01-01T12:00 UTC, where none is written) it has turned by
                its `phase` from where the shortest turn from `spin_axis` to `direction` leaves it. Without a
                period there is no phase: see `faces.Spun`.
quaternions     samples, spherical linear interpolation between them.
timeline        one of these after another. In a slew the body turns about one axis at a constant rate from the attitude
                before, as that goes on, to the one after.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from ..errors import OrbitError
from ..scenario import (
    AlignedAttitude,
    Attitude,
    AttitudeTimeline,
    InertialAttitude,
    SampledAttitude,
    SpinningAttitude,
    Target,
)
from ._samples import read_samples, state_of, within_span
from ._time import Floats, Times, seconds_since
from .geometry import Geometry
from .sun import OBLIQUITY

_SAME = 1e-9
"""Sine of the angle between two directions, below which they are the same."""


def body_to_inertial(attitude: Attitude, at: Geometry, folder: Path = Path()) -> Floats:
    """Matrices [T, 3, 3] whose columns are the body axes in the inertial frame.

    Sample files are read from `folder`. Raises OrbitError: samples that do not cover the times or have a length of
    zero, a spin without period.
    """
    if isinstance(attitude, AttitudeTimeline):
        return _in_turn(attitude, at, folder)
    if isinstance(attitude, InertialAttitude):
        quaternion = unit(attitude.inertial)
        matrix = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
        return np.broadcast_to(matrix, (len(at.times), 3, 3))
    if isinstance(attitude, AlignedAttitude):
        return _aligned(attitude, at)
    if isinstance(attitude, SpinningAttitude):
        return _spinning(attitude, at)
    if isinstance(attitude, SampledAttitude):
        return _sampled(attitude, at, folder)
    if attitude == "sun_pointing":
        return _axes(z=at.to_sun, towards_y=_towards("ecliptic_north", at))
    return _axes(z=-at.position, towards_y=-np.cross(at.position, at.velocity))


def unit(vector: Floats | tuple[float, ...]) -> Floats:
    """`vector` [..., K], not zero, at length one."""
    array = np.asarray(vector, np.float64)
    scaled: Floats = array / np.linalg.norm(array, axis=-1, keepdims=True)
    return scaled


def _axes(z: Floats, towards_y: Floats) -> Floats:
    z = z / np.linalg.norm(z, axis=-1, keepdims=True)
    x = np.cross(towards_y, z)
    x /= np.linalg.norm(x, axis=-1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=-1)


def _aligned(attitude: AlignedAttitude, at: Geometry) -> Floats:
    """The turn of two axes of the body to two directions: the first exactly, the second in their plane."""
    body = _frame(*(np.array(pointing.axis)[None] for pointing in (attitude.aligned, attitude.constrained)))
    inertial = _frame(*(_towards(pointing.towards, at) for pointing in (attitude.aligned, attitude.constrained)))
    matrices: Floats = inertial @ body.transpose(0, 2, 1)
    return matrices


def _frame(first: Floats, second: Floats) -> Floats:
    """Right-handed frames [T, 3, 3] of columns along the first of two directions [T, 3], and across both."""
    along, second = unit(first), unit(second)
    across = np.cross(along, second)
    # Where both are the same, any direction across will do: it is a moment.
    any_across = np.cross(along, np.eye(3)[np.argmin(np.abs(along), axis=-1)])
    same = np.linalg.norm(across, axis=-1, keepdims=True) < _SAME
    across = unit(np.where(same, any_across, across))
    return np.stack([along, across, np.cross(along, across)], axis=-1)


def _towards(target: Target | tuple[float, float, float], at: Geometry) -> Floats:
    """Inertial directions [T, 3], of any length."""
    if not isinstance(target, str):
        return np.broadcast_to(np.array(target), at.position.shape)
    if target == "nadir":
        return -at.position
    if target == "sun":
        return at.to_sun
    if target == "velocity":
        return at.velocity
    if target == "orbit_normal":
        return np.cross(at.position, at.velocity)
    return np.broadcast_to([0.0, -np.sin(OBLIQUITY), np.cos(OBLIQUITY)], at.position.shape)


def slew_begins(attitude: AttitudeTimeline) -> Times:
    """When each slew begins [S]."""
    return np.array([change.at for change in attitude.timeline[1:]], "datetime64[ns]")


def attitude_names(attitude: AttitudeTimeline, times: Times) -> list[str]:
    """The name of the attitude that a timeline is in, or turns to, at each of times [T]; "" of one without a name."""
    found = [change.attitude if isinstance(change.attitude, str) else "" for change in attitude.timeline]
    return [found[k] for k in np.searchsorted(slew_begins(attitude), times, side="right")]


def _in_turn(attitude: AttitudeTimeline, at: Geometry, folder: Path) -> Floats:
    begin, kinds = slew_begins(attitude), attitude.attitudes
    which = np.searchsorted(begin, at.times, side="right")
    matrices = _each(kinds, which, at, folder)
    slewing = np.flatnonzero(which)
    share = seconds_since(at.times[slewing], begin[which[slewing] - 1]) / attitude.slew
    slewing, share = slewing[share < 1.0], share[share < 1.0]
    if len(slewing):
        before = Rotation.from_matrix(_each(kinds, which[slewing] - 1, at.some(slewing), folder))
        turn = (before.inv() * Rotation.from_matrix(matrices[slewing])).as_rotvec()
        matrices[slewing] = (before * Rotation.from_rotvec(share[:, None] * turn)).as_matrix()
    return matrices


def _each(kinds: Sequence[Attitude], which: NDArray[np.intp], at: Geometry, folder: Path) -> Floats:
    """[T, 3, 3]: the attitude at each time, of `kinds` by number `which` [T]; one that comes again is asked once."""
    matrices = np.empty((len(at.times), 3, 3))
    for kind in dict.fromkeys(kinds):
        here = np.flatnonzero(np.array([pointing == kind for pointing in kinds])[which])
        if len(here):
            matrices[here] = body_to_inertial(kind, at.some(here), folder)
    return matrices


def _spinning(attitude: SpinningAttitude, at: Geometry) -> Floats:
    if attitude.period is None:
        raise OrbitError("environment.attitude: found no spin 'period', expected one: body axes depend on it")
    axis = unit(attitude.spin_axis)
    direction = unit(attitude.direction)
    turned = 2 * np.pi * (seconds_since(at.times, np.datetime64(attitude.epoch)) / attitude.period % 1.0)
    spin = Rotation.from_rotvec((turned + attitude.phase)[:, None] * direction)
    matrices: Floats = (spin * _shortest_turn(axis, direction)).as_matrix()
    return matrices


def _shortest_turn(start: Floats, end: Floats) -> Rotation:
    cosine, normal = start @ end, np.cross(start, end)
    if cosine > -1 + 1e-12:
        return Rotation.from_quat([1 + cosine, *normal], scalar_first=True)
    # Opposite vectors: half a turn about any axis across them will do.
    across = np.cross(start, np.eye(3)[np.argmin(np.abs(start))])
    return Rotation.from_rotvec(np.pi * across / np.linalg.norm(across))


def _sampled(attitude: SampledAttitude, at: Geometry, folder: Path) -> Floats:
    place = f"environment.attitude.quaternions: {attitude.quaternions}"
    path = folder / attitude.quaternions
    times, slerp = _interpolated(attitude, path, place, state_of(path, place))
    within_span(at.times, times, place)
    matrices: Floats = slerp(seconds_since(at.times, times[0])).as_matrix()
    return matrices


@lru_cache(maxsize=16)
def _interpolated(attitude: SampledAttitude, path: Path, place: str, _: tuple[int, int]) -> tuple[Times, Slerp]:
    """Times [N] of a file's samples and the turns between them, by s since the first; kept while the file is as it is.

    Many orbits and attitudes are tried on the same samples.
    """
    times, quaternions = read_samples(path, attitude.columns, place, at_least=2)
    if not quaternions.any(axis=1).all():
        raise OrbitError(f"{place}: found a quaternion of length zero, expected length 1 (w, x, y, z)")
    rotations = Rotation.from_quat(unit(quaternions), scalar_first=True)
    if attitude.turns == "inertial_to_body":
        rotations = rotations.inv()
    return times, Slerp(seconds_since(times, times[0]), rotations)
