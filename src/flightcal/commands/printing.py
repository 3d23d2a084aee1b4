"""Lines and tables on a terminal, as several verbs print them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table


def say(console: Console, line: str, style: str = "") -> None:
    """Print a line as it is, however long."""
    console.print(line, style=style, highlight=False, soft_wrap=True, markup=False)


def table_of(title: str, words: Sequence[str], numbers: Sequence[str], **column: Any) -> Table:
    """An empty table: columns of words, then of numbers, which are never broken. column: more of those of words."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(
        title=f"\n{title}" if title else None,
        title_justify="left",
        caption=" ",  # a line is left free above and below, which the edges would be
        box=SIMPLE_HEAD,
        show_edge=False,
        pad_edge=False,
        collapse_padding=True,
    )
    for heading in words:
        table.add_column(heading, **column)
    for heading in numbers:
        table.add_column(heading, justify="right", no_wrap=True)
    return table
