"""What several verbs take from the command line, and how all of them end."""

from pathlib import Path
from typing import Annotated, Final

import typer

USER_ERROR: Final = 1
GATE_FAILED: Final = 3
INTERRUPTED: Final = 130

ScenarioFile = Annotated[Path, typer.Argument(help="The scenario, a YAML file.", show_default=False)]
TelemetryPlace = Annotated[
    Path | None,
    typer.Option("--telemetry", help="Read the telemetry from this file or folder instead of where the scenario says."),
]
