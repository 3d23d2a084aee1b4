"""Gaps of measured inputs that are bridged in a window: what a simulation there takes for measured and is not."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import xarray as xr

from ..scenario import Fill, FmuSimulator, Scenario, SimulatorModel
from .clean import clock_text
from .drivers import SHORT_GAP, is_told, valid_samples
from .quality import QualityRecord
from .window import window_bounds


def measured_inputs(scenario: Scenario) -> dict[str, Fill]:
    """Channels that drive the simulator as measured, but for status, and how their gaps are bridged."""
    model = scenario.simulator
    found: dict[str, Fill] = {}
    if isinstance(model, SimulatorModel):
        drivers = [load.driver for load in model.loads.values()]
        boundaries = [node.boundary for node in model.nodes.values() if isinstance(node.boundary, str)]
        found |= dict.fromkeys(boundaries, "interpolate")
    else:
        drivers = list(model.fmu.drivers.values()) if isinstance(model, FmuSimulator) else []
    return found | {channel: scenario.telemetry.channels[channel].bridge for channel in drivers}


def bridged(scenario: Scenario, dataset: xr.Dataset, period: float | None = None) -> Iterator[QualityRecord]:
    """A record of each gap of a measured input that reaches into a window and is longer than `SHORT_GAP` intervals.

    period: of the orbit, s; default: that of the dataset. `first` and `last`: the samples on both sides.
    """
    period = period or dataset.attrs.get("period_s")
    for channel, fill in measured_inputs(scenario).items():
        if is_told(fill):
            continue
        seconds, _, interval = valid_samples(dataset, channel)
        times = np.round(seconds * 1e9).astype(np.int64).astype("datetime64[ns]")
        long = np.flatnonzero(np.diff(seconds) > SHORT_GAP * interval)
        by = "values of other orbits" if fill == "previous_orbit" else "a straight line"
        for window, written in scenario.windows.items():
            start, end = window_bounds(written, period)
            for k in long[(times[long] < end) & (times[long + 1] > start)]:
                length = float(seconds[k + 1] - seconds[k])
                missing = round(length / interval) - 1
                detail = (
                    f"'{channel}' drives the simulator and has no sample for {length / 60:.1f} min from "
                    f"{clock_text(times[k])} in window '{window}'; bridged by {by}, so temperatures may be off there"
                )
                share = missing / (missing + len(seconds))
                yield QualityRecord(channel, "bridged", missing, share, times[k], times[k + 1], detail)
