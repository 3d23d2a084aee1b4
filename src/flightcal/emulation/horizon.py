"""How much of a window the active learning looks at: its beginning, as far as an emulator tells the runs apart.

A thermostat in closed loop forgets its phase: a few cycles into the window two runs with different parameters differ by
whole cycles, no smooth function of the parameters follows them, and the likelihood has a mode for each number of cycles
that fits almost. Early in the window there is one mode, and the posterior given the beginning is narrow enough for the
emulator to follow the simulator a few cycles farther. So the window grows as the posterior shrinks.
"""

from __future__ import annotations

import math

import numpy as np
import xarray
from numpy.typing import NDArray

from ..probability import Priors
from ..problem import Window, build_window
from ..simulator import FloatArray
from .emulator import Emulator, fit_emulator
from .runs import TrainingRuns

TRUNCATION = 0.1
"""What principal shapes may leave out of a channel, added up over all its samples, in standard deviations of its noise.
Left out is a smooth function of the parameters, so it adds up where noise averages out: a posterior sees it all."""
_TELLS_APART = 0.3
"""An emulator's error over what runs differ by, up to which it tells them apart."""
_FEWEST_SAMPLES = 10


def beginning(telemetry: xarray.Dataset, window: Window, samples: int) -> Window:
    """The first so many samples of a window, made from the telemetry that it was made from."""
    span = (window.times[samples - 1] - window.start) / np.timedelta64(1, "ns") * 1e-9
    return build_window(window.scenario, telemetry, window.name, span=float(span))


def shape_tolerance(noise: FloatArray, samples: int) -> FloatArray:
    """[N] K, what principal shapes may leave out of channels with noise [N] K in a window of so many samples."""
    return TRUNCATION * noise / math.sqrt(samples)


def farthest_emulator(runs: TrainingRuns, scale: Priors, noise: FloatArray, judged: NDArray[np.bool_]) -> Emulator:
    """The emulator of finished runs on the longest beginning of the window on which it tells them apart.

    Halves the window until the second half of what is left is resolved: each channel's left-out error at the `judged`
    runs [S] is within its noise [N] K, or within `_TELLS_APART` of what these runs differ by (root mean squares).
    """
    samples = len(runs.times)
    while True:
        emulator = fit_emulator(runs.during(slice(0, samples)), scale, shape_tolerance(noise, samples))
        if samples // 2 < _FEWEST_SAMPLES or _resolved(emulator, noise, slice(samples // 2, samples), judged):
            return emulator
        samples //= 2


def _resolved(emulator: Emulator, noise: FloatArray, part: slice, judged: NDArray[np.bool_]) -> bool:
    error = emulator.leave_one_out()[0][judged, part]
    temperatures = emulator.runs.temperatures[judged, part]
    differences = _root_mean_square(temperatures - temperatures.mean(axis=0))
    return bool((_root_mean_square(error) <= np.maximum(noise, _TELLS_APART * differences)).all())


def _root_mean_square(values: FloatArray) -> FloatArray:
    """[N] of values [S, T, N]."""
    return np.asarray(np.sqrt(np.mean(values**2, axis=(0, 1))))
