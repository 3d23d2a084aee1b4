"""Year and day of year as text, in all usual spellings -> nanoseconds UTC since 1970."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from .clean import Nanoseconds

UNREADABLE = np.iinfo(np.int64).min
"""Not a time, also to numpy."""
_FIRST_OF_CENTURY = 57
"""Two digits from here on are a year of the 20th century, as in two-line elements."""
_DAY = 86_400_000_000_000
_YEAR = r"^(?P<year>\d{4}|\d{2})"
_ALWAYS = (
    (r"\s*(Z|UTC|GMT|\+00:?00)$", ""),
    # 24061.123456 is rather a fraction of a day
    (r"^\d{5}[.,]\d+$", ""),
)
_SPELLINGS = (
    # 061/2024
    (r"^(\d{3})[-/. :](\d{4})(\D|$)", r"\2-\1\3"),
    # 2024061123456, 2024061.123456789
    (r"^(\d{4}|\d{2})(\d{3})(\d{6})([.,]\d+)?$", r"\1-\2T\3\4"),
    (r"^(\d{4})(\d{3})[.](\d{6})(\d{1,3})$", r"\1-\2T\3.\4"),
    # 2024-061-12-34-56: one sign throughout. The day has three digits, for else this is a month.
    *(
        (rf"^(\d{{4}}|\d{{2}}){sign}(\d{{3}}){sign}(\d{{1,2}}){sign}(\d{{2}}){sign}(\d{{2}})\b", r"\1-\2T\3:\4:\5")
        for sign in ("-", "/", "_", r"\s+")
    ),
    # 2024 DOY 061, 2024D061
    (r"^(\d{4}|\d{2})\s*D(?:OY)?\s*(\d)", r"\1-\2"),
    # 12h34m56s
    (r"(\d{2})H\s*(\d{2})M\s*(\d{2})([.,]\d+)?S?$", r"\1:\2:\3\4"),
    # SPICE writes 2024-061 // 12:34:56
    (r"\s*//\s*", "T"),
    # 12:34:56:789
    (r":(\d{2}):(\d{2}):(\d{3})$", r":\1:\2.\3"),
)
"""What turns the rarer spellings into those of `_CLOCK`."""
_CLOCK = _YEAR + (
    # 2024-061, 2024:61, 24-061, or 2024061 and 24061
    r"(?:\s*[-/. :_,]\s*(?P<day>\d{1,3})|(?P<joined>\d{3}))"
    # T12:34:56.789, -12.34.56, T123456, ...
    r"(?:(?:\s*[-T_/.:,]\s*|\s+)(?P<hour>\d{1,2})[:.]?(?P<minute>\d{2})"
    r"(?:[:.]?(?P<second>\d{2})(?:[.,](?P<fraction>\d{1,9})\d*)?)?)?$"
)
_DECIMAL = (
    r"^(?P<year>\d{4}|\d{1,2}?)(?:\s*[-/ :]\s*(?P<day>\d{1,3})|(?P<joined>\d{3}))(?:[.,](?P<fraction>\d{1,12})\d*)?$"
)


def year_and_day(column: pa.ChunkedArray) -> Nanoseconds:
    """Times [T] such as 2024-061T12:34:56; UNREADABLE where a cell is none."""
    text = _respelled(_upper(column), _ALWAYS)
    parts = pc.extract_regex(text, _CLOCK)
    if parts.null_count > text.null_count:
        parts = pc.extract_regex(_respelled(text, _SPELLINGS), _CLOCK)
    hour, minute, second = (_number(parts, name) for name in ("hour", "minute", "second"))
    digits = pc.utf8_rpad(pc.fill_null(pc.struct_field(parts, "fraction"), ""), width=9, padding="0")
    in_day = (hour < 24) & (minute < 60) & (second < 60)
    nanoseconds = ((hour * 60 + minute) * 60 + second) * 1_000_000_000 + pc.cast(digits, pa.int64()).to_numpy()
    return np.where(in_day, _start_of_day(parts) + nanoseconds, UNREADABLE)


def decimal_day(column: pa.ChunkedArray) -> Nanoseconds:
    """Times [T] such as 24061.52426620, to a microsecond; UNREADABLE where a cell is none."""
    parts = pc.extract_regex(_upper(column), _DECIMAL)
    digits = pc.utf8_rpad(pc.fill_null(pc.struct_field(parts, "fraction"), ""), width=12, padding="0")
    share = pc.cast(digits, pa.int64()).to_numpy() / 1e12
    start = _start_of_day(parts)
    return np.where(start == UNREADABLE, start, start + np.round(share * (_DAY / 1000)).astype(np.int64) * 1000)


def _start_of_day(parts: pa.ChunkedArray) -> NDArray[np.int64]:
    """When the day of `year` and `day` (or `joined`) begins [T], ns; UNREADABLE where there is no such day."""
    matched = pc.is_valid(parts).to_numpy()
    year = _number(parts, "year")
    day = _number(parts, "day") + _number(parts, "joined")  # one of the two is not there
    year = np.where(year >= 100, year, np.where(year >= _FIRST_OF_CENTURY, 1900, 2000) + year)
    matched &= (year >= 1957) & (year <= 2150)
    first = np.where(matched, year - 1970, 0).astype("datetime64[Y]")
    days_in_year = (first + np.timedelta64(1, "Y")).astype("datetime64[D]") - first.astype("datetime64[D]")
    matched &= (day >= 1) & (day <= days_in_year.astype(np.int64))
    return np.where(matched, (first.astype("datetime64[D]").astype(np.int64) + day - 1) * _DAY, UNREADABLE)


def _number(parts: pa.ChunkedArray, name: str) -> NDArray[np.int64]:
    text = pc.if_else(pc.equal(pc.struct_field(parts, name), ""), "0", pc.struct_field(parts, name))
    return pc.fill_null(pc.cast(text, pa.int64()), 0).to_numpy()


def _respelled(text: pa.ChunkedArray, spellings: Iterable[tuple[str, str]]) -> pa.ChunkedArray:
    for spelling, usual in spellings:
        text = pc.replace_substring_regex(text, spelling, usual)
    return text


def _upper(column: pa.ChunkedArray) -> pa.ChunkedArray:
    return pc.utf8_upper(pc.utf8_trim_whitespace(pc.cast(column, pa.string())))
