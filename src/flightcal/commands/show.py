"""`flightcal show`: what a finished run found, from its files alone."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .printing import say

if TYPE_CHECKING:
    from rich.console import Console


def show(
    run: Annotated[Path, typer.Argument(help="Folder of a run.", show_default=False)],
    every: Annotated[
        bool, typer.Option("--all", help="Every quantity: noise, heat and initial temperatures too.")
    ] = False,
) -> None:
    """Print the verdict on a run, its parameters before and after, and the files that it leaves behind.

    Example: `flightcal show runs/first`
    """
    from rich.console import Console

    print_run(run, Console(), every=every)


def print_run(folder: Path, console: Console, *, every: bool = False) -> None:
    """What a finished run found; every: quantities that are no parameters of the scenario, too. Raises RunError."""
    from ..prediction import PREDICTION_FILE, read_limits_told, simulator_errors
    from .display import print_limits, print_verdict
    from .finished_run import ABOUT, chosen, parameter_table, read_finished

    kept = read_finished(folder)
    say(console, kept.title)
    print_verdict(kept.verdict, folder, console)
    rows = chosen(kept.parameters, every)
    if rows:
        console.print(parameter_table(rows, console))
    if left := len(kept.parameters) - len(rows):
        console.print(f"{left} more with --all: noise, heat and initial temperatures", highlight=False)
    for error in simulator_errors(kept.metrics):
        say(console, str(error))
    print_limits(read_limits_told(folder / PREDICTION_FILE), console)
    for name, words in ABOUT.items():
        if (folder / name).is_file():
            say(console, f"{folder / name}: {words}")
