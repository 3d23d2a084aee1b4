"""What a worker of a campaign does: simulate thetas that have no record yet, and record each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Protocol, runtime_checkable

import numpy as np

from ..external import FINISHED, Record
from ..simulator import WIDTH, FloatArray, SimulationFailure, Simulator
from .store import DamagedRecord, RunStore

RunFunction = Callable[[FloatArray], Sequence[Record]]
"""Thetas [S, d] -> their records [S]. It travels to the workers, so it must be picklable."""


@dataclass(frozen=True)
class Job:
    """A function to run and where its records go."""

    run: RunFunction
    store: RunStore
    times: int
    channels: int
    heaters: int

    def record_missing(self, thetas: FloatArray) -> Counter[str]:
        """Run those of thetas [S, d] that have no record, and record them; how many have which outcome.

        What a worker that died had recorded is found here, not run again.
        """
        found = [self.recorded(theta) for theta in thetas]
        missing = np.array([record is None for record in found])
        if missing.any():
            for theta, record in zip(thetas[missing], self._run(thetas[missing]), strict=True):
                self.store.write(theta, record)
                found.append(record)
        return Counter(record.outcome for record in found if record is not None)

    def recorded(self, theta: FloatArray) -> Record | None:
        """The record of theta [d], None where there is none or where it is damaged."""
        try:
            return self.store.read(theta)
        except DamagedRecord:
            return None

    def give_up(self, theta: FloatArray, attempts: int = 1) -> Counter[str]:
        """Record that the run at theta [d] kills its worker, attempts times at least; counts as `record_missing`."""
        message = "the worker process died each time that it was run"
        self.store.write(theta, replace(self._crashed(theta, message), attempts=attempts))
        return self.record_missing(theta[None])

    def _crashed(self, theta: FloatArray, message: str, seconds: float = np.nan) -> Record:
        """A record of a run that did not come back."""
        temperatures = np.full((self.times, self.channels), np.nan)
        return Record(theta, "crashed", message, 1, seconds, temperatures, np.full((self.times, self.heaters), np.nan))

    def _run(self, thetas: FloatArray) -> Sequence[Record]:
        """An error of the function is a crash of the run that it comes from, and of no other."""
        started = perf_counter()
        try:
            return self.run(thetas)
        except Exception as error:
            if len(thetas) > 1:
                return [record for theta in thetas for record in self._run(theta[None])]
            return [self._crashed(thetas[0], f"{type(error).__name__}: {error}", perf_counter() - started)]


@runtime_checkable
class RecordingSimulator(Protocol):
    """A simulator whose runs are slow and fail in ways of their own, such as an external one: it makes the records."""

    def run(self, theta: FloatArray) -> Record:
        """The run at theta [d]."""


def run_function(simulator: Simulator, times: int) -> tuple[RunFunction, int]:
    """How a simulator is run at thetas, observed at so many times, and how many of them are best one call."""
    if isinstance(simulator, RecordingSimulator):
        return OneByOne(simulator), 1
    return Batch(simulator, times), WIDTH


@dataclass(frozen=True)
class OneByOne:
    """The run function of a simulator that makes its records itself."""

    simulator: RecordingSimulator

    def __call__(self, thetas: FloatArray) -> list[Record]:
        """Records [S] of the runs at thetas [S, d]."""
        return [self.simulator.run(theta) for theta in thetas]


@dataclass(frozen=True)
class Batch:
    """The run function of a simulator that never leaves this process, such as a network: many runs at a time."""

    simulator: Simulator
    times: int

    def __call__(self, thetas: FloatArray) -> list[Record]:
        """Records [S] of the simulations at thetas [S, d]."""
        started = perf_counter()
        trajectories = self.simulator.simulate_many(thetas)
        seconds = (perf_counter() - started) / len(thetas)
        shape = (self.times, len(self.simulator.channels)), (self.times, len(self.simulator.heaters))
        return [
            Record(theta, "not finite", self._reason(theta), 1, seconds, *(np.full(s, np.nan) for s in shape))
            if trajectory is None
            else Record(theta, FINISHED, "", 1, seconds, trajectory.temperatures, trajectory.status)
            for theta, trajectory in zip(thetas, trajectories, strict=True)
        ]

    def _reason(self, theta: FloatArray) -> str:
        try:
            self.simulator.simulate(theta)
        except SimulationFailure as failure:
            return str(failure)
        return "the simulation fails in a batch"
