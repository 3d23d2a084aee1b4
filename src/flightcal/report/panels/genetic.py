"""The genetic algorithm's prediction: figure 4 of the paper."""

from __future__ import annotations

from ...words import letter
from .. import block
from ..block import Block, section
from ..run_files import RunFiles, bins, has_prediction
from ..windows import figure_point


@section("genetic", "Genetic algorithm")
def panel(run: RunFiles) -> list[Block]:
    """Figure 4: the genetic algorithm."""
    windows = run.test_windows or run.windows
    blocks = [
        block.figure(
            figure_point(window, [m for m in ("genetic", "genetic_best") if has_prediction(window, m)], bins(run)),
            f"Figure 4{letter(i, windows)}. Genetic algorithm (solid: mean of its runs, as published; dotted: best "
            f"run) against telemetry of the window “{name}”.",
        )
        for i, (name, window) in enumerate(windows.items())
        if has_prediction(window, "genetic") or has_prediction(window, "genetic_best")
    ]
    return blocks or [block.note("Figure 4: there is no prediction by the genetic algorithm in this run.")]
