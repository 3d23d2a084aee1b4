"""A satellite to spoil, and a way to spoil it."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.truth.flight import KINDS, Flight, fly
from benchmarks.truth.satellites import START, WINDOWS

SEED = 7
_TRIED = 60
"""Satellites among which one is looked for that a set-up fits."""


@dataclass(frozen=True)
class Case:
    """A scenario as its file has it, and its telemetry."""

    written: dict[str, Any]
    table: pd.DataFrame
    flight: Flight
    other: Flight
    """Another satellite."""

    def copy(self) -> Case:
        return replace(self, written=deepcopy(self.written), table=self.table.copy())

    @property
    def model(self) -> dict[str, Any]:
        return dict(self.written["simulator"])

    @property
    def channels(self) -> list[str]:
        """Temperatures, that which varies most first."""
        names = [name for name in self.table if name.endswith("_temp")]
        return sorted(names, key=lambda name: -float(self.training[name].std()))

    @property
    def training(self) -> pd.DataFrame:
        times = pd.to_datetime(self.table["time"])
        first, length = (orbits * self.flight.satellite.period for orbits in WINDOWS["train"])
        seconds = (times - pd.Timestamp(START)).dt.total_seconds()
        return self.table[(seconds >= first) & (seconds < first + length)]

    @property
    def heaters(self) -> list[str]:
        """Those that switch in the training."""
        return [name for name in self.model["heaters"] if 0.1 < self.training[f"{name}_status"].mean() < 0.9]


@dataclass(frozen=True)
class SetUp:
    """One way to be wrong."""

    name: str
    first: int
    """The satellite from which on one is looked for that fits."""
    kinds: tuple[str, ...]
    """Of suspicions that are right."""
    spoil: Callable[[Case], str]
    """Spoils a case in place, and says what it is about ("": anything)."""
    fits: Callable[[Case], bool] = lambda case: True

    def satellite(self, seed: int) -> tuple[int, Case]:
        """The first satellite that fits, and its number. Raises StopIteration."""
        cases = ((number, case_of(seed, number)) for number in range(self.first, self.first + _TRIED))
        return next(case for case in cases if self.fits(case[1]))


@cache
def _flown(seed: int, number: int) -> Flight:
    """Satellite `number`, with heat that its scenario lacks in three of four."""
    with tempfile.TemporaryDirectory() as folder:
        return fly(seed, number, KINDS[number % len(KINDS)], Path(folder))


def case_of(seed: int, number: int) -> Case:
    """Satellite `number`, and the next one."""
    flight = _flown(seed, number)
    return Case(dict(flight.satellite.written), flight.telemetry, flight, _flown(seed, number + 1))


def busy(case: Case) -> tuple[str, float]:
    """Node and power that the busy mode adds."""
    modes = case.model["modes"]
    node = next(name for name in modes["busy"] if name not in modes["idle"])
    return node, amount(modes["busy"][node])


def is_busy(case: Case) -> Any:
    """[T] whether the timeline says so at each sample."""
    timeline = case.model["timeline"]
    times = case.table["time"].to_numpy().astype("datetime64[s]")
    changes = np.array([change["at"] for change in timeline], "datetime64[s]")
    place = np.searchsorted(changes, times, side="right") - 1
    return np.array([change["mode"] == "busy" for change in timeline])[place]


def amount(text: Any) -> float:
    """What is before a unit."""
    return float(str(text).split()[0])


# --- which set-ups fit ---------------------------------------------------------------------------------------------


def lit(case: Case) -> bool:
    """Whether sunlight comes and goes: else no clock can be told by it."""
    return float(case.training[case.channels[0]].std()) > 2.0


def heated(case: Case) -> bool:
    """Whether a heater switches."""
    return bool(case.heaters)


def several(case: Case) -> bool:
    """Whether channels can be told apart by the others."""
    return len(case.channels) > 2


def apart(case: Case) -> bool:
    """Whether two channels differ in their means."""
    means = [float(case.training[channel].mean()) for channel in case.channels]
    return len(case.channels) > 1 and abs(means[0] - means[-1]) > 3.0


def strong_payload(case: Case) -> bool:
    """Whether the payload's heat shows."""
    node, power = busy(case)
    return power > 0.25 * case.flight.flow[node] and f"{node}_temp" in case.channels
