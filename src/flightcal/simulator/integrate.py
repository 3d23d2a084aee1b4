"""From a canonical system to its trajectory and back: memory for the kernels, and what Python calls of them."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any

import numpy as np

from ..compiled import Row
from .dense import whole_matrices
from .kernels.adjoint import AdjointCall, adjoint, adjoint_memory_size
from .kernels.forward import (
    COUNTERS,
    FINISHED,
    NOT_FINITE,
    REALS,
    TOO_MANY_SWITCHES,
    ForwardCall,
    Outputs,
    Record,
    forward,
    memory_size,
)
from .kernels.lanes import aligned, lane_memory
from .kernels.sampling import Looks
from .kernels.step import step_size
from .sampling import NOTHING, Observation, Sensors
from .system import Drive, FloatArray, Structure, Switch, System, pack, packed_size, unpack

MOST_SWITCHES = 20.0 / 30.0  # per second of a window, and as many for each point of the grid
_USUAL_SWITCHES = 1.0 / 30.0
"""So many fit in the lanes' memory, likewise."""
_SPARE = 256
_MOST_KEPT = 20_000_000
"""So many numbers (160 MB) of a run's steps are kept for its derivative; beyond, they are computed again for it."""


class SimulationFailure(ArithmeticError):  # noqa: N818 - a value of the domain, not a programming error
    """A trajectory that cannot be computed: not finite, or a thermostat that chatters. Data for the caller."""


class Integration:
    """Memory and C calls for simulations of packed systems [S, P] on one window, and for the derivative of one.

    Fill the first rows of `packed`, `errors` (of the sensors, see `Sensors`), `scatter` and `acting` (see
    `ForwardCall`), and `simulations`; `forward` then fills `record` and `outputs`. For the derivative, with room for
    one simulation and `derivative` set: from `temperatures_bar`, `states_bar` and `switches_bar` (zero unless filled,
    each) `adjoint` makes `packed_bar` and `errors_bar`.

    Memory is for the most switches that a simulation may have, and what is never touched costs nothing; but in lanes
    for about one a step: where TOO_MANY_SWITCHES is the outcome, the simulation may yet be possible alone.
    """

    def __init__(
        self,
        structure: Structure,
        drive: Drive,
        observation: Observation,
        *,
        rooms: int = 1,
        lanes: int = 1,
        derivative: bool = False,
        scatter: int = 0,
        acting: int = 0,
    ) -> None:
        points, n, heaters = len(drive.times), len(structure.mass), len(structure.sensor)
        samples, channels = len(observation.times), len(observation.sensors.state)
        switching = MOST_SWITCHES if lanes == 1 else _USUAL_SWITCHES
        most, entries = points + _SPARE + int(switching * drive.times[-1]), packed_size(structure)
        self.structure, self.simulations = structure, np.ones(1, np.int64)
        self.packed, self.packed_bar = np.empty((rooms, entries)), np.empty(entries)
        self.errors, self.errors_bar = np.empty((rooms, 3, channels)), np.empty((3, channels))
        self.scatter = np.zeros((rooms, scatter, 2, heaters))
        self.acting = np.zeros((rooms, acting, 2 * (points - 1)))
        self.temperatures_bar, self.states_bar = np.zeros((samples, channels)), np.zeros((points, n))
        # As Python: they are only lengths.
        dense = whole_matrices(structure) if lanes == 1 else None
        step, first = step_size.py_func(dense, structure), memory_size.py_func(structure)
        if lanes > 1:
            memory = lane_memory(first + step)
        else:
            memory = aligned(first + step * (1 + (min(most, _MOST_KEPT // step) if derivative else 0)), first)
        self.record = Record(
            heat=np.empty((lanes, n, 2 * (points - 1))),
            states=np.empty((lanes, points, n)),
            status=np.empty((lanes, points, heaters)),
            segments=np.zeros(lanes, np.int64),
            step=np.empty((lanes, most), np.int64),
            start=np.empty((lanes, most)),
            length=np.empty((lanes, most)),
            event=np.empty((lanes, most), np.int64),
            state=np.empty((lanes, most if derivative else 0, n)),
            heater=np.empty((lanes, most, heaters)),
            steps=memory[first:].reshape(-1, step) if derivative else np.empty((0, 0)),
        )
        switches = rooms * most if heaters else 0
        self.outputs = Outputs(
            outcome=np.full(rooms, FINISHED, np.int64),
            temperatures=np.empty((rooms, samples, channels)),
            status=np.empty((rooms, samples, heaters)),
            duty_cycle=np.empty((rooms, heaters)),
            final=np.empty((rooms, n)),
            switches=np.zeros(rooms, np.int64),
            switch_first=np.zeros(rooms, np.int64),
            switch_time=np.empty(switches),
            switch_heater=np.empty(switches, np.int64),
            switch_on=np.empty(switches),
            noted=np.zeros(1, np.int64),
        )
        self.switches_bar = np.zeros(switches if derivative else 0)
        looks = Looks(
            observation.times, *observation.sensors, int(not observation.sensors.moved.any()),
            int(structure.mass.all()), self.errors, np.empty((lanes, channels + 1), np.int64), np.empty((4, channels)),
        )  # fmt: skip
        self.forward: Row = forward.row(
            ForwardCall(
                dense, self.simulations, structure, self.packed, drive.times, drive.series, drive.measured,
                drive.initially_on, looks, self.scatter, self.acting,
                memory, np.empty((COUNTERS, lanes), np.int64), np.empty((REALS, lanes)),
                np.empty((lanes, heaters), np.bool_), self.record, self.outputs,
            )
        )  # fmt: skip
        self.adjoint: Row = adjoint.row(
            AdjointCall(
                dense, structure, self.packed, drive.times, drive.series, self.record, looks, self.outputs.temperatures,
                self.temperatures_bar, self.states_bar, self.outputs.switches, self.switches_bar,
                np.empty(adjoint_memory_size(structure)), np.empty(self.record.heat.shape[1:]), self.errors_bar,
                self.packed_bar,
            )
        )  # fmt: skip

    @property
    def states(self) -> FloatArray:
        """[K+1, n] K on the drive's grid, of a single simulation."""
        return np.asarray(self.record.states[0])

    @property
    def status(self) -> FloatArray:
        """[K+1, H] heater status just after each grid point, of a single simulation."""
        return np.asarray(self.record.status[0])

    @property
    def switches(self) -> Switch:
        """Every time a thermostat acted in a single simulation."""
        return switches(copied(self.outputs, 1), 0)

    def pull_back(self, states_bar: FloatArray, switches_bar: FloatArray | None = None) -> System:
        """Cotangent of the system from those of the states on the grid [K+1, n] and of the switches' times [E].

        The adjoint of `forward`. switches_bar: None: zero.
        """
        self.states_bar[:] = states_bar
        self.switches_bar[: self.outputs.switches[0]] = 0.0 if switches_bar is None else switches_bar
        self.adjoint()
        return unpack(self.structure, self.packed_bar.copy())


def switches(outputs: Outputs, simulation: int) -> Switch:
    """The thermostats' events in one simulation."""
    first = outputs.switch_first[simulation]
    here = slice(first, first + outputs.switches[simulation])
    return Switch(outputs.switch_time[here], outputs.switch_heater[here], outputs.switch_on[here])


def copied(outputs: Outputs, simulations: int) -> Outputs:
    """Of the first simulations, in memory of their own."""
    of_simulations = [part[:simulations].copy() for part in outputs[:7]]
    of_switches = [part[: outputs.noted[0]].copy() for part in outputs[7:10]]
    return Outputs._make([*of_simulations, *of_switches, outputs.noted.copy()])


def check_outcome(outcome: int) -> None:
    """Raises SimulationFailure where a simulation has not finished."""
    if outcome == NOT_FINITE:
        raise SimulationFailure("a temperature is not finite")
    if outcome == TOO_MANY_SWITCHES:
        raise SimulationFailure(
            f"heaters switch more than {30 * MOST_SWITCHES:.0f} times in 30 s on average: a thermostat chatters"
        )


def integrate(structure: Structure, system: System, drive: Drive, *, derivative: bool = True) -> Integration:
    """Integrate one system (NumPy arrays) over the drive's grid.

    derivative: whether the run will be asked to `pull_back`; a tenth faster without.
    Raises SimulationFailure when a state is not finite or heaters switch more than 20 times in 30 s on average.
    """
    run = Integration(structure, drive, NOTHING, derivative=derivative)
    run.packed[0] = pack(system)
    check_outcome(run.forward())
    return run


def sensor_temperatures(structure: Structure, system: System, drive: Drive, times: FloatArray) -> FloatArray:
    """Temperatures [T, H] K of the sensors of the thermostats at times [T] s. Raises SimulationFailure."""
    sensors = Sensors(structure.sensor, np.zeros(len(structure.sensor), np.bool_))
    run = Integration(structure, drive, Observation(times, sensors))
    run.packed[0] = pack(system)
    run.errors[0] = np.array([1.0, 0.0, 0.0])[:, None]
    check_outcome(run.forward())
    return run.outputs.temperatures[0].copy()


def cores() -> int:
    """How many this process may use: all of the machine, or those that a scheduler or `taskset` leaves it."""
    allowed = getattr(os, "sched_getaffinity", None)
    return len(allowed(0)) if allowed is not None else os.cpu_count() or 1


def in_parallel(task: Callable[[int], Any], count: int) -> list[Any]:
    """[task(0), ..., task(count - 1)] on all cores; the compiled functions release the interpreter lock."""
    workers = min(cores(), count)
    if workers <= 1:
        return [task(k) for k in range(count)]
    results: list[Any] = [None] * count
    tickets = iter(range(count))

    def work() -> None:
        try:
            for k in tickets:
                results[k] = task(k)
        finally:
            deque(tickets, maxlen=0)  # after an error nobody begins another

    # One future a worker, not one a task: a simulation may take less than handing it over.
    helpers = [_threads(os.getpid()).submit(work) for _ in range(workers - 1)]
    try:
        work()
    finally:
        running = [helper for helper in helpers if not helper.cancel()]
    for helper in running:
        helper.result()
    return results


@cache
def _threads(process: int) -> ThreadPoolExecutor:
    """Of a process, kept: to start threads may take longer than the simulations. A forked process has none."""
    return ThreadPoolExecutor(cores())
