"""`flightcal init`: something to start from."""

from pathlib import Path
from typing import Annotated

import typer


def init(
    folder: Annotated[Path, typer.Argument(help="Folder to create.", show_default=False)],
    telemetry: Annotated[
        list[Path] | None,
        typer.Argument(
            help="Telemetry files of your satellite (CSV, Parquet, Excel). Default: made-up telemetry.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Write a commented scenario to start from: for your telemetry files, or for made-up telemetry.

    Packets, time columns and their formats, units, kinds of channels and the modes' timeline are taken from the files.
    Numbers of the thermal network are placeholders.

    Example: `flightcal init my_satellite housekeeping.csv power.xlsx`
    """
    from ..scenario import write_new, write_template
    from .drafting import draft

    if telemetry:
        files, notes = draft(folder, telemetry)
        written = write_new(folder, files)
    else:
        written, notes = write_template(folder), []
    for note in notes:
        typer.echo(note)
    for file in written:
        typer.echo(f"wrote {file}")
    typer.echo(f"next: flightcal lint {folder / 'scenario.yaml'}")
