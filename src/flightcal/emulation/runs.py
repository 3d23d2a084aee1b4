"""Runs of a slow simulator that an emulator learns from: kept whole, the failed ones too, in one netCDF file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import xarray
from numpy.typing import NDArray

from ..errors import RunError
from ..external import FINISHED, Record, status_switches
from ..run import labelled
from ..simulator import FloatArray, Switch, Trajectory

_PER_RUN: dict[str, tuple[str, ...]] = {
    "theta": ("parameter",),
    "temperatures": ("time", "channel"),
    "status": ("time", "heater"),
    "outcome": (),
    "message": (),
    "round": (),
}
"""What is kept of each run, and its axes."""
_LABELS = {
    "theta": ("SI", "value of each quantity, in its own SI unit"),
    "temperature": ("K", "simulated temperature"),
    "status": ("1", "simulated status of the heater"),
    "outcome": ("", "how the run ended"),
    "message": ("", "what a run that failed says"),
    "round": ("1", "round of the learning"),
}
_IN_FILE = {"temperatures": "temperature"}
"""What has another name in the file."""


@dataclass(frozen=True)
class TrainingRuns:
    """S runs of one window, at its T sample times."""

    parameters: tuple[str, ...]
    """[d]"""
    channels: tuple[str, ...]
    """[N]"""
    heaters: tuple[str, ...]
    """[H]"""
    times: Any
    """[T] datetime64, UTC."""
    theta: FloatArray
    """[S, d] SI."""
    temperatures: FloatArray
    """[S, T, N] K; NaN where the run did not finish."""
    status: FloatArray
    """[S, T, H] 0 or 1; NaN where it is not known."""
    outcome: NDArray[Any]
    """[S] "finished", or why not (`external.record.Outcome`)."""
    message: NDArray[Any]
    """[S]"""
    round: NDArray[Any]
    """[S] round of the active learning in which the run was asked for; 0: the start design."""

    def __len__(self) -> int:
        return len(self.theta)

    @property
    def finished(self) -> NDArray[np.bool_]:
        """[S]"""
        return np.asarray(self.outcome == FINISHED)

    @cached_property
    def switches(self) -> list[Switch]:
        """[S] changes of the status between samples, at the later sample; seconds from the first one."""
        seconds = (self.times - self.times[0]) / np.timedelta64(1, "s")
        return [status_switches(seconds, status) for status in self.status]

    def trajectories(self) -> list[Trajectory]:
        """[S]; NaN where a run did not finish."""
        every = zip(self.temperatures, self.status, self.switches, strict=True)
        return [
            Trajectory(temperatures, status, status.mean(axis=0), switches) for temperatures, status, switches in every
        ]

    def take(self, chosen: Any) -> TrainingRuns:
        """The runs at these positions, or where this mask [S] is true."""
        return replace(self, **{name: getattr(self, name)[chosen] for name in _PER_RUN})

    def during(self, window: slice) -> TrainingRuns:
        """The same runs at these of the sample times."""
        return replace(
            self,
            times=self.times[window],
            temperatures=self.temperatures[:, window],
            status=self.status[:, window],
        )

    def join(self, others: TrainingRuns) -> TrainingRuns:
        """These runs, then the others."""
        joined: dict[str, Any] = {
            name: np.concatenate([getattr(self, name), getattr(others, name)]) for name in _PER_RUN
        }
        return replace(self, **joined)

    def add(self, records: Sequence[Record], round_: int) -> TrainingRuns:
        """These runs and the ones of `records`."""
        if not records:
            return self
        added = {name: [getattr(record, name) for record in records] for name in _PER_RUN if name != "round"}
        added["round"] = [round_] * len(records)
        every: dict[str, Any] = {name: np.concatenate([getattr(self, name), new]) for name, new in added.items()}
        return replace(self, **every)

    def dataset(self) -> xarray.Dataset:
        """As a file keeps them; `read_runs` reads it."""
        data = xarray.Dataset(
            {_IN_FILE.get(name, name): (("run", *axes), getattr(self, name)) for name, axes in _PER_RUN.items()},
            coords={
                "parameter": np.array(self.parameters, object),
                "channel": np.array(self.channels, object),
                "heater": np.array(self.heaters, object),
                "time": self.times,
            },
        )
        return labelled(data, _LABELS)


def no_runs(
    parameters: tuple[str, ...], channels: tuple[str, ...], heaters: tuple[str, ...], times: Any
) -> TrainingRuns:
    """An empty set of runs."""
    samples = len(times)
    return TrainingRuns(
        parameters, channels, heaters, times,
        np.empty((0, len(parameters))),
        np.empty((0, samples, len(channels))),
        np.empty((0, samples, len(heaters))),
        np.empty(0, object), np.empty(0, object), np.empty(0, int),
    )  # fmt: skip


def read_runs(file: Path, like: TrainingRuns) -> TrainingRuns:
    """Runs that are kept as `TrainingRuns.dataset`. Raises RunError where they are not of the same thing as `like`."""
    try:
        with xarray.open_dataset(file, engine="h5netcdf") as opened:
            data = opened.load()
    except (OSError, ValueError) as error:
        raise RunError(f"{file}: found no readable training runs ({error}); delete it to run them anew") from None
    for what, name, expected in (
        ("parameters", "parameter", like.parameters),
        ("channels", "channel", like.channels),
        ("heaters", "heater", like.heaters),
    ):
        found = tuple(str(value) for value in data[name].values)
        if found != expected:
            raise RunError(f"{file}: found {what} {', '.join(found)}, expected {', '.join(expected)}")
    if not np.array_equal(data["time"].values, like.times):
        raise RunError(
            f"{file}: found {data.sizes['time']} sample times that are not the scenario's {len(like.times)}; "
            "delete it to run anew"
        )
    values: dict[str, Any] = {
        name: data[_IN_FILE.get(name, name)].values.astype(getattr(like, name).dtype) for name in _PER_RUN
    }
    return replace(like, **values)


def failure_summary(runs: TrainingRuns) -> str:
    """How many runs failed, how, and in which region of which parameter; empty where none did."""
    failed = ~runs.finished
    if not failed.any():
        return ""
    kinds, counts = np.unique(runs.outcome[failed].astype(str), return_counts=True)
    how = ", ".join(f"{count} {kind}" for kind, count in zip(kinds, counts, strict=True))
    text = f"{failed.sum()} of {len(runs)} runs failed ({how})"
    region = _region(runs.parameters, runs.theta, failed)
    return f"{text}; {region}" if region else text


def _region(names: tuple[str, ...], theta: FloatArray, failed: NDArray[np.bool_]) -> str:
    """The side of one threshold of one parameter that best holds the failed runs apart from the others."""
    best, text = 0, ""
    for k, name in enumerate(names):
        for threshold in theta[failed, k]:
            for side, word in ((theta[:, k] >= threshold, "above"), (theta[:, k] <= threshold, "below")):
                inside, others = int((side & failed).sum()), int((side & ~failed).sum())
                if inside - others > best:
                    best = inside - others
                    text = f"{inside} of them, and {others} that finished, have '{name}' {word} {threshold:.4g}"
    return text
