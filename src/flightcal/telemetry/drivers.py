"""Measured channels as inputs of a simulation: drivers with gaps bridged, heater status as a duty cycle."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ..errors import TelemetryError
from ..scenario import Fill
from .clean import clock_text

_OUTSIDE = "before the first or after the last sample"
SHORT_GAP = 3.0
"""Gaps of up to this many sampling intervals are interpolated, whatever the channel's `fill`."""
_EDGE = 1e-3
"""s, within which a driver jumps: where a value that is held changes, and at the ends of a gap that is bridged from
another orbit."""
_JUMP = 0.5
"""Of a driver's standard deviation: what it changes by from one sample to the next, and not on its way, is a jump."""
_FEW, _REGULAR, _MOSTLY = 20, 0.05, 0.9
"""Of intervals between samples: fewer tell nothing; relative difference of what is regular; share that must be."""
LONGEST_INTERPOLATED = 1800.0
"""Longest gap (s) that `fill: interpolate` bridges where no orbital period is known."""
LONGEST_INTERPOLATED_SHARE = 0.1
"""... and its share of the orbital period, where that is known and gives less."""


def driver_series(
    dataset: xr.Dataset,
    channel: str,
    times: NDArray[np.datetime64],
    *,
    fill: Fill | None = None,
    period: float | None = None,
) -> NDArray[np.float64]:
    """The driver `channel` at `times` [K], in its SI unit.

    Linear interpolation between valid samples. Where they are more than `SHORT_GAP` sampling intervals apart,
    `fill` (default: the channel's own) says how: 'interpolate' does so up to the channel's `longest_gap`, else a tenth
    of the period, at most 30 min; 'previous_orbit' takes the value a whole number of periods earlier, the fewest
    possible, or later where there is none earlier. With 'hold' there is no interpolation: a value stays until the next
    sample, the last one as long as there is telemetry. A number is the value in such gaps, before the first sample and
    after the last, farther than half a sampling interval from the nearest. period: orbital period, s; default: that of
    the dataset.

    Raises TelemetryError when a gap cannot be bridged.
    """
    fill = dataset[channel].attrs["fill"] if fill is None else fill
    period = period or dataset.attrs.get("period_s")
    if fill == "hold":
        return _held(dataset, channel, times)
    seconds, values, interval = valid_samples(dataset, channel)
    at = _seconds(times)
    gap = _gap(seconds, at, interval)
    result = np.interp(at, seconds, values)
    open_gap = gap > SHORT_GAP * interval
    if isinstance(fill, float):
        open_gap |= (at < seconds[0]) | (at > seconds[-1])
        nearest = _nearest(seconds, at)
        in_gap = np.where(np.abs(at - seconds[nearest]) > 0.5 * interval, fill, values[nearest])
        return np.where(open_gap, in_gap, result)
    if fill == "interpolate":
        longest = dataset[channel].attrs.get("longest_gap_s")
        limit = longest or min(LONGEST_INTERPOLATED, LONGEST_INTERPOLATED_SHARE * (period or np.inf))
        open_gap &= gap > limit
        most = f"'fill: interpolate' bridges at most {limit / 60:.1f} min ('longest_gap')"
        zero = f"0 {dataset[channel].attrs.get('units', '')}".strip()
        advice = f"{most}, 'fill: previous_orbit' also longer gaps, and 'fill: {zero}' says what the driver is in them"
    elif period is None:
        advice = "'fill: previous_orbit' needs the orbital period, expected environment.period or an orbit"
    else:
        for turns in _turns(seconds, at, period):
            if not open_gap.any():
                break
            elsewhere = at[open_gap] + turns * period
            good = _gap(seconds, elsewhere, interval) <= SHORT_GAP * interval
            taken = np.flatnonzero(open_gap)[good]
            result[taken] = np.interp(elsewhere[good], seconds, values)
            open_gap[taken] = False
        advice = "no other orbit has samples at this phase"
    if open_gap.any():
        first = int(np.argmax(open_gap))
        where = _OUTSIDE if np.isinf(gap[first]) else f"a gap of {gap[first] / 60:.1f} min"
        raise TelemetryError(f"channel '{channel}': found no sample at {clock_text(times[first])}, {where}; {advice}")
    return result


def _held(dataset: xr.Dataset, channel: str, times: NDArray[np.datetime64]) -> NDArray[np.float64]:
    """The last value before each time [K], or at it."""
    seconds, values, _ = valid_samples(dataset, channel)
    at, last, slack = _seconds(times), _seconds(dataset["time"].to_numpy())[-1], dataset.attrs["sampling_interval_s"]
    outside = (at < seconds[0] - slack) | (at > last + slack)
    if outside.any():
        first = clock_text(times[int(np.argmax(outside))])
        advice = "'fill: hold' needs a sample before each window"
        raise TelemetryError(f"channel '{channel}': found no sample at {first}, {_OUTSIDE}; {advice}")
    return values[np.searchsorted(seconds, at, side="right").clip(1) - 1]


def driver_corners(dataset: xr.Dataset, channel: str, fill: Fill, period: float | None) -> NDArray[np.datetime64]:
    """Times between which `driver_series` is a straight line: those of the samples, and what bridges gaps.

    Where a gap is bridged from another orbit the driver jumps at its ends, within a millisecond; and so where a value
    that is held changes, and half a sampling interval from the ends of a gap that is bridged by a value.
    """
    seconds, values, interval = valid_samples(dataset, channel)
    if fill == "hold":
        changed = seconds[1:][np.diff(values) != 0.0]
        return _times(changed - _EDGE, changed)
    corners = [seconds]
    long = np.flatnonzero(np.diff(seconds) > SHORT_GAP * interval)
    if isinstance(fill, float):
        ends = np.concatenate([[seconds[0]], seconds[long + 1], seconds[long], [seconds[-1]]])
        outwards = np.repeat([-1.0, 1.0], len(long) + 1)
        corners += [ends + outwards * 0.5 * interval, ends + outwards * (0.5 * interval + _EDGE)]
    if fill == "previous_orbit" and period is not None:
        turns = np.arange(1, int((seconds[-1] - seconds[0]) // period) + 2) * period
        for begin, end in zip(seconds[long], seconds[long + 1], strict=True):
            moved = np.concatenate([seconds + shift for shift in (*-turns, *turns)])
            corners += [moved[(moved > begin) & (moved < end)], np.array([begin + _EDGE, end - _EDGE])]
    return _times(*corners)


def driver_gaps(
    dataset: xr.Dataset, channel: str, fill: Fill, of: Callable[[NDArray[np.float64]], NDArray[np.float64]] = np.asarray
) -> tuple[NDArray[np.datetime64], float]:
    """Where `driver_series` bridges more than `SHORT_GAP` sampling intervals, [G, 2], and how much the driver varies.

    A gap is from the last sample before to the first after it. of: what is made of the driver (SI), whose standard
    deviation is meant. That is so too where another orbit bridges the gap, however alike orbits are: what makes a gap,
    such as a pass, may change the driver.
    """
    seconds, values, interval = valid_samples(dataset, channel)
    long = np.flatnonzero((np.diff(seconds) > SHORT_GAP * interval) & (not is_told(fill)))
    return _between(seconds, long), float(of(values).std())


def driver_jumps(
    dataset: xr.Dataset, channel: str, fill: Fill, of: Callable[[NDArray[np.float64]], NDArray[np.float64]] = np.asarray
) -> tuple[NDArray[np.datetime64], NDArray[np.float64]]:
    """Samples between which a driver jumps, [J, 2], and by how much [J]: a straight line does not tell when.

    A jump is more than a smooth course brings: the change must differ from the one before or after it as much. of: as
    of `driver_gaps`. A value that is held changes when it says so, and means over blocks tell when within them.
    """
    seconds, values, interval = valid_samples(dataset, channel)
    varying = of(values)
    change = np.diff(varying)
    bends = np.abs(np.diff(change, prepend=change[:1], append=change[-1:]))
    size = np.minimum(np.abs(change), np.maximum(bends[:-1], bends[1:]))
    short = np.diff(seconds) <= SHORT_GAP * interval
    told = fill == "hold" or "averaged" in dataset[channel].attrs
    found = np.flatnonzero(short & (not told) & (size > _JUMP * varying.std()))
    return _between(seconds, found), size[found]


def is_told(fill: Fill) -> bool:
    """Whether the scenario says what a driver is between its samples, however far apart they are."""
    return fill == "hold" or isinstance(fill, float)


def sampled_every(dataset: xr.Dataset, channel: str) -> float | None:
    """Seconds between the samples of a driver that come at regular times, changed or not; None: they do not."""
    seconds, _, interval = valid_samples(dataset, channel)
    apart = np.diff(seconds)
    regular = len(apart) >= _FEW and np.mean(np.abs(apart - interval) <= _REGULAR * interval) > _MOSTLY
    return interval if regular else None


def _nearest(seconds: NDArray[np.float64], at: NDArray[np.float64]) -> NDArray[np.intp]:
    """Positions of the samples that are nearest to times."""
    after = np.searchsorted(seconds, at).clip(0, len(seconds) - 1)
    before = (after - 1).clip(0)
    return np.where(at - seconds[before] < seconds[after] - at, before, after)


def _between(seconds: NDArray[np.float64], samples: NDArray[np.intp]) -> NDArray[np.datetime64]:
    """[J, 2] the times of samples [J] and of those that come next."""
    both = np.stack([seconds[samples], seconds[samples + 1]], axis=1)
    return np.round(both * 1e9).astype(np.int64).astype("datetime64[ns]")


def status_fraction(dataset: xr.Dataset, channel: str, edges: NDArray[np.datetime64]) -> NDArray[np.float64]:
    """Share [K] of each interval [edges[k], edges[k + 1]] in which the status was on.

    A sample holds from halfway to its neighbours; in a gap of up to `SHORT_GAP` sampling intervals the last value
    holds until half an interval before the next. NaN in an interval that begins in a longer gap, more than a sampling
    interval after its last sample. edges: [K + 1]. Raises TelemetryError when the edges lie outside the telemetry.
    """
    seconds, values, interval = valid_samples(dataset, channel)
    at = _seconds(edges)
    rows = _seconds(dataset["time"].to_numpy()[[0, -1]])
    slack = max(interval, dataset.attrs["sampling_interval_s"])
    if at[0] < rows[0] - slack or at[-1] > rows[1] + slack:
        first, last = (clock_text(time) for time in dataset["time"].to_numpy()[[0, -1]])
        raise TelemetryError(
            f"channel '{channel}': found no status from {clock_text(edges[0])} to {clock_text(edges[-1])}, "
            f"expected times within the telemetry, {first} to {last}"
        )
    changes = seconds[1:] - np.minimum(np.diff(seconds), interval) / 2
    bounds = np.concatenate([[min(at[0], seconds[0])], changes, [max(at[-1], seconds[-1])]])
    on_time = np.concatenate([[0.0], np.cumsum(values * np.diff(bounds))])
    share = np.diff(np.interp(at, bounds, on_time)) / np.diff(at)
    share = np.clip(share, 0.0, 1.0)
    if len(seconds) == 1:
        return share
    before = np.clip(np.searchsorted(seconds, at[:-1], side="right") - 1, 0, len(seconds) - 2)
    long_gap = np.diff(seconds)[before] > SHORT_GAP * interval
    unknown = long_gap & (at[:-1] >= seconds[before] + interval) & (at[:-1] < seconds[before + 1])
    return np.where(unknown, np.nan, share)


def status_or_unknown(dataset: xr.Dataset, channel: str, edges: NDArray[np.datetime64]) -> NDArray[np.float64]:
    """`status_fraction`, NaN also before the first and after the last valid sample."""
    times = dataset["time"].to_numpy()[np.isfinite(dataset[channel].to_numpy())]
    found = np.full(len(edges) - 1, np.nan)
    if not len(times):
        return found
    first, last = np.searchsorted(edges, times[0]), np.searchsorted(edges, times[-1], side="right")
    if last - first > 1:
        found[first : last - 1] = status_fraction(dataset, channel, edges[first:last])
    return found


def status_changes(dataset: xr.Dataset, channel: str) -> NDArray[np.datetime64]:
    """When the status changes as `status_fraction` has it, and where it begins or ceases to be known."""
    after, within, known = _changes(dataset, channel)
    return _times(after - within / 2, known)


def switch_bounds(dataset: xr.Dataset, channel: str) -> NDArray[np.datetime64]:
    """Between which times each change of the status lies, and where it begins or ceases to be known."""
    after, within, known = _changes(dataset, channel)
    return _times(after - within, after, known)


def _changes(dataset: xr.Dataset, channel: str) -> tuple[NDArray[np.float64], ...]:
    """Samples that show a change, how long before them it may lie, and where the status gets known or unknown, s."""
    seconds, values, interval = valid_samples(dataset, channel)
    gaps = np.diff(seconds)
    changed, long = np.flatnonzero(np.diff(values) != 0.0), np.flatnonzero(gaps > SHORT_GAP * interval)
    known = np.concatenate([seconds[long] + interval, seconds[long + 1]])
    return seconds[changed + 1], np.minimum(gaps[changed], interval), known


def _times(*seconds: NDArray[np.float64]) -> NDArray[np.datetime64]:
    return np.round(np.unique(np.concatenate(seconds)) * 1e9).astype(np.int64).astype("datetime64[ns]")


def _turns(seconds: NDArray[np.float64], at: NDArray[np.float64], period: float) -> list[int]:
    """Numbers of periods to look away, all earlier ones first."""
    earlier = int((at.max() - seconds[0]) // period) + 1
    later = int((seconds[-1] - at.min()) // period) + 1
    return [*range(-1, -earlier - 1, -1), *range(1, later + 1)]


def _gap(seconds: NDArray[np.float64], at: NDArray[np.float64], interval: float) -> NDArray[np.float64]:
    """Distance (s) of the samples on either side of each time [K]; infinite beyond the first and last."""
    right = np.searchsorted(seconds, at, side="left")
    inside = (right > 0) & (right < len(seconds))
    exact = seconds[np.minimum(right, len(seconds) - 1)] == at
    before, after = seconds[np.maximum(right - 1, 0)], seconds[np.minimum(right, len(seconds) - 1)]
    beyond = np.maximum(seconds[0] - at, at - seconds[-1])
    outside = np.where(beyond <= interval, interval, np.inf)
    return np.where(exact, 0.0, np.where(inside, after - before, outside))


def valid_samples(dataset: xr.Dataset, channel: str) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Times (s since 1970) and values of the valid samples, and their median interval (s)."""
    values = dataset[channel].to_numpy()
    valid = ~np.isnan(values)
    if not valid.any():
        raise TelemetryError(f"channel '{channel}': found no valid sample to use as an input")
    seconds = _seconds(dataset["time"].to_numpy()[valid])
    interval = float(np.median(np.diff(seconds))) if len(seconds) > 1 else dataset.attrs["sampling_interval_s"]
    return seconds, values[valid], interval


def _seconds(times: NDArray[np.datetime64]) -> NDArray[np.float64]:
    return times.astype("datetime64[ns]").astype(np.int64) / 1e9
