"""The parameters before and after, how much of them is the telemetry's word, and the files that have them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence

from ...calibration import Calibrated, PriorScore
from ...prediction import SimulatorError, simulator_errors
from ...words import in_digits, number, percent, unit
from .. import block
from ..block import Block, section
from ..run_files import RunFiles
from ..tables import Cell, Table

MOST_ROWS = 16
"""Rows that the first screen has; more are folded."""
LITTLE = 0.2
"""Share of the telemetry's word below which a value is more or less what was believed before, unless it moved."""
FAR = 1.0
"""Normal score of a median in its prior, from which a value moved and is not what was believed before."""
_ALONE = (
    "A simulation of these files has no unmodelled heat. The numbers of best_fit.yaml make up for that, and lie beside "
    "the truth; those of calibrated.yaml are what the satellite is likely to be."
)
_MOVED = "moved, as wide"


@section("calibrated", "Parameters")
def panel(run: RunFiles) -> list[Block]:
    """Before, after, interval, unit, and how much is the telemetry's word."""
    rows = [quantity for quantity in run.calibrated if quantity.is_parameter]
    if not rows:
        why = "has no parameters" if run.calibrated else "has no calibrated numbers: it did not finish"
        return [block.note(f"The run {why}.")]
    words = (
        "Before: median of what was believed (the prior). After: mean of what telemetry leaves possible (the "
        "posterior), and the interval that has 95% of it. From telemetry: by how much it made the value surer "
        "(1 − variance after / before, in normal scores)."
    )
    moved = moved_far(rows, run.prior_scores)
    if moved:
        words += (
            f" {_MOVED.capitalize()}: telemetry moved it by over a deviation of the prior, but tells it hardly better."
        )
    fixed = run.fixed_numbers
    if fixed is not None:
        words += (
            " Fixed numbers are capacities, areas, links and whatever else is no parameter. Where they are uncertain "
            f"by {percent(fixed.within, 0)}, the wider interval holds. Temperatures hardly depend on it, the values do."
        )
    within = None if fixed is None else fixed.within
    blocks = [block.table(table(rows[:MOST_ROWS], within, moved))]
    if rows[MOST_ROWS:]:
        blocks.append(block.folded(f"{len(rows) - MOST_ROWS} more", table(rows[MOST_ROWS:], within, moved)))
    errors = simulator_errors(run.metrics)
    return [
        *blocks,
        block.text(words),
        *([block.table(simulated_alone(errors))] if errors else []),
        *([block.text(_ALONE)] if errors and run.heat is not None else []),
        *([block.links("To load:", run.files)] if run.files else []),
    ]


def simulated_alone(errors: Sequence[SimulatorError]) -> Table:
    """What the numbers are worth in windows that were not trained on: a row for each."""
    rows = [
        [error.window, *(number(k, 3) for k in (error.before, error.predicted, error.calibrated, error.best_fit))]
        for error in errors
    ]
    return Table(("RMSE, K", "before", "this run", "calibrated.yaml alone", "best_fit.yaml alone"), rows, (1, 2, 3, 4))


def moved_far(rows: Iterable[Calibrated], scores: Mapping[str, PriorScore]) -> set[str]:
    """Names of values that telemetry moved and made hardly surer."""
    far = {name for name, prior_score in scores.items() if abs(prior_score.prior_score) >= FAR}
    return {quantity.name for quantity in rows if quantity.from_data < LITTLE and quantity.name in far}


def table(rows: Iterable[Calibrated], within: float | None = None, moved: Collection[str] = ()) -> Table:
    """A row for each quantity.

    within: by how much fixed numbers are off in a further interval; None: without it. moved: see `moved_far`.
    """
    cells = []
    for quantity in rows:
        before, after, lower, upper = in_digits(
            quantity.lower, quantity.upper, quantity.before, quantity.mean, quantity.lower, quantity.upper
        )
        told: str = percent(quantity.from_data, 0)
        if quantity.from_data < LITTLE:
            told = Cell(f"{told}\n{_MOVED if quantity.name in moved else 'mostly the prior'}", "warn")
        wider = (
            "–" if quantity.considered is None else " to ".join(in_digits(*quantity.considered, *quantity.considered))
        )
        intervals = [f"{lower} to {upper}"] + [wider] * (within is not None)
        cells.append([quantity.name, before, after, *intervals, unit(quantity.unit) or "–", told])
    ends: tuple[str, ...] = ("95% interval",)
    if within is not None:
        ends = ("95% interval if fixed numbers are exact", f"if they are {percent(within, 0)} off")
    names = ("parameter", "before", "after", *ends, "unit", "from telemetry")
    return Table(names, cells, tuple(k for k, name in enumerate(names) if name not in ("parameter", "unit")))
