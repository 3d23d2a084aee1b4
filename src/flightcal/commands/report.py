"""`flightcal report`: the page of a run, from its files alone."""

from pathlib import Path
from typing import Annotated

import typer


def report(
    run: Annotated[Path, typer.Argument(help="Folder of a run.", show_default=False)],
    out: Annotated[Path | None, typer.Option(help="HTML file to write; default: report.html in the run.")] = None,
    mask: Annotated[
        bool, typer.Option("--mask", help="A page to pass on, masked.html: neutral names, no absolute temperatures.")
    ] = False,
) -> None:
    """Write the report of a run again, from its files alone.

    Example: `flightcal report runs/first`
    """
    from ..errors import RunError
    from ..report import write_backtest, write_report

    if (run / "backtest.json").is_file():
        if mask:
            raise RunError(f"{run}: found a backtest, expected a run of 'flightcal calibrate'; only its page is masked")
        page = write_backtest(run, out)
    else:
        page = write_report(run, out, mask=mask)
    typer.echo(f"report: {page}")
