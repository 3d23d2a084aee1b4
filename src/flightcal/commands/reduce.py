"""`flightcal reduce`: a reduced model and its certificate, in a folder."""

from pathlib import Path
from typing import Annotated

import typer


def reduce(
    file: Annotated[Path, typer.Argument(help="The reduction, a YAML file.", show_default=False)],
    out: Annotated[Path, typer.Option(help="Folder to write; nothing is overwritten.")],
) -> None:
    """Make a reduced order model of an operational simulator, with a certificate of its error.

    Example: `flightcal reduce reduce.yaml --out rom`
    """
    from ..reduction import reduce_to_folder
    from .display import display

    with display() as progress:
        lines = reduce_to_folder(file, out, progress)
    for line in lines:
        typer.echo(line)
