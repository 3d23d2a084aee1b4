"""Packets and channels of telemetry files, each by a name that a scenario can have."""

from __future__ import annotations

import json
import re
import unicodedata
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from ...telemetry import FoundColumn, FoundPacket

_PLAIN = re.compile(r"[A-Za-z][\w.-]*( [A-Za-z][\w.-]*)*")
_WORDS = ("on", "off", "yes", "no", "true", "false", "null", "y", "n")
_LABELS = re.compile(r"\s*\{.*\}\s*$")
"""Of a dashboard's series, as in `EPS.battery_temp {sat="NIX-1"}`."""


class Channel(NamedTuple):
    """A column of a packet by the name that it has in the scenario."""

    name: str
    packet: str
    found: FoundColumn
    is_guess: bool = False
    """Whether it is a temperature by its values alone."""

    @property
    def column(self) -> str:
        """What the file calls it."""
        return self.found.name

    @property
    def kind(self) -> str:
        """`temperature`, `status` or `driver`."""
        return self.found.kind

    @property
    def unit(self) -> str | None:
        """Of its numbers; None of a status."""
        return self.found.unit


def packet_names(packets: Sequence[FoundPacket]) -> dict[str, FoundPacket]:
    """Packets by a name of their own: the sheet's, or the file's."""
    names: dict[str, FoundPacket] = {}
    for packet in packets:
        stem = packet.files[0].name.split(".")[0]
        names[_unique(slug(packet.sheet or stem), names)] = packet
    return names


def channels_of(names: Mapping[str, FoundPacket]) -> list[Channel]:
    """All columns of packets, which have these names."""
    taken: dict[str, object] = dict.fromkeys(("time", "channel", "flags", "finding", "rows", "masked", "space"))
    channels = []
    whole = {_title(column) for packet in names.values() for column in packet.columns}
    bare = Counter(_LABELS.sub("", title) for title in whole)
    for packet_name, packet in names.items():
        for column in packet.columns:
            bit, title = "" if column.bit is None else f"_{column.bit}", _title(column)
            short = _LABELS.sub("", title)
            name = _unique(f"{slug(short if bare[short] == 1 else title)}{bit}", taken)
            taken[name] = None
            channels.append(Channel(name, packet_name, column))
    return channels


def _title(column: FoundColumn) -> str:
    """What a column is called."""
    return column.called or column.name


def slug(text: str) -> str:
    """A name for YAML and dotted paths."""
    plain = "".join(one for one in unicodedata.normalize("NFKD", text) if not unicodedata.combining(one))
    name = re.sub(r"\W+", "_", plain.strip(), flags=re.ASCII).strip("_").lower()
    return name if name[:1].isalpha() and name not in _WORDS else f"c_{name}".rstrip("_")


def _unique(name: str, taken: Mapping[str, object]) -> str:
    number = 2
    found = name
    while found in taken:
        found, number = f"{name}_{number}", number + 1
    return found


def text_of(value: str) -> str:
    """Text as YAML has it inside of braces."""
    plain = _PLAIN.fullmatch(value) and value.lower() not in _WORDS
    return value if plain else json.dumps(value, ensure_ascii=False)


def texts_of(values: Sequence[str]) -> str:
    """One text, or a list of several."""
    return text_of(values[0]) if len(values) == 1 else f"[{', '.join(map(text_of, values))}]"
