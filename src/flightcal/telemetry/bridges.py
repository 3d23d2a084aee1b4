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


def bridged(scenario: Scenario, dataset: xr.Dataset) -> Iterator[QualityRecord]:
    """A record of each gap of measured inputs that reaches into a window and is longer than `SHORT_GAP` intervals.

    Inputs that have the same gap, as those of one packet, share a record. `first`, `last`: the samples on both sides.
    """
    period = dataset.attrs.get("period_s")
    gaps: dict[tuple[str, str, np.datetime64, np.datetime64], list[str]] = {}
    counts: dict[str, tuple[int, float]] = {}
    for channel, fill in measured_inputs(scenario).items():
        if is_told(fill):
            continue
        seconds, _, interval = valid_samples(dataset, channel)
        counts[channel] = len(seconds), interval
        times = np.round(seconds * 1e9).astype(np.int64).astype("datetime64[ns]")
        long = np.flatnonzero(np.diff(seconds) > SHORT_GAP * interval)
        by = "values of other orbits" if fill == "previous_orbit" else "a straight line"
        for window, written in scenario.windows.items():
            start, end = window_bounds(written, period)
            for k in long[(times[long] < end) & (times[long + 1] > start)]:
                gaps.setdefault((window, by, times[k], times[k + 1]), []).append(channel)
    for (window, by, first, last), channels in gaps.items():
        length = (last - first) / np.timedelta64(1, "s")
        samples, interval = counts[channels[0]]
        missing = round(length / interval) - 1
        drive, have = ("drives", "has") if len(channels) == 1 else ("drive", "have")
        named = ", ".join(map(repr, channels))
        detail = (
            f"{named} {drive} the simulator and {have} no sample for {length / 60:.1f} min from "
            f"{clock_text(first)} in window '{window}'; bridged by {by}, so temperatures may be off there"
        )
        yield QualityRecord(", ".join(channels), "bridged", missing, missing / (missing + samples), first, last, detail)
