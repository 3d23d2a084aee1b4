"""On-board thermal control software: what it is told, what it remembers, and one control cycle.

`cycle` is a function of configuration, memory, time and thermistor readings; it returns the new memory, which holds the
commands. So a run can be stopped, stored and taken up at any cycle, and a test can drive the software by hand.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Annotated, Literal

from pydantic import Field

from ..errors import FlightcalError
from ..scenario import Count, Duration, Kelvins, Part, Power, Quantity, Seconds, Temperature


@dataclass(frozen=True)
class VotedSensor(Part):
    """Up to three thermistors that are read as one temperature."""

    thermistors: Annotated[tuple[str, ...], Field(min_length=1, max_length=3)]
    lowest: Temperature = 173.15
    """K; a reading outside of lowest..highest is taken for a failure, as is NaN (open circuit)."""
    highest: Temperature = 423.15
    disagreement: Kelvins = 5.0
    """K; of two readings that differ by more, none is believed, unless a third decides."""


@dataclass(frozen=True)
class OnOff(Part):
    """Hysteresis: on below `on_below`, off above `off_above`; never shorter than the minimum times."""

    on_below: Temperature
    """K"""
    off_above: Temperature
    minimum_on: Seconds = 0.0
    """s"""
    minimum_off: Seconds = 0.0


@dataclass(frozen=True)
class PulseWidth(Part):
    """Proportional-integral control by the width of pulses; the heater is on for a share of every period."""

    set_point: Temperature
    """K"""
    gain: Annotated[float, Quantity("1/K", above=0)]
    """Share of the period for each kelvin below the set point."""
    period: Duration
    """s; of the pulses, a multiple of the control cycle."""
    integral_time: Duration | None = None
    """s; null: proportional only. The integral is held while the output is at a limit."""


@dataclass(frozen=True)
class Branch(Part):
    """What a branch of a heater line heats."""

    power: Annotated[dict[str, Power], Field(min_length=1)]
    """Node -> W."""
    fails_at: Seconds | None = None
    """s; no power from then on; null: it does not fail."""


@dataclass(frozen=True)
class HeaterLine(Part):
    """A heater with a nominal and perhaps a redundant branch, and its control."""

    sensor: str
    """A `VotedSensor`."""
    branches: Annotated[dict[str, Branch], Field(min_length=1)]
    """In the order in which they are used."""
    thermostat: OnOff | None = None
    pulse_width: PulseWidth | None = None
    failure_time: Duration | None = None
    """s; a branch that has been on for so long without `failure_rise` gives way to the next; null: never."""
    failure_rise: Kelvins = 0.1
    """K"""
    without_sensor: Literal["off", "on", "hold"] = "off"
    """What to do while the voted sensor gives nothing."""

    def __post_init__(self) -> None:
        if (self.thermostat is None) == (self.pulse_width is None):
            raise ValueError("expected exactly one of 'thermostat' and 'pulse_width'")

    @property
    def law(self) -> OnOff | PulseWidth:
        """Its control."""
        law = self.thermostat or self.pulse_width
        assert law is not None
        return law


@dataclass(frozen=True)
class TemperatureTransition(Part):
    """A change of mode when a voted sensor is beyond a limit for some cycles."""

    to: str
    sensor: str
    below: Temperature | None = None
    """K"""
    above: Temperature | None = None
    cycles: Count = 3
    modes: tuple[str, ...] = ()
    """In which it is watched; none named: in all but `to`."""


@dataclass(frozen=True)
class Command(Part):
    """A commanded change of mode."""

    at: Seconds
    """s, after the start."""
    mode: str


@dataclass(frozen=True)
class OnboardSoftware(Part):
    """The configuration of the on-board software."""

    period: Duration
    """s, of the control cycle."""
    initial_mode: str
    enabled: Annotated[dict[str, tuple[str, ...]], Field(min_length=1)]
    """Mode -> names of the heater lines that may be switched on in it."""
    sensors: dict[str, VotedSensor] = field(default_factory=dict)
    heaters: dict[str, HeaterLine] = field(default_factory=dict)
    timeline: tuple[Command, ...] = ()
    transitions: tuple[TemperatureTransition, ...] = ()

    def __post_init__(self) -> None:
        refuse_unknown(
            "on-board software",
            (
                *((f"heater line '{name}'", line.sensor, self.sensors) for name, line in self.heaters.items()),
                *((f"transition to '{item.to}'", item.sensor, self.sensors) for item in self.transitions),
                *((f"transition on '{item.sensor}'", item.to, self.enabled) for item in self.transitions),
                *(
                    (f"enable table, mode '{mode}'", line, self.heaters)
                    for mode, lines in self.enabled.items()
                    for line in lines
                ),
                *((f"timeline at {command.at} s", command.mode, self.enabled) for command in self.timeline),
                ("initial mode", self.initial_mode, self.enabled),
            ),
        )
        for name, line in self.heaters.items():
            if line.pulse_width is not None and not is_multiple(line.pulse_width.period, self.period):
                raise FlightcalError(
                    f"on-board software: heater line '{name}': found a pulse period of {line.pulse_width.period} s, "
                    f"expected a multiple of the control cycle of {self.period} s"
                )

    @cached_property
    def commands(self) -> tuple[Command, ...]:
        """The timeline in order of time."""
        return tuple(sorted(self.timeline, key=lambda command: command.at))


def refuse_unknown(whose: str, names: Iterable[tuple[str, str, Collection[str]]]) -> None:
    """Raises FlightcalError for the first name (where it stands, name, those that there are) that nothing has."""
    for where, name, known in names:
        if name not in known:
            raise FlightcalError(f"{whose}: {where}: found '{name}', expected one of {sorted(known)}")


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
    return Memory(mode=software.initial_mode, lines={name: LineMemory() for name in software.heaters})


def cycle(software: OnboardSoftware, memory: Memory, time: float, readings: Mapping[str, float]) -> Memory:
    """One control cycle at `time` (s), with the thermistors' readings (K; NaN: open)."""
    voted = {name: vote(sensor, readings) for name, sensor in software.sensors.items()}
    memory = _change_mode(software, replace(memory, voted=voted), time)
    enabled = software.enabled[memory.mode]
    lines = {
        name: _control(software, line, memory.lines[name], time, voted[line.sensor], name in enabled)
        for name, line in software.heaters.items()
    }
    return replace(memory, lines=lines)


def vote(sensor: VotedSensor, readings: Mapping[str, float]) -> float:
    """The median of three believable readings, the mean of two that agree, or the only one; NaN: none."""
    values = [readings[name] for name in sensor.thermistors]
    believable = sorted(value for value in values if sensor.lowest <= value <= sensor.highest)
    if len(believable) == 3:
        return believable[1]
    if len(believable) == 2:
        low, high = believable
        return 0.5 * (low + high) if high - low <= sensor.disagreement else math.nan
    return believable[0] if believable else math.nan


def _change_mode(software: OnboardSoftware, memory: Memory, time: float) -> Memory:
    mode, commanded = memory.mode, memory.commanded
    for command in software.commands[commanded:]:
        if command.at > time:
            break
        mode = command.mode
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
    integral = memory.integral
    if law.integral_time is not None:
        integral += law.gain * error * law.period / law.integral_time
    share = law.gain * error + integral
    if not 0.0 <= share <= 1.0:
        integral = memory.integral
        share = min(max(law.gain * error + integral, 0.0), 1.0)
    cycles = round(share * law.period / software.period)
    return replace(memory, integral=integral, pulse_begin=time, pulse_end=time + cycles * software.period)


def _replace_failed_branch(line: HeaterLine, memory: LineMemory, time: float, temperature: float) -> LineMemory:
    """The next branch, where one has been on long enough and nothing became warmer."""
    if line.failure_time is None or not memory.on or math.isnan(temperature):
        return memory
    if time - memory.watched_from < line.failure_time:
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


def is_multiple(duration: float, period: float) -> bool:
    """Whether a duration is a whole number of periods, at least one."""
    ratio = duration / period
    return abs(ratio - round(ratio)) <= 1e-9 and round(ratio) >= 1
