"""A telemetry file, and what a reader of its kind must offer."""

from __future__ import annotations

import gzip
from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Protocol

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

NULL_WORDS = frozenset(
    ["", "N/A", "n/a", "#N/A", "NA", "NULL", "Null", "null", "None", "NaN", "nan", "NAN", "-NaN", "-nan"]
)
"""What stands for a missing value in a file whose scenario says nothing else."""


class Reader(Protocol):
    """Files of one kind -> tables. Whatever pyarrow, the system or a codec raises becomes a message."""

    @property
    def kind(self) -> str:
        """What messages call it."""

    @property
    def suffixes(self) -> tuple[str, ...]:
        """Of its files' names, in lower case; those that end in .gz are also opened uncompressed by `Source.open`."""

    @property
    def has_header(self) -> bool:
        """Whether a row of the file has the columns' names, so that it may be another than the first."""

    @property
    def has_sheets(self) -> bool:
        """Whether a file has several tables."""

    @property
    def magic(self) -> bytes | None:
        """First bytes of all its files, if there are such."""

    def read(self, source: Source, text_columns: Collection[str], markers: Collection[str]) -> pa.Table:
        """The whole file; columns are typed by what they hold.

        text_columns: stay text as it is written, where the file is text.
        markers: texts that are kept although they usually stand for a missing value (`NULL_WORDS`).
        """

    def place(self, source: Source, row: int) -> str:
        """Where data row `row` (from 0) stands, as a person looks for it."""


@dataclass(frozen=True)
class Source:
    """A telemetry file: where it is, the name by which messages call it, and what reads it."""

    path: Path
    name: str
    reader: Reader
    sheet: str | None = None
    """Of a spreadsheet; null: its first."""
    header: int | None = None
    """Number of the line or row with the columns' names; null: the first that is not empty."""
    rows: NDArray[np.intp] | None = None
    """Which data rows are looked at; null: all of them."""

    def open(self) -> IO[bytes]:
        """The file's bytes, uncompressed."""
        compressed = self.path.name.lower().endswith(".gz")
        return gzip.open(self.path, "rb") if compressed else self.path.open("rb")  # type: ignore[return-value]

    def only(self, rows: NDArray[np.intp]) -> Source:
        """With some rows of those that are looked at."""
        return replace(self, rows=rows if self.rows is None else self.rows[rows])

    def place(self, row: int) -> str:
        """The file's name, and where in it data row `row` (from 0) of those that are looked at stands."""
        in_file = row if self.rows is None else int(self.rows[row])
        return f"{self.name}: {self.reader.place(self, in_file)}"
