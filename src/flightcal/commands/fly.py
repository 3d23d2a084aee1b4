"""A flight of the operational simulator as a CSV file, which a scenario reads as telemetry."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

from ..errors import RunError
from ..operational import fly, load_spacecraft
from ..prediction import ZERO_CELSIUS
from ..run import write_atomically


def fly_to_csv(
    spacecraft_file: Path, out: Path, pace: float | None, on_progress: Callable[[float], None] = lambda _: None
) -> list[str]:
    """Fly a spacecraft file and write its telemetry: time (UTC), temperatures (degC), heater status, mode.

    on_progress: told the share that is done. Returns lines that say what was done. Raises ScenarioError, and RunError
    where `out` is there already.
    """
    if out.exists():
        raise RunError(f"{out}: found a file, expected none: nothing is overwritten")
    mission = load_spacecraft(spacecraft_file)
    flight = fly(
        mission.spacecraft,
        mission.start,
        mission.duration,
        seed=mission.seed,
        pace=math.inf if pace is None else pace,
        on_cycle=lambda time, _: on_progress(time / mission.duration),
    )
    table = flight.telemetry.copy()
    thermistors = list(mission.spacecraft.downlink.thermistors)
    table[thermistors] -= ZERO_CELSIUS
    write_atomically(out, lambda path: table.to_csv(path, float_format="%.4f", date_format="%Y-%m-%dT%H:%M:%S"))
    lines = [
        f"{len(flight.nodes)} nodes, {len(flight.cycle_times)} control cycles; "
        f"{flight.real_time_factor:,.0f} times real time"
    ]
    for enclosure, share in mission.openness.items():
        if share > 0.01:
            lines.append(f"enclosure {enclosure}: up to {share:.0%} of a cell's view is open to space")
    for k, line in enumerate(mission.spacecraft.software.heaters):
        lines.append(
            f"heater {line.name}: on {(flight.power[:, k] > 0).mean():.1%} of the time, "
            f"{flight.power[:, k].mean():.2f} W on average"
        )
    changes = [
        f"{flight.cycle_times[k]:.0f} s: mode {mode}"
        for k, mode in enumerate(flight.modes)
        if k == 0 or mode != flight.modes[k - 1]
    ]
    return [*lines, *changes, f"wrote {out}"]
