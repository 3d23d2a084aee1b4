"""What the sections of a page are made of."""

from __future__ import annotations

from dataclasses import dataclass

import plotly.graph_objects as go

from .tables import Table


@dataclass(frozen=True)
class Block:
    """A piece of a section; `kind` says which of the other fields it has."""

    kind: str
    """text, note (something lacks), heading, table, figure, grid (small figures), folded (a table), source (a file)"""
    text: str = ""
    table: Table | None = None
    figures: tuple[go.Figure, ...] = ()
    key: tuple[tuple[str, str, str], ...] = ()
    """Legend of a grid: name, colour, and line, dash or mark."""
    wide: bool = False
    """A figure that scrolls sideways on a narrow screen."""


@dataclass(frozen=True)
class Section:
    """A section: its anchor, title and blocks."""

    anchor: str
    title: str
    blocks: list[Block]


def text(text: str) -> Block:
    """A paragraph."""
    return Block("text", text)


def note(text: str) -> Block:
    """A paragraph that says what lacks."""
    return Block("note", text)


def table(table: Table, nothing: str = "There is nothing to list.") -> Block:
    """A table; where it has no rows, a note."""
    return Block("table", table=table) if table.rows else note(nothing)


def figure(figure: go.Figure, caption: str, *, wide: bool = False) -> Block:
    """A figure with its caption."""
    return Block("figure", caption, figures=(figure,), wide=wide)
