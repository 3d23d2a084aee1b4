"""Time stamps as text or numbers -> nanoseconds UTC since 1970."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial

import erfa
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ..errors import TelemetryError
from ..scenario import TimeColumn
from ._doy import UNREADABLE, decimal_day, year_and_day
from .clean import Nanoseconds
from .readers import Source

_EARLIEST = np.datetime64("1957-10-04", "ns").astype(np.int64)
_FINE = ("unix-ms", "unix-us", "unix-ns")
_EARLIEST_FINE = np.datetime64("1973-01-01", "ns").astype(np.int64)
"""Of these formats: what is earlier counts coarser units."""
_LATEST = np.datetime64("2150-01-01", "ns").astype(np.int64)
_ZONE = r"[T ]\d{2}.*([zZ]|[+-]\d{2}(:?\d{2})?)$"
_NOON = datetime(2024, 3, 1, 12, 0, 0, 500_000, tzinfo=UTC)
_DECIMAL_COMMA = (r"(:\d{2}),(\d+)", r"\1.\2")
"""Pattern and replacement of a comma before fractions of a second."""
_HEXADECIMAL = r"0[xX][0-9a-fA-F]{1,15}"
_COARSE_FINE = r"^(?:1/)?(?P<coarse>\d+)\s*[:., -]\s*(?P<fine>\d+)$"
"""As SPICE writes them, of the first partition."""
_EXAMPLES = {
    "iso8601": "ISO 8601 such as 2024-03-01T12:00:00.5Z",
    "unix": "UNIX seconds such as 1709294400.5",
    "unix-ms": "UNIX milliseconds such as 1709294400500",
    "unix-us": "UNIX microseconds such as 1709294400500000",
    "unix-ns": "UNIX nanoseconds such as 1709294400500000000",
    "year-doy": "year and day of year such as 2024-061T12:00:00.5",
    "decimal-doy": "year, day of year and its fraction such as 24061.50000000",
    "clock": "a counter such as 762609605.5",
}


def time_cells(table: pa.Table, time: TimeColumn) -> pa.ChunkedArray:
    """The time column; several joined with spaces."""
    if len(time.column) == 1:
        return table[time.column[0]]
    parts = [_part(table[name]) for name in time.column]
    if time.format == "year-doy":
        # Else a month and a day could follow on the year.
        parts[1] = pc.replace_substring_regex(parts[1], r"^(\d{2})$", r"0\1")
    return pc.binary_join_element_wise(*parts, " ")


def _part(column: pa.ChunkedArray) -> pa.ChunkedArray:
    """One of several time columns as text; numbers with the zeros that they lack in a column of their own."""
    if pa.types.is_timestamp(column.type):
        column = pc.strftime(column, "%Y-%m-%d")  # a date, as a spreadsheet has it
    return pc.replace_substring_regex(_trimmed(column), r"^(\d)(\.\d*)?$", r"0\1\2")


def is_fill(cells: pa.ChunkedArray, time: TimeColumn) -> NDArray[np.bool_]:
    """Where [T] a mark stands in the place of a time."""
    text = pc.fill_null(_trimmed(cells), "")
    return pc.is_in(text, value_set=pa.array([str(mark).strip() for mark in time.invalid], pa.string())).to_numpy()


def parse_times(column: pa.ChunkedArray, time: TimeColumn, source: Source) -> Nanoseconds:
    """Times [T] of a column that is written as `time` says, ns since 1970, UTC.

    Raises TelemetryError that names the first line whose time is empty, not of this format, or outside 1957
    to 2150, or has a time zone where others have none.
    """
    times = readable_times(column, time, source)
    bad = times == UNREADABLE
    if bad.any():
        raise _unreadable(column, time, source, int(np.argmax(bad)), int(bad.sum()))
    if time.format == "iso8601" and is_text(column):
        _check_zones(column, source)
    return times


def readable_times(column: pa.ChunkedArray, time: TimeColumn, source: Source) -> Nanoseconds:
    """As `parse_times`, and UNREADABLE where a cell is no time that is believed."""
    written = time.format
    if pa.types.is_dictionary(column.type):
        column = column.cast(column.type.value_type)
    if pa.types.is_timestamp(column.type) or pa.types.is_date(column.type):
        unit = getattr(column.type, "unit", "s")
        times = _nanoseconds(column.to_pandas().to_numpy(dtype=f"datetime64[{unit}]"))
    elif is_text(column) or pa.types.is_integer(column.type) or pa.types.is_floating(column.type):
        times = _clock(column, time) if written == "clock" else _parser(written)(column)
    else:
        raise TelemetryError(f"{source.name}: found times of type {column.type}, expected {_example(written)}")
    return np.where((times < _earliest(written)) | (times > _LATEST), UNREADABLE, times)


def _iso8601(column: pa.ChunkedArray) -> Nanoseconds:
    text = _trimmed(column)
    text = pc.replace_substring_regex(text, r"\s*(UTC|GMT)$", "Z")
    text = pc.replace_substring_regex(text, *_DECIMAL_COMMA)
    # A run of digits is a number of seconds that pandas would take for a year.
    text = pc.if_else(pc.match_substring_regex(text, r"^-?(\d{1,7}|\d{9,})(\.\d*)?$"), None, text)
    parsed = pd.to_datetime(text.to_numpy(zero_copy_only=False), format="ISO8601", utc=True, errors="coerce")
    return _nanoseconds(parsed.tz_localize(None).to_numpy())


def _patterned(column: pa.ChunkedArray, pattern: str) -> Nanoseconds:
    trimmed = _trimmed(column)
    if "," not in pattern:
        trimmed = pc.replace_substring_regex(trimmed, *_DECIMAL_COMMA)
    text = trimmed.to_numpy(zero_copy_only=False)
    parsed = pd.to_datetime(text, format=pattern, utc=True, errors="coerce")
    return _nanoseconds(parsed.tz_localize(None).to_numpy())


def _unix(column: pa.ChunkedArray, rate: float = 1.0) -> Nanoseconds:
    """Counts since 1970, `rate` a second."""
    if is_text(column):
        text = pd.Series(_trimmed(column).to_numpy(zero_copy_only=False))
        counts = pd.to_numeric(text, errors="coerce").to_numpy(float, copy=True)
        for row in np.flatnonzero(text.str.fullmatch(_HEXADECIMAL, na=False)):
            counts[row] = int(text[row], 16)
    else:
        counts = pc.cast(column, pa.float64(), safe=False).to_numpy(zero_copy_only=False)
    seconds = counts / rate
    seconds = np.where(np.abs(seconds) < 9e9, seconds, np.nan)
    whole = np.floor(np.nan_to_num(seconds))
    # A double holds today's UNIX time to 0.24 microseconds.
    microseconds = np.round((np.nan_to_num(seconds) - whole) * 1e6)
    nanoseconds = (whole.astype(np.int64) * 1_000_000 + microseconds.astype(np.int64)) * 1000
    return np.where(np.isnan(seconds), UNREADABLE, nanoseconds)


def _clock(column: pa.ChunkedArray, time: TimeColumn) -> Nanoseconds:
    """Counts of a spacecraft's clock since its epoch."""
    assert time.epoch is not None  # the schema wants it
    epoch = int(np.datetime64(time.epoch, "ns").astype(np.int64))
    elapsed = _unix(column if time.fine is None else _counts(column, time.fine), time.rate or 1.0)
    times = np.where(elapsed == UNREADABLE, 0, elapsed) + epoch
    if time.leap_seconds:
        since, leaps = _leap_seconds()
        before = np.searchsorted(since, epoch, side="right")
        # A leap second lies at the end of its day, so each count is held against where UTC then has got to.
        passed = np.searchsorted(since + (leaps[1:] - leaps[before]) * 1_000_000_000, times, side="right")
        times = times - (leaps[passed] - leaps[before]) * 1_000_000_000
    return np.where(elapsed == UNREADABLE, UNREADABLE, times)


def _counts(column: pa.ChunkedArray, fine: int) -> pa.ChunkedArray:
    """Counts of the coarse part of a clock, with the fine part as a fraction; null where a cell has not both."""
    parts = pc.extract_regex(_trimmed(column), _COARSE_FINE)
    coarse, ticks = (pc.cast(pc.struct_field(parts, name), pa.float64()) for name in ("coarse", "fine"))
    return pc.add(coarse, pc.divide(pc.if_else(pc.less(ticks, fine), ticks, None), float(fine)))


def _leap_seconds() -> tuple[Nanoseconds, NDArray[np.int64]]:
    """When (ns since 1970, UTC) the leap seconds [L] after 1972 had passed, and how many there were [L + 1]."""
    table = erfa.leap_seconds.get()
    table = table[table["year"] * 12 + table["month"] > 1972 * 12 + 1]
    months = (table["year"].astype(np.int64) - 1970) * 12 + table["month"] - 1
    since = months.astype("datetime64[M]").astype("datetime64[ns]").astype(np.int64)
    return since, np.arange(len(since) + 1)


_PARSERS: dict[str, Callable[[pa.ChunkedArray], Nanoseconds]] = {
    "iso8601": _iso8601,
    "unix": _unix,
    "unix-ms": partial(_unix, rate=1e3),
    "unix-us": partial(_unix, rate=1e6),
    "unix-ns": partial(_unix, rate=1e9),
    "year-doy": year_and_day,
    "decimal-doy": decimal_day,
}


def _parser(written: str) -> Callable[[pa.ChunkedArray], Nanoseconds]:
    return _PARSERS.get(written) or partial(_patterned, pattern=written)


def _example(written: str) -> str:
    """What is expected of a time, with an example."""
    return _EXAMPLES.get(written) or f"'{written}' such as {_NOON.strftime(written)}"


def _unreadable(column: pa.ChunkedArray, time: TimeColumn, source: Source, row: int, rows: int) -> TelemetryError:
    written = time.format
    value = column[row].as_py()
    where = source.place(row)
    if value is None:
        return TelemetryError(f"{where}: found no time, expected {_example(written)}")
    cell = pa.chunked_array([[str(value)]])
    others = [
        name for name, parse in _PARSERS.items() if name != written and _earliest(name) <= parse(cell)[0] <= _LATEST
    ]
    hint = f"; format: {others[0]} would read it" if others else ""
    found = f"found the time '{value}'{more_rows(rows)}"
    if time.fine is not None:
        wanted = f"a coarse count and a fine one below {time.fine}, such as 515721623:{time.fine // 2}"
        return TelemetryError(f"{where}: {found}, expected {wanted}, that give a time up to 2150")
    if written == "clock":
        if pc.match_substring_regex(cell, _COARSE_FINE)[0].as_py():
            hint = "; 'fine' says how many counts of the fine part are one of the coarse"
        hint = f" after the epoch {time.epoch:%Y-%m-%dT%H:%M:%S}{hint}"
        return TelemetryError(f"{where}: {found}, expected {_example(written)} that gives a time up to 2150{hint}")
    first = np.datetime64(int(_earliest(written)), "ns").astype("datetime64[Y]")
    return TelemetryError(f"{where}: {found}, expected {_example(written)}, between {first} and 2150{hint}")


def _earliest(written: str) -> np.int64:
    """The earliest time (ns) that is believed of a format."""
    return _EARLIEST_FINE if written in _FINE else _EARLIEST


def _check_zones(column: pa.ChunkedArray, source: Source) -> None:
    text = pc.replace_substring_regex(_trimmed(column), r"\s*(UTC|GMT)$", "Z")
    zoned = pc.match_substring_regex(text, _ZONE).to_numpy(zero_copy_only=False).astype(bool)
    if zoned.any() and not zoned.all():
        odd = int(np.argmax(zoned != zoned[0]))
        with_zone, without = (0, odd) if zoned[0] else (odd, 0)
        raise TelemetryError(
            f"{source.place(odd)}: found times with a time zone ('{column[with_zone]}') and without "
            f"('{column[without]}') in one file, expected either all or none"
        )


def _nanoseconds(times: NDArray[np.datetime64]) -> Nanoseconds:
    # Coarser units reach further than 64 bits of nanoseconds do.
    near = (times > np.datetime64("1900")) & (times < np.datetime64("2200"))
    return np.where(near, times, np.datetime64("NaT", "D")).astype("datetime64[ns]").astype(np.int64)


def is_text(column: pa.ChunkedArray) -> bool:
    """Whether the cells of a column are text."""
    return pa.types.is_string(column.type) or pa.types.is_large_string(column.type)


def more_rows(rows: int) -> str:
    """What a message on the first of several rows says of the others."""
    return "" if rows == 1 else f" (and in {rows - 1} more row{'s' if rows > 2 else ''})"


def _trimmed(column: pa.ChunkedArray) -> pa.ChunkedArray:
    return pc.utf8_trim_whitespace(pc.cast(column, pa.string()))
