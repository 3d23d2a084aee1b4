"""The parameters before and after, how much of them is the telemetry's word, and the files that have them."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from scipy.stats import norm

from ...calibration import Calibrated
from .. import block
from ..block import Block, section
from ..run_files import RunFiles, draws
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
    rows = [own for own in calibrated(run) if own.kind in SHOWN]
    if not rows:
        why = "has no parameters" if run.posterior is not None else "has no calibrated numbers: sampling did not finish"
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


def calibrated(run: RunFiles) -> tuple[Calibrated, ...]:
    """Quantities before and after: those that the run kept, else from its draws; none without draws."""
    return run.calibrated or tuple(_from_draws(run))


def _from_draws(run: RunFiles) -> Iterable[Calibrated]:
    if run.posterior is None or "prior" not in run.posterior.children:
        return
    for info in (own for own in run.sampled if own.name in run.posterior["prior"]):
        before, after = (draws(run.posterior, group, [info.name]).ravel() for group in ("prior", "posterior"))
        lower, median, upper = (np.quantile(after, [0.025, 0.5, 0.975]) + info.offset).tolist()
        before_lower, middle, before_upper = (value + info.offset for value in info.prior_quantiles)
        scores = norm.ppf((np.searchsorted(np.sort(before), after) + 0.5) / (before.size + 1))
        yield Calibrated(
            info.name, info.kind, info.unit, middle, before_lower, before_upper, float(after.mean()) + info.offset,
            median, float(after.std()), lower, upper, float(np.clip(1.0 - scores.var(), 0.0, 1.0)),
        )  # fmt: skip


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
