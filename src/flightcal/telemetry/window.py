"""Stretches of telemetry."""

from __future__ import annotations

import numpy as np
import xarray as xr

from ..errors import TelemetryError
from ..scenario import Window
from .clean import clock_text


def window_bounds(window: Window, period: float | None) -> tuple[np.datetime64, np.datetime64]:
    """Start and end (datetime64[ns], UTC) of `window`; the end belongs to the next one.

    period: orbital period, s, for a window that counts orbits. Raises TelemetryError where that lacks it.
    """
    start = np.datetime64(window.start, "ns")
    if window.end is not None:
        return start, np.datetime64(window.end, "ns")
    if period is None:
        raise TelemetryError(
            f"window from {window.start.isoformat()}: found {window.orbits:g} orbits and no orbital period, "
            "expected environment.period or an orbit, or the window's 'end'"
        )
    assert window.orbits is not None  # the schema wants one of the two
    return start, start + np.timedelta64(round(window.orbits * period * 1e9), "ns")


def select_window(dataset: xr.Dataset, window: Window, period: float | None = None) -> xr.Dataset:
    """The samples of `dataset` with start <= time < end.

    period: orbital period, s; default: that of the dataset. Raises TelemetryError when the window lies, even
    partly, outside the telemetry, or holds no valid sample.
    """
    start, end = window_bounds(window, period or dataset.attrs.get("period_s"))
    times = dataset["time"].to_numpy()
    slack = np.timedelta64(round(dataset.attrs["sampling_interval_s"] * 1e9), "ns")
    name = f"window {clock_text(start)} to {clock_text(end)}"
    span = f"telemetry runs from {clock_text(times[0])} to {clock_text(times[-1])}"
    if end <= times[0] or start > times[-1]:
        raise TelemetryError(f"{name}: found no telemetry, expected a window within it; {span}")
    if start < times[0] - slack or end > times[-1] + slack:
        raise TelemetryError(f"{name}: found telemetry in a part of it only, expected a window within it; {span}")
    selected = dataset.isel(time=(times >= start) & (times < end))
    if selected.sizes["time"] == 0:
        before, after = times[times < start][-1], times[times >= end][0]
        raise TelemetryError(
            f"{name}: found no telemetry, a gap from {clock_text(before)} to {clock_text(after)}, expected samples"
        )
    if not any(selected[channel].notnull().any() for channel in selected["channel"].to_numpy()):
        raise TelemetryError(f"{name}: found {selected.sizes['time']} samples, none valid, expected some that are")
    return selected
