"""Tables with a row for each reading (time, name, value) -> a column for each name that a channel wants."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from ..errors import TelemetryError
from ..scenario import Readings
from ._times import Nanoseconds, is_text
from .readers import Source, nearest

LOOKED_AT = 1000
"""Rows that decide what a column is."""


def side_by_side(
    table: pa.Table,
    readings: Readings,
    time: tuple[str, ...],
    wanted: tuple[str, ...],
    beside: tuple[str, ...],
    source: Source,
) -> tuple[pa.Table, Source]:
    """The readings called `wanted` in columns of these names, beside the columns `time`; of several: at equal times.

    beside: columns that each reading keeps beside its value, called as `of` says.

    Raises TelemetryError where one is not in the file, or they have no time in common.
    """
    names = names_of(table, readings.name)
    joined: pd.DataFrame | None = None
    for name in wanted:
        rows = np.flatnonzero(names == name)
        if not len(rows):
            known = [str(one) for one in pd.unique(names[names != ""])]
            listed = nearest(name, known) or f"; it has {', '.join(known[:12])}{', ...' if len(known) > 12 else ''}"
            where = " ".join(readings.name)
            raise TelemetryError(f"{source.name}: column '{where}': found no '{name}'{listed}")
        joined_rows = pd.DataFrame({column: table[column].take(rows).to_pandas() for column in time})
        joined_rows[f"row of {name}"] = rows
        joined = joined_rows if joined is None else joined.merge(joined_rows, on=list(time))
    assert joined is not None  # a channel has a column
    if not len(joined):
        together = ", ".join(f"'{name}'" for name in wanted)
        raise TelemetryError(f"{source.name}: found no time that {together} share, expected them side by side")
    first = joined[f"row of {wanted[0]}"].to_numpy()
    columns = {column: table[column].take(first) for column in time}
    columns |= {name: typed(table[readings.value].take(joined[f"row of {name}"].to_numpy())) for name in wanted}
    for name in wanted:
        joined_rows = joined[f"row of {name}"].to_numpy()
        columns |= {of(column, name): table[column].take(joined_rows) for column in beside}
    return pa.table(columns), source.only(first)


def of(column: str, name: str) -> str:
    """What the column of a table of readings is called that belongs to the reading `name`."""
    return f"{column} of {name}"


def names_of(table: pa.Table, columns: Sequence[str]) -> np.ndarray:
    """The name of each reading [T], of several columns with spaces in between; "" where there is none."""
    texts = [pc.fill_null(pc.utf8_trim_whitespace(table[column].cast(pa.string())), "") for column in columns]
    joined = texts[0] if len(texts) == 1 else pc.utf8_trim_whitespace(pc.binary_join_element_wise(*texts, " "))
    return np.asarray(joined.to_numpy(zero_copy_only=False), dtype=object)


def comes_again(names: np.ndarray) -> bool:
    """Whether the names of the first readings come again and again, in turns."""
    names = names[:LOOKED_AT]
    changes = int(np.count_nonzero(names[1:] != names[:-1]))
    return len(set(names)) > 1 and changes > len(names) / 4 and len(names) >= 2 * len(set(names))


def follows(names: np.ndarray, times: Nanoseconds) -> bool:
    """Whether the names [T] of readings come in turns, or stretch after stretch with times [T] that mostly go back."""
    if comes_again(names):
        return True
    first = np.flatnonzero(names[1:] != names[:-1]) + 1
    return len(first) > 0 and bool((times[first] < times[first - 1]).mean() > 0.5)


def typed(column: pa.ChunkedArray) -> pa.ChunkedArray:
    """Numbers in text as numbers, where all are."""
    try:
        return pc.cast(pc.utf8_trim_whitespace(column), pa.float64()) if is_text(column) else column
    except pa.ArrowInvalid:
        return column
