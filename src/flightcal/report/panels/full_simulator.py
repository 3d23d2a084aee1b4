"""The operational simulator beside its reduced model."""

from __future__ import annotations

from ...words import count, number
from .. import block
from ..block import Block, section
from ..run_files import Record, RunFiles
from ..tables import Table


@section("full-simulator", "The full simulator")
def panel(run: RunFiles) -> list[Block]:
    """The operational simulator beside its reduced model."""
    check = run.full_check
    if check is None:
        return []
    return [
        block.text(
            "The calibration went through a reduced model. Here it is beside the operational simulator that it stands "
            f"for, on-board software in the loop, on the training window: {count(check['flights'])} flights, at the "
            f"posterior's mean and at draws from it ({count(check['failed'])} could not be compared). The difference "
            "is reduced minus operational, from where the flight is at the window's start; it includes what the "
            "software does that a thermostat does not. Neither has unmodelled heat. A sensor whose heater cycles out "
            "of step differs by up to its band."
        ),
        block.table(differences(check)),
    ]


def differences(check: Record) -> Table:
    """How far the reduced model is off the operational simulator at posterior draws: sensors, then heaters' duty."""
    rows = []
    for r in check["records"]:
        factor, unit = (1.0, "K") if r["unit"] == "K" else (100.0, "percentage points of duty")
        rows.append(
            [r["channel"], unit, *(number(factor * r[key], 2) for key in ("mean", "rms", "quantile_95", "worst"))]
        )
    return Table(("", "in", "mean", "RMS", "95% of its size", "worst"), rows, range(2, 6))
