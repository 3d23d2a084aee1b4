"""Excel workbooks (Office Open XML)."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import closing, contextmanager
from datetime import datetime
from itertools import islice, zip_longest
from typing import Any

import pyarrow as pa

from ...errors import TelemetryError, require
from ._source import NULL_WORDS, Source


class Excel:
    """One sheet with a header; rows have the numbers that a spreadsheet shows."""

    kind = "an Excel workbook"
    suffixes = (".xlsx", ".xlsm")
    has_header, has_sheets = True, True
    magic = None  # that of any ZIP archive

    def read(self, source: Source, text_columns: Collection[str], markers: Collection[str]) -> pa.Table:
        """See `Reader`."""
        rows = _rows(source)
        header = next(rows, (0, ()))[1]
        if not header:
            raise TelemetryError(f"{source.name}: found an empty sheet, expected telemetry")
        names = ["" if cell is None else str(cell) for cell in header]
        nulls = NULL_WORDS - set(markers) | {""}
        # Cells beyond the header are notes of whoever made the sheet.
        columns = list(zip_longest(*(cells[: len(names)] for _, cells in rows)))
        columns += [()] * (len(names) - len(columns))
        length = max(len(column) for column in columns)
        arrays = [_column([_cell(value, nulls) for value in column], length) for column in columns]
        return pa.Table.from_arrays(arrays, names=names)

    def place(self, source: Source, row: int) -> str:
        """See `Reader`."""
        number = next(islice(_rows(source), row + 1, None), (row + 2, ()))[0]
        return f"row {number}" if source.sheet is None else f"sheet '{source.sheet}', row {number}"


def sheets(source: Source) -> list[str]:
    """Names of a workbook's sheets. Raises as `Excel.read`."""
    with _opened(source) as book:
        return [sheet.title for sheet in book.worksheets]


def _rows(source: Source) -> Iterator[tuple[int, Sequence[Any]]]:
    """Number and cells of each row that is not empty, the header first."""
    with _opened(source) as book:
        titles = [sheet.title for sheet in book.worksheets]
        if source.sheet is not None and source.sheet not in titles:
            found = ", ".join(f"'{name}'" for name in titles)
            raise TelemetryError(f"{source.name}: found the sheets {found}, expected '{source.sheet}' among them")
        sheet = book.worksheets[0 if source.sheet is None else titles.index(source.sheet)]
        sheet.reset_dimensions()  # what the file says of its size is often wrong
        for number, cells in enumerate(sheet.iter_rows(values_only=True), start=1):
            if number >= (source.header or 1) and any(cell is not None for cell in cells):
                yield number, _trimmed(cells)


@contextmanager
def _opened(source: Source) -> Iterator[Any]:
    """The workbook; what goes wrong while it is read becomes a message."""
    require("openpyxl", "excel", source.name)
    import openpyxl

    try:
        with source.open() as file, closing(openpyxl.load_workbook(file, read_only=True, data_only=True)) as book:
            yield book
    except TelemetryError:
        raise
    except Exception as error:  # openpyxl raises a dozen kinds for what is no workbook, or a damaged one
        text = str(error).strip().splitlines()
        reason = f" ({text[0][:100]})" if text else ""
        raise TelemetryError(f"{source.name}: cannot be read, expected an Excel workbook{reason}") from None


def _trimmed(cells: Sequence[Any]) -> Sequence[Any]:
    """Without the empty cells at the end."""
    last = max(k for k, cell in enumerate(cells) if cell is not None)
    return cells[: last + 1]


def _cell(value: Any, nulls: Collection[str]) -> Any:
    return None if isinstance(value, str) and value.strip() in nulls else value


def _column(cells: list[Any], length: int) -> pa.Array:
    """Cells of one kind as they are; where kinds are mixed, what a spreadsheet would write as text."""
    cells += [None] * (length - len(cells))
    kinds = {type(cell) for cell in cells} - {type(None)}
    if kinds == {int} and all(abs(cell or 0) < 2**63 for cell in cells):
        return pa.array(cells, type=pa.int64())
    if kinds <= {int, float}:
        return pa.array([None if cell is None else float(cell) for cell in cells], type=pa.float64())
    if kinds == {bool}:
        return pa.array(cells, type=pa.bool_())
    if kinds == {datetime}:
        return pa.array(cells, type=pa.timestamp("us"))
    return pa.array([None if cell is None else _text(cell) for cell in cells], type=pa.string())


def _text(cell: Any) -> str:
    return cell.isoformat() if isinstance(cell, datetime) else str(cell)
