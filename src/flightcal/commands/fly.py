"""`flightcal fly`: a flight of the operational simulator as a CSV file, which a scenario reads as telemetry."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from ..errors import RunError
from ..progress import SILENT, Progress

if TYPE_CHECKING:
    from ..simulator import Times


def fly(
    spacecraft: Annotated[Path, typer.Argument(help="The spacecraft, a YAML file.", show_default=False)],
    out: Annotated[Path, typer.Option(help="CSV file to write; nothing is overwritten.")] = Path("telemetry.csv"),
    pace: Annotated[
        float | None, typer.Option(min=0.001, help="Seconds to simulate in a second at most; 1: real time.")
    ] = None,
) -> None:
    """Fly the full-order operational simulator, on-board software in the loop, and write its telemetry.

    Example: `flightcal fly spacecraft.yaml --out telemetry.csv`
    """
    from .display import display

    with display() as progress:
        lines = fly_to_csv(spacecraft, out, pace, progress)
    for line in lines:
        typer.echo(line)


def _written_times(times: Times) -> list[str]:
    """Times as ISO 8601, with as many decimals of a second as they have."""
    import numpy as np

    units: tuple[Literal["s", "ms", "us", "ns"], ...] = ("s", "ms", "us", "ns")
    for unit in units:
        if (times == times.astype(f"datetime64[{unit}]")).all():
            break
    return [str(time) for time in np.datetime_as_string(times, unit=unit)]


def fly_to_csv(spacecraft_file: Path, out: Path, pace: float | None, progress: Progress = SILENT) -> list[str]:
    """Fly a spacecraft file and write its telemetry: time (UTC), temperatures (degC), heater status, mode.

    Returns lines that say what was done. Raises ScenarioError, and RunError where `out` is there already.
    """
    import pandas

    from ..operational import fly as flown
    from ..operational import load_spacecraft
    from ..run import write_text
    from ..scenario import ICE_POINT

    if out.exists():
        raise RunError(f"{out}: found a file, expected none: nothing is overwritten")
    if not out.absolute().parent.is_dir():
        raise RunError(f"{out}: found no folder '{out.parent}', expected one to write in")
    mission = load_spacecraft(spacecraft_file)
    with progress.stage("flying", mission.duration) as flying:
        flight = flown(
            mission.spacecraft,
            mission.start,
            mission.duration,
            seed=mission.seed,
            pace=math.inf if pace is None else pace,
            on_cycle=lambda time, _: flying.at(time, f"{time / 3600:.1f} of {mission.duration / 3600:.1f} h"),
        )
    table = flight.telemetry.copy()
    thermistors = list(mission.spacecraft.downlink.thermistors)
    table[thermistors] -= ICE_POINT
    table.index = pandas.Index(_written_times(table.index.to_numpy("datetime64[ns]")), name=table.index.name)
    write_text(out, table.to_csv(float_format="%.4f"))
    lines = [
        f"{len(flight.nodes)} nodes, {len(flight.cycle_times)} control cycles; "
        f"{flight.real_time_factor:,.0f} times real time"
    ]
    for enclosure, share in mission.openness.items():
        if share > 0.01:
            lines.append(f"enclosure {enclosure}: up to {share:.0%} of a cell's view is open to space")
    for k, line in enumerate(mission.spacecraft.software.heaters):
        lines.append(
            f"heater {line}: on {(flight.power[:, k] > 0).mean():.1%} of the time, "
            f"{flight.power[:, k].mean():.2f} W on average"
        )
    changes = [
        f"{flight.cycle_times[k]:.0f} s: mode {mode}"
        for k, mode in enumerate(flight.modes)
        if k == 0 or mode != flight.modes[k - 1]
    ]
    return [*lines, *changes, f"wrote {out}"]
