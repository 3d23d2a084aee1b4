"""Names of nodes as a scenario's dotted paths allow them."""

from __future__ import annotations

import re


def node_name(name: str) -> str:
    """The name as a scenario's dotted paths allow it: ``bus.z-[0,3]`` is ``bus_z-_0_3``."""
    return re.sub(r"[^\w+-]+", "_", name).strip("_")
