"""A table as rows of text, and intervals in its cells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .text import number


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


def interval(middle: float, low: float, high: float) -> str:
    """``0.4213 [0.4131, 0.4298]``, all with the significant digits that the width asks for."""
    shown, lower, upper = in_digits(low, high, middle, low, high)
    return "–" if lower == "–" else f"{shown} [{lower}, {upper}]"


def in_digits(low: float, high: float, *values: float) -> list[str]:
    """Values with the digits that the width from `low` to `high` asks for; dashes where it is not known."""
    width = high - low
    if not np.isfinite(width):
        return ["–"] * len(values)
    largest = max(abs(low), abs(high), 1e-300)
    digits = 4 if width <= 0 else int(np.clip(np.ceil(np.log10(largest / width)) + 2, 3, 8))
    return [number(value, digits) for value in values]
