"""Telemetry files as Arrow tables, and the places in them that messages point to."""

from __future__ import annotations

import csv
import difflib
import gzip
import io
import re
import zlib
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import IO

import pandas as pd
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from ..errors import TelemetryError

NULL_WORDS = frozenset(
    ["", "N/A", "n/a", "#N/A", "NA", "NULL", "Null", "null", "None", "NaN", "nan", "NAN", "-NaN", "-nan"]
)
"""What stands for a missing value in a file whose scenario says nothing else."""

_CSV_SUFFIXES = (".csv", ".csv.gz", ".txt", ".txt.gz")
_PARQUET_SUFFIXES = (".parquet", ".pq")
_MAGIC = {
    b"PAR1": "Parquet",
    b"PK\x03\x04": "a ZIP archive or a spreadsheet",
    b"\x1f\x8b": "gzip data",
    b"\x89HDF": "HDF5",
    b"\xff\xfe": "UTF-16",
    b"\xfe\xff": "UTF-16",
}
"""First bytes of files that are sometimes called .csv."""


@dataclass(frozen=True)
class Source:
    """A telemetry file: where it is, and the name by which messages call it."""

    path: Path
    name: str

    @property
    def is_parquet(self) -> bool:
        """Whether rows have numbers rather than lines."""
        return self.name.lower().endswith(_PARQUET_SUFFIXES)

    def place(self, row: int) -> str:
        """Where data row `row` (from 0) stands: the line of a text file, else the row, both from 1."""
        if self.is_parquet:
            return f"{self.name}: row {row + 1}"
        line, _ = next(islice(_lines(self.path), row + 1, None), (row + 2, []))
        return f"{self.name}: line {line}"


def locate(folder: Path, name: str) -> Source:
    """The file `name` (relative to `folder`). Raises TelemetryError when it cannot be a telemetry file."""
    path = folder / name
    if path.is_dir():
        raise TelemetryError(f"{name}: found a folder, expected a telemetry file")
    if not path.is_file():
        siblings = sorted(p.name for p in path.parent.iterdir()) if path.parent.is_dir() else []
        hint = nearest(path.name, siblings)
        raise TelemetryError(f"{name}: found no such file, expected a path relative to the scenario's folder{hint}")
    if not name.lower().endswith(_CSV_SUFFIXES + _PARQUET_SUFFIXES):
        expected = ", ".join(_CSV_SUFFIXES + _PARQUET_SUFFIXES)
        raise TelemetryError(f"{name}: found a file of type '{path.suffix}', expected one of {expected}")
    return Source(path, name)


def read_table(source: Source, time_column: str, markers: Collection[str] = ()) -> pa.Table:
    """The whole file; the time column of a text file stays text, other columns are typed by what they hold.

    markers: texts that are kept although they usually stand for a missing value.
    Raises TelemetryError with file and line for a file that is no table.
    """
    try:
        table = pa.parquet.read_table(source.path) if source.is_parquet else _read_csv(source, time_column, markers)
        table.validate(full=True)
    except (pa.ArrowException, OSError, EOFError, UnicodeError, zlib.error, csv.Error) as error:
        raise TelemetryError(f"{source.name}: cannot be read: {_first_sentence(error)}") from None
    if table.num_rows == 0:
        raise TelemetryError(f"{source.name}: found a header and no rows, expected telemetry")
    return table.rename_columns([column.strip() for column in table.column_names])


def content(table: pa.Table, without: str) -> pd.DataFrame:
    """All columns but `without`, such that overlapping files agree: every number a float, none nested."""
    columns = {}
    for i, (name, column) in enumerate(zip(table.column_names, table.columns, strict=True)):
        kind = column.type
        if name == without or pa.types.is_nested(kind):
            continue
        if pa.types.is_integer(kind) or pa.types.is_decimal(kind) or pa.types.is_null(kind):
            column = column.cast(pa.float64(), safe=False)
        columns[f"{name} ({i})" if name in columns else name] = column
    return pa.table(columns).to_pandas()


def nearest(name: str, candidates: Sequence[str]) -> str:
    """'; nearest: ...' for a message, or nothing where no candidate is like `name`."""
    lower = {candidate.lower(): candidate for candidate in candidates}
    found = difflib.get_close_matches(name.lower(), lower, n=1, cutoff=0.5)
    return f"; nearest: '{lower[found[0]]}'" if found else ""


def _read_csv(source: Source, time_column: str, markers: Collection[str]) -> pa.Table:
    header = _header(source)
    convert = pa.csv.ConvertOptions(
        column_types={column: pa.string() for column in header if column.strip() == time_column},
        null_values=sorted(NULL_WORDS - set(markers) | {""}),
        strings_can_be_null=True,
    )
    try:
        table = pa.csv.read_csv(source.path, convert_options=convert)
    except pa.ArrowInvalid as error:
        # Arrow names no line when it reads in parallel; a second, slow look does.
        _check_encoding(source)
        raise _ragged(source, len(header)) or error from None
    if any(pa.types.is_binary(kind) for kind in table.schema.types):
        _check_encoding(source)
    return table


def _ragged(source: Source, columns: int) -> TelemetryError | None:
    """The first line that has not as many values as the header, if any."""
    lines = _lines(source.path)
    for line, cells in lines:
        if len(cells) != columns:
            found = "1 value" if len(cells) == 1 else f"{len(cells)} values"
            hint = "" if next(lines, None) else "; it is the last line, is the file cut off?"
            return TelemetryError(
                f"{source.name}: line {line}: found {found}, expected {columns} as in the header{hint}"
            )
    return None


def _header(source: Source) -> list[str]:
    """Column names as the file has them. Raises TelemetryError where it is not comma-separated text."""
    with _open(source.path) as file:
        start = file.read(65536)
    for magic, kind in _MAGIC.items():
        if start.startswith(magic):
            raise TelemetryError(f"{source.name}: found {kind}, expected comma-separated UTF-8 text")
    if b"\0" in start:
        raise TelemetryError(f"{source.name}: found binary data, expected comma-separated UTF-8 text")
    if not start.strip():
        raise TelemetryError(f"{source.name}: the file is empty")
    _check_encoding(source, lines=1)
    header = next(_lines(source.path))[1]
    if len(header) == 1:
        separator = {";": "semicolons", "\t": "tabs", "|": "bars"}
        hint = next(
            (f"; the header looks separated by {word}" for mark, word in separator.items() if mark in header[0]), ""
        )
        raise TelemetryError(
            f"{source.name}: found one column, '{header[0][:60]}', expected columns separated by commas{hint}"
        )
    if all(re.match(r"\s*[-+]?\.?\d|\s*$", cell) for cell in header):
        raise TelemetryError(
            f"{source.name}: line 1: found values ({', '.join(header[:3])}), expected the columns' names"
        )
    return header


def _check_encoding(source: Source, lines: int | None = None) -> None:
    with _open(source.path) as file:
        for number, line in enumerate(islice(file, lines), start=1):
            try:
                line.decode("utf-8")
            except UnicodeDecodeError as error:
                found = f"the byte 0x{line[error.start]:02x}"
                raise TelemetryError(f"{source.name}: line {number}: found {found}, expected UTF-8 text") from None


def _lines(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Line number and cells of each line that is not empty, the header first; as Arrow counts rows."""
    with _open(path) as file:
        reader = csv.reader(io.TextIOWrapper(file, encoding="utf-8-sig", errors="replace", newline=""))
        for cells in reader:
            if cells:
                yield reader.line_num, cells


def _open(path: Path) -> IO[bytes]:
    return gzip.open(path, "rb") if path.name.lower().endswith(".gz") else path.open("rb")  # type: ignore[return-value]


def _first_sentence(error: BaseException) -> str:
    # Arrow and the system add paths and nested detail that say nothing to the reader of a message.
    text = str(getattr(error, "strerror", None) or error).strip().splitlines()
    return re.split(r"(?<=\w)\. |: '", re.sub(r"^.*input source '.*?': ", "", text[0]))[0].rstrip(".") if text else ""
