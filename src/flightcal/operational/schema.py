"""The blocks of a spacecraft file, as a scenario's schema has its own; numbers are SI floats here."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from ..scenario import (
    Block,
    Conductor,
    Count,
    Duration,
    Environment,
    Face,
    Node,
    Pair,
    Power,
    Quantity,
    Temperature,
    Time,
)

Length = Annotated[float, Quantity("m")]
Kelvins = Annotated[float, Quantity("K", at_least=0, difference=True)]
Seconds = Annotated[float, Quantity("s", at_least=0)]


class MaterialBlock(Block):
    """What plates are made of."""

    conductivity: Annotated[float, Quantity("W/m/K", above=0)]
    density: Annotated[float, Quantity("kg/m^3", above=0)]
    specific_heat: Annotated[float, Quantity("J/kg/K", above=0)]


class CoatingBlock(Block):
    """A surface."""

    absorptivity: Annotated[float, Quantity("", at_least=0, at_most=1)]
    emissivity: Annotated[float, Quantity("", above=0, at_most=1)]


class InsulationBlock(Block):
    """Multi-layer insulation."""

    effective_emissivity: Annotated[float, Quantity("", above=0, at_most=1)]
    coating: str
    """Of its outer layer."""
    heat_capacity: Annotated[float, Quantity("J/K/m^2", above=0)] = 77.0
    """Of its outer layer."""


class SideBlock(Block):
    """One side of a plate."""

    coating: str
    enclosure: str | None = None
    """Which one it looks into; null: outside."""
    insulation: str | None = None


class PlateBlock(Block):
    """A rectangle whose edges are parallel to the body axes."""

    corner: tuple[Length, Length, Length]
    """With the smallest coordinates."""
    size: tuple[Length, Length, Length]
    """Along x, y, z; exactly one is zero."""
    thickness: Annotated[float, Quantity("m", above=0)]
    material: str
    mesh: tuple[Count, Count]
    """Cells along the two edges, in the order of the axes."""
    positive: SideBlock | None = None
    """The side towards larger coordinates; null: adiabatic."""
    negative: SideBlock | None = None


class BoxBlock(Block):
    """Six plates, ``<box>.x-`` to ``<box>.z+``; the inside is an enclosure named after the box."""

    corner: tuple[Length, Length, Length]
    size: tuple[Length, Length, Length]
    thickness: Annotated[float, Quantity("m", above=0)]
    material: str
    mesh: Count
    """Cells along each edge."""
    outside: SideBlock
    inside: str
    """Coating."""
    joints: Annotated[float, Quantity("W/m/K", above=0)]
    """Conductance of its edges."""


class JointBlock(Block):
    """Two plates that touch along an edge."""

    between: Pair
    conductance: Annotated[float, Quantity("W/m/K", above=0)]


class SensorBlock(Block):
    """Up to three thermistors that are read as one temperature."""

    thermistors: tuple[str, ...] = Field(min_length=1, max_length=3)
    lowest: Temperature = 173.15
    highest: Temperature = 423.15
    disagreement: Kelvins = 5.0


class ThermostatBlock(Block):
    """Hysteresis."""

    on_below: Temperature
    off_above: Temperature
    minimum_on: Seconds = 0.0
    minimum_off: Seconds = 0.0


class PulseWidthBlock(Block):
    """Proportional-integral control by the width of pulses."""

    set_point: Temperature
    gain: Annotated[float, Quantity("1/K", above=0)]
    integral_time: Duration | None = None
    """null: proportional only."""
    period: Duration


class BranchBlock(Block):
    """What a branch of a heater line heats."""

    power: dict[str, Power] = Field(min_length=1)
    fails_at: Seconds | None = None


class HeaterBlock(Block):
    """A heater line and its control."""

    sensor: str
    thermostat: ThermostatBlock | None = None
    pulse_width: PulseWidthBlock | None = None
    branches: dict[str, BranchBlock] = Field(min_length=1)
    """In the order in which they are used."""
    failure_time: Duration | None = None
    """A branch that has been on for so long without `failure_rise` gives way to the next; null: never."""
    failure_rise: Kelvins = 0.1
    without_sensor: Literal["off", "on", "hold"] = "off"

    @model_validator(mode="after")
    def _one_law(self) -> HeaterBlock:
        if (self.thermostat is None) == (self.pulse_width is None):
            raise ValueError("expected exactly one of 'thermostat' and 'pulse_width'")
        return self


class TransitionBlock(Block):
    """A change of mode by temperature."""

    to: str
    sensor: str
    below: Temperature | None = None
    above: Temperature | None = None
    cycles: Count = 3
    modes: tuple[str, ...] = ()


class CommandBlock(Block):
    """A commanded change of mode."""

    at: Seconds
    """After the start."""
    mode: str


class SoftwareBlock(Block):
    """The on-board software."""

    period: Duration
    """Of the control cycle."""
    initial_mode: str
    sensors: dict[str, SensorBlock] = Field(default_factory=dict)
    heaters: dict[str, HeaterBlock] = Field(default_factory=dict)
    enabled: dict[str, tuple[str, ...]] = Field(min_length=1)
    """Mode -> heater lines that may be switched on in it."""
    timeline: tuple[CommandBlock, ...] = ()
    transitions: tuple[TransitionBlock, ...] = ()


class FailureBlock(Block):
    """A thermistor's failure, from `at` (after the start) on."""

    at: Seconds
    kind: Literal["open", "stuck", "drift"]
    stuck_at: Temperature | None = None
    rate: Annotated[float, Quantity("K/s")] | None = None

    @model_validator(mode="after")
    def _its_number(self) -> FailureBlock:
        wanted = {"open": None, "stuck": "stuck_at", "drift": "rate"}[self.kind]
        given = [name for name in ("stuck_at", "rate") if getattr(self, name) is not None]
        if given != ([wanted] if wanted else []):
            raise ValueError(f"found {given or 'no number'}, expected {wanted or 'none'} with kind '{self.kind}'")
        return self


class ThermistorBlock(Block):
    """A sensor on a node."""

    node: str
    bias: Annotated[float, Quantity("K", difference=True)] = 0.0
    noise: Kelvins = 0.0
    failures: tuple[FailureBlock, ...] = ()


class DownlinkBlock(Block):
    """What is sent to ground."""

    thermistors: tuple[str, ...]
    period: Duration
    quantum: Kelvins = 0.0


class SpacecraftFile(Block):
    """The whole file."""

    name: str
    description: str = ""
    start: Time
    duration: Duration
    seed: Count = 0
    step: Duration = 30.0
    """Longest time step of the integration between two control cycles."""
    environment: Environment = Environment()
    materials: dict[str, MaterialBlock] = Field(default_factory=dict)
    coatings: dict[str, CoatingBlock] = Field(default_factory=dict)
    insulations: dict[str, InsulationBlock] = Field(default_factory=dict)
    boxes: dict[str, BoxBlock] = Field(default_factory=dict)
    plates: dict[str, PlateBlock] = Field(default_factory=dict)
    joints: tuple[JointBlock, ...] = ()
    initial: Temperature = 290.0
    """Of every node that does not say otherwise."""
    nodes: dict[str, Node] = Field(default_factory=dict)
    """Besides the plates' cells, ``plate[row,column]``."""
    conductors: tuple[Conductor, ...] = ()
    faces: dict[str, Face] = Field(default_factory=dict)
    modes: dict[str, dict[str, Power]] = Field(default_factory=dict)
    """Mode -> node -> dissipation."""
    software: SoftwareBlock
    thermistors: dict[str, ThermistorBlock] = Field(default_factory=dict)
    downlink: DownlinkBlock
