"""A table as rows of text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


class Cell(str):
    """Text of a cell that wants to be seen, with its state: good, warn or bad."""

    state: str

    def __new__(cls, text: str, state: str) -> Cell:
        """A cell of this text and state."""
        cell = super().__new__(cls, text)
        cell.state = state
        return cell


@dataclass(frozen=True)
class Table:
    """A table: a header and rows of text."""

    header: tuple[str, ...]
    rows: list[list[str]]
    numbers: Sequence[int] = ()
    """Columns of numbers, which are set to the right."""
    groups: Sequence[tuple[str, int]] = ()
    """Titles over several columns: title and number of columns."""

    def state(self, row: int, column: int) -> str:
        """State of a cell, or nothing."""
        return getattr(self.rows[row][column], "state", "")
