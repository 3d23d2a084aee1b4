"""Unmodelled heat: which nodes can have it, and what it cannot stand beside."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from ..blocks import Blocks, readable
from ..document import Issue, Location
from ..reading import Reading
from ..residuals import Noise
from .common import channel_of_kind, known, node_with_capacity

_HEAT: Location = ("heat",)


def check(reading: Reading, folder: Path) -> Iterator[Issue]:
    """Nodes with heat hold heat, and nothing stands beside it that excludes it."""
    data, blocks = reading.document.data, reading.blocks
    if "heat" in data and data["heat"] is None:
        yield Issue(_HEAT, "found nothing, expected none or a mapping: without the key it has its default")
    if blocks.heat is None:
        return
    for what, wanted in _beside(blocks):
        yield Issue(_HEAT, f"found heat beside {what}, expected {wanted}, or 'heat: none'")
    # A reduced model's nodes are known where its file can be read.
    if blocks.external is None and (blocks.reduced is None or blocks.full_nodes):
        yield from _check_nodes(blocks, blocks.heat.nodes)
    if blocks.heat.pattern is not None and blocks.heat.pattern.over is not None:
        yield from channel_of_kind(blocks, blocks.heat.pattern.over, "driver", (*_HEAT, "pattern", "over"))


def _beside(blocks: Blocks) -> Iterator[tuple[str, str]]:
    """What excludes heat, and what it should be instead."""
    if blocks.external is not None:
        yield f"an external simulator ({blocks.external.kind})", "a thermal network: it needs nodes"
    if blocks.has_errors and blocks.reduced is None:
        yield "'simulator.errors'", "no errors: both explain the same"
    if blocks.discrepancy is not None:
        yield "'discrepancy'", "no discrepancy: both explain the same"
    for name, observation in readable(blocks.observations).items():
        noise = blocks.noise if observation.noise is None else observation.noise
        if observation.heater is None and isinstance(noise, Noise) and noise.not_normal:
            wanted = "normal noise (its weights can be integrated out only beside that)"
            yield f"{noise.not_normal} noise of {name!r}", wanted


def _check_nodes(blocks: Blocks, names: tuple[str, ...]) -> Iterator[Issue]:
    for k, name in enumerate(names):
        location = (*_HEAT, "nodes", k)
        if blocks.reduced is not None:
            yield from known("node of the full network", name, blocks.full_nodes, location)
        else:
            yield from node_with_capacity(blocks, name, location)
        if name in names[:k]:
            yield Issue(location, f"found {name!r} twice, expected it once")
