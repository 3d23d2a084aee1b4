"""A thermal network from plates: meshing, materials, insulation, conduction, and radiation between plates.

Plates are rectangles whose edges are parallel to the body axes; a box is six of them. Every cell of a plate's mesh is a
node, named ``plate[row,column]``. A side of a plate is outside (it sees space), in an enclosure (it exchanges heat with
all other sides of it, which nothing may stand between), or covered by insulation.

NumPy is imported where it is used: to read a scenario must not wait for it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

from ..errors import FlightcalError
from .body import Body, Box, Joint, Material, Plate, Side
from .document import Location
from .network import DEEP_SPACE, Conductor, Face, Node
from .units import did_you_mean

if TYPE_CHECKING:
    from .view_factors import Rectangles

SPACE = "space"
"""Boundary node behind the openings of enclosures."""

_SAME_PLACE = 1e-9  # m
_MOST_SEEN = 1.0 + 1e-6
_LEAST_SHARE = 1e-4
"""Of what a cell emits: couplings that carry less than this are left out."""


class MeshError(FlightcalError):
    """Plates, boxes and nodes that do not fit together: `message`, and the `location` of what is wrong."""

    def __init__(self, location: Location, message: str) -> None:
        super().__init__(f"{'.'.join(map(str, location))}: {message}")
        self.location, self.message = location, message


@dataclass(frozen=True)
class Mesh:
    """Blocks of a scenario's simulator, in SI units, so they are constructed without the reading of a file's text."""

    nodes: dict[str, Node]
    conductors: tuple[Conductor, ...]
    faces: dict[str, Face]
    openness: dict[str, float]
    """Enclosure -> largest share of a cell's view that meets none of its sides (0: closed), but space."""


def box_plates(name: str, box: Box) -> dict[str, Plate]:
    """The six plates of a box, each of mesh x mesh cells."""
    plates = {}
    inner = Side(box.inside, enclosure=name)
    for axis, letter in enumerate("xyz"):
        x, y, z = (0.0 if k == axis else box.size[k] for k in range(3))
        for sign in "-+":
            corner = list(box.corner)
            corner[axis] += box.size[axis] if sign == "+" else 0.0
            plates[f"{name}.{letter}{sign}"] = Plate(
                corner=(corner[0], corner[1], corner[2]),
                size=(x, y, z),
                thickness=box.thickness,
                material=box.material,
                mesh=(box.mesh, box.mesh),
                positive=box.outside if sign == "+" else inner,
                negative=inner if sign == "+" else box.outside,
            )
    return plates


def box_joints(name: str, box: Box) -> list[Joint]:
    """The twelve edges of a box."""
    sides = [f"{name}.{letter}{sign}" for letter in "xyz" for sign in "-+"]
    return [Joint((a, b), box.joints) for a, b in combinations(sides, 2) if a[-2] != b[-2]]


def mesh_plates(body: Body) -> Mesh:
    """The nodes, conductors and faces of boxes and plates.

    Raises MeshError where something has no name that is known, a plate is not flat, a joint does not join, or the sides
    of an enclosure overlap.
    """
    _check_names(body)
    plates: dict[str, Plate] = {}
    joints: list[tuple[Location, Joint]] = []
    for name, box in body.boxes.items():
        if min(box.size) <= 0.0:
            raise MeshError(("boxes", name, "size"), f"found {_metres(box.size)}, expected three lengths above 0 m")
        plates |= box_plates(name, box)
        joints += [(("boxes", name, "joints"), joint) for joint in box_joints(name, box)]
    plates |= body.plates
    joints += [(("joints", k), joint) for k, joint in enumerate(body.joints)]
    for name, plate in plates.items():
        _check(name, plate)
    nodes: dict[str, Node] = {}
    faces: dict[str, Face] = {}
    conductors: list[Conductor] = []
    for name, plate in plates.items():
        cells, material = cell_names(name, plate), body.materials[plate.material]
        nodes |= _nodes(plate, material, cells)
        conductors += _in_plane(plate, material, cells)
        for sign, side in (("+", plate.positive), ("-", plate.negative)):
            if side is not None and side.enclosure is None:
                more_nodes, more_conductors, more_faces = _outside(body, plate, cells, sign, side)
                nodes |= more_nodes
                conductors += more_conductors
                faces |= more_faces
    for location, joint in joints:
        for name in joint.between:
            if name not in plates:
                raise MeshError((*location, "between"), f"found no plate '{name}'{did_you_mean(name, plates)}")
        conductors += _joined(body, plates, joint, location)
    openness = {}
    sides = [side for plate in plates.values() for side in (plate.positive, plate.negative) if side is not None]
    for enclosure in sorted({side.enclosure for side in sides if side.enclosure}):
        radiation, openness[enclosure] = _enclosed(body, plates, enclosure)
        conductors += radiation
    if any(SPACE in conductor.between for conductor in conductors):
        nodes[SPACE] = Node.model_construct(boundary=DEEP_SPACE)
    return Mesh(nodes, tuple(conductors), faces, openness)


def cell_names(name: str, plate: Plate) -> list[str]:
    """The nodes of a plate, row by row: the first edge's cells outermost."""
    return [f"{name}[{i},{j}]" for i in range(plate.mesh[0]) for j in range(plate.mesh[1])]


def _check_names(body: Body) -> None:
    """What plates, boxes and insulations say that they are made of is there."""
    boxes, plates = body.boxes.items(), body.plates.items()
    sides: list[tuple[Location, Side]] = [(("boxes", name, "outside"), box.outside) for name, box in boxes]
    for name, plate in plates:
        two = (("positive", plate.positive), ("negative", plate.negative))
        sides += [(("plates", name, key), side) for key, side in two if side]
    named: list[tuple[Location, str, str, Mapping[str, object]]] = [
        *((("boxes", name, "material"), "material", box.material, body.materials) for name, box in boxes),
        *((("plates", name, "material"), "material", plate.material, body.materials) for name, plate in plates),
        *((("boxes", name, "inside"), "coating", box.inside, body.coatings) for name, box in boxes),
        *(((*at, "coating"), "coating", side.coating, body.coatings) for at, side in sides),
        *(
            ((*at, "insulation"), "insulation", side.insulation, body.insulations)
            for at, side in sides
            if side.insulation
        ),
        *(
            (("insulations", k, "coating"), "coating", item.coating, body.coatings)
            for k, item in body.insulations.items()
        ),
    ]
    for location, kind, name, known in named:
        if name not in known:
            listed = ", ".join(sorted(known)) or f"one of '{kind}s', which are none"
            raise MeshError(location, f"found the {kind} '{name}', expected {listed}{did_you_mean(name, known)}")


def _check(name: str, plate: Plate) -> None:
    location = ("plates", name)
    if list(plate.size).count(0.0) != 1 or min(plate.size) < 0.0:
        expected = "expected exactly one zero, along the normal"
        raise MeshError((*location, "size"), f"found {_metres(plate.size)}, {expected}")


def _metres(size: Sequence[float]) -> str:
    return f"[{', '.join(f'{length:g} m' for length in size)}]"


def _cells(plate: Plate, side: int) -> Rectangles:
    """The cells of one side, as `cell_names` orders them."""
    import numpy as np

    from .view_factors import Rectangles

    a, b = plate.edges
    rows, columns = plate.mesh
    i, j = (index.ravel() for index in np.indices(plate.mesh))
    lower, upper = (np.tile(np.asarray(plate.corner, float), (rows * columns, 1)) for _ in range(2))
    lower[:, a] += plate.size[a] * i / rows
    upper[:, a] += plate.size[a] * (i + 1) / rows
    lower[:, b] += plate.size[b] * j / columns
    upper[:, b] += plate.size[b] * (j + 1) / columns
    return Rectangles(plate.axis, side, lower, upper)


def _cell_size(plate: Plate) -> tuple[float, float]:
    a, b = plate.edges
    return plate.size[a] / plate.mesh[0], plate.size[b] / plate.mesh[1]


def _nodes(plate: Plate, material: Material, cells: Sequence[str]) -> dict[str, Node]:
    width, height = _cell_size(plate)
    capacity = material.density * material.specific_heat * plate.thickness * width * height
    return {name: Node.model_construct(capacity=capacity) for name in cells}


def _in_plane(plate: Plate, material: Material, cells: Sequence[str]) -> list[Conductor]:
    import numpy as np

    names = np.array(cells).reshape(plate.mesh)
    width, height = _cell_size(plate)
    sheet = material.conductivity * plate.thickness  # W/K of a square
    return [
        *(_conductor(a, b, sheet * height / width) for a, b in zip(names[:-1].flat, names[1:].flat, strict=True)),
        *(_conductor(a, b, sheet * width / height) for a, b in zip(names[:, :-1].flat, names[:, 1:].flat, strict=True)),
    ]


def _conductor(first: str, second: str, conductance: float) -> Conductor:
    return Conductor.model_construct(between=(str(first), str(second)), conductance=float(conductance))


def _outside(
    body: Body, plate: Plate, cells: Sequence[str], sign: str, side: Side
) -> tuple[dict[str, Node], list[Conductor], dict[str, Face]]:
    width, height = _cell_size(plate)
    area = width * height
    x, y, z = ((1.0 if sign == "+" else -1.0) if k == plate.axis else 0.0 for k in range(3))
    insulation = body.insulations[side.insulation] if side.insulation else None
    coating = body.coatings[insulation.coating if insulation else side.coating]
    nodes: dict[str, Node] = {}
    conductors, faces = [], {}
    for name in cells:
        surface = name
        if insulation is not None:
            surface = f"{name}{sign}insulation"
            nodes[surface] = Node.model_construct(capacity=area * insulation.heat_capacity)
            radiative = area * insulation.effective_emissivity
            conductors.append(Conductor.model_construct(between=(name, surface), radiative=radiative))
        faces[f"{name}{sign}"] = Face.model_construct(
            node=surface,
            area=area,
            normal=(x, y, z),
            absorptivity=coating.absorptivity,
            emissivity=coating.emissivity,
        )
    return nodes, conductors, faces


def _joined(body: Body, plates: Mapping[str, Plate], joint: Joint, location: Location) -> list[Conductor]:
    """Cells of both plates along their common edge: half a cell, the contact, half a cell in series."""
    first, second = (plates[name] for name in joint.between)
    if first.axis == second.axis:
        raise MeshError(location, f"found parallel plates {' and '.join(joint.between)}, expected a common edge")
    along = 3 - first.axis - second.axis
    sheets = [body.materials[plate.material].conductivity * plate.thickness for plate in (first, second)]
    conductors = []
    ours, theirs = _cells(first, 1), _cells(second, 1)
    our_names, their_names = (cell_names(name, plates[name]) for name in joint.between)
    for k, name in enumerate(our_names):
        if not _touches(ours, k, second):
            continue
        for m, other in enumerate(their_names):
            overlap = min(ours.upper[k, along], theirs.upper[m, along]) - max(
                ours.lower[k, along], theirs.lower[m, along]
            )
            if overlap > _SAME_PLACE and _touches(theirs, m, first):
                resistance = 1.0 / (joint.conductance * overlap)
                for sheet, cells, cell, across in (
                    (sheets[0], ours, k, second.axis),
                    (sheets[1], theirs, m, first.axis),
                ):
                    half = 0.5 * (cells.upper[cell, across] - cells.lower[cell, across])
                    resistance += half / (sheet * overlap)
                conductors.append(_conductor(name, other, 1.0 / resistance))
    if not conductors:
        raise MeshError(location, f"found {' and '.join(joint.between)} without a common edge, expected one")
    return conductors


def _touches(cells: Rectangles, k: int, plate: Plate) -> bool:
    """Whether an edge of cell k lies in the plate's plane, within the plate's reach across it."""
    plane = plate.corner[plate.axis]
    ends = (cells.lower[k, plate.axis], cells.upper[k, plate.axis])
    place = cells.lower[k, cells.axis]
    low = plate.corner[cells.axis]
    within = low - _SAME_PLACE <= place <= low + plate.size[cells.axis] + _SAME_PLACE
    return within and min(abs(end - plane) for end in ends) < _SAME_PLACE


def _enclosed(body: Body, plates: Mapping[str, Plate], enclosure: str) -> tuple[list[Conductor], float]:
    """Radiation between all sides of an enclosure, and the largest share of a cell's view that meets none."""
    import numpy as np

    from .view_factors import gebhart_factors, view_factors

    names: list[str] = []
    groups: list[Rectangles] = []
    emissivities: list[float] = []
    for name, plate in plates.items():
        for sign, side in ((1, plate.positive), (-1, plate.negative)):
            if side is not None and side.enclosure == enclosure:
                cells = cell_names(name, plate)
                names += cells
                groups.append(_cells(plate, sign))
                emissivities += [body.coatings[side.coating].emissivity] * len(cells)
    factors = np.block([[view_factors(first, second) for second in groups] for first in groups])
    seen = factors.sum(axis=1)
    if seen.max() > _MOST_SEEN:
        worst = int(np.argmax(seen))
        raise MeshError(
            ("boxes", enclosure) if enclosure in body.boxes else ("plates",),
            f"found that '{names[worst]}' sees {seen[worst]:.3f} of its surroundings in the enclosure '{enclosure}', "
            "expected at most 1: sides overlap, or stand behind one another",
        )
    emissivity, area = np.array(emissivities), np.concatenate([group.area for group in groups])
    shares = gebhart_factors(factors, emissivity)
    couplings = emissivity[:, None] * area[:, None] * shares
    keep = np.maximum(shares, shares.T) > _LEAST_SHARE
    found: dict[tuple[str, str], float] = {}
    for i, j in zip(*np.nonzero(np.triu(keep, 1)), strict=True):
        if names[i] != names[j]:
            pair = (names[i], names[j])
            found[pair] = found.get(pair, 0.0) + 0.5 * float(couplings[i, j] + couplings[j, i])
    lost = np.maximum(1.0 - shares.sum(axis=1), 0.0)
    for i in np.flatnonzero(lost > _LEAST_SHARE):
        pair = (names[i], SPACE)
        found[pair] = found.get(pair, 0.0) + float(emissivity[i] * area[i] * lost[i])
    conductors = [
        Conductor.model_construct(between=pair, name=f"{pair[0]}~{pair[1]}", radiative=value)
        for pair, value in found.items()
    ]
    return conductors, float(max(1.0 - seen.min(), 0.0))
