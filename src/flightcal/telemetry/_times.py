"""Time stamps as text or numbers -> nanoseconds UTC since 1970."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ..errors import TelemetryError
from .clean import Nanoseconds
from .readers import Source

_UNREADABLE = np.iinfo(np.int64).min
"""Not a time, also to numpy."""
_EARLIEST = np.datetime64("1957-10-04", "ns").astype(np.int64)
_LATEST = np.datetime64("2150-01-01", "ns").astype(np.int64)
_ZONE = r"[T ]\d{2}.*([zZ]|[+-]\d{2}(:?\d{2})?)$"
_YEAR_DOY = (
    r"^(?P<year>\d{4})[-/. :](?P<day>\d{1,3})"
    r"(?:[T /.:-](?P<hour>\d{1,2})[:.](?P<minute>\d{2})"
    r"(?:[:.](?P<second>\d{2})(?:[.,](?P<fraction>\d{1,9})\d*)?)?)?[zZ]?$"
)
_EXAMPLES = {
    "iso8601": "ISO 8601 such as 2024-03-01T12:00:00.5Z",
    "unix": "UNIX seconds such as 1709294400.5",
    "year-doy": "year and day of year such as 2024-061T12:00:00.5",
}


def parse_times(column: pa.ChunkedArray, written: str, source: Source) -> Nanoseconds:
    """Times [T] of a column in the format `written` ('iso8601', 'unix' or 'year-doy'), ns since 1970, UTC.

    Raises TelemetryError that names the first line whose time is empty, not of this format, or outside 1957
    to 2150, or has a time zone where others have none.
    """
    if pa.types.is_dictionary(column.type):
        column = column.cast(column.type.value_type)
    if pa.types.is_timestamp(column.type) or pa.types.is_date(column.type):
        unit = getattr(column.type, "unit", "s")
        times = _nanoseconds(column.to_pandas().to_numpy(dtype=f"datetime64[{unit}]"))
    elif is_text(column) or pa.types.is_integer(column.type) or pa.types.is_floating(column.type):
        times = _PARSERS[written](column)
    else:
        raise TelemetryError(f"{source.name}: found times of type {column.type}, expected {_EXAMPLES[written]}")
    bad = (times == _UNREADABLE) | (times < _EARLIEST) | (times > _LATEST)
    if bad.any():
        raise _unreadable(column, written, source, int(np.argmax(bad)), int(bad.sum()))
    if written == "iso8601" and is_text(column):
        _check_zones(column, source)
    return times


def _iso8601(column: pa.ChunkedArray) -> Nanoseconds:
    text = _trimmed(column)
    text = pc.replace_substring_regex(text, r"\s*(UTC|GMT)$", "Z")
    text = pc.replace_substring_regex(text, r"(:\d{2}),(\d+)", r"\1.\2")
    # A run of digits is a number of seconds that pandas would take for a year.
    text = pc.if_else(pc.match_substring_regex(text, r"^-?(\d{1,7}|\d{9,})(\.\d*)?$"), None, text)
    parsed = pd.to_datetime(text.to_numpy(zero_copy_only=False), format="ISO8601", utc=True, errors="coerce")
    return _nanoseconds(parsed.tz_localize(None).to_numpy())


def _unix(column: pa.ChunkedArray) -> Nanoseconds:
    if is_text(column):
        text = pd.Series(_trimmed(column).to_numpy(zero_copy_only=False))
        seconds = pd.to_numeric(text, errors="coerce").to_numpy(float)
    else:
        seconds = pc.cast(column, pa.float64(), safe=False).to_numpy(zero_copy_only=False)
    seconds = np.where(np.abs(seconds) < 9e9, seconds, np.nan)
    whole = np.floor(np.nan_to_num(seconds))
    # A double holds today's UNIX time to 0.24 microseconds.
    microseconds = np.round((np.nan_to_num(seconds) - whole) * 1e6)
    nanoseconds = (whole.astype(np.int64) * 1_000_000 + microseconds.astype(np.int64)) * 1000
    return np.where(np.isnan(seconds), _UNREADABLE, nanoseconds)


def _year_doy(column: pa.ChunkedArray) -> Nanoseconds:
    parts = pc.extract_regex(_trimmed(column), _YEAR_DOY)
    matched = pc.is_valid(parts).to_numpy()

    def number(name: str) -> Nanoseconds:
        text = pc.if_else(pc.equal(pc.struct_field(parts, name), ""), "0", pc.struct_field(parts, name))
        return pc.fill_null(pc.cast(text, pa.int64()), 0).to_numpy()

    digits = pc.utf8_rpad(pc.fill_null(pc.struct_field(parts, "fraction"), ""), width=9, padding="0")
    nanoseconds = pc.cast(digits, pa.int64()).to_numpy()
    year, day, hour, minute, second = (number(name) for name in ("year", "day", "hour", "minute", "second"))
    matched &= (year >= 1957) & (year <= 2150)
    first = np.where(matched, year - 1970, 0).astype("datetime64[Y]")
    days_in_year = (first + np.timedelta64(1, "Y")).astype("datetime64[D]") - first.astype("datetime64[D]")
    matched &= (day >= 1) & (day <= days_in_year.astype(np.int64)) & (hour < 24) & (minute < 60) & (second < 60)
    days = first.astype("datetime64[D]").astype(np.int64) + day - 1
    seconds = ((days * 24 + hour) * 60 + minute) * 60 + second
    return np.where(matched, seconds * 1_000_000_000 + nanoseconds, _UNREADABLE)


_PARSERS: dict[str, Callable[[pa.ChunkedArray], Nanoseconds]] = {
    "iso8601": _iso8601,
    "unix": _unix,
    "year-doy": _year_doy,
}


def _unreadable(column: pa.ChunkedArray, written: str, source: Source, row: int, rows: int) -> TelemetryError:
    value = column[row].as_py()
    where = source.place(row)
    if value is None:
        return TelemetryError(f"{where}: found no time, expected {_EXAMPLES[written]}")
    cell = pa.chunked_array([[str(value)]])
    others = [name for name, parse in _PARSERS.items() if name != written and _EARLIEST <= parse(cell)[0] <= _LATEST]
    hint = f"; format: {others[0]} would read it" if others else ""
    if written == "unix" and re.fullmatch(r"\d{13,19}(\.0*)?", str(value).strip()):
        hint = "; these look like milliseconds or finer"
    found = f"found the time '{value}'{more_rows(rows)}"
    return TelemetryError(f"{where}: {found}, expected {_EXAMPLES[written]}, between 1957 and 2150{hint}")


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
