"""Which columns of a telemetry file are its times, or a clock, and how these are written."""

from __future__ import annotations

import re
from collections import Counter
from itertools import pairwise
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ..errors import TelemetryError
from ..scenario import TimeColumn
from ._doy import UNREADABLE
from ._times import Nanoseconds, is_text, readable_times, time_cells
from .read import without_empty_rows
from .readers import Source, read_table
from .readings import LOOKED_AT, follows, names_of

_UNIX: Final = ("unix", "unix-ms", "unix-us", "unix-ns")
_DAYS: Final = ("year-doy", "decimal-doy")
_MONTH_FIRST: Final = {"%d/%m/%Y ": "%m/%d/%Y ", "%d-%m-%Y ": "%m-%d-%Y "}
_DATES: Final = ("%Y-%m-%d-", "%Y%m%d ", "%d-%b-%Y ", "%d %b %Y ", "%Y %b %d ", "%Y-%b-%d ", "%d.%m.%Y ")
_PATTERNS: Final = (
    *(
        f"{date}{time}"
        for date in (*_DATES, *_MONTH_FIRST, *_MONTH_FIRST.values())
        for time in ("%H:%M:%S", "%H:%M:%S.%f", "%H:%M")
    ),
    "%Y%m%d_%H%M%S",
    "%Y%m%d%H%M%S",
)
_FORMATS: Final = ("iso8601", *_DAYS, *_UNIX)
_FIRST, _LAST = np.datetime64("1990-01-01", "ns").astype(np.int64), np.datetime64("2040-01-01", "ns").astype(np.int64)
"""A number is a UNIX time only between these; a larger one counts something else, such as ticks of a clock."""
_OF_DAYS = r"^(\d{5}|\d{7}|\d{13})(\.\d+)?$"
"""Numbers that can be a year and a day of year; some have to tell more than the day."""
_HALF_A_DAY = 43_200_000_000_000
_LAST_DAY = np.datetime64("2036-01-01", "ns").astype(np.int64)
"""45352.5 is rather what a spreadsheet counts from 1900 than a day of 2045."""
_DAY_NUMBERS = {(32_874, 47_848): "1899-12-30", (47_892, 69_807): "1858-11-17"}
"""Days of a spreadsheet from 1990 to 2030, modified Julian dates from 1990 to 2049, and the epochs of both."""
_TIME_NAME = re.compile(r"(?i)time|date|utc|epoch|clock|sclk|stamp|(^|_)t(_|$)")
_CLOCK_NAME = re.compile(r"(?i)clock|sclk|scet|obt|met$|tick|time")
_DATE_NAME = re.compile(r"(?i)date|year|yyyy|utc|day|^yr$")
"""Of the first of several columns that are one time."""
_MOST_PARTS = 5
"""Year, day, hour, minute and second."""
_MARKS, _FILL = 3, 0.2
"""So many texts, in such a share of the rows at most, stand in the place of times."""
_GPS_NAME = re.compile(r"(?i)(^|[^a-z])gps")
_GPS: Final = {"format": "clock", "epoch": "1980-01-06", "leap_seconds": True}
_COARSE_FINE = r"^(?:1/)?(?P<coarse>\d{5,})\s*[:., -]\s*(?P<fine>\d+)$"
_FINE = (100, 256, 1000, 65_536, 1_000_000, 2**24, 2**32)


def time_of(table: pa.Table, names: list[str], source: Source) -> tuple[TimeColumn | None, Nanoseconds]:
    """The column of times, or several that are one together, and what they give; null where there is none."""
    likely = sorted(names, key=lambda name: not _TIME_NAME.search(name))  # a column called a time comes first
    beside = [
        tuple(names[k : k + size])
        for k, name in enumerate(names)
        for size in range(2, _MOST_PARTS + 1)
        if _DATE_NAME.search(name) and k + size <= len(names)
    ]
    # A date and a time of day have names in the language of whoever exported them.
    pairs = [pair for pair in pairwise(names) if pair not in beside and not is_numeric(table[pair[0]])]
    for columns in ((name,) for name in likely), beside, pairs:
        for column in columns:
            numeric = len(column) == 1 and is_numeric(table[column[0]])
            # As it is written, where it may well be a time.
            written = (
                table
                if not numeric or not _TIME_NAME.search(column[0])
                else without_empty_rows(read_table(source, column))
            )
            keys: list[dict[str, object]] = [{"format": format} for format in _formats(column, written, numeric)]
            if numeric and _GPS_NAME.search(column[0]):
                keys = [*({**_GPS, "rate": rate} for rate in ("1 Hz", "1000 Hz")), *keys]
            for key in keys:
                time = TimeColumn.model_validate({"column": column, **key})
                if (found := _believable(written, time, numeric, source)) is not None:
                    return _with_month_first(found, written, source)
    days = next((found for name in names if (found := _day_numbers(table, name, source))), None)
    return days or (None, np.array([], dtype=np.int64))


def _with_month_first(
    found: tuple[TimeColumn, Nanoseconds], table: pa.Table, source: Source
) -> tuple[TimeColumn, Nanoseconds]:
    """The times with month before day, where both can be and these then lie closer together."""
    date = next((date for date in _MONTH_FIRST if found[0].format.startswith(date)), None)
    if date is None:
        return found
    time = found[0].model_copy(update={"format": found[0].format.replace(date, _MONTH_FIRST[date])})
    other = _believable(table, time, False, source)
    return found if other is None or np.ptp(other[1]) >= np.ptp(found[1]) else other


def _believable(
    table: pa.Table, time: TimeColumn, numeric: bool, source: Source
) -> tuple[TimeColumn, Nanoseconds] | None:
    """The time with marks for what is none, and the times; null: this is not what the column holds."""
    head = _marked(time_cells(table.slice(0, LOOKED_AT), time), time, source)
    if head is None or (numeric and time.format in _DAYS and not _are_days(head[1])):
        return None
    if numeric or time.format in _UNIX:
        near = head[1].min() >= _FIRST and head[1].max() <= _LAST
        if not near or not (numeric or _TIME_NAME.search(time.column[0])):
            return None
    if not _moves_on(head[1]) and not _of_readings(table, time, head[1]):
        return None
    return _marked(time_cells(table, time), time, source)


def _moves_on(times: Nanoseconds) -> bool:
    return len(np.unique(times)) > len(times) // 2


def _of_readings(table: pa.Table, time: TimeColumn, times: Nanoseconds) -> bool:
    """Whether a row holds one reading of several that may have their times in common, and each moves on."""
    for name in table.column_names:
        if name not in time.column and is_text(table[name]) and len(times) == min(len(table), LOOKED_AT):
            names = names_of(table.slice(0, LOOKED_AT), (name,))
            if follows(names, times) and _moves_on(times[names == Counter(names).most_common(1)[0][0]]):
                return True
    return False


def _marked(cells: pa.ChunkedArray, time: TimeColumn, source: Source) -> tuple[TimeColumn, Nanoseconds] | None:
    """The time with marks for the few cells that are none, and the times [T]; null: there are more than a few."""
    try:
        times = readable_times(cells, time, source)
    except TelemetryError:
        return None
    bad = times == UNREADABLE
    if not bad.any():
        return time, times
    marks = cells.filter(pa.array(bad)).cast(pa.string()).fill_null("").unique().to_pylist()
    if len(marks) > _MARKS or bad.mean() > _FILL or len(time.column) > 1:
        return None
    return time.model_copy(update={"invalid": tuple(marks)}), times[~bad]


def _formats(columns: tuple[str, ...], table: pa.Table, numeric: bool) -> tuple[str, ...]:
    if len(columns) > 1:
        return ("iso8601", "year-doy", *_PATTERNS)
    cells = table[columns[0]].slice(0, LOOKED_AT)
    if numeric:
        return _formats_of_numbers(cells)
    if not is_text(cells) or not pc.any(pc.match_substring_regex(cells, r"\d")).as_py():
        return ("iso8601",)
    return (*_FORMATS, *_PATTERNS)


def _day_numbers(table: pa.Table, name: str, source: Source) -> tuple[TimeColumn, Nanoseconds] | None:
    """A column that counts days as spreadsheets or modified Julian dates do, and its times; null: it does not."""
    if not (is_numeric(table[name]) and _TIME_NAME.search(name)) or table[name].null_count:
        return None
    days = table[name].to_numpy()
    if len(days) < 2 or not 0 < np.median(np.abs(np.diff(days))) < 0.5:
        return None
    for (lowest, highest), epoch in _DAY_NUMBERS.items():
        if lowest <= days.min() and days.max() < highest:
            time = TimeColumn.model_validate({"column": name, "format": "clock", "epoch": epoch, "rate": "1 1/day"})
            return time, readable_times(table[name], time, source)
    return None


def fine_of(name: str, column: pa.ChunkedArray) -> int | None:
    """How many counts of the fine part of what can be a clock are one of the coarse; 0: it has none; null: no clock."""
    if not _CLOCK_NAME.search(name) or column.null_count:
        return None
    head = column.slice(0, LOOKED_AT)
    if is_text(head) and pc.all(pc.match_substring_regex(head, _COARSE_FINE)).as_py():
        largest = int(
            pc.max(pc.cast(pc.struct_field(pc.extract_regex(head, _COARSE_FINE), "fine"), pa.int64())).as_py()
        )
        return next((fine for fine in _FINE if fine > largest), None) if np.all(np.diff(coarse_of(head)) >= 0) else None
    if not is_numeric(head):
        return None
    steps = np.diff(head.to_numpy())
    return 0 if len(steps) and np.all(steps > 0) else None


def coarse_of(column: pa.ChunkedArray) -> NDArray[np.float64]:
    """Counts of a clock, of its coarse part where it has two."""
    if is_text(column):
        column = pc.struct_field(pc.extract_regex(column, _COARSE_FINE), "coarse")
    return pc.cast(column, pa.float64()).to_numpy()


def _formats_of_numbers(cells: pa.ChunkedArray) -> tuple[str, ...]:
    text = cells.cast(pa.string()).drop_null()
    if pc.all(pc.match_substring_regex(text, r"^\d{14}$")).as_py():
        return ("%Y%m%d%H%M%S", *_UNIX)
    days = pc.all(pc.match_substring_regex(text, _OF_DAYS)).as_py()
    return (*_DAYS, *_UNIX) if days and pc.any(pc.match_substring_regex(text, r"\.|\d{13}")).as_py() else _UNIX


def _are_days(times: Nanoseconds) -> bool:
    """Whether numbers that can be days are no counter."""
    return bool(times.max() < _LAST_DAY and np.median(np.abs(np.diff(times))) < _HALF_A_DAY)


def is_called_time(name: str) -> bool:
    """Whether a column is called as times are."""
    return _TIME_NAME.search(name) is not None


def is_numeric(column: pa.ChunkedArray) -> bool:
    """Whether a column was read as numbers."""
    return pa.types.is_integer(column.type) or pa.types.is_floating(column.type)


def is_second_time(name: str, column: pa.ChunkedArray, source: Source) -> bool:
    """Whether a column of numbers beside the time is a time or a clock too."""
    table = pa.table({name: column})
    times = [TimeColumn.model_validate({"column": name, "format": format}) for format in _formats_of_numbers(column)]
    return fine_of(name, column) is not None or any(_believable(table, time, True, source) for time in times)
