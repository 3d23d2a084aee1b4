"""Plates and boxes in a scenario: the nodes, conductors and faces of their mesh, beside those that are written."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from .blocks import read_block
from .body import Body
from .document import Issue, Location, walk
from .external import is_external
from .fields import Block, keys_of
from .geometry import MeshError, mesh_plates
from .network import Node
from .units import Temperature
from .wording import UNREADABLE

CELL = re.compile(r"([\w+-][\w+ -]*)(\.[xyz][+-])?\[\d+,\d+\](?:[+-](?:insulation)?)?")
"""Name of a cell, its insulation or its face: ``plate[0,1]``, ``box.z-[0,1]+insulation``. Groups: of its plate or box,
side of the box."""
MESHED = (*keys_of(Body), "initial")
"""Keys of a simulator's block that are gone once its plates and boxes are meshed."""
_MOST_OPEN = 0.01
_SOMEWHERE = 290.0
"""K, where no initial temperature can be read."""


def with_mesh(data: Mapping[str, Any]) -> tuple[dict[str, Any], list[Issue]]:
    """The simulator's block of a scenario's data with the network of its plates and boxes in it.

    What is written of a cell or its face replaces what the mesh says of it. Where the plates cannot be meshed, every
    cell that the scenario names is there, but cannot be read.
    """
    simulator: dict[str, Any] = data["simulator"]
    # The file of a reduced model has all keys, empty.
    written = {key: simulator[key] for key in MESHED if simulator.get(key) not in (None, {}, [])}
    if not written or is_external(simulator):
        return simulator, []
    block = {key: value for key, value in simulator.items() if key not in written}
    if "reduced_model" in simulator:
        key = next(iter(written))
        return block, [Issue(("simulator", key), f"found {key!r} beside 'reduced_model', expected one of them")]
    problems: list[Issue] = []
    start = written.pop("initial", None)
    if start is not None:
        start = read_block(Temperature, start, ("simulator", "initial"), problems) or _SOMEWHERE
    body = read_block(Body, written, ("simulator",), problems)
    nodes, conductors, faces = _network(data, body, problems)
    if start is None and nodes:
        expected = "expected the temperature at which the cells of plates and boxes start, such as '20 degC'"
        problems.append(Issue(("simulator",), f"missing key 'initial', {expected}"))
    links = simulator.get("conductors", [])
    block["nodes"] = _started(_over(nodes, simulator.get("nodes", {})), start or _SOMEWHERE)
    block["conductors"] = [*links, *conductors] if isinstance(links, list) else links
    block["faces"] = _over(faces, simulator.get("faces", {}))
    return block, problems


def source(cell: str) -> Location | None:
    """Where the plate or box stands that a cell is of; null: the name is not that of a cell."""
    match = CELL.fullmatch(cell)
    return match and ("simulator", "boxes" if match[2] else "plates", match[1])


def _network(
    data: Mapping[str, Any], body: Body | None, problems: list[Issue]
) -> tuple[Mapping[str, Any], list[Any], Mapping[str, Any]]:
    """Nodes, conductors and faces; `problems` gets what is wrong with the plates."""
    if body is not None:
        try:
            mesh = mesh_plates(body)
        except MeshError as error:
            problems.append(Issue(("simulator", *error.location), error.message))
        else:
            for enclosure, share in mesh.openness.items():
                if share > _MOST_OPEN:
                    place = ("boxes", enclosure) if enclosure in body.boxes else ("plates",)
                    message = f"found an enclosure {enclosure!r} with up to {share:.0%} of a cell's view open to space"
                    message += ", expected sides all around it"
                    problems.append(Issue(("simulator", *place), message, warning=True))
            return mesh.nodes, list(mesh.conductors), mesh.faces
    texts = (str(text) for location, value in walk(dict(data)) for text in (value, *location[-1:]))
    cells = {match[0]: UNREADABLE for text in texts for match in CELL.finditer(text)}
    return cells, [UNREADABLE], cells


def _over(made: Mapping[str, Any], written: Any) -> Any:
    """Blocks by name, with what is written over those of the mesh."""
    if not isinstance(written, dict):
        return written
    return {**made, **{name: _merged(made.get(name), value) for name, value in written.items()}}


def _merged(made: Any, written: Any) -> Any:
    if not isinstance(made, Block) or not isinstance(written, dict):
        return written
    return {**made.model_dump(mode="json", exclude_none=True), **written}


def _started(nodes: Any, temperature: float) -> Any:
    """Nodes that start at a temperature (K) where they have a capacity and no other is written."""
    if not isinstance(nodes, dict):
        return nodes
    found = {}
    for name, node in nodes.items():
        if isinstance(node, Node) and node.capacity is not None:
            node = node.model_copy(update={"initial": temperature})
        elif isinstance(node, dict) and "capacity" in node:
            node = {"initial": f"{temperature!r} K", **node}
        found[name] = node
    return found
