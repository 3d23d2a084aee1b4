"""The full-order operational simulator: a thermal network of any size with the on-board software in the loop.

The network is a scenario's, in the canonical form that everything else uses, and is advanced by the same step. Between
two control cycles the heaters do not change, so the steps in between are smooth; at each cycle the software reads the
thermistors and commands the heaters.
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
import pandas as pd

from ..errors import FlightcalError
from ..scenario import Duration, Kelvins, Part, Quantity, Scenario, Seconds, Temperature
from ..simulator import (
    FloatArray,
    MarchCall,
    Network,
    ParameterMap,
    Structure,
    assemble,
    build_network,
    face_series,
    march,
    step_size,
    unpack,
)
from .onboard import Memory, OnboardSoftware, cycle, is_multiple, refuse_unknown, started


@dataclass(frozen=True)
class ThermistorFailure(Part):
    """From `at` (s, after the start) on the thermistor is open (reads NaN), stuck at a temperature, or drifts."""

    at: Seconds
    kind: Literal["open", "stuck", "drift"]
    stuck_at: Temperature | None = None
    """K"""
    rate: Annotated[float, Quantity("K/s")] | None = None
    """K/s"""

    def __post_init__(self) -> None:
        wanted = {"open": None, "stuck": "stuck_at", "drift": "rate"}[self.kind]
        given = [name for name in ("stuck_at", "rate") if getattr(self, name) is not None]
        if given != ([wanted] if wanted else []):
            raise ValueError(f"found {given or 'no number'}, expected {wanted or 'none'} with kind '{self.kind}'")


@dataclass(frozen=True)
class Thermistor(Part):
    """A sensor on a node."""

    node: str
    bias: Annotated[float, Quantity("K", difference=True)] = 0.0
    """K"""
    noise: Kelvins = 0.0
    """K, standard deviation."""
    failures: tuple[ThermistorFailure, ...] = ()


@dataclass(frozen=True)
class Downlink(Part):
    """What is sent to ground."""

    thermistors: tuple[str, ...]
    period: Duration
    """s, a multiple of the control cycle."""
    quantum: Kelvins = 0.0
    """K; readings are rounded to multiples of it (0: not at all)."""


@dataclass(frozen=True)
class Spacecraft:
    """All of it."""

    scenario: Scenario
    """Network, environment and dissipation by mode; its heaters are not used."""
    software: OnboardSoftware
    thermistors: Mapping[str, Thermistor]
    downlink: Downlink


@dataclass(frozen=True)
class Flight:
    """What a run of the simulator gives."""

    telemetry: pd.DataFrame
    """Index: UTC. A column for each thermistor (K), ``heater.<line>`` for each heater line (0 or 1), and `mode`."""
    cycle_times: FloatArray
    """[C] s, of the control cycles."""
    temperatures: FloatArray
    """[C, n] K, of all nodes at the cycles: the truth."""
    nodes: tuple[str, ...]
    power: FloatArray
    """[C, lines] W that each heater line gives in the cycle."""
    modes: tuple[str, ...]
    """[C]"""
    real_time_factor: float
    """Seconds simulated in a second, without any waiting."""


def fly(
    spacecraft: Spacecraft,
    start: np.datetime64,
    duration: float,
    *,
    seed: int = 0,
    pace: float = math.inf,
    on_cycle: Callable[[float, Memory], None] = lambda *_: None,
) -> Flight:
    """Simulate from `start` (UTC) for `duration` (s).

    pace: at most so many seconds are simulated in a second (1: real time). on_cycle: told the time (s) and the on-board
    memory after each cycle. Raises FlightcalError where names do not match, or a temperature is not finite.
    """
    software, scenario = spacecraft.software, spacecraft.scenario
    network = build_network(scenario)
    _check(spacecraft, network)
    structure, mass = network.structure, network.structure.mass
    nothing = np.zeros(0, np.int64)
    given = [scenario.network.nodes[name].initial for name in network.nodes]
    theta = np.array([value for value, m in zip(given, mass, strict=True) if m > 0.0], float)
    mapping = ParameterMap(0, network.values, nothing, nothing, nothing, nothing)
    _, packed = assemble(mapping, network.terms, theta)
    x = packed[len(packed) - len(mass) :].copy()

    cycles = math.ceil(duration / software.period - 1e-9)
    seconds: FloatArray = software.period * np.arange(cycles + 1.0)
    inputs = _inputs(scenario, network, start, seconds)
    mode_columns = {
        mode: network.columns.index(f"mode.{mode}") for mode in software.enabled if f"mode.{mode}" in network.columns
    }
    forcing = unpack(structure, packed).forcing
    substeps = math.ceil(software.period / (scenario.network.step or software.period) - 1e-9)
    b0, b1, workspace = np.empty(len(mass)), np.empty(len(mass)), np.empty(step_size.py_func(None, structure))
    advance = march.row(MarchCall(structure, packed, x, b0, b1, software.period, substeps, workspace))
    rng = np.random.default_rng(seed)
    memory = started(software)
    place = {name: k for k, name in enumerate(network.nodes)}
    # Rows of massless nodes are in watts.
    capacity = [scenario.network.nodes[name].capacity or 1.0 for name in network.nodes]
    temperatures = np.empty((cycles, len(mass)))
    power = np.zeros((cycles, len(software.heaters)))
    modes, rows, stamps = [], [], []
    every = round(spacecraft.downlink.period / software.period)
    begin, working = clock.perf_counter(), 0.0
    for k in range(cycles):
        turn = clock.perf_counter()
        readings = {name: _read(t, x[place[t.node]], seconds[k], rng) for name, t in spacecraft.thermistors.items()}
        memory = cycle(software, memory, seconds[k], readings)
        heat = np.zeros(len(mass))
        for j, name in enumerate(software.heaters):
            for node, watts in _power(software, memory, name, seconds[k]).items():
                heat[place[node]] += watts / capacity[place[node]]
                power[k, j] += watts
        temperatures[k] = x
        modes.append(memory.mode)
        if k % every == 0:
            rows.append(_frame(spacecraft, memory, readings))
            stamps.append(start + np.timedelta64(round(seconds[k] * 1e9), "ns"))
        for mode, column in mode_columns.items():
            inputs[k : k + 2, column] = float(mode == memory.mode)
        b0[:], b1[:] = (_heat(structure, forcing, inputs[point]) + heat for point in (k, k + 1))
        advance()
        if not np.isfinite(x).all():
            raise FlightcalError(f"operational simulator: a temperature is not finite at {seconds[k + 1]:.0f} s")
        working += clock.perf_counter() - turn
        on_cycle(seconds[k], memory)
        ahead = seconds[k + 1] / pace - (clock.perf_counter() - begin)
        if ahead > 0.0:
            clock.sleep(ahead)
    columns = [*spacecraft.downlink.thermistors, *(f"heater.{name}" for name in software.heaters), "mode"]
    return Flight(
        telemetry=pd.DataFrame(rows, columns=columns, index=pd.DatetimeIndex(stamps, name="time")),
        cycle_times=seconds[:-1],
        temperatures=temperatures,
        nodes=network.nodes,
        power=power,
        modes=tuple(modes),
        real_time_factor=float(seconds[-1] / max(working, 1e-9)),
    )


def _check(spacecraft: Spacecraft, network: Network) -> None:
    thermistors, software = spacecraft.thermistors, spacecraft.software
    refuse_unknown(
        "spacecraft",
        (
            *((f"thermistor '{name}'", item.node, network.nodes) for name, item in thermistors.items()),
            *(
                (f"voted sensor '{sensor}'", name, thermistors)
                for sensor, item in software.sensors.items()
                for name in item.thermistors
            ),
            *(("downlink", name, thermistors) for name in spacecraft.downlink.thermistors),
            *(
                (f"branch '{name}'", node, network.nodes)
                for line in software.heaters.values()
                for name, branch in line.branches.items()
                for node in branch.power
            ),
        ),
    )
    if not is_multiple(spacecraft.downlink.period, software.period):
        raise FlightcalError(
            f"spacecraft: downlink: found a period of {spacecraft.downlink.period} s, expected a multiple of the "
            f"control cycle of {software.period} s"
        )
    for name in network.nodes:
        node = spacecraft.scenario.network.nodes[name]
        if node.capacity is not None and node.initial is None:
            raise FlightcalError(f"spacecraft: node '{name}' has no initial temperature")


def _inputs(scenario: Scenario, network: Network, start: np.datetime64, seconds: FloatArray) -> FloatArray:
    """Input series [C+1, q] at the control cycles; those of the modes are set while the software runs."""
    times = start.astype("datetime64[ns]") + np.round(seconds * 1e9).astype("timedelta64[ns]")
    inputs = np.zeros((len(seconds), len(network.columns)))
    inputs[:, network.columns.index("one")] = 1.0
    for name, series in face_series(scenario, times).items():
        inputs[:, network.columns.index(name)] = series
    return inputs


def _heat(structure: Structure, forcing: FloatArray, inputs: FloatArray) -> FloatArray:
    """B w [n]."""
    rows, columns = structure.forcing_row, structure.forcing_column
    return np.asarray(np.bincount(rows, forcing * inputs[columns], len(structure.mass)), float)


def _read(thermistor: Thermistor, temperature: float, time: float, rng: np.random.Generator) -> float:
    value = temperature + thermistor.bias + thermistor.noise * rng.standard_normal()
    for failure in thermistor.failures:
        if time >= failure.at:
            if failure.rate is not None:
                value += failure.rate * (time - failure.at)
            else:
                value = math.nan if failure.stuck_at is None else failure.stuck_at
    return float(value)


def _power(software: OnboardSoftware, memory: Memory, line: str, time: float) -> Mapping[str, float]:
    """Node -> W that a heater line gives."""
    state = memory.lines[line]
    branch = list(software.heaters[line].branches.values())[state.branch]
    works = branch.fails_at is None or time < branch.fails_at
    return branch.power if state.on and works else {}


def _frame(spacecraft: Spacecraft, memory: Memory, readings: Mapping[str, float]) -> list[float | str]:
    """A row of telemetry."""
    quantum = spacecraft.downlink.quantum
    values = [readings[name] for name in spacecraft.downlink.thermistors]
    rounded = [quantum * round(v / quantum) if quantum > 0.0 and math.isfinite(v) else v for v in values]
    status = [float(memory.lines[name].on) for name in spacecraft.software.heaters]
    return [*rounded, *status, memory.mode]
