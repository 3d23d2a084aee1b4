"""What is predicted of planned windows, of which there is no telemetry."""

from __future__ import annotations

import numpy as np
import xarray as xr

from .. import block
from ..block import Block, section
from ..run_files import RunFiles, is_plan
from ..tables import Table
from ..text import number
from ..windows import column, degrees, names


@section("plans", "Plans")
def panel(run: RunFiles) -> list[Block]:
    """How low and how high each channel goes; nothing where nothing is planned."""
    windows = {name: window for name, window in run.test_windows.items() if is_plan(window)}
    if not windows:
        return []
    words = (
        f"Nothing is measured there yet. Lowest: the least of the predicted mean, and of the lower end of its "
        f"{run.interval}, with the time (UTC) of the mean's. Highest: likewise. A limit between may be passed."
    )
    tables = [(block.heading(f"“{name}”"), block.table(table(window))) for name, window in windows.items()]
    return [*(part for parts in tables for part in parts), block.text(words)]


def table(window: xr.Dataset) -> Table:
    """A row for each channel."""
    # Before that, the last telemetry tells where it begins.
    window, rows, unit = window.isel(time=window["scored"].values), [], degrees(window)
    for channel in names(window, "channel"):
        mean, lower, upper = (column(window, what, channel, "stochastic") for what in ("mean", "lower", "upper"))
        if not np.isfinite(mean).any():
            continue
        ends = []
        for find, extreme, end in ((np.nanargmin, np.nanmin, lower), (np.nanargmax, np.nanmax, upper)):
            k = int(find(mean))
            when = np.datetime_as_string(window["time"].values[k], unit="m").replace("T", " ")
            ends += [f"{number(mean[k], 3)} ({number(float(extreme(end)), 3)})", when[len("2024-") :]]
        rows.append([channel, *ends])
    return Table(("channel", f"lowest, {unit}", "at", f"highest, {unit}", "at"), rows, (1, 2, 3, 4))
