"""How a telemetry file is laid out: a row has all channels, one reading of several, or the file's one parameter."""

from __future__ import annotations

import re
from itertools import chain, combinations
from operator import itemgetter

import numpy as np
import pandas as pd
import pyarrow as pa

from ..scenario import Readings
from ._times import Nanoseconds, is_text
from .columns import is_called_by_kind
from .readings import follows, names_of

_READING_NAME = re.compile(
    r"(?i)param|name|mnemonic|channel|sensor|signal|item|measur|field|series|point|variable|metric|key|tag"
)
_READING_VALUE = re.compile(r"(?i)value|reading|eng|cal|raw|result|^val")
_UNITS = re.compile(r"(?i)^units?$")
"""Columns of a file with a row for each reading."""
_RAW = re.compile(r"(?i)[\W_]*raw$|^raw[\W_]*")
_MEANT = re.compile(r"(?i)[\W_]*(eng|cal|calibrated|value|val|conv)$|^(eng|cal)[\W_]+")
"""What tells a column of raw readings from that of what they mean."""
_VALIDITY = re.compile(r"(?i)valid|quality")
_VALID = re.compile(r"(?i)^(valid|good|ok|nominal|yes|true)$")
"""Columns that say which rows are valid, and the words for it."""


def readings_of(table: pa.Table, times: Nanoseconds) -> Readings | None:
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


def is_meant_by(name: str, others: list[str]) -> bool:
    """Whether a column of raw readings has another one beside it that says what they mean."""
    plain = _RAW.sub("", name)
    return plain != name and any(_MEANT.sub("", other) == plain for other in others if other != name)


def _engineering(values: list[str]) -> str:
    """Of columns with a value, that of engineering values before that of raw ones."""
    return min(values, key=lambda name: bool(re.search(r"(?i)raw", name)))


def _values(table: pa.Table) -> list[str]:
    """The columns that are called as the value of a reading, and hold something."""
    columns = zip(table.column_names, table.columns, strict=True)
    return [name for name, column in columns if _READING_VALUE.search(name) and column.null_count < len(column)]


def one_parameter(table: pa.Table) -> tuple[str, str] | None:
    """The column of the one parameter in a file, and its name where a column has it, else ""; null: there are more."""
    values = [name for name in _values(table) if not is_called_by_kind(name)]
    validity, names = valid_where(table), []
    for name, column in zip(table.column_names, table.columns, strict=True):
        if name in values or name in validity or _UNITS.search(name) or column.null_count == len(column):
            continue
        told = column.unique().to_pylist()
        if len(told) > 1:
            return None
        if is_text(column) and _READING_NAME.search(name):
            names.append(str(told[0]).strip())
    return (_engineering(values), " ".join(names)) if values else None


def valid_where(table: pa.Table) -> dict[str, str]:
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


def units_column(table: pa.Table) -> str | None:
    """The column with the unit of each reading; null: there is none."""
    return next(filter(_UNITS.search, table.column_names), None)
