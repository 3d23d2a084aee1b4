"""Names of things: they become parts of dotted paths and variables of netCDF files."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from ..document import Location, Problem
from ..reading import Reading
from ..units import show

_NAME = re.compile(r"[\w+-][\w+ -]*(?<! )")
_DIMENSIONS = ("chain", "draw")


def check(reading: Reading, folder: Path) -> Iterator[Problem]:
    """Every name can stand in a dotted path; a parameter is not called like a dimension of the results."""
    draft = reading.draft
    sections: dict[Location, list[str]] = {
        ("telemetry", "channels"): list(draft.channels),
        ("simulator", "nodes"): list(draft.nodes),
        ("simulator", "faces"): list(draft.faces),
        ("simulator", "heaters"): list(draft.heaters),
        ("simulator", "modes"): list(draft.modes),
        ("simulator", "loads"): list(draft.loads),
        ("parameters",): list(draft.parameters),
    }
    if draft.external is not None:
        for section in ("inputs", "outputs", "heaters"):
            sections["simulator", section] = list(getattr(draft.external, section))
    named = [((*section, name), name) for section, names in sections.items() for name in names]
    # A window of a group is called after both.
    named += [(("windows", name), part) for name in draft.windows for part in name.split(".", 1)]
    for k, conductor in enumerate(draft.conductors):
        if conductor is not None and conductor.name is not None:
            named.append((("simulator", "conductors", k, "name"), conductor.name))
    for location, name in named:
        if not _NAME.fullmatch(name):
            message = f"found the name {show(name)}, expected letters, digits, spaces, '_', '-' and '+' only"
            yield Problem(location, message)
    for name in _DIMENSIONS:
        if name in draft.parameters:
            yield Problem(
                ("parameters", name), f"found the name {name!r}, expected another: results use it for an axis"
            )
