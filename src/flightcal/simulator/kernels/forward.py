"""Compiled integration of the canonical form over the grid, one simulation or eight side by side.

A thermostat that has crossed its threshold at a step's end cuts the step where its sensor meets the threshold (see
`crossing`): the heater switches, and the rest of the step follows. A piece of a step between such cuts is called a
segment.

Every lane of `lanes` carries a simulation of its own, with its own place on the grid and its own step length; a lane
whose simulation is finished takes the next. So each round makes one step, or one trial of a cut, for every lane at
once (`advance`), and between rounds each lane decides what its next one is (`crossing.decide`).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...compiled import inlined, kernel, short_loops
from .crossing import WHOLE, decide
from .lanes import elements, lane_count, put, take
from .sampling import Looks, in_balance, observe_end, observe_segment
from .step import advance, load_matrices, make_step, step_size

FINISHED = 0
NOT_FINITE = 1
TOO_MANY_SWITCHES = 2

COUNTERS, REALS = 7, 6
"""A lane's integers and reals (see `_Lanes`)."""

_IDLE = 0
"""What a lane does: nothing, or a step (see `crossing`)."""


class Record(NamedTuple):
    """What a lane notes of the simulation it carries: the states on the grid, and every segment."""

    heat: Any
    """[lane, n, 2 K] of the inputs, B w, at the start and at the end of each step."""
    states: Any
    """[lane, K+1, n] K."""
    status: Any
    """[lane, K+1, H] heater status just after each grid point."""
    segments: Any
    """[lane] number of segments."""
    step: Any
    """[lane, segment] grid step."""
    start: Any
    """[lane, segment] s within the window."""
    length: Any
    """[lane, segment] s."""
    event: Any
    """[lane, segment] heater that switches at the end; -1: none."""
    state: Any
    """[lane, segment, n] at the start (no segment: not wanted)."""
    heater: Any
    """[lane, segment, H] heater status."""
    steps: Any
    """[segment, step_size] the whole `Step` of each segment of a single simulation; or one row, the last step's."""


class Outputs(NamedTuple):
    """What is kept of every simulation."""

    outcome: Any
    """[S] FINISHED, NOT_FINITE or TOO_MANY_SWITCHES."""
    temperatures: Any
    """[S, T, N] K at the samples."""
    status: Any
    """[S, T, H] at the samples."""
    duty_cycle: Any
    """[S, H]."""
    final: Any
    """[S, n] K at the window's end."""
    switches: Any
    """[S] number of switches."""
    switch_first: Any
    """[S] where they are in the arrays below."""
    switch_time: Any
    """[switch] s."""
    switch_heater: Any
    switch_on: Any
    """[switch] 1: went on, 0: went off."""
    noted: Any
    """[1] switches in these arrays so far."""


class _Lanes(NamedTuple):
    """Where each lane is. Arrays [lane], and elements (see `lanes`), the latter from x on."""

    simulation: Any
    step: Any
    phase: Any
    heater: Any
    """Whose crossing is being located; -1: none."""
    iterations: Any
    switches: Any
    """So far, where thresholds scatter."""
    settled: Any
    """1: no thermostat that is back within its band at the segment's end has left it in between."""
    duration: Any
    """Of the grid step, s."""
    low: Any
    """Bracket of the crossing, s."""
    high: Any
    rate: Any
    """K/s of the sensor towards its threshold, for the secant step."""
    previous: Any
    previous_value: Any
    driven: Any
    """[lane, H] by its measured status, in the step before."""
    x: Any
    """[n] at the segment's start."""
    left: Any
    """[n] heat of the inputs at the grid step's start, and its change per second."""
    ramp: Any
    heating: Any
    """[n] heat of the heaters."""
    status: Any
    """[H]"""
    lower: Any
    upper: Any
    begin: Any
    """[1] of the segment, s within the grid step."""
    length: Any
    """[1] of the trial, s."""
    A: Any
    N: Any
    Q: Any


class ForwardCall(NamedTuple):
    """What `forward` takes: S rooms for simulations, of which the first ones are made."""

    dense: Any
    """See `step`."""
    simulations: Any
    """[1] how many."""
    structure: Any
    packed: Any
    """[S, P], see `system.pack`."""
    times: Any
    series: Any
    measured: Any
    initially_on: Any
    looks: Looks
    scatter: Any
    """[S, E, 2, H] K, added to the lower and to the upper threshold of each heater at first and after each switch of
    its (by the number of switches of all, modulo E); E = 0: nothing is."""
    acting: Any
    """[S, h, 2 K] W, added to the last h input series; h = 0: nothing is."""
    memory: Any
    """[memory_size + step_size], or that x 8 for eight lanes. With room for more `Step`s, a single simulation keeps its
    first ones; all others are made in the last place."""
    counters: Any
    """[COUNTERS, lane]"""
    reals: Any
    """[REALS, lane]"""
    driven: Any
    """[lane, H]"""
    record: Record
    outputs: Outputs


@kernel(long=True)
def forward(call):
    """Simulate over the grid, and fill `record` and `outputs`; returns the outcome where there is one simulation."""
    short_loops()
    dense, structure, packed, times, series = call.dense, call.structure, call.packed, call.times, call.series
    measured, initially_on, scatter, memory = call.measured, call.initially_on, call.scatter, call.memory
    acting = call.acting
    record, outputs, looks, simulations = call.record, call.outputs, call.looks, call.simulations[0]
    outputs.noted[0] = 0
    count = lane_count(memory)
    lanes = _make_lanes(structure, memory, call.counters, call.reals, call.driven)
    size = step_size(dense, structure)
    first = memory_size(structure)
    rows = (memory.shape[0] - first) // size
    n = structure.mass.shape[0]
    load_matrices(dense, structure, packed[0])
    waiting = 0  # the next simulation that no lane has taken
    active = 0
    for lane in range(count):
        if waiting < simulations:
            _load(structure, packed, series, measured, initially_on, scatter, acting, lanes, lane, waiting, record)
            looks.next[lane] = 0
            _enter_step(structure, packed, times, measured, lanes, lane, record)
            active += 1
            waiting += 1
    while active > 0:
        row = first + size * min(record.segments[0], rows - 1)
        step = make_step(dense, structure, memory[row : row + size])
        for i in range(n):
            step.b0[i] = lanes.left[i] + lanes.ramp[i] * lanes.begin[0] + lanes.heating[i]
            step.b1[i] = step.b0[i] + lanes.ramp[i] * lanes.length[0]
        advance(dense, structure, lanes.A, lanes.N, lanes.Q, lanes.x, lanes.length[0], step)
        for lane in range(count):
            if lanes.phase[lane] == _IDLE or decide(structure, measured, lanes, lane, step):
                continue
            reached = _accept(structure, times, lanes, lane, step, record, looks, outputs)
            if scatter.shape[1] > 0 and lanes.heater[lane] >= 0:
                lanes.switches[lane] += 1
                _set_thresholds(structure, packed, scatter, lanes, lane, lanes.heater[lane])
            if reached:
                if lanes.heater[lane] >= 0:
                    _set_heating(structure, packed, lanes, lane)
                going_on = _enter_step(structure, packed, times, measured, lanes, lane, record)
            else:
                _start_segment(structure, packed, lanes, lane)
                going_on = True
            if going_on and record.segments[lane] < record.step.shape[1]:
                continue
            simulation = lanes.simulation[lane]
            if going_on:
                outputs.outcome[simulation] = TOO_MANY_SWITCHES
            elif not _finite(structure, lanes, lane):
                outputs.outcome[simulation] = NOT_FINITE
            else:
                outputs.outcome[simulation] = FINISHED
                _finish(looks, lanes, lane, record, outputs)
            active -= 1
            lanes.phase[lane] = _IDLE
            if waiting < simulations:
                _load(structure, packed, series, measured, initially_on, scatter, acting, lanes, lane, waiting, record)
                looks.next[lane] = 0
                _enter_step(structure, packed, times, measured, lanes, lane, record)
                active += 1
                waiting += 1
    return outputs.outcome[0] if packed.shape[0] == 1 else 0


@inlined
def _finite(structure, lanes, lane):
    """Whether the last state is finite; one that is not never becomes finite again."""
    finite = True
    for i in range(structure.mass.shape[0]):
        finite = finite and np.isfinite(take(lanes.x, i, lane))
    return finite


@inlined
def memory_size(structure):
    """Length of the memory that `forward` works in, before the `Step` at its end."""
    n, H = structure.mass.shape[0], structure.sensor.shape[0]
    entries = structure.linear_column.shape[0] + structure.radiative_column.shape[0]
    return entries + structure.quadratic_column.shape[0] + 4 * n + 3 * H + 2


@inlined
def _make_lanes(structure, memory, counters, reals, driven):
    n, H = structure.mass.shape[0], structure.sensor.shape[0]
    a, m = structure.linear_column.shape[0], structure.radiative_column.shape[0]
    q = structure.quadratic_column.shape[0]
    at = 4 * n + 3 * H + 2
    memory[: at + a + m + q] = 0.0  # not the steps behind it, which are many
    counters[:] = 0
    return _Lanes(
        counters[0],
        counters[1],
        counters[2],
        counters[3],
        counters[4],
        counters[5],
        counters[6],
        reals[0],
        reals[1],
        reals[2],
        reals[3],
        reals[4],
        reals[5],
        driven,
        elements(memory[:n]),
        elements(memory[n : 2 * n]),
        elements(memory[2 * n : 3 * n]),
        elements(memory[3 * n : 4 * n]),
        elements(memory[4 * n : 4 * n + H]),
        elements(memory[4 * n + H : 4 * n + 2 * H]),
        elements(memory[4 * n + 2 * H : 4 * n + 3 * H]),
        elements(memory[at - 2 : at - 1]),
        elements(memory[at - 1 : at]),
        elements(memory[at : at + a]),
        elements(memory[at + a : at + a + m]),
        elements(memory[at + a + m : at + a + m + q]),
    )


@inlined
def _load(structure, packed, series, measured, initially_on, scatter, acting, lanes, lane, simulation, record):
    """Put a simulation into a lane, before the first grid point."""
    n, H = structure.mass.shape[0], structure.sensor.shape[0]
    a, m = structure.linear_column.shape[0], structure.radiative_column.shape[0]
    first_forcing = a + m + structure.quadratic_column.shape[0]
    initial = packed.shape[1] - n
    lanes.simulation[lane] = simulation
    lanes.step[lane] = -1
    lanes.switches[lane] = 0
    record.segments[lane] = 0
    for p in range(a):
        put(lanes.A, p, lane, packed[simulation, p])
    for p in range(m):
        put(lanes.N, p, lane, packed[simulation, a + p])
    for p in range(first_forcing - a - m):
        put(lanes.Q, p, lane, packed[simulation, a + m + p])
    for i in range(n):
        put(lanes.x, i, lane, packed[simulation, initial + i])
        for k in range(series.shape[1]):
            record.heat[lane, i, k] = 0.0
    unmoved = series.shape[0] - acting.shape[1]
    for p in range(structure.forcing_row.shape[0]):
        i, j, value = structure.forcing_row[p], structure.forcing_column[p], packed[simulation, first_forcing + p]
        for k in range(series.shape[1]):
            record.heat[lane, i, k] += value * series[j, k]
        if j >= unmoved:
            for k in range(series.shape[1]):
                record.heat[lane, i, k] += value * acting[simulation, j - unmoved, k]
    for k in range(H):
        _set_thresholds(structure, packed, scatter, lanes, lane, k)
        lanes.driven[lane, k] = not np.isnan(measured[0, k])
        put(lanes.status, k, lane, measured[0, k] if lanes.driven[lane, k] else initially_on[k])
        if not lanes.driven[lane, k]:
            _start_thermostat(structure, lanes, lane, k)
    _set_heating(structure, packed, lanes, lane)


@inlined
def _set_thresholds(structure, packed, scatter, lanes, lane, k):
    H = structure.sensor.shape[0]
    simulation = lanes.simulation[lane]
    lower = packed.shape[1] - structure.mass.shape[0] - 2 * H + k
    to_lower, to_upper = 0.0, 0.0
    if scatter.shape[1] > 0:
        row = lanes.switches[lane] % scatter.shape[1]
        to_lower, to_upper = scatter[simulation, row, 0, k], scatter[simulation, row, 1, k]
    put(lanes.lower, k, lane, packed[simulation, lower] + to_lower)
    put(lanes.upper, k, lane, packed[simulation, lower + H] + to_upper)


@inlined
def _set_heating(structure, packed, lanes, lane):
    n, H = structure.mass.shape[0], structure.sensor.shape[0]
    first = packed.shape[1] - n - 2 * H - structure.heating_row.shape[0]
    for i in range(n):
        put(lanes.heating, i, lane, 0.0)
    for p in range(structure.heating_row.shape[0]):
        i = structure.heating_row[p]
        heat = take(lanes.status, structure.heating_heater[p], lane) * packed[lanes.simulation[lane], first + p]
        put(lanes.heating, i, lane, take(lanes.heating, i, lane) + heat)


@inlined
def _start_thermostat(structure, lanes, lane, k):
    """Status with which a thermostat begins to act: its own, unless the sensor is outside the band."""
    temperature = take(lanes.x, structure.sensor[k], lane)
    if temperature < take(lanes.lower, k, lane):
        put(lanes.status, k, lane, 1.0)
    elif temperature > take(lanes.upper, k, lane):
        put(lanes.status, k, lane, 0.0)
    else:
        put(lanes.status, k, lane, 1.0 if take(lanes.status, k, lane) > 0.5 else 0.0)


@inlined
def _note_status(lanes, lane, record, step):
    """What the heaters do from a grid point on."""
    for k in range(record.status.shape[2]):
        record.status[lane, step, k] = take(lanes.status, k, lane)


@inlined
def _enter_step(structure, packed, times, measured, lanes, lane, record):
    """Note the grid point that the lane has reached, and enter the next step; False: there is none."""
    n, H = structure.mass.shape[0], structure.sensor.shape[0]
    lanes.step[lane] += 1
    step = lanes.step[lane]
    for i in range(n):
        record.states[lane, step, i] = take(lanes.x, i, lane)
    if step + 1 >= times.shape[0]:
        _note_status(lanes, lane, record, step)
        return False
    duration = times[step + 1] - times[step]
    lanes.duration[lane] = duration
    rate = 1.0 / duration
    for i in range(n):
        left = record.heat[lane, i, 2 * step]
        put(lanes.left, i, lane, left)
        put(lanes.ramp, i, lane, (record.heat[lane, i, 2 * step + 1] - left) * rate)
    changed = False
    for k in range(H):
        if not np.isnan(measured[step, k]):
            put(lanes.status, k, lane, measured[step, k])
            lanes.driven[lane, k] = True
            changed = True
        elif lanes.driven[lane, k]:
            _start_thermostat(structure, lanes, lane, k)
            lanes.driven[lane, k] = False
            changed = True
    if changed:
        _set_heating(structure, packed, lanes, lane)
    _note_status(lanes, lane, record, step)
    put(lanes.begin, 0, lane, 0.0)
    put(lanes.length, 0, lane, duration)
    lanes.phase[lane], lanes.settled[lane] = WHOLE, 0
    return True


@inlined
def _start_segment(structure, packed, lanes, lane):
    """The next trial goes from the switch to the grid point."""
    _set_heating(structure, packed, lanes, lane)
    put(lanes.length, 0, lane, lanes.duration[lane] - take(lanes.begin, 0, lane))
    lanes.phase[lane], lanes.settled[lane] = WHOLE, 0


@inlined
def _accept(structure, times, lanes, lane, step, record, looks, outputs):
    """Note the segment and what is observed in it, and move to its end; whether that is the grid point."""
    n, H = structure.mass.shape[0], structure.sensor.shape[0]
    segment = record.segments[lane]
    event = lanes.heater[lane]
    length = take(lanes.length, 0, lane)
    record.segments[lane] = segment + 1
    record.step[lane, segment] = lanes.step[lane]
    record.start[lane, segment] = times[lanes.step[lane]] + take(lanes.begin, 0, lane)
    record.length[lane, segment] = length
    record.event[lane, segment] = event
    for k in range(H):
        record.heater[lane, segment, k] = take(lanes.status, k, lane)
    begin = take(lanes.begin, 0, lane) + length
    simulation = lanes.simulation[lane]
    is_last = event < 0 and lanes.step[lane] + 2 == times.shape[0]
    observe_segment(
        structure, looks, looks.errors[simulation], lanes.x, lanes.status, step, lane, record.start[lane, segment],
        times[lanes.step[lane]] + begin if event >= 0 else times[lanes.step[lane] + 1], length, is_last,
        in_balance(looks, record.heater, lane, segment), outputs.temperatures[simulation], outputs.status[simulation],
    )  # fmt: skip
    if record.state.shape[1] > 0:
        for i in range(n):
            record.state[lane, segment, i] = take(lanes.x, i, lane)
    for i in range(n):
        put(lanes.x, i, lane, take(step.x1, i, lane))
    if event < 0:
        return True
    put(lanes.status, event, lane, 1.0 - take(lanes.status, event, lane))
    put(lanes.begin, 0, lane, begin)
    return begin >= lanes.duration[lane]


@inlined
def _finish(looks, lanes, lane, record, outputs):
    """From a lane's `Record` of a simulation that has come to its end to the rest of `Outputs`."""
    simulation, segments, heaters = lanes.simulation[lane], record.segments[lane], record.heater.shape[2]
    for i in range(outputs.final.shape[1]):
        outputs.final[simulation, i] = take(lanes.x, i, lane)
    observe_end(
        looks, looks.errors[simulation], lanes.x, lanes.status, lane,
        outputs.temperatures[simulation], outputs.status[simulation],
    )  # fmt: skip
    first = outputs.noted[0]
    switches = first
    total = 0.0
    for h in range(heaters):
        outputs.duty_cycle[simulation, h] = 0.0
    for s in range(segments):
        length = record.length[lane, s]
        total += length
        for h in range(heaters):
            outputs.duty_cycle[simulation, h] += length * record.heater[lane, s, h]
        event = record.event[lane, s]
        if event >= 0:
            outputs.switch_time[switches] = record.start[lane, s] + length
            outputs.switch_heater[switches] = event
            outputs.switch_on[switches] = 1.0 - record.heater[lane, s, event]
            switches += 1
    for h in range(heaters):
        outputs.duty_cycle[simulation, h] /= total
    outputs.switches[simulation] = switches - first
    outputs.switch_first[simulation] = first
    outputs.noted[0] = switches
