"""What the checks share: the form of a check, and sentences about names."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from pathlib import Path

from ..blocks import Blocks
from ..document import Problem
from ..reading import Reading
from ..units import did_you_mean, show

Check = Callable[[Reading, Path], Iterator[Problem]]
"""A check looks at what could be read of a scenario in a folder, and yields what is wrong."""


def unknown(what: str, name: str, names: Collection[str]) -> str:
    """Sentence about a name that nothing has."""
    if not names:
        return f"unknown {what} {show(name)}: the scenario has none"
    listed = ", ".join(list(names)[:8]) + (", ..." if len(names) > 8 else "")
    return f"unknown {what} {show(name)}, expected {listed}{did_you_mean(name, names)}"


def heated_node(blocks: Blocks, name: str, what: str) -> str | None:
    """What is wrong with `name` as the node that takes up heat from `what`, or None."""
    if name not in blocks.nodes:
        return unknown("node", name, blocks.nodes)
    node = blocks.nodes[name]
    if node is not None and node.boundary is not None:
        return f"found the boundary node {name!r}, expected a node that {what} can heat: its temperature is given"
    return None


def channel_of_kind(blocks: Blocks, name: str, kind: str) -> str | None:
    """What is wrong with `name` as the name of a channel of a kind, or None."""
    if name not in blocks.channels:
        of_kind = [other for other, channel in blocks.channels.items() if channel is None or channel.kind == kind]
        return unknown(f"{kind} channel", name, of_kind)
    channel = blocks.channels[name]
    if channel is not None and channel.kind != kind:
        return f"found {show(name)}, a {channel.kind} channel, expected a {kind} channel"
    return None
