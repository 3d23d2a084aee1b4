"""What the checks share: the form of a check, and sentences about names."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import TypeVar

from ..blocks import Draft
from ..document import Problem
from ..reading import Reading
from ..units import did_you_mean, show

Check = Callable[[Reading, Path], Iterator[Problem]]
"""A check looks at what could be read of a scenario in a folder, and yields what is wrong."""

T = TypeVar("T")


def readable(blocks: Mapping[str, T | None]) -> dict[str, T]:
    """The blocks that could be read."""
    return {name: block for name, block in blocks.items() if block is not None}


def unknown(what: str, name: str, names: Collection[str]) -> str:
    """Sentence about a name that nothing has."""
    if not names:
        return f"unknown {what} {show(name)}: the scenario has none"
    listed = ", ".join(list(names)[:8]) + (", ..." if len(names) > 8 else "")
    return f"unknown {what} {show(name)}, expected {listed}{did_you_mean(name, names)}"


def heated_node(draft: Draft, name: str, what: str) -> str | None:
    """What is wrong with `name` as the node that takes up heat from `what`, or None."""
    if name not in draft.nodes:
        return unknown("node", name, draft.nodes)
    node = draft.nodes[name]
    if node is not None and node.boundary is not None:
        return f"found the boundary node {name!r}, expected a node that {what} can heat: its temperature is given"
    return None


def channel_of_kind(draft: Draft, name: str, kind: str) -> str | None:
    """What is wrong with `name` as the name of a channel of a kind, or None."""
    if name not in draft.channels:
        of_kind = [other for other, channel in draft.channels.items() if channel is None or channel.kind == kind]
        return unknown(f"{kind} channel", name, of_kind)
    channel = draft.channels[name]
    if channel is not None and channel.kind != kind:
        return f"found {show(name)}, a {channel.kind} channel, expected a {kind} channel"
    return None
