"""Telemetry files as Arrow tables, and the places in them that messages point to. A kind of file is a module here."""

from __future__ import annotations

import difflib
import re
import zlib
from collections.abc import Collection, Sequence
from csv import Error as CsvError
from pathlib import Path

import pandas as pd
import pyarrow as pa

from ...errors import TelemetryError
from ._source import NULL_WORDS, Reader, Source
from .csv import Csv
from .excel import Excel
from .excel import sheets as _sheets_of_workbook
from .parquet import Parquet

READERS: tuple[Reader, ...] = (
    Csv(),
    Parquet(),
    Excel(),
)

__all__ = [
    "NULL_WORDS",
    "READERS",
    "Parquet",
    "Reader",
    "Source",
    "content",
    "locate",
    "nearest",
    "read_table",
    "sheets",
]


def locate(folder: Path, name: str, sheet: str | None = None, header: int | None = None) -> Source:
    """The file `name` (relative to `folder`), the sheet where it is a spreadsheet, and where its header stands.

    Raises TelemetryError when it cannot be a telemetry file.
    """
    path = folder / name
    if path.is_dir():
        raise TelemetryError(f"{name}: found a folder, expected a telemetry file")
    if not path.is_file():
        siblings = sorted(p.name for p in path.parent.iterdir()) if path.parent.is_dir() else []
        hint = nearest(path.name, siblings)
        raise TelemetryError(f"{name}: found no such file, expected a telemetry file{hint}")
    for reader in READERS:
        if name.lower().endswith(reader.suffixes):
            if sheet is not None and not reader.has_sheets:
                raise TelemetryError(f"{name}: found sheet '{sheet}', expected none: it is {reader.kind}")
            if header is not None and not reader.has_header:
                raise TelemetryError(f"{name}: found header {header}, expected none: it is {reader.kind}")
            return Source(path, name, reader, sheet, header)
    expected = ", ".join(suffix for reader in READERS for suffix in reader.suffixes)
    raise TelemetryError(f"{name}: found a file of type '{path.suffix}', expected one of {expected}")


def sheets(source: Source) -> list[str]:
    """Names of a spreadsheet's sheets; none for another file. Raises TelemetryError."""
    _check_kind(source)
    return _sheets_of_workbook(source) if source.reader.has_sheets else []


def read_table(source: Source, text_columns: Collection[str], markers: Collection[str] = ()) -> pa.Table:
    """The whole file; see `Reader.read`. Raises TelemetryError with file and line for a file that is no table."""
    try:
        _check_kind(source)
        table = source.reader.read(source, text_columns, markers)
        table.validate(full=True)
    except (pa.ArrowException, OSError, EOFError, UnicodeError, zlib.error, CsvError) as error:
        raise TelemetryError(f"{source.name}: cannot be read: {_first_sentence(error)}") from None
    if table.num_rows == 0:
        raise TelemetryError(f"{source.name}: found a header and no rows, expected telemetry")
    return table.rename_columns([column.strip() for column in table.column_names])


def content(table: pa.Table, without: Collection[str]) -> pd.DataFrame:
    """All columns but `without`, such that overlapping files agree: every number a float, none nested."""
    columns = {}
    for i, (name, column) in enumerate(zip(table.column_names, table.columns, strict=True)):
        kind = column.type
        if name in without or pa.types.is_nested(kind):
            continue
        if pa.types.is_integer(kind) or pa.types.is_decimal(kind) or pa.types.is_null(kind):
            column = column.cast(pa.float64(), safe=False)
        columns[f"{name} ({i})" if name in columns else name] = column
    return pa.table(columns).to_pandas()


def nearest(name: str, candidates: Sequence[str]) -> str:
    """'; nearest: ...' for a message, or nothing where no candidate is like `name`."""
    lower = {candidate.lower(): candidate for candidate in candidates}
    begins = [
        candidate for candidate in lower if candidate.startswith(name.lower()) or name.lower().startswith(candidate)
    ]
    # A name that was made longer or shorter is more likely than one with other letters.
    found = difflib.get_close_matches(name.lower(), begins or lower, n=1, cutoff=0.5)
    return f"; nearest: '{lower[found[0]]}'" if found else ""


def _check_kind(source: Source) -> None:
    """A file that begins as those of another reader do is called by a wrong name."""
    with source.open() as file:
        start = file.read(64)
    for reader in READERS:
        if reader is not source.reader and reader.magic is not None and start.startswith(reader.magic):
            raise TelemetryError(f"{source.name}: found {reader.kind}, expected {source.reader.kind}")


def _first_sentence(error: BaseException) -> str:
    # Arrow and the system add paths and nested detail that say nothing to the reader of a message.
    text = str(getattr(error, "strerror", None) or error).strip().splitlines()
    return re.split(r"(?<=\w)\. |: '", re.sub(r"^.*input source '.*?': ", "", text[0]))[0].rstrip(".") if text else ""
