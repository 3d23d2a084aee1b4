"""What several verbs take from the command line."""

from pathlib import Path
from typing import Annotated

import typer

ScenarioFile = Annotated[Path, typer.Argument(help="The scenario, a YAML file.", show_default=False)]
TelemetryPlace = Annotated[
    Path | None,
    typer.Option("--telemetry", help="Read the telemetry from this file or folder instead of where the scenario says."),
]
