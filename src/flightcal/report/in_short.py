"""What a terminal shows of a page that is no calibration's: its first tables and its findings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

from . import backtest_page, comparison_page, validation_page
from .findings import Finding
from .run_files import Record, read_content
from .tables import Table

InShort = tuple[list[Table], list[Finding]]

_KINDS: Final[Mapping[str, Callable[[Record], InShort]]] = {
    "backtest": lambda content: (backtest_page.first_tables(content), backtest_page.findings(content)),
    "comparison": lambda content: (comparison_page.first_tables(content), comparison_page.findings(content)),
    "validation": lambda content: (validation_page.first_tables(content), validation_page.findings(content)),
}


def in_short(folder: Path, kind: str) -> InShort:
    """Of a `backtest`, `comparison` or `validation` in a folder. Raises RunError where that is not there."""
    return _KINDS[kind](read_content(folder, kind))
