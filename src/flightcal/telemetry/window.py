"""Stretches of telemetry."""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ..errors import TelemetryError
from ..scenario import Stretch, Window, is_trained
from ._flags import Flag
from .clean import clock_text

_PLAN = ", or 'planned: true' of a time to come"
_MOST, _MANY = 5_000, 2_000
"""Times of a plan, and of one that are closer to each other than the telemetry's."""
_FINE = np.timedelta64(60, "s")
"""Between the times of a plan, so that they show how far thermostats let temperatures go."""


def window_bounds(window: Stretch, period: float | None) -> tuple[np.datetime64, np.datetime64]:
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


def select_window(dataset: xr.Dataset, window: Window, period: float | None = None, called: str = "") -> xr.Dataset:
    """The samples of `dataset` with start <= time < end.

    Of several packets, times at which there are samples of drivers only are left out. A planned window
    goes on, after the last temperature, at times as far apart as these are, or closer, without a valid sample.

    period: orbital period, s; default: that of the dataset. called: what the scenario calls it, for errors. Raises
    TelemetryError when the window lies, even partly, outside the telemetry or outside one of its packets, or holds no
    valid sample.
    """
    start, end = window_bounds(window, period or dataset.attrs.get("period_s"))
    times = dataset["time"].to_numpy()
    name = f"window {f'{called}, ' if called else ''}{clock_text(start)} to {clock_text(end)}"
    if window.planned:
        read = when_read(dataset)
        if not np.any((read >= start) & (read < end)) or read[-1] + _slack(read) < end:
            return _planned(dataset, start, end, read)
    sampled = _sampled(dataset)
    for packet, flags in _packets(dataset).items():
        _check_within(times[flags], start, end, name, packet, "" if is_trained(called) else _PLAN)
    selected = dataset.isel(time=(times >= start) & (times < end) & sampled)
    if selected.sizes["time"] == 0:
        times = times[sampled]
        before, after = times[times < start][-1], times[times >= end][0]
        raise TelemetryError(
            f"{name}: found no telemetry, a gap from {clock_text(before)} to {clock_text(after)}, expected samples"
        )
    if not any(selected[channel].notnull().any() for channel in selected["channel"].to_numpy()):
        raise TelemetryError(f"{name}: found {selected.sizes['time']} samples, none valid, expected some that are")
    return selected


def end_of_telemetry(dataset: xr.Dataset) -> np.datetime64:
    """Up to when a window may go: no packet ends more than its usual interval before."""
    times = dataset["time"].to_numpy()
    return np.datetime64(min(times[packet][-1] + _slack(times[packet]) for packet in _packets(dataset).values()))


def _slack(times: NDArray[np.datetime64]) -> np.timedelta64:
    """How far a window may reach beyond the times of a packet."""
    return np.median(np.diff(times)) if len(times) > 1 else np.timedelta64(0, "ns")


def _planned(dataset: xr.Dataset, start: np.datetime64, end: np.datetime64, read: NDArray[np.datetime64]) -> xr.Dataset:
    """A window of which telemetry lacks the end, or all; read: when temperatures are."""
    usual = np.median(np.diff(read)) if len(read) > 1 else np.timedelta64(0, "s")
    known = read[(read >= start) & (read < end)]
    length = end - start
    step = max(min(usual, max(_FINE, length // _MANY)), length // _MOST, np.timedelta64(1, "s"))
    inside = np.arange(known[-1] + step if len(known) else start, end, step)
    flags = np.full((len(inside), dataset.sizes["channel"]), Flag.MISSING, np.uint8)
    empty = {name: ("time", np.full(len(inside), np.nan)) for name in dataset["channel"].to_numpy()}
    made = dataset.drop_dims("time").assign_coords(time=inside).assign(empty)
    made = made.assign(flags=(("time", "channel"), flags)).assign_attrs(dataset.attrs)
    return xr.concat([dataset.sel(time=known), made], "time", combine_attrs="override") if len(known) else made


def _packets(dataset: xr.Dataset) -> dict[str, NDArray[np.bool_]]:
    """Which times [T] are those of each packet."""
    flags = dataset["flags"].to_numpy()
    channels = {str(dataset[name].attrs.get("packet", "")): i for i, name in enumerate(dataset["channel"].to_numpy())}
    return {packet: flags[:, i] & Flag.OTHER_PACKET == 0 for packet, i in channels.items()}


def when_read(dataset: xr.Dataset) -> NDArray[np.datetime64]:
    """Times with a valid temperature."""
    names = [name for name in dataset["channel"].to_numpy() if dataset[name].attrs.get("kind") == "temperature"]
    found = [np.isfinite(dataset[name].to_numpy()) for name in names]
    return np.asarray(dataset["time"].to_numpy()[np.any(found, axis=0) if found else slice(0)])


def _sampled(dataset: xr.Dataset) -> NDArray[np.bool_]:
    """Times [T] at which there is more than drivers of other packets."""
    kinds = np.array([dataset[name].attrs.get("kind", "") for name in dataset["channel"].to_numpy()])
    if len(_packets(dataset)) == 1 or np.all(kinds == "driver"):
        return np.ones(dataset.sizes["time"], dtype=bool)
    return np.any(dataset["flags"].to_numpy()[:, kinds != "driver"] & Flag.OTHER_PACKET == 0, axis=1)


def _check_within(
    times: NDArray[np.datetime64], start: np.datetime64, end: np.datetime64, name: str, packet: str, plan: str
) -> None:
    slack = _slack(times)
    of = f" of packet '{packet}'" if packet else ""
    span = f"{'it' if packet else 'telemetry'} runs from {clock_text(times[0])} to {clock_text(times[-1])}"
    if end <= times[0] or start > times[-1]:
        raise TelemetryError(f"{name}: found no telemetry{of}, expected a window within it{plan}; {span}")
    if start < times[0] - slack or end > times[-1] + slack:
        what = f"found telemetry{of} in a part of it only, expected a window within it"
        raise TelemetryError(f"{name}: {what}{plan if end > times[-1] + slack else ''}; {span}")
