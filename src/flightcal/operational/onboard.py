"""On-board thermal control software: what it is told, what it remembers, and one control cycle.

`cycle` is a function of configuration, memory, time and thermistor readings; it returns the new memory, which holds the
commands. So a run can be stopped, stored and taken up at any cycle, and a test can drive the software by hand.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from ..errors import FlightcalError


@dataclass(frozen=True)
class VotedSensor:
    """Up to three thermistors that are read as one temperature."""

    name: str
    thermistors: tuple[str, ...]
    lowest: float = 173.15
    """K; a reading outside of lowest..highest is taken for a failure, as is NaN (open circuit)."""
    highest: float = 423.15
    disagreement: float = 5.0
    """K; of two readings that differ by more, none is believed, unless a third decides."""


@dataclass(frozen=True)
class OnOff:
    """Hysteresis: on below `on_below`, off above `off_above`; never shorter than the minimum times."""

    on_below: float
    """K"""
    off_above: float
    minimum_on: float = 0.0
    """s"""
    minimum_off: float = 0.0


@dataclass(frozen=True)
class PulseWidth:
    """Proportional-integral control; the heater is on for a share of every period."""

    set_point: float
    """K"""
    gain: float
    """Share of the period for each kelvin below the set point."""
    integral_time: float
    """s; infinite: proportional only. The integral is held while the output is at a limit."""
    period: float
    """s; of the pulses, a multiple of the control cycle."""


@dataclass(frozen=True)
class HeaterLine:
    """A heater with a nominal and perhaps a redundant branch."""

    name: str
    sensor: str
    """A `VotedSensor`."""
    law: OnOff | PulseWidth
    branches: tuple[str, ...] = ("nominal",)
    """In the order in which they are used."""
    failure_time: float = math.inf
    """s; a branch that has been on for so long without `failure_rise` gives way to the next."""
    failure_rise: float = 0.1
    """K"""
    without_sensor: Literal["off", "on", "hold"] = "off"
    """What to do while the voted sensor gives nothing."""


@dataclass(frozen=True)
class TemperatureTransition:
    """A change of mode when a voted sensor is beyond a limit for some cycles."""

    to: str
    sensor: str
    below: float | None = None
    """K"""
    above: float | None = None
    cycles: int = 3
    modes: tuple[str, ...] = ()
    """In which it is watched; none named: in all but `to`."""


@dataclass(frozen=True)
class OnboardSoftware:
    """The configuration."""

    period: float
    """s, of the control cycle."""
    sensors: tuple[VotedSensor, ...]
    heaters: tuple[HeaterLine, ...]
    enabled: Mapping[str, tuple[str, ...]]
    """Mode -> names of the heater lines that may be switched on in it."""
    initial_mode: str
    timeline: tuple[tuple[float, str], ...] = ()
    """(s, mode): commanded changes, in order."""
    transitions: tuple[TemperatureTransition, ...] = ()

    def __post_init__(self) -> None:
        sensors = {sensor.name for sensor in self.sensors}
        lines = {line.name for line in self.heaters}
        modes = set(self.enabled)
        for where, name, known in (
            *((f"heater line '{line.name}'", line.sensor, sensors) for line in self.heaters),
            *((f"transition to '{item.to}'", item.sensor, sensors) for item in self.transitions),
            *((f"transition on '{item.sensor}'", item.to, modes) for item in self.transitions),
            *((f"enable table, mode '{mode}'", line, lines) for mode, these in self.enabled.items() for line in these),
            *((f"timeline at {time} s", mode, modes) for time, mode in self.timeline),
            ("initial mode", self.initial_mode, modes),
        ):
            if name not in known:
                raise FlightcalError(f"on-board software: {where}: found '{name}', expected one of {sorted(known)}")
        for line in self.heaters:
            if isinstance(line.law, PulseWidth) and not _whole(line.law.period / self.period):
                raise FlightcalError(
                    f"on-board software: heater line '{line.name}': found a pulse period of {line.law.period} s, "
                    f"expected a multiple of the control cycle of {self.period} s"
                )


@dataclass(frozen=True)
class LineMemory:
    """What is remembered of a heater line."""

    on: bool = False
    since: float = -math.inf
    """s, when it was last switched."""
    branch: int = 0
    exhausted: bool = False
    """All branches have failed."""
    start: float = math.nan
    """K, when the branch was switched on: what the failure detection compares with."""
    watched_from: float = -math.inf
    """s"""
    integral: float = 0.0
    """Share of the period."""
    pulse_begin: float = -math.inf
    pulse_end: float = -math.inf
    """s"""


@dataclass(frozen=True)
class Memory:
    """What the software remembers from cycle to cycle; `lines` are also its commands."""

    mode: str
    commanded: int = 0
    """Entries of the timeline that have been carried out."""
    lines: Mapping[str, LineMemory] = field(default_factory=dict)
    beyond: Mapping[int, int] = field(default_factory=dict)
    """Transition -> cycles that its sensor has been beyond its limit."""
    voted: Mapping[str, float] = field(default_factory=dict)
    """K; NaN: nothing believable."""


def started(software: OnboardSoftware) -> Memory:
    """The memory after a boot."""
    return Memory(mode=software.initial_mode, lines={line.name: LineMemory() for line in software.heaters})


def cycle(software: OnboardSoftware, memory: Memory, time: float, readings: Mapping[str, float]) -> Memory:
    """One control cycle at `time` (s), with the thermistors' readings (K; NaN: open)."""
    voted = {sensor.name: vote(sensor, readings) for sensor in software.sensors}
    memory = _change_mode(software, replace(memory, voted=voted), time)
    enabled = software.enabled[memory.mode]
    lines = {
        line.name: _control(software, line, memory.lines[line.name], time, voted[line.sensor], line.name in enabled)
        for line in software.heaters
    }
    return replace(memory, lines=lines)


def vote(sensor: VotedSensor, readings: Mapping[str, float]) -> float:
    """The median of three believable readings, the mean of two that agree, or the only one; NaN: none."""
    values = [readings[name] for name in sensor.thermistors]
    believable = sorted(value for value in values if sensor.lowest <= value <= sensor.highest)
    if len(believable) >= 3:
        return float(np.median(believable))
    if len(believable) == 2:
        low, high = believable
        return 0.5 * (low + high) if high - low <= sensor.disagreement else math.nan
    return believable[0] if believable else math.nan


def _change_mode(software: OnboardSoftware, memory: Memory, time: float) -> Memory:
    mode, commanded = memory.mode, memory.commanded
    while commanded < len(software.timeline) and software.timeline[commanded][0] <= time:
        mode = software.timeline[commanded][1]
        commanded += 1
    beyond = {}
    for k, item in enumerate(software.transitions):
        watched = mode in item.modes if item.modes else mode != item.to
        value = memory.voted[item.sensor]
        outside = (item.below is not None and value < item.below) or (item.above is not None and value > item.above)
        beyond[k] = memory.beyond.get(k, 0) + 1 if watched and outside else 0
        if beyond[k] >= item.cycles:
            mode = item.to
            beyond[k] = 0
    return replace(memory, mode=mode, commanded=commanded, beyond=beyond)


def _control(
    software: OnboardSoftware, line: HeaterLine, memory: LineMemory, time: float, temperature: float, enabled: bool
) -> LineMemory:
    memory = _replace_failed_branch(line, memory, time, temperature)
    if not enabled or memory.exhausted:
        wanted = False
    elif math.isnan(temperature):
        wanted = {"off": False, "on": True, "hold": memory.on}[line.without_sensor]
    elif isinstance(line.law, OnOff):
        wanted = _hysteresis(line.law, memory, time, temperature)
    else:
        memory = _pulse(software, line.law, memory, time, temperature)
        # Half a cycle, so that rounding of the time does not lengthen a pulse by a cycle.
        wanted = time < memory.pulse_end - 0.5 * software.period
    if wanted == memory.on:
        return memory
    return replace(memory, on=wanted, since=time, start=temperature, watched_from=time)


def _hysteresis(law: OnOff, memory: LineMemory, time: float, temperature: float) -> bool:
    if memory.on:
        return not (temperature > law.off_above and time - memory.since >= law.minimum_on)
    return temperature < law.on_below and time - memory.since >= law.minimum_off


def _pulse(
    software: OnboardSoftware, law: PulseWidth, memory: LineMemory, time: float, temperature: float
) -> LineMemory:
    """At the beginning of a period, how long the heater is on in it."""
    if time < memory.pulse_begin + law.period - 0.5 * software.period:
        return memory
    error = law.set_point - temperature
    integral = memory.integral + law.gain * error * law.period / law.integral_time
    share = law.gain * error + integral
    if not 0.0 <= share <= 1.0:
        integral = memory.integral
        share = min(max(law.gain * error + integral, 0.0), 1.0)
    cycles = round(share * law.period / software.period)
    return replace(memory, integral=integral, pulse_begin=time, pulse_end=time + cycles * software.period)


def _replace_failed_branch(line: HeaterLine, memory: LineMemory, time: float, temperature: float) -> LineMemory:
    """The next branch, where one has been on long enough and nothing became warmer."""
    if not memory.on or math.isnan(temperature) or time - memory.watched_from < line.failure_time:
        return memory
    if math.isnan(memory.start) or temperature - memory.start >= line.failure_rise:
        return replace(memory, start=temperature, watched_from=time)
    last = memory.branch + 1 >= len(line.branches)
    return replace(
        memory,
        branch=memory.branch if last else memory.branch + 1,
        exhausted=last,
        start=temperature,
        watched_from=time,
    )


def _whole(value: float) -> bool:
    return abs(value - round(value)) < 1e-9 and round(value) >= 1
