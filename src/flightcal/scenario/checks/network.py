"""The thermal network: conductors, faces and nodes that fit together."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from ..blocks import Blocks, readable
from ..document import Issue, Location
from ..network import Conductor, Node
from ..reading import Reading
from ..units import celsius, show
from .common import channel_of_kind, heated_node, known

_CONDUCTORS: Location = ("simulator", "conductors")
_USUAL_TEMPERATURES = (173.15, 373.15)
"""K, from -100 to 100 degC."""


def check(reading: Reading, folder: Path) -> Iterator[Issue]:
    """Conductors and faces touch nodes that exist; every temperature is determined."""
    blocks = reading.blocks
    yield from _check_conductors(blocks)
    yield from _check_faces(blocks)
    yield from _check_links(blocks)
    if blocks.reduced is None:
        yield from _check_arithmetic(blocks)
    yield from _check_temperatures(blocks)


def _check_conductors(blocks: Blocks) -> Iterator[Issue]:
    labels = set()
    for k, conductor in enumerate(blocks.conductors):
        if conductor is None:
            continue
        if conductor.label in labels:
            message = f"found a second conductor called {conductor.label!r}, expected a 'name' that tells them apart"
            yield Issue((*_CONDUCTORS, k), message)
        labels.add(conductor.label)
        location = (*_CONDUCTORS, k, "between")
        for name in dict.fromkeys(conductor.between):
            yield from known("node", name, blocks.nodes, location)
        yield from _check_slope(conductor, "conductance", (*_CONDUCTORS, k), "the ends")
        first, second = conductor.between
        if first == second:
            yield Issue(location, f"found {show(first)} twice, expected two different nodes")
        elif all((node := blocks.nodes.get(name)) and node.boundary is not None for name in conductor.between):
            message = f"found the boundary nodes {first!r} and {second!r}, expected one whose temperature can change"
            yield Issue(location, message)


def _check_slope(block: Conductor | Node, key: str, location: Location, what: str) -> Iterator[Issue]:
    """A number that depends on temperature stays positive at usual ones."""
    slope = getattr(block, f"{key}_slope") or 0.0
    for temperature in _USUAL_TEMPERATURES:
        if 1.0 + slope * (temperature - block.written_at) < 0.0:
            message = f"found a slope with which the {key} is below zero at {celsius(temperature)}"
            message += f", expected one that keeps it positive where {what} may be"
            yield Issue((*location, f"{key}_slope"), message, warning=True)


def _check_faces(blocks: Blocks) -> Iterator[Issue]:
    environment = blocks.environment
    for name, face in readable(blocks.faces).items():
        location = ("simulator", "faces", name)
        yield from heated_node(blocks, face.node, "sunlight", (*location, "node"))
        node = blocks.nodes.get(face.node)
        if node is not None and node.arithmetic:
            # Its temperature jumps by 200 K when the Sun comes up, farther than the linear equations of a step follow.
            message = f"found the arithmetic node {face.node!r}, expected one with the heat capacity of its outer layer"
            yield Issue((*location, "node"), f"{message} (50 um of polyimide: 77 J/K for each m^2)")
        if environment is not None and environment.orbit is None:
            yield Issue(location, "found a face without an orbit, expected 'orbit' in environment to light it")


def _check_links(blocks: Blocks) -> Iterator[Issue]:
    """A node holds heat, and it can leave every one that does. (A reduced order model has its links inside.)"""
    if blocks.reduced is not None:
        return
    if blocks.nodes and not any(node is None or node.capacity is not None for node in blocks.nodes.values()):
        message = "found no node with a capacity, expected one: without it nothing holds heat"
        yield Issue(("simulator", "nodes"), message)
    if None in blocks.conductors or None in blocks.faces.values():
        return
    linked = {name for conductor in blocks.conductors if conductor is not None for name in conductor.between}
    linked |= {face.node for face in readable(blocks.faces).values()}
    for name, node in readable(blocks.nodes).items():
        if node.capacity is not None and name not in linked:
            message = "found a node without conductor or face, expected one: its heat cannot leave"
            yield Issue(("simulator", "nodes", name), message, warning=True)


def _check_arithmetic(blocks: Blocks) -> Iterator[Issue]:
    """A massless node takes the temperature of what it is linked to: something with a temperature of its own."""
    if None in blocks.conductors:
        return
    links = [conductor for conductor in blocks.conductors if isinstance(conductor, Conductor)]
    massless = {name for name, node in readable(blocks.nodes).items() if node.arithmetic}
    determined = set(blocks.nodes) - massless
    while True:
        reached = {
            name
            for link in links
            for name, other in (link.between, link.between[::-1])
            if name in massless - determined and other in determined
        }
        if not reached:
            break
        determined |= reached
    for name in blocks.nodes:
        if name in massless - determined:
            message = "found an arithmetic node without a conductor to a node with a capacity or a boundary"
            yield Issue(("simulator", "nodes", name), f"{message}, expected one")


def _check_temperatures(blocks: Blocks) -> Iterator[Issue]:
    """Given temperatures are measured; initial ones are measured or written, and belong to nodes that can have one."""
    observations = blocks.observations.values()
    observed: dict[str | None, list[str]] = {}
    for channel, observation in readable(blocks.observations).items():
        observed.setdefault(observation.node, []).append(channel)
    twice = [f"{' and '.join(names)} observe '{node}'" for node, names in observed.items() if node and len(names) > 1]
    hint = f"; {', '.join(twice)}: is one of them of this node?" if twice else ""
    for name, node in readable(blocks.nodes).items():
        location = ("simulator", "nodes", name)
        yield from _check_slope(node, "capacity", location, "the node")
        if isinstance(node.boundary, str):
            yield from channel_of_kind(blocks, node.boundary, "temperature", (*location, "boundary"))
        if node.capacity is None and node.initial is not None:
            kind = "an arithmetic" if node.arithmetic else "a boundary"
            yield Issue((*location, "initial"), f"found 'initial' for {kind} node, expected it for a capacity only")
        if node.capacity is not None and node.initial is None and name not in observed and None not in observations:
            message = "missing key 'initial': no channel observes this node, so its initial temperature is not known"
            yield Issue(location, message + hint)
