"""The backtest of the same scenario, where it lies in the run's folder."""

from __future__ import annotations

from ...words import number, percent
from .. import block
from ..block import Block, section
from ..run_files import RunFiles
from ..tables import Table


@section("backtest", "Backtest")
def panel(run: RunFiles) -> list[Block]:
    """After how many origins intervals held, and scores by how far ahead is predicted."""
    content = run.backtest
    if content is None:
        return []
    words = (
        "The same scenario, trained anew up to each of several times (origins), predicts what follows. Intervals held "
        f"after {content['held']} of {len(content['origins'])} origins."
    )
    rows = [
        [
            score["band"],
            percent(score["coverage"]),
            number(score["rmse"], 3),
            number(score["width"], 3),
            number(score["crps"], 3),
        ]
        for score in content["scores"]
        if score["origin"] == score["channel"] == "all" and score["samples"]
    ]
    header = (
        "how far ahead",
        f"inside the {100 * content['interval']:g}% interval",
        "RMSE, K",
        "width of the interval, K",
        "CRPS, K",
    )
    table = Table(header, rows, range(1, 5))
    return [block.text(words), block.table(table), block.links("Its page:", [("backtest/report.html", "")])]
