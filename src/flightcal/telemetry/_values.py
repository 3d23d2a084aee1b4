"""Cells of a channel's columns -> numbers, with a flag for each cell that is not one."""

from __future__ import annotations

from collections.abc import Collection
from functools import reduce

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ..errors import TelemetryError
from ..scenario import Channel
from ._flags import Flag, Flags
from ._times import is_text, more_rows
from ._units import between, known_unit
from .readers import NULL_WORDS, Source

Values = NDArray[np.float64]

_OFF_WORDS = frozenset(["off", "false", "no", "disabled", "disable", "inactive", "open", "idle"])
"""Words, in any case, that mean off; so does the number 0."""

_WORDS = {
    2: "digits of base 2 such as 10010",
    10: "a whole number such as 18, 0x12 or 0b10010",
    16: "digits of base 16 such as 0012 or A3",
}
_NUMBER_AND_UNIT = r"^(?P<number>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(?P<unit>[^\d\s.,:;+-].*)$"
_LARGEST_EXACT = 2.0**53
"""A larger whole number in floating point has lost its last bits."""


def channel_values(name: str, channel: Channel, table: pa.Table, source: Source) -> tuple[Values, Flags]:
    """Values [T] as the file has them, combined over the channel's columns, and flags [T]; NaN where flagged.

    Raises TelemetryError with the line of the first cell that cannot be understood.
    """
    read = _status if channel.is_state else _numbers
    valid = np.all([_among_cells(table[column], ok) for column, ok in channel.valid_where.items()], axis=0)
    parts = [
        read(f"channel '{name}', column '{column}'", channel, _only_where(valid, table[column]), source)
        for column in channel.column
    ]
    values = np.stack([part[0] for part in parts])
    flags = reduce(np.bitwise_or, [part[1] for part in parts])
    flags = np.where(valid, flags, Flag.INVALID_MARKER).astype(np.uint8)
    match channel.combine:
        case "sum":
            combined = values.sum(axis=0)
        case "product":
            combined = values.prod(axis=0)
        case _:
            combined = values.mean(axis=0)
    return combined, flags


def _among_cells(cells: pa.ChunkedArray, candidates: tuple[float | str, ...]) -> NDArray[np.bool_]:
    """Whether each cell [T] is one of the candidates."""
    encoded = pc.dictionary_encode(cells.combine_chunks())
    known = np.array([*(_among(value, candidates) for value in encoded.dictionary.to_pylist()), False])
    return known[pc.fill_null(encoded.indices, len(known) - 1).to_numpy(zero_copy_only=False)]


def _only_where(valid: NDArray[np.bool_], cells: pa.ChunkedArray) -> pa.ChunkedArray:
    """The cells [T] with nothing where they are not valid."""
    if valid.all():
        return cells
    return pc.if_else(pa.array(valid), cells, pa.scalar(None, cells.type))


def _numbers(label: str, channel: Channel, cells: pa.ChunkedArray, source: Source) -> tuple[Values, Flags]:
    if pa.types.is_dictionary(cells.type):
        cells = cells.cast(cells.type.value_type)
    if is_text(cells):
        values, marked = _numbers_in_text(label, channel, cells, source)
    elif _is_numeric(cells.type):
        values = pc.cast(cells, pa.float64(), safe=False).to_numpy()
        marked = np.zeros(len(values), dtype=bool)
    else:
        raise TelemetryError(f"{source.name}: {label}: found values of type {cells.type}, expected numbers")
    markers = [_number(marker) for marker in channel.invalid]
    marked |= np.isin(values, [number for number in markers if number is not None])
    unusable = marked | ~np.isfinite(values)
    flags = np.select([marked, unusable], [Flag.INVALID_MARKER, _missing(channel)], 0).astype(np.uint8)
    return np.where(unusable, np.nan, values), flags


def _numbers_in_text(
    label: str, channel: Channel, cells: pa.ChunkedArray, source: Source
) -> tuple[Values, NDArray[np.bool_]]:
    """Values [T], NaN where a cell is no number, and where the channel's marks stand [T]."""
    text = pc.utf8_trim_whitespace(cells)
    values = pd.to_numeric(pd.Series(text.to_numpy(zero_copy_only=False)), errors="coerce").to_numpy(float)
    empty = _contains(text, NULL_WORDS) | pc.is_null(text).to_numpy()
    marked = _contains(text, [str(marker).strip() for marker in channel.invalid])
    bad = np.isnan(values) & ~empty & ~marked
    if bad.any() and channel.unit is not None:
        values, bad = _of_units(text, values, bad, channel.unit)
    if bad.any():
        row = int(np.argmax(bad))
        found = text[row].as_py()
        hint = "a mark of an invalid value belongs in the channel's 'invalid'"
        if _number(found.replace(",", ".")) is not None:
            hint = "the decimal sign is a point"
        raise TelemetryError(
            f"{source.place(row)}: {label}: found '{found}'{more_rows(bad.sum())}, expected a number; {hint}"
        )
    return values, marked


def _of_units(
    text: pa.ChunkedArray, values: Values, bad: NDArray[np.bool_], unit: str
) -> tuple[Values, NDArray[np.bool_]]:
    """With the cells [T] that are a number with a unit, in `unit`; and which of the bad ones are left."""
    values, bad = values.copy(), bad.copy()
    numbers, units = _split(text)
    for found in pd.unique(units[bad]):
        factors = between(found, unit)
        if factors is not None:
            rows = bad & (units == found)
            values[rows] = factors[0] * numbers[rows] + factors[1]
            bad &= ~rows
    return values, bad


def _split(text: pa.ChunkedArray) -> tuple[Values, NDArray[np.object_]]:
    """Number and unit of each cell [T]; NaN and "" where it is something else."""
    parts = pc.extract_regex(text, _NUMBER_AND_UNIT)
    numbers, units = (pc.struct_field(parts, name) for name in ("number", "unit"))
    numbers = pd.to_numeric(pd.Series(numbers.to_numpy(zero_copy_only=False)), errors="coerce").to_numpy(float)
    return numbers, np.asarray(pc.fill_null(units, "").to_numpy(zero_copy_only=False), dtype=object)


def with_units(text: pa.ChunkedArray) -> tuple[pa.ChunkedArray, str] | None:
    """A column of numbers that all have a unit, as numbers in the first one's; null: it is none."""
    cells = pc.utf8_trim_whitespace(text)
    told = ~(_contains(cells, NULL_WORDS) | pc.is_null(cells).to_numpy())
    values, units = _split(cells)
    unit = known_unit(units[told][0]) if told.any() else None
    if unit is None:
        return None
    values, bad = _of_units(cells, values, told, unit)
    return None if bad.any() else (pa.chunked_array([pa.array(values, from_pandas=True)]), unit)


def _status(label: str, channel: Channel, cells: pa.ChunkedArray, source: Source) -> tuple[Values, Flags]:
    """1 on, 0 off; a value that is neither nor marked invalid is an error, as off would be a guess."""
    if not (is_text(cells) or _is_numeric(cells.type) or pa.types.is_dictionary(cells.type)):
        raise TelemetryError(f"{source.name}: {label}: found values of type {cells.type}, expected a status")
    state = _state if channel.bits is None else _bits_state
    encoded = cells.combine_chunks()
    encoded = encoded if pa.types.is_dictionary(encoded.type) else pc.dictionary_encode(encoded)
    kinds = [state(value, channel) for value in encoded.dictionary.to_pylist()]
    states = np.array([kind[0] for kind in kinds] + [np.nan])
    reasons = np.array([kind[1] for kind in kinds] + [_missing(channel)], dtype=np.int64)
    codes = pc.fill_null(encoded.indices, len(kinds)).to_numpy(zero_copy_only=False).astype(np.int64)
    values, reason = states[codes], reasons[codes]
    bad = reason < 0
    if bad.any():
        row = int(np.argmax(bad))
        found = _written(encoded.dictionary[int(codes[row])].as_py())
        raise TelemetryError(
            f"{source.place(row)}: {label}: found {_expected(channel, found, more_rows(bad.sum()))}; "
            "a mark of an invalid value belongs in the channel's 'invalid'"
        )
    return values, reason.astype(np.uint8)


def is_status(cells: pa.ChunkedArray, channel: Channel) -> bool:
    """Whether all cells of a column tell a status, and not all of them the same reason why none is known."""
    found = [_state(value, channel) for value in cells.unique().to_pylist()]
    return all(flag >= 0 for _, flag in found) and any(flag == 0 for _, flag in found)


def _expected(channel: Channel, found: str, rows: str) -> str:
    """What was found as a status, and what was expected."""
    if channel.bits is not None:
        return f"the word '{found}'{rows}, expected {_WORDS[channel.base or 10]}"
    # One of each kind will do, and what the user has written.
    written = channel.on if "on" in channel.model_fields_set else ("ON", "TRUE", "ENABLED", "1")
    on = ", ".join({_written(value).lower(): _written(value) for value in written}.values())
    off = ", ".join([*(_written(value) for value in channel.off), "0, OFF, FALSE, ..."])
    return f"the status '{found}'{rows}, expected one that means on ({on}) or off ({off})"


def _state(value: object, channel: Channel) -> tuple[float, int]:
    """Status and flag of a distinct value; flag -1 where it is neither on nor off nor marked."""
    if _among(value, channel.invalid):
        return np.nan, Flag.INVALID_MARKER
    if _among(value, channel.on):
        return 1.0, 0
    if _among(value, channel.off) or _number(value) == 0 or _written(value).lower() in _OFF_WORDS:
        return 0.0, 0
    if value is None or _written(value) in NULL_WORDS:
        return np.nan, _missing(channel)
    return np.nan, -1


def _bits_state(value: object, channel: Channel) -> tuple[float, int]:
    """Status and flag of a distinct word; flag -1 where it is none."""
    if _among(value, channel.invalid):
        return np.nan, Flag.INVALID_MARKER
    if value is None or value != value or _written(value) in NULL_WORDS:
        return np.nan, _missing(channel)
    word = _word(value, channel.base or 10)
    if word is None:
        return np.nan, -1
    assert channel.bits is not None  # only then it is a word
    number = sum((word >> bit & 1) << k for k, bit in enumerate(channel.bits))
    return float(_among(number, channel.on) if "on" in channel.model_fields_set else number != 0), 0


def _word(value: object, base: int) -> int | None:
    """The whole number that a cell stands for, if any; its digits are of the base unless it begins with 0x or 0b."""
    try:
        if isinstance(value, str) and value.strip()[:2].lower() in ("0x", "0b"):
            return int(value.strip(), 0)
        if base != 10:
            return int(_written(value), base)
        number = float(value)  # type: ignore[arg-type]
        if isinstance(value, int) or (isinstance(value, str) and value.strip().isdigit()):
            return int(value)
        return int(number) if number.is_integer() and abs(number) <= _LARGEST_EXACT else None
    except (TypeError, ValueError, OverflowError):
        return None


def _among(value: object, candidates: tuple[float | str, ...]) -> bool:
    text, number = _written(value).lower(), _number(value)
    return any(
        text == _written(candidate).lower() or (number is not None and number == _number(candidate))
        for candidate in candidates
    )


def _written(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value).strip()


def _number(value: object) -> float | None:
    """The number that a cell or marker stands for, if any."""
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return None
    return number if np.isfinite(number) else None


def _missing(channel: Channel) -> Flag:
    """What an empty cell is: missing, unless it is among the channel's marks."""
    return Flag.INVALID_MARKER if "" in channel.invalid else Flag.MISSING


def _contains(text: pa.ChunkedArray, words: Collection[str]) -> NDArray[np.bool_]:
    return pc.is_in(text, value_set=pa.array(sorted(words), type=text.type)).to_numpy()


def _is_numeric(kind: pa.DataType) -> bool:
    return any(
        test(kind)
        for test in (
            pa.types.is_integer,
            pa.types.is_floating,
            pa.types.is_decimal,
            pa.types.is_boolean,
            pa.types.is_null,
        )
    )
