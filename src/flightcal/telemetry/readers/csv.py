"""Text separated by commas, semicolons or tabs, compressed or not."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Collection, Iterator
from functools import partial
from itertools import islice

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv

from ...errors import TelemetryError
from ._source import NULL_WORDS, Source

_MAGIC = {
    b"PK\x03\x04": "a ZIP archive or a spreadsheet",
    b"\x1f\x8b": "gzip data",
    b"\x89HDF": "HDF5",
    b"\xff\xfe": "UTF-16",
    b"\xfe\xff": "UTF-16",
}
"""First bytes of files that are sometimes called .csv and that no reader reads."""

_ANNOTATIONS = ("#group", "#datatype", "#default")
"""First cells of the lines above each table of an InfluxDB export."""
_SEPARATORS = (",", ";", "\t", "|")
_LOOKED_AT = 50
"""Lines that tell what separates the columns."""
_BELOW_TITLE = "where a title stands above the columns' names, 'header' says in which line these are"
_DECIMAL_COMMA = r"^(\s*[-+]?\d*),(\d+(?:[eE][-+]?\d+)?\s*)$"


class Csv:
    """Text with a header, a row to a line."""

    kind = "comma-separated UTF-8 text"
    suffixes = tuple(f"{suffix}{packed}" for suffix in (".csv", ".txt", ".dat", ".tsv") for packed in ("", ".gz"))
    has_header, has_sheets = True, False
    magic = None

    def read(self, source: Source, text_columns: Collection[str], markers: Collection[str]) -> pa.Table:
        """See `Reader`."""
        _check_text(source)
        separator = _separator(source)
        header = _header(source, separator)
        commas = separator != "," and _has_decimal_commas(source, separator)
        convert = pa.csv.ConvertOptions(
            decimal_point="," if commas else ".",
            column_types={column: pa.string() for column in header if column.strip() in text_columns},
            null_values=sorted(NULL_WORDS - set(markers) | {""}),
            strings_can_be_null=True,
        )
        parse = pa.csv.ParseOptions(delimiter=separator)
        read = partial(pa.csv.read_csv, parse_options=parse, convert_options=convert)
        try:
            above = next(_lines(source, separator))[0] - 1
            with source.open() as file:
                table = read(file, read_options=pa.csv.ReadOptions(skip_rows=above))
            is_whole = not _has_header_again(table, header)
        except pa.ArrowInvalid:
            # Arrow names no line when it reads in parallel; a second, slow look does.
            _check_encoding(source)
            ragged = _ragged(source, separator, len(header))
            if ragged is not None:
                raise ragged from None
            is_whole = False
        if not is_whole:
            table = read(io.BytesIO(_one_table(source, separator)))
        if any(pa.types.is_binary(kind) for kind in table.schema.types):
            _check_encoding(source)
        return _with_points(table) if commas else table

    def place(self, source: Source, row: int) -> str:
        """See `Reader`."""
        line, _ = next(islice(_lines(source, _separator(source)), row + 1, None), (row + 2, []))
        return f"line {line}"


def _separator(source: Source) -> str:
    """What parts the first lines into most columns, as many in most as in the header; a comma where nothing does."""
    found = []
    for separator in _SEPARATORS:
        counts = [len(cells) for _, cells in islice(_lines(source, separator), _LOOKED_AT)]
        found.append(counts[0] if counts and 2 * counts.count(counts[0]) > len(counts) else 0)
    most = max(found)
    return _SEPARATORS[found.index(most)] if most > 1 else ","


def _has_decimal_commas(source: Source, separator: str) -> bool:
    """Whether a cell is a number with a comma."""
    number = re.compile(_DECIMAL_COMMA)
    return any("," in cell and number.match(cell) for _, cells in _lines(source, separator) for cell in cells)


def _with_points(table: pa.Table) -> pa.Table:
    """A table with points for the commas of numbers, in columns that hold other text too."""
    for place, column in enumerate(table.columns):
        if pa.types.is_string(column.type):
            points = pc.replace_substring_regex(column, pattern=_DECIMAL_COMMA, replacement=r"\1.\2")
            table = table.set_column(place, table.column_names[place], points)
    return table


def _has_header_again(table: pa.Table, header: list[str]) -> bool:
    """Whether a file has several tables below each other, each with its header."""
    place = next((k for k, name in enumerate(header) if name), 0)
    column = table.column(place)
    return pa.types.is_string(column.type) and bool(pc.any(pc.equal(column, header[place])).as_py())


def _one_table(source: Source, separator: str) -> bytes:
    """The header and the rows of all tables in a file, as text, without what stands above, between and below them."""
    text = io.StringIO()
    csv.writer(text, delimiter=separator).writerows(cells for _, cells in _lines(source, separator))
    return text.getvalue().encode()


def _ragged(source: Source, separator: str, columns: int) -> TelemetryError | None:
    """The first line that has not as many values as the header, if any."""
    lines = _lines(source, separator)
    for row, (line, cells) in enumerate(lines):
        if len(cells) != columns:
            found = "1 value" if len(cells) == 1 else f"{len(cells)} values"
            hint = "" if next(lines, None) else "; it is the last line, is the file cut off?"
            if row == 1 and not hint:
                hint = f"; {_BELOW_TITLE}"
            return TelemetryError(
                f"{source.name}: line {line}: found {found}, expected {columns} as in the header{hint}"
            )
    return None


def _check_text(source: Source) -> None:
    """Raises TelemetryError where it is no text."""
    with source.open() as file:
        start = file.read(65536)
    for magic, kind in _MAGIC.items():
        if start.startswith(magic):
            raise TelemetryError(f"{source.name}: found {kind}, expected comma-separated UTF-8 text")
    if b"\0" in start:
        raise TelemetryError(f"{source.name}: found binary data, expected comma-separated UTF-8 text")
    if not start.strip():
        raise TelemetryError(f"{source.name}: the file is empty")
    _check_encoding(source, lines=1)


def _header(source: Source, separator: str) -> list[str]:
    """Column names as the file has them. Raises TelemetryError where they are none."""
    header = next(_lines(source, separator), (0, []))[1]
    if not header:
        raise TelemetryError(f"{source.name}: found no line {source.header}, expected the columns' names there")
    if len(header) == 1:
        raise TelemetryError(
            f"{source.name}: found one column, '{header[0][:60]}', expected columns separated by commas, semicolons or "
            f"tabs; {_BELOW_TITLE}"
        )
    if all(re.match(r"\s*[-+]?\.?\d|\s*$", cell) for cell in header):
        where = f"{source.name}: line {source.header or 1}"
        raise TelemetryError(f"{where}: found values ({', '.join(header[:3])}), expected the columns' names")
    return header


def _check_encoding(source: Source, lines: int | None = None) -> None:
    with source.open() as file:
        for number, line in enumerate(islice(file, lines), start=1):
            try:
                line.decode("utf-8")
            except UnicodeDecodeError as error:
                found = f"the byte 0x{line[error.start]:02x}"
                raise TelemetryError(f"{source.name}: line {number}: found {found}, expected UTF-8 text") from None


def _lines(source: Source, separator: str) -> Iterator[tuple[int, list[str]]]:
    """Line number and cells of the header and of each line of its tables that is not empty, as Arrow counts rows."""
    with source.open() as file:
        reader = csv.reader(
            io.TextIOWrapper(file, encoding="utf-8-sig", errors="replace", newline=""), delimiter=separator
        )
        header: list[str] | None = None
        for cells in reader:
            if not cells or reader.line_num < (source.header or 1) or cells[0] in _ANNOTATIONS or cells == header:
                continue
            if header is not None and cells[0].startswith("#") and len(cells) != len(header):
                continue  # a comment, such as one below the last row
            header = header or cells
            yield reader.line_num, cells
