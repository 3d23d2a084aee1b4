"""Samples of a channel: what it reads between them, and how noisy they are."""

from __future__ import annotations

import numpy as np
import xarray
from numpy.typing import NDArray

from ..simulator import FloatArray
from ..telemetry import quiet_noise

_LONGEST = 300.0
"""s, over which telemetry is interpolated."""
_NOISES = 4.0
"""Deviations, by which no noise bends samples."""
_COARSEST = 10.0
"""K, of a digit of telemetry."""


def series_at(telemetry: xarray.Dataset, name: str, times: NDArray[np.datetime64], bent: float = np.inf) -> FloatArray:
    """A channel at times, linear between its samples; NaN beyond `_LONGEST` or three sampling intervals of one.

    NaN too where samples are so bent that a line between them may be off by more than `bent`, beside their noise: in a
    packet of other times, a shadow begins between two samples.
    """
    values = telemetry[name].to_numpy()
    valid = np.isfinite(values)
    if valid.sum() < 2:
        return np.full(len(times), np.nan)
    seconds, at, after = _placed(telemetry, valid, times)
    found = np.interp(at, seconds, values[valid], left=np.nan, right=np.nan)
    gap = seconds[after] - seconds[after - 1]
    on_sample = np.isin(at, seconds)
    near = gap <= max(_LONGEST, 3.0 * float(np.median(np.diff(seconds))))
    if np.isfinite(bent):
        # Where a slope changes between two samples they bend by a and b, and the line is off by a b / (a + b).
        bends = np.pad(np.abs(np.diff(values[valid], 2)), 1)
        a, b = bends[after - 1], bends[after]
        near &= a * b <= (a + b) * (bent + _NOISES * noise_of(values))
    return np.where(on_sample | near, found, np.nan)


def noise_left(telemetry: xarray.Dataset, name: str, times: NDArray[np.datetime64]) -> FloatArray:
    """Share [t] of the variance of a channel's noise that is left at times, on the line between two samples."""
    valid = np.isfinite(telemetry[name].to_numpy())
    if valid.sum() < 2:
        return np.ones(len(times))
    seconds, at, after = _placed(telemetry, valid, times)
    share = np.clip((at - seconds[after - 1]) / (seconds[after] - seconds[after - 1]), 0.0, 1.0)
    return np.asarray(share**2 + (1.0 - share) ** 2)


def _placed(
    telemetry: xarray.Dataset, valid: NDArray[np.bool_], times: NDArray[np.datetime64]
) -> tuple[FloatArray, FloatArray, NDArray[np.int64]]:
    """Valid samples and times [t], s from the telemetry's first, and of each time the sample after it."""
    origin = telemetry["time"].to_numpy()[0]
    seconds = (telemetry["time"].to_numpy()[valid] - origin) / np.timedelta64(1, "s")
    at = (times - origin) / np.timedelta64(1, "s")
    return seconds, at, np.clip(np.searchsorted(seconds, at), 1, len(seconds) - 1)


def noise_of(values: FloatArray) -> float:
    """Deviation of a channel's samples [T] from what is smooth, K."""
    valid = values[np.isfinite(values)]
    if len(valid) < 4:
        return 0.0
    return float(np.hypot(quiet_noise(valid), step_of(valid) / np.sqrt(12.0)))


def step_of(values: FloatArray) -> float:
    """The least difference between readings [T] of a channel that are not the same, K; at most `_COARSEST`."""
    apart = np.diff(np.unique(values[np.isfinite(values)]))
    return min(float(np.min(apart[apart > 1e-6], initial=_COARSEST)), _COARSEST) if len(apart) else 1.0
