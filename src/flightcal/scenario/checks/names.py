"""Names of things: they become parts of dotted paths and variables of netCDF files."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ..document import Issue, Location
from ..meshed import CELL
from ..reading import Reading
from ..units import show

_NAME = re.compile(r"[\w+-][\w+ -]*(?<! )")
_CONDUCTORS: Location = ("simulator", "conductors")
_DIMENSIONS = ("chain", "draw")


def check(reading: Reading, folder: Path) -> Iterator[Issue]:
    """Every name can stand in a dotted path; a parameter is not called like a dimension of the results."""
    blocks = reading.blocks
    sections: dict[Location, list[str]] = {
        ("telemetry", "channels"): list(blocks.channels),
        ("parameters",): list(blocks.parameters),
    }
    external = ("inputs", "outputs", "heaters")
    for section in external if blocks.external else ("nodes", "faces", "heaters", "modes", "loads"):
        sections["simulator", section] = list(getattr(blocks.external or blocks, section))
    named = [((*section, name), name) for section, names in sections.items() for name in names]
    # A window of a group is called after both, with a dot between them.
    named += [(("windows", name), part) for name in blocks.windows for part in name.split(".", 1)]
    named += [(("windows", name), name) for name in _keys(reading.document.data, "windows")]
    for k, conductor in enumerate(blocks.conductors):
        if conductor is not None and conductor.name is not None:
            named.append(((*_CONDUCTORS, k, "name"), conductor.name))
    simulator = reading.document.data.get("simulator")
    named += [(("simulator", key, name), name) for key in ("boxes", "plates") for name in _keys(simulator, key)]
    for location, name in named:
        # What is meshed from plates has names with brackets, and conductors that radiate are called after both ends.
        may_be_cell = location[:2] in (("simulator", "nodes"), ("simulator", "faces"), _CONDUCTORS)
        parts = name.split("~") if location[:2] == _CONDUCTORS else [name]
        if not all(_NAME.fullmatch(part) or (may_be_cell and CELL.fullmatch(part)) for part in parts):
            message = f"found the name {show(name)}, expected letters, digits, spaces, '_', '-' and '+' only"
            yield Issue(location, message)
    for name in _DIMENSIONS:
        if name in blocks.parameters:
            yield Issue(("parameters", name), f"found the name {name!r}, expected another: results use it for an axis")


def _keys(block: Any, key: str) -> list[str]:
    """Names in a mapping of a block, as the file has them."""
    found = block.get(key) if isinstance(block, dict) else None
    return [name for name in found if isinstance(name, str)] if isinstance(found, dict) else []
