"""A thermal network from plates: meshing, materials, insulation, conduction, and radiation between plates.

Plates are rectangles whose edges are parallel to the body axes; a box is six of them. Every cell of a plate's mesh is a
node, named ``plate[row,column]``. A side of a plate is outside (it sees space), in an enclosure (it exchanges heat with
all other sides of it, which nothing may stand between), or covered by insulation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np

from ..errors import FlightcalError
from ..scenario import Conductor, Face, Node
from ..simulator import DEEP_SPACE
from .view_factors import Array, Rectangles, gebhart_factors, view_factors

SPACE = "space"
"""Boundary node behind the openings of enclosures."""

_SAME_PLACE = 1e-9  # m
_MOST_SEEN = 1.0 + 1e-6
_LEAST_SHARE = 1e-4
"""Of what a cell emits: couplings that carry less than this are left out."""


@dataclass(frozen=True)
class Material:
    """What plates are made of."""

    conductivity: float
    """W/(m K), in the plane."""
    density: float
    """kg/m^3"""
    specific_heat: float
    """J/(kg K)"""


@dataclass(frozen=True)
class Coating:
    """A surface."""

    absorptivity: float
    emissivity: float


@dataclass(frozen=True)
class Insulation:
    """Multi-layer insulation over a side: its outer layer radiates to space and to the plate below."""

    effective_emissivity: float
    coating: Coating
    """Of the outer layer."""
    heat_capacity: float = 77.0
    """Of the outer layer, J/(m^2 K): 50 um of polyimide (1420 kg/m^3, 1090 J/(kg K)). Without one its temperature would
    jump by 200 K when the Sun comes up, farther than a step that solves linear equations can follow."""


@dataclass(frozen=True)
class Side:
    """One side of a plate."""

    coating: Coating
    enclosure: str | None = None
    """Which one it looks into; None: outside."""
    insulation: Insulation | None = None


@dataclass(frozen=True)
class Plate:
    """A rectangle with edges along the axes, and its mesh."""

    name: str
    corner: tuple[float, float, float]
    """With the smallest coordinates, m."""
    size: tuple[float, float, float]
    """Along x, y, z, m; exactly one is zero: the plate's normal."""
    thickness: float
    """m"""
    material: Material
    mesh: tuple[int, int]
    """Cells along the two edges, in the order of the axes."""
    positive: Side | None = None
    """The side towards larger coordinates; None: adiabatic."""
    negative: Side | None = None

    @property
    def axis(self) -> int:
        """0, 1 or 2: that of the normal."""
        return self.size.index(0.0)

    @property
    def edges(self) -> tuple[int, int]:
        """The axes of the two edges."""
        first, second = (k for k in range(3) if k != self.axis)
        return first, second


@dataclass(frozen=True)
class Joint:
    """Two plates that touch along an edge."""

    first: str
    second: str
    conductance: float
    """W/K for each metre of the edge."""


@dataclass(frozen=True)
class Mesh:
    """Blocks of a scenario's simulator, in SI units, so they are constructed without the reading of a file's text."""

    nodes: dict[str, Node]
    conductors: tuple[Conductor, ...]
    faces: dict[str, Face]
    openness: dict[str, float]
    """Enclosure -> largest share of a cell's view that meets none of its sides (0: closed), but space."""


def box(
    name: str,
    corner: tuple[float, float, float],
    size: tuple[float, float, float],
    *,
    thickness: float,
    material: Material,
    mesh: int,
    outside: Side,
    inside: Coating,
) -> list[Plate]:
    """The six plates of a box, ``name.x-`` to ``name.z+``, each of mesh x mesh cells; its inside is an enclosure."""
    plates = []
    inner = Side(inside, enclosure=name)
    for axis, letter in enumerate("xyz"):
        flat = tuple(0.0 if k == axis else size[k] for k in range(3))
        for sign in "-+":
            place = tuple(corner[k] + (size[k] if k == axis and sign == "+" else 0.0) for k in range(3))
            plates.append(
                Plate(
                    name=f"{name}.{letter}{sign}",
                    corner=place,  # type: ignore[arg-type]
                    size=flat,  # type: ignore[arg-type]
                    thickness=thickness,
                    material=material,
                    mesh=(mesh, mesh),
                    positive=outside if sign == "+" else inner,
                    negative=inner if sign == "+" else outside,
                )
            )
    return plates


def box_joints(name: str, conductance: float) -> list[Joint]:
    """The twelve edges of a box."""
    sides = [f"{name}.{letter}{sign}" for letter in "xyz" for sign in "-+"]
    return [Joint(a, b, conductance) for a, b in combinations(sides, 2) if a[-2] != b[-2]]


def mesh_plates(plates: Sequence[Plate], joints: Sequence[Joint] = ()) -> Mesh:
    """The nodes, conductors and faces of plates.

    Raises FlightcalError where a plate is not flat, a joint does not join, or the sides of an enclosure overlap.
    """
    for plate in plates:
        _check(plate)
    by_name = {plate.name: plate for plate in plates}
    nodes: dict[str, Node] = {}
    faces: dict[str, Face] = {}
    conductors: list[Conductor] = []
    for plate in plates:
        nodes |= _nodes(plate)
        conductors += _in_plane(plate)
        for sign, side in (("+", plate.positive), ("-", plate.negative)):
            if side is not None and side.enclosure is None:
                more_nodes, more_conductors, more_faces = _outside(plate, sign, side)
                nodes |= more_nodes
                conductors += more_conductors
                faces |= more_faces
    for joint in joints:
        for name in (joint.first, joint.second):
            if name not in by_name:
                raise FlightcalError(f"joint {joint.first}-{joint.second}: found no plate '{name}'")
        conductors += _joined(by_name[joint.first], by_name[joint.second], joint)
    openness = {}
    for enclosure in sorted({s.enclosure for p in plates for s in (p.positive, p.negative) if s and s.enclosure}):
        radiation, openness[enclosure] = _enclosed(plates, enclosure)
        conductors += radiation
    if any(SPACE in conductor.between for conductor in conductors):
        nodes[SPACE] = Node.model_construct(boundary=DEEP_SPACE)
    return Mesh(nodes, tuple(conductors), faces, openness)


def cell_names(plate: Plate) -> list[str]:
    """The plate's nodes, row by row: the first edge's cells outermost."""
    return [f"{plate.name}[{i},{j}]" for i in range(plate.mesh[0]) for j in range(plate.mesh[1])]


def _check(plate: Plate) -> None:
    if list(plate.size).count(0.0) != 1 or min(plate.size) < 0.0:
        raise FlightcalError(
            f"plate '{plate.name}': found size {plate.size} m, expected exactly one zero, along the normal"
        )
    if min(plate.mesh) < 1:
        raise FlightcalError(f"plate '{plate.name}': found a mesh of {plate.mesh}, expected at least one cell")


def _cells(plate: Plate, side: int) -> Rectangles:
    """The cells of one side, as `cell_names` orders them."""
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


def _nodes(plate: Plate) -> dict[str, Node]:
    width, height = _cell_size(plate)
    material = plate.material
    capacity = material.density * material.specific_heat * plate.thickness * width * height
    return {name: Node.model_construct(capacity=capacity) for name in cell_names(plate)}


def _in_plane(plate: Plate) -> list[Conductor]:
    names = np.array(cell_names(plate)).reshape(plate.mesh)
    width, height = _cell_size(plate)
    sheet = plate.material.conductivity * plate.thickness  # W/K of a square
    return [
        *(_conductor(a, b, sheet * height / width) for a, b in zip(names[:-1].flat, names[1:].flat, strict=True)),
        *(_conductor(a, b, sheet * width / height) for a, b in zip(names[:, :-1].flat, names[:, 1:].flat, strict=True)),
    ]


def _conductor(first: str, second: str, conductance: float) -> Conductor:
    return Conductor.model_construct(between=(str(first), str(second)), conductance=float(conductance))


def _outside(
    plate: Plate, sign: Literal["+", "-"] | str, side: Side
) -> tuple[dict[str, Node], list[Conductor], dict[str, Face]]:
    width, height = _cell_size(plate)
    area = width * height
    x, y, z = ((1.0 if sign == "+" else -1.0) if k == plate.axis else 0.0 for k in range(3))
    nodes: dict[str, Node] = {}
    conductors, faces = [], {}
    for name in cell_names(plate):
        surface, coating = name, side.coating
        if side.insulation is not None:
            surface, coating = f"{name}{sign}insulation", side.insulation.coating
            nodes[surface] = Node.model_construct(capacity=area * side.insulation.heat_capacity)
            conductors.append(
                Conductor.model_construct(
                    between=(name, surface), radiative=area * side.insulation.effective_emissivity
                )
            )
        faces[f"{name}{sign}"] = Face.model_construct(
            node=surface,
            area=area,
            normal=(x, y, z),
            absorptivity=coating.absorptivity,
            emissivity=coating.emissivity,
        )
    return nodes, conductors, faces


def _joined(first: Plate, second: Plate, joint: Joint) -> list[Conductor]:
    """Cells of both plates along their common edge: half a cell, the contact, half a cell in series."""
    if first.axis == second.axis:
        raise FlightcalError(f"joint {joint.first}-{joint.second}: found parallel plates, expected a common edge")
    along = 3 - first.axis - second.axis
    conductors = []
    ours, theirs = _cells(first, 1), _cells(second, 1)
    for k, name in enumerate(cell_names(first)):
        if not _touches(ours, k, second):
            continue
        for m, other in enumerate(cell_names(second)):
            overlap = min(ours.upper[k, along], theirs.upper[m, along]) - max(
                ours.lower[k, along], theirs.lower[m, along]
            )
            if overlap > _SAME_PLACE and _touches(theirs, m, first):
                resistance = 1.0 / (joint.conductance * overlap)
                for plate, cells, cell, across in ((first, ours, k, second.axis), (second, theirs, m, first.axis)):
                    half = 0.5 * (cells.upper[cell, across] - cells.lower[cell, across])
                    resistance += half / (plate.material.conductivity * plate.thickness * overlap)
                conductors.append(_conductor(name, other, 1.0 / resistance))
    if not conductors:
        raise FlightcalError(f"joint {joint.first}-{joint.second}: found no common edge")
    return conductors


def _touches(cells: Rectangles, k: int, plate: Plate) -> bool:
    """Whether an edge of cell k lies in the plate's plane, within the plate's reach across it."""
    plane = plate.corner[plate.axis]
    ends = (cells.lower[k, plate.axis], cells.upper[k, plate.axis])
    place = cells.lower[k, cells.axis]
    low = plate.corner[cells.axis]
    within = low - _SAME_PLACE <= place <= low + plate.size[cells.axis] + _SAME_PLACE
    return within and min(abs(end - plane) for end in ends) < _SAME_PLACE


def _enclosed(plates: Sequence[Plate], enclosure: str) -> tuple[list[Conductor], float]:
    """Radiation between all sides of an enclosure, and the largest share of a cell's view that meets none."""
    names: list[str] = []
    groups: list[Rectangles] = []
    emissivities: list[float] = []
    for plate in plates:
        for sign, side in ((1, plate.positive), (-1, plate.negative)):
            if side is not None and side.enclosure == enclosure:
                cells = cell_names(plate)
                names += cells
                groups.append(_cells(plate, sign))
                emissivities += [side.coating.emissivity] * len(cells)
    factors = np.block([[view_factors(first, second) for second in groups] for first in groups])
    seen = factors.sum(axis=1)
    if seen.max() > _MOST_SEEN:
        worst = int(np.argmax(seen))
        raise FlightcalError(
            f"enclosure '{enclosure}': found that '{names[worst]}' sees {seen[worst]:.3f} of its surroundings, "
            "expected at most 1: sides overlap, or stand behind one another"
        )
    emissivity, area = np.array(emissivities), np.concatenate([group.area for group in groups])
    shares = gebhart_factors(factors, emissivity)
    couplings: Array = emissivity[:, None] * area[:, None] * shares
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
