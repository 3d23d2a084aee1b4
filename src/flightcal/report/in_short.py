"""What a terminal shows of a page that is no calibration's: its first tables and its findings."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from . import backtest_page, comparison_page, validation_page
from .findings import Finding
from .run_files import read_content
from .tables import Table

_PAGES: Final = {"backtest": backtest_page, "comparison": comparison_page, "validation": validation_page}


def in_short(folder: Path, kind: str) -> tuple[list[Table], list[Finding]]:
    """Of a `backtest`, `comparison` or `validation` in a folder. Raises RunError where that is not there."""
    page, content = _PAGES[kind], read_content(folder, kind)
    return page.first_tables(content), page.findings(content)
