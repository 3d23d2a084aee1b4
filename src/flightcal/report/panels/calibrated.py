"""The parameters before and after, how much of them is the telemetry's word, and the files that have them."""

from __future__ import annotations

from collections.abc import Iterable

from ...calibration import Calibrated
from .. import block
from ..block import Block, section
from ..run_files import RunFiles
from ..tables import Cell, Table, in_digits
from ..text import percent, unit

SHOWN = ("parameter", "drift")
MOST_ROWS = 16
"""Rows that the first screen has; more are folded."""
LITTLE = 0.2
"""Share of the telemetry's word below which a value is more or less what was believed before."""


@section("calibrated", "Parameters")
def panel(run: RunFiles) -> list[Block]:
    """Before, after, interval, unit, and how much is the telemetry's word."""
    rows = [own for own in run.calibrated if own.kind in SHOWN]
    if not rows:
        why = "has no parameters" if run.calibrated else "has no calibrated numbers: it did not finish"
        return [block.note(f"The run {why}.")]
    words = (
        "Before: median of what was believed (the prior). After: mean of what telemetry leaves possible (the "
        "posterior), and the interval that has 95% of it. From telemetry: how much is its word and not the prior's "
        "(1 − variance after / before, in normal scores)."
    )
    blocks = [block.table(table(rows[:MOST_ROWS]))]
    if rows[MOST_ROWS:]:
        blocks.append(block.folded(f"{len(rows) - MOST_ROWS} more", table(rows[MOST_ROWS:])))
    return [*blocks, block.text(words), *([block.links("To load:", run.files)] if run.files else [])]


def table(rows: Iterable[Calibrated]) -> Table:
    """A row for each quantity."""
    cells = []
    for own in rows:
        before, after, lower, upper = in_digits(own.lower, own.upper, own.before, own.mean, own.lower, own.upper)
        told: str = percent(own.from_data, 0)
        if own.from_data < LITTLE:
            told = Cell(f"{told}\nmostly the prior", "warn")
        cells.append([own.name, before, after, f"{lower} to {upper}", unit(own.unit) or "–", told])
    return Table(("parameter", "before", "after", "95% interval", "unit", "from telemetry"), cells, (1, 2, 3, 5))
