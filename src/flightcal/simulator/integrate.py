"""From a canonical system to its trajectory and back: the thin layer of NumPy around the compiled kernel."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from . import kernel
from .system import Drive, FloatArray, Structure, Switch, System

_SPARE_SEGMENTS = 256
_MOST_SWITCHES_PER_STEP = 20


class SimulationFailure(Exception):  # noqa: N818 - a value of the domain, not a programming error
    """A trajectory that cannot be computed: not finite, or a thermostat that chatters. Data for the caller."""


@dataclass(frozen=True)
class Run:
    """One integrated trajectory with the record that its derivative needs."""

    states: FloatArray
    """[K+1, n] K on the drive's grid."""
    status: FloatArray
    """[K+1, H] heater status just after each grid point."""
    switches: Switch
    segments: tuple[Any, ...]
    """Step, start, length, event, initial state and heater status of each segment (see `kernel.forward`)."""


def integrate(structure: Structure, system: System, drive: Drive) -> Run:
    """Integrate one system (NumPy arrays) over the drive's grid.

    Raises SimulationFailure when a state is not finite or heaters switch more than 20 times a step on average.
    """
    steps, n = len(drive.times) - 1, len(system.initial)
    heaters = len(system.lower)
    states = np.empty((steps + 1, n))
    status = np.empty((steps + 1, heaters))
    capacity = steps + _SPARE_SEGMENTS
    while True:
        record = (
            np.empty(capacity, np.int64),
            np.empty(capacity),
            np.empty(capacity),
            np.empty(capacity, np.int64),
            np.empty((capacity, n)),
            np.empty((capacity, heaters)),
        )
        outcome, segments = kernel.forward(
            structure, *system, drive.times, drive.inputs, drive.measured, drive.initially_on, states, status, *record
        )
        if outcome == kernel.TOO_MANY_SWITCHES and capacity < _MOST_SWITCHES_PER_STEP * steps:
            capacity *= 4
            continue
        break
    if outcome == kernel.NOT_FINITE:
        raise SimulationFailure("a temperature is not finite")
    if outcome == kernel.TOO_MANY_SWITCHES:
        raise SimulationFailure(
            f"heaters switch more than {_MOST_SWITCHES_PER_STEP} times a time step: a thermostat chatters"
        )
    kept: tuple[Any, ...] = tuple(part[:segments] for part in record)
    _, start, length, event, _, heater_state = kept
    switched = np.flatnonzero(event >= 0)
    heater = event[switched]
    switches = Switch(start[switched] + length[switched], heater, 1.0 - heater_state[switched, heater])
    return Run(states, status, switches, kept)


def pull_back(structure: Structure, system: System, drive: Drive, run: Run, states_bar: FloatArray) -> System:
    """Cotangent of the system from the cotangent [K+1, n] of the states on the grid: the adjoint of `integrate`."""
    bar = System(*(np.zeros_like(part) for part in system))
    kernel.adjoint(
        structure, system.linear, system.radiative, system.forcing, system.heating, drive.times, drive.inputs,
        *run.segments, states_bar, *bar,
    )  # fmt: skip
    return bar


def in_parallel(task: Callable[[int], Any], count: int) -> list[Any]:
    """[task(0), ..., task(count - 1)] on all cores; the kernel releases the interpreter lock."""
    workers = min(os.cpu_count() or 1, count)
    if workers <= 1:
        return [task(k) for k in range(count)]
    results: list[Any] = [None] * count
    tickets = iter(range(count))

    def work() -> None:
        for k in tickets:
            results[k] = task(k)

    # One future a worker, not one a task: a simulation may take less than handing it over.
    with ThreadPoolExecutor(workers) as pool:
        for future in [pool.submit(work) for _ in range(workers)]:
            future.result()
    return results
