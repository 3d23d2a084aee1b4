"""Apache Parquet."""

from __future__ import annotations

from collections.abc import Collection

import pyarrow as pa
import pyarrow.parquet

from ._source import Source


class Parquet:
    """Typed columns; rows have numbers rather than lines."""

    kind = "Parquet"
    suffixes = (".parquet", ".pq")
    has_header, has_sheets = False, False
    magic = b"PAR1"

    def read(self, source: Source, text_columns: Collection[str], markers: Collection[str]) -> pa.Table:
        """See `Reader`."""
        return pa.parquet.read_table(source.path)

    def place(self, source: Source, row: int) -> str:
        """See `Reader`."""
        return f"row {row + 1}"
