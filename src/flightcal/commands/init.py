"""`flightcal init`: something to start from."""

from pathlib import Path
from typing import Annotated

import typer


def init(folder: Annotated[Path, typer.Argument(help="Folder to create.", show_default=False)]) -> None:
    """Write a commented scenario and example telemetry to start from.

    Example: `flightcal init my_satellite`
    """
    from ..scenario import write_template

    for file in write_template(folder):
        typer.echo(f"wrote {file}")
    typer.echo(f"next: flightcal lint {folder / 'scenario.yaml'}")
