"""What the checks share: the form of a check, and sentences about names."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterator
from pathlib import Path

from ..blocks import Blocks
from ..document import Issue, Location
from ..reading import Reading
from ..units import did_you_mean, show

Check = Callable[[Reading, Path], Iterator[Issue]]
"""A check looks at what could be read of a scenario in a folder, and yields what is wrong."""


def unknown(what: str, name: str, names: Collection[str]) -> str:
    """Sentence about a name that nothing has."""
    if not names:
        return f"unknown {what} {show(name)}: the scenario has none"
    listed = ", ".join(list(names)[:8]) + (", ..." if len(names) > 8 else "")
    return f"unknown {what} {show(name)}, expected {listed}{did_you_mean(name, names)}"


def known(what: str, name: str, names: Collection[str], location: Location) -> Iterator[Issue]:
    """Something has the name."""
    if name not in names:
        yield Issue(location, unknown(what, name, names))


def heated_node(blocks: Blocks, name: str, what: str, location: Location) -> Iterator[Issue]:
    """The node of this name can take up heat from `what`."""
    yield from known("node", name, blocks.nodes, location)
    node = blocks.nodes.get(name)
    if node is not None and node.boundary is not None:
        found = f"found the boundary node {name!r}, expected a node that {what} can heat"
        yield Issue(location, f"{found}: its temperature is given")


def node_with_capacity(blocks: Blocks, name: str, location: Location) -> Iterator[Issue]:
    """The node of this name holds heat."""
    yield from known("node", name, blocks.nodes, location)
    node = blocks.nodes.get(name)
    if node is not None and node.capacity is None:
        yield Issue(location, f"found {name!r}, a node without a capacity, expected one with a capacity")


def channel_of_kind(blocks: Blocks, name: str, kind: str, location: Location) -> Iterator[Issue]:
    """The channel of this name is of a kind."""
    of_kind = [other for other, channel in blocks.channels.items() if channel is None or channel.kind == kind]
    channel = blocks.channels.get(name)
    if name not in blocks.channels:
        yield Issue(location, unknown(f"{kind} channel", name, of_kind))
    elif channel is not None and channel.kind != kind:
        yield Issue(location, f"found {show(name)}, a {channel.kind} channel, expected a {kind} channel")


def file_exists(folder: Path, name: str, wanted: str, location: Location) -> Iterator[Issue]:
    """The file is there."""
    if not os.path.isfile(folder / name):  # unlike Path's, False for a name that no file can have
        found = "a folder" if os.path.isdir(folder / name) else "no such file"
        yield Issue(location, f"found {found} at {show(name)}, expected {wanted} relative to the scenario")
