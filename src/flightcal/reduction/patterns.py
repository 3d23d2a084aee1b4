"""Names of nodes: by pattern, and as a scenario allows them.

In a pattern `*` stands for any text, `?` for one character; brackets are part of the names of cells.
"""

from __future__ import annotations

import re
from collections.abc import Iterable


def matching(pattern: str, names: Iterable[str]) -> list[str]:
    """The names that fit, in their order."""
    expression = "".join({"*": ".*", "?": "."}.get(character, re.escape(character)) for character in pattern)
    fits = re.compile(expression).fullmatch
    return [name for name in names if fits(name)]


def has_wildcard(text: str) -> bool:
    """Whether it is a pattern rather than a name."""
    return "*" in text or "?" in text


def plain(name: str) -> str:
    """The name as a scenario's dotted paths allow it: ``bus.z-[0,3]`` is ``bus_z-_0_3``."""
    return re.sub(r"[^\w+-]+", "_", name).strip("_")
