"""From a canonical system to its trajectory and back: the thin layer of NumPy around the compiled functions."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from .adjoint import adjoint, adjoint_memory_size
from .forward import (
    COUNTERS,
    FINISHED,
    NOT_FINITE,
    REALS,
    TOO_MANY_SWITCHES,
    Outputs,
    Record,
    forward,
    memory_size,
)
from .lanes import WIDTH, lane_memory
from .sampling import Sampling, Sensors
from .step import step_size
from .system import Drive, FloatArray, Structure, Switch, System, pack, unpack

_SPARE_SEGMENTS = 256
MOST_SWITCHES_PER_STEP = 20
_MOST_KEPT = 20_000_000
"""So many numbers (160 MB) of a run's steps are kept for its derivative; beyond, they are computed again for it."""


class SimulationFailure(Exception):  # noqa: N818 - a value of the domain, not a programming error
    """A trajectory that cannot be computed: not finite, or a thermostat that chatters. Data for the caller."""


@dataclass(frozen=True)
class Observation:
    """Where and when the states are looked at."""

    sampling: Sampling
    sensors: Sensors


NOTHING = Observation(
    Sampling(np.zeros(0, np.int64), np.zeros(0)), Sensors(np.zeros(0, np.int64), np.zeros(0, np.bool_))
)


@dataclass(frozen=True)
class Run:
    """One integrated trajectory with the record that its derivative needs."""

    record: Record
    """Of a single lane."""
    outputs: Outputs
    """Of a single simulation."""

    @property
    def states(self) -> FloatArray:
        """[K+1, n] K on the drive's grid."""
        return np.asarray(self.record.states[0])

    @property
    def status(self) -> FloatArray:
        """[K+1, H] heater status just after each grid point."""
        return np.asarray(self.record.status[0])

    @property
    def switches(self) -> Switch:
        """Every time a thermostat acted."""
        return switches(self.outputs, 0)


def switches(outputs: Outputs, simulation: int) -> Switch:
    """The thermostats' events in one simulation."""
    first = outputs.switch_first[simulation]
    here = slice(first, first + outputs.switches[simulation])
    return Switch(outputs.switch_time[here], outputs.switch_heater[here], outputs.switch_on[here])


def integrate(structure: Structure, system: System, drive: Drive, *, derivative: bool = True) -> Run:
    """Integrate one system (NumPy arrays) over the drive's grid.

    derivative: whether `pull_back` will be asked of the run; a tenth faster without.
    Raises SimulationFailure when a state is not finite or heaters switch more than 20 times a step on average.
    """
    return integrate_packed(structure, pack(system), drive, NOTHING, np.zeros((3, 0)), derivative=derivative)


def integrate_packed(
    structure: Structure,
    packed: FloatArray,
    drive: Drive,
    observation: Observation,
    errors: FloatArray,
    *,
    derivative: bool = True,
    scatter: FloatArray | None = None,
) -> Run:
    """`integrate` of a packed system [P], observed with errors [3, N] (see `Sensors`).

    scatter: [E, H] K of the thresholds, see `forward`; its derivative takes it as given. None: there is none.
    """
    scattered = None if scatter is None else scatter[None]
    capacity = len(drive.times) - 1 + _SPARE_SEGMENTS
    while True:
        memory, steps = step_memory(structure, capacity if derivative else 0)
        record = make_record(structure, drive, 1, capacity, steps if derivative else None)
        outputs = make_outputs(structure, observation, 1, capacity)
        _forward(structure, packed[None], drive, observation, errors[None], scattered, memory, record, outputs)
        outcome = outputs.outcome[0]
        if outcome == TOO_MANY_SWITCHES and capacity < MOST_SWITCHES_PER_STEP * len(drive.times):
            capacity *= 4
            continue
        break
    if outcome == NOT_FINITE:
        raise SimulationFailure("a temperature is not finite")
    if outcome == TOO_MANY_SWITCHES:
        raise SimulationFailure(
            f"heaters switch more than {MOST_SWITCHES_PER_STEP} times a time step: a thermostat chatters"
        )
    return Run(record, outputs)


def integrate_many(
    structure: Structure,
    packed: FloatArray,
    drive: Drive,
    observation: Observation,
    errors: FloatArray,
    scatter: FloatArray | None = None,
) -> Outputs:
    """Packed systems [S, P] side by side, observed with errors [S, 3, N] (see `Sensors`).

    scatter: [S, E, H] K of the thresholds, see `forward`; None: there is none.
    outputs.outcome says which failed; TOO_MANY_SWITCHES: more than one a step, which `integrate_packed` may still do.
    """
    capacity = len(drive.times) - 1 + _SPARE_SEGMENTS
    outputs = make_outputs(structure, observation, len(packed), capacity)
    record = make_record(structure, drive, WIDTH, capacity, None)
    memory = lane_memory(memory_size.py_func(structure) + step_size.py_func(structure))
    _forward(structure, packed, drive, observation, errors, scatter, memory, record, outputs)
    return outputs


def pull_back(
    structure: Structure,
    system: System,
    drive: Drive,
    run: Run,
    states_bar: FloatArray,
    switches_bar: FloatArray | None = None,
) -> System:
    """Cotangent of the system from those of the states on the grid [K+1, n] and of the switches' times [E].

    The adjoint of `integrate`. switches_bar: None: zero.
    """
    return unpack(structure, pull_back_packed(structure, pack(system), drive, run, states_bar, switches_bar))


def pull_back_packed(
    structure: Structure,
    packed: FloatArray,
    drive: Drive,
    run: Run,
    states_bar: FloatArray,
    switches_bar: FloatArray | None = None,
) -> FloatArray:
    """The same of a packed system [P]."""
    if switches_bar is None:
        switches_bar = np.zeros(run.outputs.switches[0])
    packed_bar = np.empty_like(packed)
    memory = np.empty(adjoint_memory_size(structure))
    heat_bar = np.empty((len(structure.mass), len(drive.times)))
    adjoint(
        structure, packed, drive.times, drive.series, run.record, states_bar, switches_bar, memory, heat_bar, packed_bar
    )
    return packed_bar


def _forward(
    structure: Structure,
    packed: FloatArray,
    drive: Drive,
    observation: Observation,
    errors: FloatArray,
    scatter: FloatArray | None,
    memory: FloatArray,
    record: Record,
    outputs: Outputs,
) -> None:
    lanes, heaters = record.heater.shape[0], record.heater.shape[2]
    scatter = np.zeros((1, 0, heaters)) if scatter is None else np.ascontiguousarray(scatter)
    counters, reals = np.empty((COUNTERS, lanes), np.int64), np.empty((REALS, lanes))
    forward(
        structure, packed, drive.times, drive.series, drive.measured, drive.initially_on,
        observation.sampling, observation.sensors, errors, scatter,
        memory, counters, reals, np.empty((lanes, heaters), np.bool_), record, outputs,
    )  # fmt: skip


def step_memory(structure: Structure, most: int) -> tuple[FloatArray, FloatArray]:
    """Memory for `forward` of a single simulation, and its part that holds the steps [., step_size].

    At most so many steps are kept, and no more than the limit on memory allows.
    """
    # As Python: it takes longer to hand a structure to a compiled function than to add up a few lengths.
    size, first = step_size.py_func(structure), memory_size.py_func(structure)
    memory = np.empty(first + size * (1 + min(most, _MOST_KEPT // size)))
    return memory, memory[first:].reshape(-1, size)


def make_record(structure: Structure, drive: Drive, lanes: int, segments: int, steps: FloatArray | None) -> Record:
    """Memory for what `forward` notes; steps: of `step_memory`, or None: the record is not for a derivative."""
    points, n, heaters = len(drive.times), len(structure.mass), len(structure.sensor)
    return Record(
        heat=np.empty((lanes, n, points)),
        states=np.empty((lanes, points, n)),
        status=np.empty((lanes, points, heaters)),
        segments=np.zeros(lanes, np.int64),
        step=np.empty((lanes, segments), np.int64),
        start=np.empty((lanes, segments)),
        length=np.empty((lanes, segments)),
        event=np.empty((lanes, segments), np.int64),
        state=np.empty((lanes, 0 if steps is None else segments, n)),
        heater=np.empty((lanes, segments, heaters)),
        steps=np.empty((0, 0)) if steps is None else steps,
    )


def make_outputs(structure: Structure, observation: Observation, simulations: int, most_switches: int) -> Outputs:
    """Memory for what is kept of simulations."""
    samples, channels, heaters = len(observation.sampling.point), len(observation.sensors.state), len(structure.sensor)
    # Memory that is never touched costs nothing.
    most = simulations * most_switches if heaters else 0
    return Outputs(
        outcome=np.full(simulations, FINISHED, np.int64),
        temperatures=np.empty((simulations, samples, channels)),
        status=np.empty((simulations, samples, heaters)),
        duty_cycle=np.empty((simulations, heaters)),
        switches=np.zeros(simulations, np.int64),
        switch_first=np.zeros(simulations, np.int64),
        switch_time=np.empty(most),
        switch_heater=np.empty(most, np.int64),
        switch_on=np.empty(most),
        noted=np.zeros(1, np.int64),
    )


def in_parallel(task: Callable[[int], Any], count: int) -> list[Any]:
    """[task(0), ..., task(count - 1)] on all cores; the compiled functions release the interpreter lock."""
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
