"""`flightcal schema`: what a file may say, for editors."""

import json
from typing import Annotated

import typer


def schema(
    spacecraft: Annotated[bool, typer.Option("--spacecraft", help="Of the files that `fly` reads instead.")] = False,
) -> None:
    """Print the JSON Schema of scenario files, for editors.

    Example: `flightcal schema > flightcal.schema.json`
    """
    if spacecraft:
        from ..operational import SpacecraftFile
        from ..scenario import schema_of

        content = schema_of(SpacecraftFile)
    else:
        from ..scenario import json_schema

        content = json_schema()
    typer.echo(json.dumps(content, indent=2))
