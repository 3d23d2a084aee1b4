"""What the sections of a page are made of."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import wraps
from typing import TypeVar

import plotly.graph_objects as go

from .tables import Table

R = TypeVar("R")

Key = tuple[str, str, str]
"""An entry of the legend of a grid: name, colour, and line, dash or mark."""


@dataclass(frozen=True)
class Block:
    """A piece of a section; `kind` says which of the other fields it has."""

    kind: str
    """text, note (something lacks), heading, table, figure, grid (small figures), folded (a table), links, source"""
    text: str = ""
    table: Table | None = None
    figures: tuple[go.Figure, ...] = ()
    key: tuple[Key, ...] = ()
    wide: bool = False
    """A figure that scrolls sideways on a narrow screen."""
    large: bool = False
    """A grid of larger figures."""
    targets: tuple[tuple[str, str], ...] = ()
    """Files beside the page, and what each is."""


@dataclass(frozen=True)
class Section:
    """A section: its anchor, title and blocks."""

    anchor: str
    title: str
    blocks: list[Block]


@dataclass(frozen=True)
class Part:
    """A folded part of a page: its anchor, title, a line that says what is in it, and its sections."""

    anchor: str
    title: str
    words: str
    sections: list[Section]


def section(anchor: str, title: str) -> Callable[[Callable[[R], list[Block]]], Callable[[R], Section | None]]:
    """Makes a section of the blocks that a function gives of a run; None of none."""

    def of(build: Callable[[R], list[Block]]) -> Callable[[R], Section | None]:
        def panel(run: R) -> Section | None:
            blocks = build(run)
            return Section(anchor, title, blocks) if blocks else None

        return wraps(build)(panel)

    return of


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


def heading(text: str) -> Block:
    """A title inside a section."""
    return Block("heading", text)


def links(text: str, targets: Sequence[tuple[str, str]]) -> Block:
    """Files beside the page, each with what it is."""
    return Block("links", text, targets=tuple(targets))


def folded(title: str, table: Table) -> Block:
    """A table that opens by a click on its title."""
    return Block("folded", title, table=table)


def grid(figures: Sequence[go.Figure], caption: str, key: Sequence[Key], *, large: bool = False) -> Block:
    """Small figures beside each other, with one legend; large: larger ones."""
    return Block("grid", caption, figures=tuple(figures), key=tuple(key), large=large)
