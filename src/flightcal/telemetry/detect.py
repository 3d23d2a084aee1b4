"""What telemetry files seem to hold: their time columns, and a kind and unit for each other column."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Literal

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from ..errors import TelemetryError
from ..scenario import Channel, TimeColumn, is_temperature, si_unit
from ._times import Nanoseconds, is_text, parse_times
from ._values import is_status
from .readers import Source, locate, read_table, sheets

_UNIX: Final = ("unix", "unix-ms", "unix-us", "unix-ns")
_DAYS: Final = ("year-doy", "decimal-doy")
_FORMATS: Final = ("iso8601", *_DAYS, *_UNIX)
_LOOKED_AT = 1000
"""Rows that decide what a column is."""
_FIRST, _LAST = np.datetime64("1990-01-01", "ns").astype(np.int64), np.datetime64("2100-01-01", "ns").astype(np.int64)
"""A number is a UNIX time only between these."""
_OF_DAYS = r"^(\d{5}|\d{7}|\d{13})(\.\d+)?$"
"""Numbers that can be a year and a day of year; some have to tell more than the day."""
_HALF_A_DAY = 43_200_000_000_000
_LAST_DAY = np.datetime64("2036-01-01", "ns").astype(np.int64)
"""45352.5 is rather what a spreadsheet counts from 1900 than a day of 2045."""
_TIME_NAME = re.compile(r"(?i)time|date|utc|epoch|clock|sclk|stamp|(^|_)t(_|$)")
_CLOCK_NAME = re.compile(r"(?i)clock|sclk|scet|obt|met$|tick|time")
_STATUS_NAME = re.compile(r"(?i)htr|heater|status|state|switch|enable|(^|[_. ])(on|sw)($|[_. ])")
_TEMPERATURE_NAME = re.compile(r"(?i)temp|therm|^t$|^tt?[_.\d-]|[_. ]tt?\d*$|^pt\d|deg\.? ?c|°c")
# A last letter alone is more often the name of a branch than a unit.
_UNIT = re.compile(r"[\[(]\s*([^\[\]()]+?)\s*[\])]|[_ ](degC|mA|mV|mW|kW|deg)$")
_CELSIUS = {"c": "degC", "deg c": "degC", "deg. c": "degC", "degc": "degC", "°c": "degC", "celsius": "degC"}


@dataclass(frozen=True)
class FoundColumn:
    """A column that can be a channel."""

    name: str
    kind: Literal["temperature", "status", "driver"]
    unit: str | None
    """null: of a status."""


@dataclass(frozen=True)
class FoundPacket:
    """Files with the same columns, and what is in them."""

    files: tuple[Path, ...]
    sheet: str | None
    time: TimeColumn | None
    """null: `clock` counts from an epoch that only the user knows."""
    clock: str
    """Name of the time column."""
    first: float
    """The first time, ns since 1970; of a clock, the first count."""
    columns: tuple[FoundColumn, ...]


def detect(files: list[Path]) -> list[FoundPacket]:
    """The packets in telemetry files: those with the same columns are one, each sheet of a workbook is a file.

    Raises TelemetryError for a file that cannot be read, or in which no column has times.
    """
    found: list[FoundPacket] = []
    for file in files:
        packets = list(_packets(file))
        if not packets:
            raise TelemetryError(f"{file}: found no sheet with a column of times, expected one")
        for packet in packets:
            same = [k for k, other in enumerate(found) if _alike(packet, other)]
            if same:
                found[same[0]] = replace(found[same[0]], files=(*found[same[0]].files, *packet.files))
            else:
                found.append(packet)
    return found


def _alike(one: FoundPacket, other: FoundPacket) -> bool:
    same_columns = {column.name for column in one.columns} == {column.name for column in other.columns}
    return same_columns and (one.sheet, one.time, one.clock) == (other.sheet, other.time, other.clock)


def _packets(file: Path) -> Iterator[FoundPacket]:
    source = locate(file.parent, file.name)
    titles = sheets(source)
    if len(titles) < 2:
        yield _packet(file, source)
        return
    for title in titles:
        try:
            yield _packet(file, locate(file.parent, file.name, title))
        except TelemetryError:
            continue  # a workbook has sheets of other things, too


def _packet(file: Path, source: Source) -> FoundPacket:
    # The name of no column: what every column holds decides.
    table = read_table(source, "")
    names = [name for name in dict.fromkeys(table.column_names) if table.column_names.count(name) == 1 and name]
    head = table.select(names).slice(0, _LOOKED_AT)
    # A column called a time comes first.
    for name in sorted(names, key=lambda name: not _TIME_NAME.search(name)):
        cells = head[name]
        if _is_numeric(cells) and _TIME_NAME.search(name):
            cells = read_table(source, name)[name].slice(0, _LOOKED_AT)  # as it is written
        written = _time_format(name, head[name], cells, source)
        if written is None:
            continue
        times = None if written == "clock" else _times(cells, written, source)
        first = float(head[name][0].as_py() if times is None else times[0])
        others = [column for other in names if other != name and (column := _column(other, head[other], source))]
        time = TimeColumn.model_validate({"column": name, "format": written}) if written != "clock" else None
        return FoundPacket((file,), source.sheet, time, name, first, tuple(others))
    listed = ", ".join(names[:12])
    wanted = "UTC times, UNIX times, year and day of year, or a clock's counter"
    raise TelemetryError(f"{source.name}: found no column of times among {listed}, expected one with {wanted}")


def _time_format(name: str, column: pa.ChunkedArray, cells: pa.ChunkedArray, source: Source) -> str | None:
    """How the times in a column are written; null: it has none.

    cells: those of the column as they are written, where its name is that of a time.
    """
    numeric = _is_numeric(column)
    for written in _formats_of_numbers(cells) if numeric else _FORMATS:
        if (times := _times(cells, written, source)) is None:
            continue
        if written in _UNIX and not (numeric or _TIME_NAME.search(name)):
            continue
        if (numeric or written in _UNIX) and not (times.min() >= _FIRST and times.max() <= _LAST):
            continue
        if numeric and written in _DAYS and not _are_days(times):
            continue
        if len(np.unique(times)) > len(times) // 2:
            return written
    if numeric and _CLOCK_NAME.search(name) and column.null_count == 0:
        steps = np.diff(column.to_numpy())
        return "clock" if len(steps) and np.all(steps > 0) else None
    return None


def _formats_of_numbers(cells: pa.ChunkedArray) -> tuple[str, ...]:
    text = cells.cast(pa.string()).drop_null()
    days = pc.all(pc.match_substring_regex(text, _OF_DAYS)).as_py()
    return (*_DAYS, *_UNIX) if days and pc.any(pc.match_substring_regex(text, r"\.|\d{13}")).as_py() else _UNIX


def _are_days(times: Nanoseconds) -> bool:
    """Whether numbers that can be days are no counter."""
    return bool(times.max() < _LAST_DAY and np.median(np.abs(np.diff(times))) < _HALF_A_DAY)


def _is_numeric(column: pa.ChunkedArray) -> bool:
    return pa.types.is_integer(column.type) or pa.types.is_floating(column.type)


def _times(column: pa.ChunkedArray, written: str, source: Source) -> Nanoseconds | None:
    if column.null_count == len(column):
        return None
    try:
        return parse_times(column.drop_null(), TimeColumn.model_validate({"column": "", "format": written}), source)
    except TelemetryError:
        return None


def _column(name: str, column: pa.ChunkedArray, source: Source) -> FoundColumn | None:
    """What a column is; null: nothing that a channel can be, such as a second time or a comment."""
    if column.null_count == len(column):
        return None
    if is_text(column) or pa.types.is_boolean(column.type) or pa.types.is_dictionary(column.type):
        return FoundColumn(name, "status", None) if is_status(column, Channel(column=name, kind="status")) else None
    if not _is_numeric(column) or _time_format(name, column, column, source) is not None:
        return None
    values = column.drop_null().to_numpy()
    if _STATUS_NAME.search(name) and np.isin(values, (0, 1)).all():
        return FoundColumn(name, "status", None)
    unit = _unit(name)
    if unit is not None and is_temperature(unit):
        return FoundColumn(name, "temperature", unit)
    if unit is None and _TEMPERATURE_NAME.search(name):
        return FoundColumn(name, "temperature", "K" if np.median(values) > 150 else "degC")
    return FoundColumn(name, "driver", unit or "1")


def _unit(name: str) -> str | None:
    """The unit that stands in a column's name, in brackets or at its end; null: none does."""
    match = _UNIT.search(name)
    if match is None:
        return None
    text = match[1] or match[2]
    text = _CELSIUS.get(text.lower(), text)
    try:
        si_unit(text)
    except ValueError:
        return None
    return text
