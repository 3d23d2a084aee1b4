"""What telemetry files seem to hold: their time columns, and a kind and unit for each other column."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import reduce
from itertools import chain, combinations
from operator import and_, itemgetter, or_
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd
import pyarrow as pa
from numpy.typing import NDArray

from ..errors import TelemetryError
from ..scenario import Channel, Readings, TimeColumn, is_temperature
from ._times import Nanoseconds, is_fill, is_text, time_cells
from ._units import known_unit
from ._values import NULL_WORDS, is_status, with_units
from .modes import FoundModes, activities_in, both, lasting, modes_in, start_and_end
from .read import without_empty_rows
from .readers import Parquet, Source, locate, read_table, sheets
from .readings import follows, names_of, typed
from .time_columns import LOOKED_AT, coarse_of, fine_of, is_called_time, is_numeric, is_second_time, time_of

_COUNTS = {"unix": "1 Hz", "unix-ms": "1000 Hz", "unix-us": "1000000 Hz", "unix-ns": "1000000000 Hz"}
"""Counts a second of the UNIX formats."""
_USUAL_EPOCHS = {
    "2000-01-01": False, "2000-01-01T12:00:00": False, "1980-01-06": True, "1958-01-01": True, "1998-01-01": False,
    "2001-01-01": False,
}  # fmt: skip
"""Of clocks of spacecraft, and whether they count leap seconds too."""
_DEEPEST_HEADER = 20
"""So far down a file's title may reach."""
_STATUS_NAME = re.compile(r"(?i)htr|heater|status|state|switch|enable|flag|ecl|umbra|(^|[_. ])(on|sw)($|[_. ])")
_HEATER_NAME = re.compile(
    r"(?i)(htr|heater).*(cur|amp|pow|_i\b|\b[mk]?[AW]\b|_[mk]?[AW]$)|(cur|pow|^[iIpP]_).*(htr|heater)"
)
"""Of a heater's current or power."""
_OF_HEATER = re.compile(r"(?i)htr|heat")
_ON_WORD = re.compile(r"(?i)^on|^heat|act|run|enab|clos|yes|true")
_OFF_WORD = re.compile(r"(?i)off|^no|idle|inact|st(an)?d?by|stop|cool|disab|open|false")
"""Words that a heater's status has; what looks like both is off, as INACTIVE is."""
_READING_NAME = re.compile(
    r"(?i)param|name|mnemonic|channel|sensor|signal|item|measur|field|series|point|variable|metric|key|tag"
)
_READING_VALUE = re.compile(r"(?i)value|reading|eng|cal|raw|result|^val")
_RAW = re.compile(r"(?i)[\W_]*raw$|^raw[\W_]*")
_MEANT = re.compile(r"(?i)[\W_]*(eng|cal|calibrated|value|val|conv)$|^(eng|cal)[\W_]+")
"""What tells a column of raw readings from that of what they mean."""
_UNITS = re.compile(r"(?i)^units?$")
"""Columns of a file with a row for each reading."""
_VALIDITY = re.compile(r"(?i)valid|quality")
_VALID = re.compile(r"(?i)^(valid|good|ok|nominal|yes|true)$")
"""Columns that say which rows are valid, and the words for it."""
_DATE_AT_END = re.compile(r"([\W_]+\d[\dTZ]*)+$")
_SAME_TIMES = 0.5
"""Of the shorter one's time: so much do two files with the same columns have in common that are of different things."""
_LEVELS = 5
"""A word of few bits, which has no unit, has fewer values."""
_TEMPERATURE_NAME = re.compile(
    r"(?i)temp|therm|thm|tmp|^t$|(^|\.)t[th]?[_.\d-]|^(ntc|rtd|prt)|[_. ]tt?\d*([_ /][ckf])?$|^pt\d|deg\.? ?c|°c"
    r"|^t(bat[a-z]*|obc|eps|pcb|cpu|pan[a-z]*|trx|rad[a-z]*|pay[a-z]*|cam|tank|[pm][xyz]|[xyz][pm])\d*$"
    r"|^t(pnl|panel|north|south|east|west|top|bottom|front|rear|zenith|nadir|str|struct|ccd|det|mli)(_?[a-z\d]{1,2})?$"
)
_THERMOCOUPLE_NAME = re.compile(r"(?i)^tc[_.\d-]")
"""Counters of telecommands are called so too, and are whole."""
_KELVIN_NAME = re.compile(r"[_ ./]K$")
_KELVINS = (150.0, 450.0)
"""Of a satellite: what ends in K and is between these is a temperature."""
_CELSIUSES = (-200.0, 200.0)
"""What is called a temperature, and is neither between these nor those, are raw readings."""
_WORD_NAME = re.compile(r"(?i)(htr|heater).*(word|bits|mask|flags)|(word|bits|mask|flags).*(htr|heater)")
_MAY_BE_WORD = re.compile(r"(?i)status|state|word|bits|mask|flags")
_WORDS = {0: re.compile(r"(?i)0x[0-9a-f]+|0b[01]+"), 10: re.compile("[0-9]+"), 16: re.compile(r"(?i)[0-9a-f]+")}
"""Words that are text, by the base of their digits; 0: they say it."""
_NO_STATE = 8
"""Bits that all values of a status have in common are those of a word from this on."""
_MOST_BITS = 8
"""Of a word that heaters switch; where more change, it is a counter."""
# A last letter alone is more often the name of a branch than a unit, but of what begins with a voltage or a power.
_UNIT = re.compile(
    r"[\[(]\s*([^\[\]()]+?)\s*[\])]|[_ ](degC|mA|mV|mW|kW|mK|AU|(?i:deg|degc|w_m2)|MA|MV)$"
    r"|^(?:V|U|VOLT[A-Z]*)_.*_(V)$|^(?:P|PWR|POW[A-Z]*)_.*_(W)$"
)
_AT_THE_END = {"ma": "mA", "mv": "mV", "deg": "deg", "w_m2": "W/m^2"}


@dataclass(frozen=True)
class FoundColumn:
    """A column that can be a channel."""

    name: str
    kind: Literal["temperature", "status", "driver"]
    unit: str | None
    """null: of a status that is no number."""
    on_above: str | None = None
    """Of a status that is a heater's current or power: between its two levels, with the unit."""
    on_off: tuple[str, str] | None = None
    """The word for on and that for off, of a heater's status with words of its own."""
    raw: tuple[float, float] | None = None
    """Lowest and highest of a temperature's readings that are no degC or K, such as counts of a converter."""
    bit: int | None = None
    """Of a status that is a bit of a word."""
    base: int | None = None
    """Of the word's digits, where they have no 0x and are not decimal."""
    called: str | None = None
    """What it is, where the name of its file says so and that of the column does not."""


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
            same = next((own for own in alike if all(_are_one(packet, other) for other in own)), None)
            if same is None:
                alike.append([packet])
            else:
                same.append(packet)
    found = [reduce(_together, own) for own in alike]
    return [_of_usual_epoch(packet, [own for own in found if own is not packet]) for packet in found]


def _of_usual_epoch(packet: FoundPacket, others: list[FoundPacket]) -> FoundPacket:
    """A packet whose UNIX times no other packet shares, as a clock of the usual epoch that brings it to the others."""

    def shared(first: float, last: float) -> float:
        known = [own for own in others if own.time is not None]
        return max((min(last, own.last) - max(first, own.first) for own in known), default=0.0)

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
        if isinstance(source.reader, Parquet):
            break
    if not found:
        assert refusal is not None  # nothing was found, and each time it was told why
        raise refusal
    return max(found, key=lambda packet: (_has_names(packet), len(packet.columns)))  # the first of equals


def _has_names(packet: FoundPacket) -> bool:
    """Whether what stands in the header are names, and not the numbers of a row."""
    return not any(re.match(r"[-+]?\.?\d", name) for name in (*packet.clock, *(own.name for own in packet.columns)))


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
        readings = _readings(table.drop_columns(list(found)), times)
        if readings is not None:
            return _packet_of_readings(file, source, time, times, table, readings, names_of(table, readings.name))
        alone = _alone(table.drop_columns(list(found)))
        if alone is not None:
            return _packet_of_one(file, source, time, times, table, alone)
    head, units = _below_units(table.slice(0, LOOKED_AT), time)
    valid_where = _valid_where(table)
    others = [name for name in names if name not in found and name not in valid_where]
    raw = [name for name in others if _meant_by(name, others)]
    others = [name for name in others if name not in raw]
    said = {name: units.get(name) or _fahrenheit(name, names) for name in others}
    columns = {name: _column(name, head[name], source, said[name]) for name in others}
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
        if column is not None and pa.types.is_integer(table[name].type) and _MAY_BE_WORD.search(name)
    ]
    written = without_empty_rows(read_table(source, words)) if words else table
    parts = {
        name: tuple(_parts(name, column, (written if name in words else table)[name]))
        for name, column in columns.items()
    }
    return FoundPacket(
        (file,),
        source.sheet,
        time,
        found,
        first,
        last,
        tuple(part for own in parts.values() for part in own),
        source.header,
        fine or None,
        (*raw, *(name for name, own in parts.items() if not own and head[name].null_count < len(head[name]))),
        modes,
        valid_where=valid_where,
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


def _readings(table: pa.Table, times: Nanoseconds) -> Readings | None:
    """The columns of a name and of its value, where a row holds one reading; null: a row holds all channels.

    The name stands in one column, or in two where one tells too little.
    """
    values = _values(table)
    if not values:
        return None
    texts = [name for name in table.column_names if is_text(table[name]) and name not in values]
    found = [
        (round(_share_told_twice(names, times), 2), len(columns), columns)
        for columns in chain(combinations(texts, 1), combinations(texts, 2))
        if any(map(_READING_NAME.search, columns)) and follows(names := names_of(table, columns), times)
    ]
    if not found:
        return None
    return Readings(name=min(found, key=itemgetter(0, 1))[2], value=_engineering(values))


def _meant_by(name: str, others: list[str]) -> bool:
    """Whether a column of raw readings has another one beside it that says what they mean."""
    plain = _RAW.sub("", name)
    return plain != name and any(_MEANT.sub("", other) == plain for other in others if other != name)


def _engineering(values: list[str]) -> str:
    """Of columns with a value, that of engineering values before that of raw ones."""
    return min(values, key=lambda name: bool(re.search(r"(?i)raw", name)))


def _values(table: pa.Table) -> list[str]:
    """The columns that are called as the value of a reading, and hold something."""
    columns = zip(table.column_names, table.columns, strict=True)
    return [name for name, own in columns if _READING_VALUE.search(name) and own.null_count < len(own)]


def _alone(table: pa.Table) -> tuple[str, str] | None:
    """The column of the one parameter in a file, and its name where a column has it, else ""; null: there are more."""
    values = [name for name in _values(table) if not (_TEMPERATURE_NAME.search(name) or _STATUS_NAME.search(name))]
    valid_where, names = _valid_where(table), []
    for name, column in zip(table.column_names, table.columns, strict=True):
        if name in values or name in valid_where or _UNITS.search(name) or column.null_count == len(column):
            continue
        told = column.unique().to_pylist()
        if len(told) > 1:
            return None
        if is_text(column) and _READING_NAME.search(name):
            names.append(str(told[0]).strip())
    return (_engineering(values), " ".join(names)) if values else None


def _valid_where(table: pa.Table) -> dict[str, str]:
    """The one column that says in words which rows are valid, and its word for it; else nothing."""
    found: dict[str, str] = {}
    for name, column in zip(table.column_names, table.columns, strict=True):
        if _VALIDITY.search(name) and (is_text(column) or pa.types.is_boolean(column.type)):
            words = [str(word).strip() for word in column.unique().drop_null().to_pylist()]
            found[name] = next(filter(_VALID.search, words), "")
    found = {name: word for name, word in found.items() if word}
    return found if len(found) == 1 else {}


def _share_told_twice(names: np.ndarray, times: Nanoseconds) -> float:
    """Of the readings, whose name has another one at the same time."""
    return float(pd.DataFrame({"name": names, "time": times}).duplicated().mean())


def _packet_of_readings(
    file: Path,
    source: Source,
    time: TimeColumn,
    times: Nanoseconds,
    table: pa.Table,
    readings: Readings,
    names: NDArray[np.object_],
) -> FoundPacket:
    units = next(filter(_UNITS.search, table.column_names), None)
    columns, left_out, modes = [], [], None
    for name in dict.fromkeys(names[names != ""].tolist()):
        rows = np.flatnonzero(names == name)
        own = pa.table({name: typed(table[readings.value].take(rows))})
        modes = modes or modes_in(own, [name], times[rows], alone=True)
        if modes is not None and modes.column == name:
            continue
        said = None if units is None else str(table[units][int(rows[0])].as_py() or "")
        column = _column(name, own[name].slice(0, LOOKED_AT), source, said)
        if column is not None:
            columns.append(column)
        else:
            left_out.append(name)
    return FoundPacket(
        (file,), source.sheet, time, time.column, float(times.min()), float(times.max()), tuple(columns), source.header,
        left_out=tuple(left_out), modes=modes, readings=readings, valid_where=_valid_where(table),
    )  # fmt: skip


def _packet_of_one(
    file: Path, source: Source, time: TimeColumn, times: Nanoseconds, table: pa.Table, alone: tuple[str, str]
) -> FoundPacket:
    """A file of one parameter, which is called as a column of it says, or else as the file."""
    value, name = alone
    called = name or _stem(file)
    readings = Readings(name=(value,), value=value)
    names = np.full(len(table), called, dtype=object)
    packet = _packet_of_readings(file, source, time, times, table, readings, names)
    columns = tuple(replace(column, name=value, called=called) for column in packet.columns)
    return replace(packet, columns=columns, left_out=tuple(value for _ in packet.left_out), readings=None)


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


def _column(name: str, column: pa.ChunkedArray, source: Source, said: str | None = None) -> FoundColumn | None:
    """What a column is; null: nothing that a channel can be, such as a second time or a comment.

    said: its unit, where a row below the header has units, or is in degF by its name.
    """
    if column.null_count == len(column):
        return None
    if is_text(column) and (found := with_units(column)) is not None:
        column, said = found
    if is_text(column) or pa.types.is_boolean(column.type) or pa.types.is_dictionary(column.type):
        if is_status(column, Channel(column=name, kind="status")):
            return FoundColumn(name, "status", None)
        own = _on_off(column) if _OF_HEATER.search(name) else None
        return None if own is None else FoundColumn(name, "status", None, on_off=own)
    if not is_numeric(column) or is_second_time(name, column, source):
        return None
    values = column.drop_null().to_numpy()
    values = values[np.isfinite(values)]
    if not len(values):
        return None
    if _STATUS_NAME.search(name) and np.isin(values, (0, 1)).all():
        return FoundColumn(name, "status", None)
    unit = known_unit(said or "") or _unit(name)
    if unit is not None and is_temperature(unit):
        return FoundColumn(name, "temperature", unit)
    middle = float(np.median(values))
    in_kelvins = _KELVINS[0] < middle < _KELVINS[1]
    named = _TEMPERATURE_NAME.search(name) or (in_kelvins and _KELVIN_NAME.search(name))
    if unit is None and (named or (_THERMOCOUPLE_NAME.search(name) and (values % 1.0).any())):
        if not in_kelvins and not _CELSIUSES[0] < middle < _CELSIUSES[1]:
            low, high = np.quantile(values, (0.02, 0.98))
            return FoundColumn(name, "temperature", None, raw=(float(low), float(max(high, low + 1.0))))
        return FoundColumn(name, "temperature", "K" if in_kelvins else "degC")
    if _HEATER_NAME.search(name) and (level := _between_levels(values, unit)) is not None:
        return FoundColumn(name, "status", unit or "1", f"{level:.3g} {unit or ''}".strip())
    return FoundColumn(name, "driver", unit or "1")


def _parts(name: str, column: FoundColumn | None, cells: pa.ChunkedArray) -> Iterator[FoundColumn]:
    """Each bit of a word that changes; else the column itself, if it can be a channel."""
    words, base = _words(name, cells) if column is None or column.kind == "driver" else (None, None)
    changing: list[int] = []
    if words:
        changed = reduce(or_, words) ^ reduce(and_, words)
        changing = [bit for bit in range(changed.bit_length()) if changed >> bit & 1]
    if 0 < len(changing) <= _MOST_BITS:
        yield from (FoundColumn(name, "status", None, bit=bit, base=base) for bit in changing)
    elif column is not None:
        yield column


def _words(name: str, cells: pa.ChunkedArray) -> tuple[list[int] | None, int | None]:
    """A column's different words, and the base of their digits where these do not tell it; null: none.

    Numbers are words by the column's name, which of a status is enough where a bit is always set that is not one of the
    lowest: states are counted from 0 or 1. Text is also where it begins with 0x or 0b.
    """
    named = _WORD_NAME.search(name)
    if named and pa.types.is_integer(cells.type):
        return list(lasting(cells.drop_null().to_pylist())), None
    found = list(lasting(_told(cells)))
    for base, shape in _WORDS.items() if named else ((0, _WORDS[0]),):
        if found and all(shape.fullmatch(cell) for cell in found):
            return [int(cell, base) for cell in found], base if base == 16 else None
    if _MAY_BE_WORD.search(name) and found and all(_WORDS[10].fullmatch(cell) for cell in found):
        words = [int(cell) for cell in found]
        return (words if reduce(and_, words) >= _NO_STATE else None), None
    return None, None


def _told(cells: pa.ChunkedArray) -> list[str]:
    """What stands in the cells of a text column that say something; empty: it is none."""
    read = [cell.strip() for cell in cells.drop_null().to_pylist()] if is_text(cells) else []
    return [cell for cell in read if cell not in NULL_WORDS]


def _between_levels(values: NDArray[np.float64], unit: str | None) -> float | None:
    """The middle between the two levels of a current that is on or off; null: it has not two."""
    found = np.unique(values)
    if len(found) < (_LEVELS if unit is None else 2) or found[-1] <= 0:
        return None
    gaps = np.diff(found)
    widest = int(np.argmax(gaps))
    return float(found[widest] + gaps[widest] / 2) if gaps[widest] > 0.5 * (found[-1] - found[0]) else None


def _on_off(cells: pa.ChunkedArray) -> tuple[str, str] | None:
    """The word for on and that for off, of a column with two words; null: what they mean is not plain."""
    words = set(_told(cells))
    off = {word for word in words if _OFF_WORD.search(word)}
    on = {word for word in words - off if _ON_WORD.search(word)}
    return (min(on), min(off)) if len(words) == 2 and on and off else None


def _unit(name: str) -> str | None:
    """The unit that stands in a column's name, in brackets or at its end; null: none does."""
    match = _UNIT.search(name)
    if match is None:
        return None
    in_brackets, *at_the_end = match.groups()
    found = in_brackets or next(filter(None, at_the_end))
    return known_unit(found if in_brackets else _AT_THE_END.get(found.lower(), found))


def _fahrenheit(name: str, names: list[str]) -> str | None:
    """The unit of a temperature whose name ends in F, where no other differs from it in this letter alone."""
    if not _TEMPERATURE_NAME.search(name) or not re.search(r"(?i)[_. ]f$", name):
        return None
    branches = [other for other in names if other[:-1] == name[:-1] and other[-1:].isalpha()]
    return "degF" if len(branches) == 1 else None
