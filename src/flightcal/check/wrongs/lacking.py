"""Faces and conductors that the scenario leaves out, and conductors that end at another node."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import product

import numpy as np

from ...problem import PIN, Window
from ...scenario import Face, FaceNormal
from ...simulator import FloatArray, IntArray, ParameterMap, build_network
from ...words import listed, number
from ..network_view import NO_LINK, View
from .normals import WAYS, Shone, behind, looking, put_on, shone_on, times_of, turnable, written
from .wrong import Words, Wrong

_NONE = 10.0 * NO_LINK
"""W/K, below which nodes are not linked."""
_MOST_NODES = 14
"""Of a network, which may lack a face anywhere."""
_COATINGS = ((0.25, 0.85), (0.9, 0.85))
"""Absorptivity and emissivity of white and of black paint: what a face may have of which nothing is known."""
_PER_FACE = 6.0
"""Ways in which a face that is left out may be another, about: its area and its coating."""
_AREAS, _RATIOS, _CLOSER = tuple(1.3**k for k in range(-3, 4)), (0.5, 0.7, 0.85, 1.0, 1.2, 1.5, 2.0), 2
"""Times as large as what is looked at first, and times what it absorbs of the Sun for what it radiates; so often."""
_MOST_FACES = 40
"""Of a scenario, whose other sides are tried."""
_Making = Callable[[Sequence[Face]], Window]
"""The window with faces that look one way."""


@dataclass(frozen=True)
class _Lacking:
    """What may be left out: faces of some nodes that look one way."""

    faces: tuple[Face, ...]
    behind: tuple[str, ...] = ()
    """Of what they are the other sides."""

    @property
    def nodes(self) -> str:
        """Those of the faces, in words."""
        return listed([face.node for face in self.faces])


def faces_left_out(view: View) -> Iterator[Wrong]:
    """A face is not in the scenario, or the other sides of all wings."""
    known = turnable(view)
    if not known:
        return
    seconds = times_of(view)
    lit = cache(lambda way: shone_on(view, way, seconds))

    def making(faces: Sequence[Face]) -> Window:
        return _with_faces(view, faces, seconds, lit(faces[0].normal))

    every = [*_other_sides(view, known), *_anywhere(view, known)]
    for lacking in every:
        yield from _of(lacking, making, _PER_FACE * len(every))


def _other_sides(view: View, known: Mapping[str, FaceNormal]) -> Iterator[_Lacking]:
    """Other sides of what has one face only: of each alone, and of all that look the same way."""
    faces, found = view.window.scenario.network.faces, {}
    for name, normal in known.items() if len(known) <= _MOST_FACES else ():
        way = behind(normal)
        if not looking(view, known, faces[name].node, way):
            found[name] = faces[name].model_copy(update={"normal": way})
    groups: dict[FaceNormal, list[str]] = {}
    for name, face in found.items():
        groups.setdefault(face.normal, []).append(name)
    for names in groups.values():
        if 1 < len(names) == len({found[name].node for name in names}):
            yield _Lacking(tuple(found[name] for name in names), tuple(names))
    for name, face in found.items():
        yield _Lacking((face,), (name,))


def _anywhere(view: View, known: Mapping[str, FaceNormal]) -> Iterator[_Lacking]:
    """Faces of white or black paint, along an axis of the body and as large as others are."""
    nodes, faces = view.network.network.own_nodes, view.window.scenario.network.faces
    area = float(np.median([faces[name].area for name in known]))
    for node, way, coating in product(nodes, WAYS, _COATINGS) if len(nodes) <= _MOST_NODES else ():
        if not looking(view, known, node, way):
            absorptivity, emissivity = coating
            face = Face.model_construct(
                node=node, area=area, normal=way, absorptivity=absorptivity, emissivity=emissivity
            )
            yield _Lacking((face,), looking(view, known, node, behind(way)))


def _of(lacking: _Lacking, making: _Making, tries: float, near: int = 0) -> Iterator[Wrong]:
    """near: how often they were looked at more closely."""
    one, many = lacking.faces[0], len(lacking.faces) > 1
    other = f"the other {'sides' if many else 'side'} of {listed(lacking.behind)}"
    place = f" on {other}" if lacking.behind else ""
    area = " and ".join(dict.fromkeys(number(face.area, 2) for face in lacking.faces))
    absorptivity, emissivity = number(one.absorptivity, 2), number(one.emissivity, 2)
    words = Words(
        f"{'Faces' if many else 'A face'} of {lacking.nodes} {'are' if many else 'is'} missing in the scenario",
        f"With {area} m2{place}, the normal {written(one.normal)}, an absorptivity of {absorptivity} and an emissivity "
        f"of {emissivity}, the model explains the telemetry.",
        f"Add {other if lacking.behind else 'the face'} to 'simulator: faces', with "
        f"{'their' if many else 'its'} own area and coating",
    )

    def closer() -> Iterator[Wrong]:
        for times, ratio in product(_AREAS, _RATIOS):
            faces = tuple(_sized(face, times, ratio) for face in lacking.faces)
            yield from _of(replace(lacking, faces=faces), making, tries, near + 1)

    window = making(lacking.faces)
    yield Wrong("face", lacking.nodes, words, window=window, tries=tries, closer=closer if near < _CLOSER else None)


def _sized(face: Face, times: float, ratio: float) -> Face:
    """A face that radiates so many times as much, and absorbs so much more sunlight beside it."""
    absorptivity, emissivity = ratio * face.absorptivity, face.emissivity
    if absorptivity > 1.0:
        absorptivity, emissivity = 1.0, emissivity / absorptivity
    area = times * face.area * (face.emissivity / emissivity if emissivity else 1.0)
    return face.model_copy(update={"area": area, "absorptivity": absorptivity, "emissivity": emissivity})


def _with_faces(view: View, faces: Sequence[Face], seconds: FloatArray, shone: Shone) -> Window:
    """The view's window with faces that its scenario lacks, one a node; shone: on each at seconds [M]."""
    scenario, simulator = view.window.scenario, view.network
    model, old, drive = scenario.network, simulator.network, simulator.drive
    added = {f"lacking_{face.node}": face for face in faces}
    changed = scenario.model_copy(update={"simulator": model.model_copy(update={"faces": {**model.faces, **added}})})
    network = build_network(changed, old.heated)
    inputs = np.zeros((*drive.inputs.shape[:2], len(network.columns)))
    inputs[:, :, [network.columns.index(column) for column in old.columns]] = drive.inputs
    put_on(inputs, network.columns, seconds, dict.fromkeys(added, shone), drive.times)
    # The numbers of the faces stand between the others.
    places = np.array([network.position(path) for path in old.paths], dtype=np.int64)
    window = view.simulated_by(
        network=network,
        mapping=_moved(simulator.mapping, places, network.values),
        drive=replace(drive, inputs=inputs),
        channel_errors=places[simulator.channel_errors],
    )
    return replace(window, scenario=changed)


def conductors(view: View) -> Iterator[Wrong]:
    """Two nodes are linked that the scenario does not link; `prepared` gave them a link of nothing."""
    mapping, paths = view.network.mapping, view.network.network.paths
    values = [mapping.written[k] for k, path in enumerate(paths) if path.startswith("conductors.") and PIN not in path]
    known = [value for value in values if value > _NONE] or [1.0]
    unlinked = [
        k for k, path in enumerate(paths) if path.endswith(".conductance") and 0.0 < mapping.written[k] <= _NONE
    ]
    for k in unlinked:
        yield from _link(view, k, [float(np.median(known)) * size for size in (0.2, 1.0, 5.0)], 3.0 * len(unlinked))


def _link(view: View, place: int, sizes: Sequence[float], tries: float, near: bool = False) -> Iterator[Wrong]:
    mapping, path = view.network.mapping, view.network.network.paths[place]
    for size in sizes:
        values = mapping.written.copy()
        values[place] = size
        between = path.split(".")[1]
        words = Words(
            f"A conductor {between} is missing in the scenario",
            f"With {number(size, 2)} W/K between the two, the model explains the telemetry.",
            f"Add a conductor between {between.replace('-', ' and ')} to 'simulator: conductors'",
        )
        window = view.with_numbers(values)
        around = partial(_link, view, place, [size * 1.3**k for k in range(-3, 4)], tries, True)
        yield Wrong("link", between, words, window=window, tries=tries, closer=None if near else around)


def other_ends(view: View) -> Iterator[Wrong]:
    """A conductor ends at another node than the scenario says."""
    model, network, mapping = view.window.scenario.network, view.network.network, view.network.mapping
    number_of = {
        frozenset(conductor.between): f"conductors.{conductor.label}.conductance"
        for conductor in model.conductors
        if conductor.conductance is not None and PIN not in conductor.label
    }
    places = {pair: network.position(path) for pair, path in number_of.items()}
    nothing = [pair for pair, k in places.items() if 0.0 < mapping.written[k] <= _NONE]
    moves = [(pair, other) for pair in places for other in nothing if pair not in nothing and len(pair & other) == 1]
    for pair, other in moves:
        name, should = (number_of[ends].split(".")[1] for ends in (pair, other))
        (was,), (end,) = pair - other, other - pair
        words = Words(
            f"Conductor {name} is of {end}, not of {was}",
            f"With the conductor between {listed(sorted(other))}, the model explains the telemetry.",
            f"Correct 'between' of {name} in 'simulator: conductors'",
        )
        window = _exchanged(view, places[pair], places[other])
        yield Wrong("link", f"{name} {should}", words, window=window, tries=len(moves))


def _exchanged(view: View, one: int, other: int) -> Window:
    """The view's window with two numbers in each other's place, and what sets or scales them."""
    mapping = view.network.mapping
    places = np.arange(len(mapping.written))
    places[[one, other]] = other, one
    return view.simulated_by(mapping=_moved(mapping, places, mapping.written))


def _moved(mapping: ParameterMap, places: IntArray, values: FloatArray) -> ParameterMap:
    """The map where each number stands at another of `places`, among values that are written beside them."""
    numbers = values.copy()
    numbers[places] = mapping.written
    return mapping._replace(
        written=numbers,
        set_positions=places[mapping.set_positions],
        scaled_positions=places[mapping.scaled_positions],
    )


WRONGS = (conductors, other_ends, faces_left_out)
"""What looks for them."""
