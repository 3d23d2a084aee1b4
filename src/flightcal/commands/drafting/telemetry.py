"""The block `telemetry` of a draft."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .channels import Channel, text_of, texts_of

if TYPE_CHECKING:
    from ...telemetry import FoundColumn, FoundPacket

_EPOCH = np.datetime64("2000-01-01T12:00:00", "ns")
_RATES = (10, 100, 1000, 10_000, 100_000, 1_000_000, *(2**k for k in range(17)))
"""Hz, of clocks that count ticks."""
_LONGEST_COUNT = 4e9
"""s, of a clock that nothing else tells the rate of: some hundred years."""
_ABOUT = 0.15
_COLD, _WARM = -20, 60
"""degC, that stand for the lowest and the highest of raw readings."""
_GUESS = "  # PLACEHOLDER: a temperature by its values, not by its name"


def telemetry_block(folder: Path | None, names: Mapping[str, FoundPacket], channels: Sequence[Channel]) -> str:
    """The block for a scenario in a folder; null: with absolute paths."""
    lines = ["telemetry:"]
    single = len(names) == 1 and all(packet.sheet is None for packet in names.values())
    if not single:
        lines.append("  packets:                          # each has columns, sampling and a clock of its own")
    for name, packet in names.items():
        file = texts_of(
            [str(path.absolute()) if folder is None else os.path.relpath(path, folder) for path in packet.files]
        )
        sheet = f", sheet: {text_of(packet.sheet)}" if packet.sheet else ""
        header = f"header: {packet.header}" if packet.header else ""
        time = _time(packet, names)
        readings = ""
        if packet.readings is not None:
            found_readings = packet.readings
            readings = f"readings: {{name: {texts_of(found_readings.name)}, value: {text_of(found_readings.value)}}}"
        valid = ", ".join(f"{text_of(column)}: {text_of(word)}" for column, word in packet.valid_where.items())
        valid_where = f"valid_where: {{{valid}}}" if valid else ""
        comment = "" if packet.time is not None else "  # PLACEHOLDER: UTC at count 0, counts a second"
        if single:
            more = [f"  {key}" for key in (header, readings, valid_where) if key]
            lines += [f"  file: {file}", f"  time: {time}{comment}", *more]
        else:
            more = [f", {key}" for key in (header, readings, valid_where) if key]
            lines.append(f"    {name}: {{file: {file}{sheet}, time: {time}{''.join(more)}}}{comment}")
    lines += [
        "  channels:",
        "    # The name is yours. kind: temperature, status (on or off) or driver (measured input).",
    ]
    for channel in channels:
        packet_key = "" if single else f"packet: {channel.packet}, "
        unit = "" if channel.unit is None else f", unit: {text_of(channel.unit) if channel.unit != '1' else 1}"
        lines.append(
            f"    {channel.name}: {{{packet_key}column: {text_of(channel.column)}{unit}, kind: {channel.kind}"
            f"{_more(channel.found)}{_GUESS if channel.is_guess else ''}"
        )
    return "\n".join(lines) + "\n"


def _more(column: FoundColumn) -> str:
    """What says how a column is read, the bracket that ends it, and a comment."""
    if column.raw is not None:
        low, high = column.raw
        guess = f"[[{low:g}, {_COLD} degC], [{high:g}, {_WARM} degC]]"
        return f", curve: {guess}}}  # PLACEHOLDER: what the raw readings of {column.name} mean"
    if column.bit is not None:
        base = "" if column.base is None else f", base: {column.base}"
        return f", bits: {column.bit}{base}}}"
    if column.on_off is not None:
        on, off = map(text_of, column.on_off)
        return f", on: [{on}], off: [{off}]}}"
    return "}" if column.on_above is None else f", on_above: {column.on_above}}}"


def _time(packet: FoundPacket, names: Mapping[str, FoundPacket]) -> str:
    """The block `time` of a packet."""
    parts = [f"column: {texts_of(packet.clock)}"]
    if packet.time is None:
        rate = _rate(packet, names)
        parts += ["format: clock", f"epoch: {_epoch(packet, names, rate)}", f"rate: {rate} Hz"]
        parts += [f"fine: {packet.fine}"] if packet.fine else []
    else:
        parts.append(f"format: {text_of(packet.time.format)}")
        if packet.time.epoch is not None:
            per_day = 86400 * (packet.time.rate or 1.0)
            pace = "1 1/day" if round(per_day) == 1 else f"{per_day / 86400:g} Hz"
            parts += [f"epoch: {packet.time.epoch:%Y-%m-%dT%H:%M:%S}", f"rate: {pace}"]
        parts += ["leap_seconds: true"] if packet.time.leap_seconds else []
        marks = ", ".join(json.dumps(str(mark)) for mark in packet.time.invalid)
        parts += [f"invalid: [{marks}]"] if marks else []
    return f"{{{', '.join(parts)}}}"


def _epoch(packet: FoundPacket, names: Mapping[str, FoundPacket], rate: int) -> str:
    """A guess at a clock's epoch, with which it begins where the other packets do."""
    starts = [other.first for other in names.values() if other.time is not None]
    since = np.timedelta64(int(packet.first / rate), "s")
    epoch = _EPOCH if not starts else np.datetime64(int(max(starts)), "ns") - since
    return str(np.datetime_as_string(epoch, unit="s"))


def _rate(packet: FoundPacket, names: Mapping[str, FoundPacket]) -> int:
    """A guess at how often a clock counts a second: with it, it runs about as long as the other packets do."""
    longest = max((other.last - other.first for other in names.values() if other.time is not None), default=0.0) / 1e9
    if not longest:
        return next((rate for rate in sorted(_RATES) if packet.last / rate < _LONGEST_COUNT), max(_RATES))
    nearest = min(_RATES, key=lambda rate: abs(np.log((packet.last - packet.first) / rate / longest)))
    return nearest if abs(np.log((packet.last - packet.first) / nearest / longest)) < _ABOUT else 1
