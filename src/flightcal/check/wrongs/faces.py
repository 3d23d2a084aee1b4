"""Faces that look another way than the scenario says: one alone, or all with the body."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from itertools import chain, combinations, product

import numpy as np
from scipy.spatial.transform import Rotation

from ...problem import Window
from ...scenario import FaceNormal, Scenario, SunTracking, spins_fast
from ...simulator import FloatArray, flux_kinds
from ...words import listed
from ..network_view import View
from .normals import (
    ALONG,
    AXES,
    SAME,
    WAYS,
    Shone,
    alike,
    behind,
    named,
    put_on,
    shone_on,
    tilted,
    times_of,
    turnable,
    written,
)
from .wrong import Words, Wrong, at_node, driven_otherwise

_DRIVEN = tuple(SunTracking(tracks_sun_about=axis, back=back) for axis in AXES for back in (False, True))
"""How sides of a plate look that a drive turns to the Sun."""
_MOST_NODES = 14
"""Of a network, whose faces are tried at every node."""
_OF_ALL, _MIRRORED = 3.0, 300.0
"""Times as many turns there are, for all faces are seldom wrong where one or two are; and so many are of the other
hand: that a face or two look the other way is often the same."""
_HINGES, _APART = (30.0, 60.0), 30.0
"""deg, by which plates are tilted that are tried first, and faces when they are looked at closely."""
_ANY_WAY = 10.0
"""Times as many ways there are that are along no axis."""
_Turned = Callable[[Mapping[str, FaceNormal]], Window]
"""The window with some faces that look other ways."""
_TILTS = (-60.0, -40.0, -20.0, 20.0, 40.0, 60.0)
"""deg, by which the body is turned about one of its axes that are tried first."""
_LEAST_TILT = 8.0
"""deg, from which a body is tilted: by less an `attitude_offset` may say so."""
_TILTED_WAYS = 500.0
"""Attitudes that can be told apart, about: a turn is three numbers."""


def faces(view: View) -> Iterator[Wrong]:
    """A face looks another way, or all do, for the body's axes are others."""
    normals = turnable(view)
    if not normals:
        return
    seconds = times_of(view)
    lit = cache(lambda way: shone_on(view, way, seconds))

    def turned(ways: Mapping[str, FaceNormal]) -> Window:
        return _turned(view, seconds, {name: lit(way) for name, way in ways.items()})

    for name, normal in normals.items():
        for way in dict.fromkeys((*WAYS, *_behind_others(view, normals, name))):
            if alike(normal, way) < 1.0 - SAME:
                yield from _one(name, way, turned, 5 * len(normals))
    yield from _plates(view, normals, turned)
    if len(normals) > 1:
        yield from _axes(view)
    yield from _exchanged(view, normals)


def _behind_others(view: View, normals: Mapping[str, FaceNormal], name: str) -> list[FaceNormal]:
    """Ways that a face would look as the other side of one of its node."""
    faces_of = view.window.scenario.network.faces
    return [behind(way) for other, way in normals.items() if faces_of[other].node == faces_of[name].node]


def _one(name: str, way: FaceNormal, turned: _Turned, tries: float, apart: float = _APART) -> Iterator[Wrong]:
    words = Words(
        f"Face {name} looks another way",
        f"With the normal {written(way)} of {name}, the model explains the telemetry.",
        f"Check 'normal' of {name} in 'simulator: faces'",
    )

    def near() -> Iterator[Wrong]:
        for other in tilted(way, apart):
            yield from _one(name, other, turned, _of_any_way(tries, apart), 0.5 * apart)

    yield Wrong("face", name, words, window=turned({name: way}), tries=tries, closer=near)


def _of_any_way(tries: float, apart: float) -> float:
    """Alternatives of a face that looks any way, where those that look along the axes are tried first."""
    return _ANY_WAY * tries if apart == _APART else tries


_Plate = Sequence[tuple[str, str]]
"""Front and back of a plate, or of several that are alike."""


def _plates(view: View, normals: Mapping[str, FaceNormal], turned: _Turned) -> Iterator[Wrong]:
    """Both sides of a plate look another way: it was not deployed, is hinged otherwise, or its drive stands still."""
    pairs, wings = _two_sided(view, normals)
    # Of a body that spins so fast that means count, no drive turns anything to the Sun.
    driven = () if spins_fast(view.window.scenario.environment.attitude) else _DRIVEN
    ways: list[FaceNormal] = [*WAYS, *driven]
    plates: list[_Plate] = [*([pair] for pair in pairs), *wings]
    for plate in plates:
        normal, tries = normals[plate[0][0]], 8.0 * len(plates)
        for way in ways:
            if abs(alike(way, normal)) <= ALONG:
                yield from _plate(plate, way, turned, tries)
        for way in dict.fromkeys(plate_normal for hinge in _HINGES for plate_normal in tilted(normal, hinge)):
            yield from _plate(plate, way, turned, _of_any_way(tries, _APART), 0.5 * _APART)


def _plate(plate: _Plate, way: FaceNormal, turned: _Turned, tries: float, apart: float = _APART) -> Iterator[Wrong]:
    names = [name for both in plate for name in both]
    fronts, rears = (listed([both[side] for both in plate]) for side in (0, 1))
    one = len(plate) == 1
    words = Words(
        f"Faces {listed(names)} look another way",
        f"With the normal {written(way)} of {fronts}, and {rears} on {'its' if one else 'their'} other "
        "side, the model explains the telemetry.",
        f"Check whether the {'panel is' if one else 'panels are'} deployed and turn{'s' if one else ''}, and 'normal' "
        f"of {listed(names)}",
    )

    def near() -> Iterator[Wrong]:
        for other in tilted(way, apart):
            yield from _plate(plate, other, turned, _of_any_way(tries, apart), 0.5 * apart)

    window = turned(
        {name: side_normal for front, rear in plate for name, side_normal in ((front, way), (rear, behind(way)))}
    )
    yield Wrong("face", " ".join(names), words, window=window, tries=tries, closer=near)


def _two_sided(
    view: View, normals: Mapping[str, FaceNormal]
) -> tuple[list[tuple[str, str]], list[list[tuple[str, str]]]]:
    """Both sides of each plate; and of plates that look alike: wings on both sides of a body are built together."""
    faces_of = view.window.scenario.network.faces
    pairs = [
        (a, b)
        for a, b in combinations(normals, 2)
        if faces_of[a].node == faces_of[b].node and alike(normals[a], behind(normals[b])) > 1.0 - SAME
    ]
    # From either side they are the same wings.
    wings = {frozenset(chain(*like)): like for front, _ in pairs if len(like := _like(front, pairs, normals)) > 1}
    return pairs, list(wings.values())


def _like(front: str, pairs: Sequence[tuple[str, str]], normals: Mapping[str, FaceNormal]) -> list[tuple[str, str]]:
    """Both sides of all plates that look as this face does, that side first."""
    both_ways = [pair for a, b in pairs for pair in ((a, b), (b, a))]
    return [both_way for both_way in both_ways if alike(normals[both_way[0]], normals[front]) > 1.0 - SAME]


def elsewhere(view: View) -> Iterator[Wrong]:
    """A face is of another node than the scenario says."""
    model, network = view.window.scenario.network, view.network.network
    pairs = [(name, node) for name, face in model.faces.items() for node in network.own_nodes if node != face.node]
    for name, node in pairs if len(network.own_nodes) <= _MOST_NODES else ():
        words = Words(
            f"Face {name} is of {node}, not of {model.faces[name].node}",
            f"With {name} at {node}, the model explains the telemetry.",
            f"Correct 'node' of {name} in 'simulator: faces'",
        )
        yield Wrong("face", name, words, window=at_node(view, "faces", name, node), tries=len(pairs))


def _axes(view: View) -> Iterator[Wrong]:
    """The body's axes are others, or one of them points the other way, as where axes are left-handed."""
    turns = [turn for turn in Rotation.create_group("O").as_matrix() if not np.allclose(turn, np.eye(3))]
    mirrors = [np.diag(1.0 - 2.0 * axis) for axis in np.eye(3)]
    ways = [
        *((turn, "axes", _OF_ALL * len(turns)) for turn in turns),
        *((mirror, "hand", _MIRRORED) for mirror in mirrors),
    ]
    for way, about, tries in ways:
        turned = [named(axis) for axis in way.T]
        words = Words(
            "The body's axes are others" if about == "axes" else "The body's axes are of the other hand",
            f"With +x, +y and +z of all faces turned to {', '.join(turned)}, sunlight and Earth's heat explain the "
            "telemetry.",
            "Check the axes of 'normal' in 'simulator: faces' beside those of 'attitude'",
        )
        yield from driven_otherwise("attitude", about, words, view, tries=tries, scenario=_looking(view, way))


def _exchanged(view: View, normals: Mapping[str, FaceNormal]) -> Iterator[Wrong]:
    """Two faces look each other's way, or both sides of all wings."""
    columns, kinds = view.network.network.columns, flux_kinds(view.window.scenario)
    pairs = [(a, b) for a, b in combinations(normals, 2) if alike(normals[a], normals[b]) < 1.0 - SAME]
    for both in [[couple] for couple in pairs] + _two_sided(view, normals)[1]:
        ones, others = zip(*both, strict=True)
        a, b = ([columns.index(f"{kind}.{name}") for name in names for kind in kinds] for names in (ones, others))
        words = Words(
            f"Faces {', '.join(map(' and '.join, both))} are exchanged",
            f"With the normals of {listed(ones)} and of {listed(others)} exchanged, the model explains the telemetry.",
            f"Check 'normal' of {listed([*ones, *others])} in 'simulator: faces'",
        )
        about = " ".join(name for pair in both for name in pair)
        yield Wrong("face", about, words, window=view.exchanged(a, b), tries=5 * len(pairs))


def _with_normals(view: View, normals: Mapping[str, FaceNormal]) -> Scenario:
    """The scenario of a view with some faces that look another way."""
    model = view.window.scenario.network
    looking = {name: model.faces[name].model_copy(update={"normal": normal}) for name, normal in normals.items()}
    changed = model.model_copy(update={"faces": {**model.faces, **looking}})
    return view.window.scenario.model_copy(update={"simulator": changed})


def _turned(view: View, seconds: FloatArray, lit: Mapping[str, Shone]) -> Window:
    """The view's window with faces that look another way; lit: what shines on each at seconds [M]."""
    drive = view.network.drive
    inputs = drive.inputs.copy()
    put_on(inputs, view.network.network.columns, seconds, lit, drive.times)
    return view.with_inputs(inputs)


def tilts(view: View) -> Iterator[Wrong]:
    """The body is turned by a constant angle against its attitude."""
    for axis, angle in product(np.eye(3), _TILTS if turnable(view) else ()):
        yield from _tilt(view, angle * axis, 20.0)


def _tilt(view: View, turn: FloatArray, apart: float) -> Iterator[Wrong]:
    """The body turned by a rotation vector [3], deg; apart: deg, between it and those that are tried near by."""
    angle = float(np.linalg.norm(turn))
    if angle < _LEAST_TILT:
        return
    looking = _looking(view, Rotation.from_rotvec(turn, degrees=True).as_matrix())
    about = ", ".join(f"{number:+.0f}" for number in turn)
    advice = "Check 'attitude' in 'environment', and the axes of 'normal' in 'simulator: faces'"
    words = Words(
        f"The body is turned by {angle:.0f} deg against its attitude",
        f"With the body turned by [{about}] deg about its axes x, y and z, sunlight and Earth's heat explain the "
        "telemetry.",
        advice,
    )

    def around() -> Iterator[Wrong]:
        for step in product((-1.0, 0.0, 1.0), repeat=3):
            yield from _tilt(view, turn + 0.5 * apart * np.array(step), 0.5 * apart)

    yield from driven_otherwise("attitude", "tilt", words, view, tries=_TILTED_WAYS, closer=around, scenario=looking)


def _looking(view: View, turn: FloatArray) -> Scenario:
    """The scenario of a view with all faces turned, or mirrored; turn: [3, 3], orthogonal."""
    faces = view.window.scenario.network.faces
    return _with_normals(view, {name: _rotated(face.normal, turn) for name, face in faces.items()})


def _rotated(normal: FaceNormal, turn: FloatArray) -> FaceNormal:
    if isinstance(normal, SunTracking):
        return normal.model_copy(update={"tracks_sun_about": _rotated(normal.tracks_sun_about, turn)})
    if normal == "all":
        return normal
    x, y, z = (turn @ np.array(normal)).tolist()
    return x, y, z


def tumbling(view: View) -> Iterator[Wrong]:
    """The body tumbles, and its faces see all directions alike."""
    normals = turnable(view)
    if not normals:
        return
    words = Words(
        "The body tumbles",
        "With faces that see all directions alike, sunlight and Earth's heat explain the telemetry.",
        "Write 'normal: all' for its faces, or how it spins in 'environment: attitude'",
    )
    scenario = _with_normals(view, dict.fromkeys(normals, "all"))
    yield from driven_otherwise("attitude", "tumbling", words, view, tries=2, scenario=scenario)


WRONGS = (faces, elsewhere, tilts, tumbling)
"""What looks for them."""
