"""What telemetry files seem to hold: packets, their time columns, and a channel or modes in each other column."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import reduce
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ..errors import TelemetryError
from ..scenario import Readings, TimeColumn
from ._times import Nanoseconds, is_fill, time_cells
from .columns import FoundColumn, column_of, fahrenheit, may_be_word, parts_of
from .layout import is_meant_by, one_parameter, readings_of, units_column, valid_where
from .modes import FoundModes, activities_in, both, modes_in, start_and_end
from .read import without_empty_rows
from .readers import Source, locate, read_table, sheets
from .readings import names_of, typed
from .time_columns import LOOKED_AT, coarse_of, fine_of, is_called_time, time_of

_COUNTS = {"unix": "1 Hz", "unix-ms": "1000 Hz", "unix-us": "1000000 Hz", "unix-ns": "1000000000 Hz"}
"""Counts a second of the UNIX formats."""
_USUAL_EPOCHS = {
    "2000-01-01": False, "2000-01-01T12:00:00": False, "1980-01-06": True, "1958-01-01": True, "1998-01-01": False,
    "2001-01-01": False,
}  # fmt: skip
"""Of clocks of spacecraft, and whether they count leap seconds too."""
_DEEPEST_HEADER = 20
"""So far down a file's title may reach."""
_DATE_AT_END = re.compile(r"([\W_]+\d[\dTZ]*)+$")
_SAME_TIMES = 0.5
"""Of the shorter one's time: so much do two files with the same columns have in common that are of different things."""


@dataclass(frozen=True)
class FoundPacket:
    """Files with the same columns, and what is in them."""

    files: tuple[Path, ...]
    sheet: str | None
    time: TimeColumn | None
    """null: `clock` counts from an epoch that only the user knows."""
    clock: tuple[str, ...]
    """Names of the time columns."""
    first: float
    last: float
    """The first and the last time, ns since 1970; of a clock, counts (of its coarse part)."""
    columns: tuple[FoundColumn, ...]
    header: int | None = None
    """Number of the line or row with the columns' names; null: the first."""
    fine: int | None = None
    """A guess at how many counts of a clock's fine part are one of its coarse; null: it has no fine part."""
    left_out: tuple[str, ...] = ()
    """Names of columns that hold something, but nothing that a channel can be."""
    modes: FoundModes | None = None
    """Of the satellite, where a column tells them."""
    readings: Readings | None = None
    """Of a file with a row for each reading, whose names then stand in `columns`."""
    valid_where: dict[str, str] = field(default_factory=dict)
    """A column that says which rows are valid, and its word for it."""


def detect(files: list[Path]) -> list[FoundPacket]:
    """The packets in telemetry files: each sheet of a workbook is a file.

    Files with the same columns are one packet, but where they are of the same time: these are of different things.

    Raises TelemetryError for a file that cannot be read, or in which no column has times.
    """
    alike: list[list[FoundPacket]] = []
    for file in files:
        packets = list(_packets(file))
        if not packets:
            raise TelemetryError(f"{file}: found no sheet with a column of times, expected one")
        for packet in packets:
            same = next((packets for packets in alike if all(_are_one(packet, other) for other in packets)), None)
            if same is None:
                alike.append([packet])
            else:
                same.append(packet)
    found = [reduce(_together, packets) for packets in alike]
    return [_of_usual_epoch(packet, [other for other in found if other is not packet]) for packet in found]


def _of_usual_epoch(packet: FoundPacket, others: list[FoundPacket]) -> FoundPacket:
    """A packet whose UNIX times no other packet shares, as a clock of the usual epoch that brings it to the others."""

    def shared(first: float, last: float) -> float:
        known = [packet for packet in others if packet.time is not None]
        return max((min(last, packet.last) - max(first, packet.first) for packet in known), default=0.0)

    if packet.time is None or packet.time.format not in _COUNTS or shared(packet.first, packet.last) > 0.0:
        return packet

    def since(epoch: str) -> tuple[float, float]:
        zero = float(np.datetime64(epoch, "ns").astype(np.int64))
        return packet.first + zero, packet.last + zero

    epoch = max(_USUAL_EPOCHS, key=lambda epoch: shared(*since(epoch)))
    first, last = since(epoch)
    if shared(first, last) <= 0.0:
        return packet
    time = TimeColumn.model_validate({
        "column": packet.time.column, "format": "clock", "epoch": epoch, "rate": _COUNTS[packet.time.format],
        "leap_seconds": _USUAL_EPOCHS[epoch] or None, "invalid": packet.time.invalid,
    })  # fmt: skip
    return replace(packet, time=time, first=first, last=last)


def _kind(packet: FoundPacket) -> tuple[object, ...]:
    """What files of one packet have in common."""
    written = packet.time and packet.time.format
    # What files of one parameter are called may end in a date.
    columns = {(column.name, _DATE_AT_END.sub("", column.called or "")) for column in packet.columns}
    return columns, written, packet.sheet, packet.header, packet.clock


def _are_one(packet: FoundPacket, other: FoundPacket) -> bool:
    """Whether files have the same columns, of other times."""
    shared = min(packet.last, other.last) - max(packet.first, other.first)
    shorter = min(packet.last - packet.first, other.last - other.first)
    return _kind(packet) == _kind(other) and shared <= _SAME_TIMES * shorter


def _together(one: FoundPacket, other: FoundPacket) -> FoundPacket:
    """Files of one packet, with the marks of both."""
    time = one.time
    if time is not None and other.time is not None:
        time = time.model_copy(update={"invalid": tuple(dict.fromkeys((*time.invalid, *other.time.invalid)))})
    first, last = min(one.first, other.first), max(one.last, other.last)
    files, modes = (*one.files, *other.files), both(one.modes, other.modes)
    return replace(one, files=files, time=time, first=first, last=last, modes=modes)


def _packets(file: Path) -> Iterator[FoundPacket]:
    source = locate(file.parent, file.name)
    titles = sheets(source)
    if len(titles) < 2:
        yield _packet_below_title(file, source)
        return
    for title in titles:
        try:
            yield _packet_below_title(file, locate(file.parent, file.name, title))
        except TelemetryError:
            continue  # a workbook has sheets of other things, too


def _packet_below_title(file: Path, source: Source) -> FoundPacket:
    """What is in a file whose header is its first row, or else one of those below a title: that with most columns."""
    found: list[FoundPacket] = []
    refusal: TelemetryError | None = None
    for header in (None, *range(2, _DEEPEST_HEADER + 1)):
        try:
            packet = _packet(file, replace(source, header=header))
        except TelemetryError as error:
            refusal = refusal or error
            continue
        is_whole = packet.columns and not (packet.time and packet.time.invalid)
        if header is None and (is_whole or (packet.modes and packet.modes.of_activities)):
            return packet  # no row looks like the end of a title
        found.append(packet)
        if not source.reader.has_header:
            break
    if not found:
        assert refusal is not None  # nothing was found, and each time it was told why
        raise refusal
    return max(found, key=lambda packet: (_has_names(packet), len(packet.columns)))  # the first of equals


def _has_names(packet: FoundPacket) -> bool:
    """Whether what stands in the header are names, and not the numbers of a row."""
    return not any(
        re.match(r"[-+]?\.?\d", name) for name in (*packet.clock, *(column.name for column in packet.columns))
    )


def _packet(file: Path, source: Source) -> FoundPacket:
    # The name of no column: what every column holds decides.
    table = without_empty_rows(read_table(source, ()))
    names = [name for name in dict.fromkeys(table.column_names) if table.column_names.count(name) == 1 and name]
    time, times = time_of(table.select(names), names, source)
    fine = None
    if time is None:
        clock, fine = next(
            ((name, fine) for name in names if (fine := fine_of(name, table[name])) is not None), ("", None)
        )
        if fine is None:
            listed = ", ".join(names[:12])
            wanted = "UTC times, UNIX times, year and day of year, or a clock's counter"
            likely = next((name for name in names if is_called_time(name)), None)
            holds = "" if likely is None else f"; '{likely}' holds '{table[likely][0].as_py()}'"
            raise TelemetryError(
                f"{source.name}: found no column of times among {listed}, expected one with {wanted}{holds}"
            )
        counts = coarse_of(table[clock])
        first, last = float(counts.min()), float(counts.max())
    else:
        first, last = float(times.min()), float(times.max())
    found = (clock,) if time is None else time.column
    if time is not None and len(times) == len(table):
        activities = _activities(table, names, time, times, source)
        if activities is not None:
            return FoundPacket((file,), source.sheet, time, found, first, last, (), source.header, modes=activities)
        readings = readings_of(table.drop_columns(list(found)), times)
        if readings is not None:
            packet = _packet_of_names(file, source, time, times, table, readings.value, names_of(table, readings.name))
            return replace(packet, readings=readings)
        alone = one_parameter(table.drop_columns(list(found)))
        if alone is not None:
            return _packet_of_one(file, source, time, times, table, alone)
    head, units = _below_units(table.slice(0, LOOKED_AT), time)
    validity = valid_where(table)
    others = [name for name in names if name not in found and name not in validity]
    raw = [name for name in others if is_meant_by(name, others)]
    others = [name for name in others if name not in raw]
    said = {name: units.get(name) or fahrenheit(name, names) for name in others}
    columns = {name: column_of(name, head[name], source, said[name]) for name in others}
    modes = None
    if time is not None and len(times) == len(table):
        free = [name for name, column in columns.items() if column is None or column.kind == "driver"]
        modes = modes_in(table, free, times, alone=len(others) == 1)
    if modes is not None:
        del columns[modes.column]
    # A number such as 0x41 is read as 65.
    words = [
        name
        for name, column in columns.items()
        if column is not None and pa.types.is_integer(table[name].type) and may_be_word(name)
    ]
    written = without_empty_rows(read_table(source, words)) if words else table
    parts = {
        name: tuple(parts_of(name, column, (written if name in words else table)[name]))
        for name, column in columns.items()
    }
    return FoundPacket(
        (file,),
        source.sheet,
        time,
        found,
        first,
        last,
        tuple(part for group in parts.values() for part in group),
        source.header,
        fine or None,
        (*raw, *(name for name, group in parts.items() if not group and head[name].null_count < len(head[name]))),
        modes,
        valid_where=validity,
    )


def _activities(
    table: pa.Table, names: list[str], time: TimeColumn, times: Nanoseconds, source: Source
) -> FoundModes | None:
    """Modes of a log with a row for each activity; null: the table is none."""
    column = time.column[0]
    for other in names:
        is_end, is_start = start_and_end(column, other), start_and_end(other, column)
        if other in time.column or not (is_end or is_start):
            continue
        second, beside = time_of(table.select([other]), [other], source)
        if second is not None and len(beside) == len(times):
            pair = (column, other, times, beside) if is_end else (other, column, beside, times)
            return activities_in(table, *pair)
    return None


def _packet_of_names(
    file: Path,
    source: Source,
    time: TimeColumn,
    times: Nanoseconds,
    table: pa.Table,
    value: str,
    names: NDArray[np.object_],
) -> FoundPacket:
    """A file whose column `value` holds what is called so, row by row [T]."""
    units = units_column(table)
    columns, left_out, modes = [], [], None
    for name in dict.fromkeys(names[names != ""].tolist()):
        rows = np.flatnonzero(names == name)
        part = pa.table({name: typed(table[value].take(rows))})
        modes = modes or modes_in(part, [name], times[rows], alone=True)
        if modes is not None and modes.column == name:
            continue
        said = None if units is None else str(table[units][int(rows[0])].as_py() or "")
        column = column_of(name, part[name].slice(0, LOOKED_AT), source, said)
        if column is not None:
            columns.append(column)
        else:
            left_out.append(name)
    return FoundPacket(
        (file,), source.sheet, time, time.column, float(times.min()), float(times.max()), tuple(columns), source.header,
        left_out=tuple(left_out), modes=modes, valid_where=valid_where(table),
    )  # fmt: skip


def _packet_of_one(
    file: Path, source: Source, time: TimeColumn, times: Nanoseconds, table: pa.Table, alone: tuple[str, str]
) -> FoundPacket:
    """A file of one parameter, which is called as a column of it says, or else as the file."""
    value, name = alone
    called = name or _stem(file)
    packet = _packet_of_names(file, source, time, times, table, value, np.full(len(table), called, dtype=object))
    columns = tuple(replace(column, name=value, called=called) for column in packet.columns)
    return replace(packet, columns=columns, left_out=tuple(value for _ in packet.left_out))


def _stem(file: Path) -> str:
    """A file's name without what says its kind."""
    return file.name.removesuffix(".gz").rpartition(".")[0]


def _below_units(table: pa.Table, time: TimeColumn | None) -> tuple[pa.Table, dict[str, str]]:
    """The rows with a time, and units that a row without one has above them."""
    if time is None or not time.invalid:
        return table, {}
    fill = is_fill(time_cells(table, time), time)
    above = table.slice(0, 1).to_pylist()[0].items() if fill[0] else ()
    units = {name: cell for name, cell in above if isinstance(cell, str)}
    kept = table.take(np.flatnonzero(~fill))
    return pa.table({name: typed(column) for name, column in zip(kept.column_names, kept.columns, strict=True)}), units
