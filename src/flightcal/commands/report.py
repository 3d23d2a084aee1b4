"""`flightcal report`: the page of a run, from its files alone."""

from pathlib import Path
from typing import Annotated

import typer


def report(
    run: Annotated[Path, typer.Argument(help="Folder of a run.", show_default=False)],
    out: Annotated[Path | None, typer.Option(help="HTML file to write; default: report.html in the run.")] = None,
) -> None:
    """Write the report of a run again, from its files alone.

    Example: `flightcal report runs/first`
    """
    from ..report import write_backtest, write_report

    write = write_backtest if (run / "backtest.json").is_file() else write_report
    typer.echo(f"report: {write(run, out)}")
