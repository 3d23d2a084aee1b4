"""Whether a posterior through an emulator is that of the simulator, judged by the simulator's own runs at its draws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..problem import Problem, Window
from ..simulator import FloatArray
from .runs import TrainingRuns

LARGEST_DENSITY_ERROR = 0.5
"""Of the log density, standard deviation over posterior draws. To first order no quantity's mean is off by more than so
many of its standard deviations; where one is off by 0.5, its 95% interval covers 92%."""


@dataclass(frozen=True)
class Steps:
    """Whether a heater switches as it was measured to."""

    heater: str
    measured: int
    """Switches in the telemetry's status."""
    unmatched: float
    """Measured switches without a simulated counterpart, and the other way round: the median over the runs."""


def density_error(problem: Problem, emulated: Problem, thetas: FloatArray, runs: Sequence[TrainingRuns]) -> float:
    """Standard deviation of the exact less the emulated log density over posterior draws [S, d].

    runs: those of each window's simulator at these draws, all finished. NaN with fewer than two. Importance weights
    would make up for the difference; to first order a mean then moves by its covariance with the log weights, in its
    own standard deviations at most by the standard deviation of these.
    """
    if len(thetas) < 2:
        return float("nan")
    made = zip(*(training.trajectories() for training in runs), strict=True)
    points = zip(problem.to_z(thetas), made, strict=True)
    return float(np.std([problem.log_density(z, run) - emulated.log_density(z) for z, run in points], ddof=1))


def steps(window: Window, runs: TrainingRuns) -> tuple[Steps, ...]:
    """Of each heater whose status is measured in a window, from finished runs at the posterior."""
    found = []
    for k, heater in enumerate(window.simulator.heaters):
        if len(runs) and np.isfinite(window.status[:, k]).any():
            unmatched = [unmatched_switches(window.status[:, k], status) for status in runs.status[:, :, k]]
            known = window.status[np.isfinite(window.status[:, k]), k] > 0.5
            measured = int(np.count_nonzero(known[1:] != known[:-1]))
            found.append(Steps(heater, measured, float(np.median(unmatched))))
    return tuple(found)


def unmatched_switches(measured: FloatArray, simulated: FloatArray) -> int:
    """Switches of two sampled statuses [T] that have no counterpart: the nearest of the same direction, mutually.

    Those next to the window's ends do not count, for their counterpart may lie outside. Samples of which one is NaN are
    passed over.
    """
    known = np.isfinite(measured) & np.isfinite(simulated)
    first, second = measured[known] > 0.5, simulated[known] > 0.5
    count = 0
    for on in (True, False):
        ours, theirs = _switched(first, on), _switched(second, on)
        for alone in (_without_counterpart(ours, theirs), _without_counterpart(theirs, ours)):
            count += int(((alone > 1) & (alone < known.sum() - 1)).sum())
    return count


def _switched(status: NDArray[np.bool_], on: bool) -> NDArray[np.intp]:
    """Positions of the first samples after a switch on, or off."""
    return 1 + np.flatnonzero((status[1:] == on) & (status[:-1] != on))


def _without_counterpart(switches: NDArray[np.intp], other: NDArray[np.intp]) -> NDArray[np.intp]:
    if not len(switches) or not len(other):
        return switches
    apart = np.abs(switches[:, None] - other)
    mutual = apart.argmin(axis=0)[apart.argmin(axis=1)] == np.arange(len(switches))
    return switches[~mutual]
