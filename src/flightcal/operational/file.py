"""The spacecraft file: geometry, network, on-board software and downlink of the operational simulator, in YAML.

Numbers with a dimension are written with their unit, as in a scenario; blocks that both have are the scenario's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationError, model_validator

from ..errors import FlightcalError, ScenarioError
from ..scenario import Scenario
from ..scenario._document import Problem, read_document
from ..scenario._fields import Block, Count, Pair, Time
from ..scenario._units import Duration, Power, Quantity, Temperature, show
from ..scenario._wording import problems_of
from ..scenario.schema import Conductor, Environment, Face, Node, SimulatorModel, TelemetryFile, TimeColumn
from . import geometry, onboard, simulator

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


@dataclass(frozen=True)
class Mission:
    """A spacecraft, and when it is flown."""

    spacecraft: simulator.Spacecraft
    start: np.datetime64
    duration: float
    """s"""
    seed: int
    openness: dict[str, float]
    """See `geometry.Mesh`."""


def load_spacecraft(path: str | Path) -> Mission:
    """The spacecraft file at `path`.

    Raises ScenarioError, whose message lists what is wrong with the file, a line each; where names or geometry do not
    fit together, the first of these.
    """
    place = Path(path)
    document = read_document(place)
    problems = list(document.problems)
    content: SpacecraftFile | None = None
    if not isinstance(document.data, dict):
        if not problems:
            problems.append(Problem((), f"found {show(document.data)}, expected a mapping (key: value)"))
    else:
        try:
            content = SpacecraftFile.model_validate(document.data)
        except ValidationError as error:
            problems += problems_of(error, SpacecraftFile)
    if problems or content is None:
        raise ScenarioError("\n".join(_line(problem, document.line(problem.location), path) for problem in problems))
    try:
        return _mission(content, place.parent)
    except FlightcalError as error:
        raise ScenarioError(f"{path}: {error}") from None


def _line(problem: Problem, line: int | None, path: str | Path) -> str:
    number = problem.line or line
    dotted = ".".join(map(str, problem.location))
    return ": ".join(part for part in (f"{path}:{number}" if number else str(path), dotted, problem.message) if part)


def _mission(content: SpacecraftFile, folder: Path) -> Mission:
    mesh = geometry.mesh_plates(*_plates(content))
    both = set(mesh.nodes) & set(content.nodes)
    if both:
        raise FlightcalError(f"nodes: found '{min(both)}', which is a cell of a plate")
    nodes = {
        name: node if node.capacity is None or node.initial is not None else _warm(node, content.initial)
        for name, node in {**mesh.nodes, **content.nodes}.items()
    }
    conductors = (*mesh.conductors, *content.conductors)
    faces = {**mesh.faces, **content.faces}
    for where, name in (
        *((f"conductor '{c.label}'", name) for c in conductors for name in c.between),
        *((f"face '{label}'", face.node) for label, face in faces.items()),
        *((f"mode '{mode}'", name) for mode, powers in content.modes.items() for name in powers),
    ):
        if name not in nodes:
            raise FlightcalError(f"{where}: found '{name}', which is no node")
    if faces and content.environment.orbit is None:
        raise FlightcalError("environment: found no orbit, expected one: there are faces outside")
    scenario = Scenario.model_construct(
        name=content.name,
        environment=content.environment,
        simulator=SimulatorModel.model_construct(
            step=content.step, nodes=nodes, conductors=conductors, faces=faces, modes=content.modes
        ),
        telemetry=TelemetryFile.model_construct(file=(), time=TimeColumn.model_construct(column=""), channels={}),
        parameters={},
        observations={},
        windows={},
        folder=folder,
    )
    craft = simulator.Spacecraft(
        scenario=scenario,
        software=_software(content.software),
        thermistors=tuple(_thermistor(name, item) for name, item in content.thermistors.items()),
        branches=tuple(
            simulator.Branch(line, name, branch.power, math.inf if branch.fails_at is None else branch.fails_at)
            for line, heater in content.software.heaters.items()
            for name, branch in heater.branches.items()
        ),
        downlink=simulator.Downlink(content.downlink.thermistors, content.downlink.period, content.downlink.quantum),
    )
    start = np.datetime64(content.start, "ns")
    return Mission(craft, start, content.duration, content.seed, mesh.openness)


def _warm(node: Node, temperature: float) -> Node:
    return node.model_copy(update={"initial": temperature})


def _plates(content: SpacecraftFile) -> tuple[list[geometry.Plate], list[geometry.Joint]]:
    materials = {name: geometry.Material(**dict(block)) for name, block in content.materials.items()}
    coatings = {name: geometry.Coating(**dict(block)) for name, block in content.coatings.items()}

    def find(known: dict[str, Any], name: str, kind: str, where: str) -> Any:
        if name not in known:
            raise FlightcalError(f"{where}: found the {kind} '{name}', expected one of {sorted(known)}")
        return known[name]

    def side_of(block: SideBlock | None, where: str) -> geometry.Side | None:
        if block is None:
            return None
        insulation = None
        if block.insulation is not None:
            written = find(content.insulations, block.insulation, "insulation", where)
            coating = find(coatings, written.coating, "coating", f"insulations.{block.insulation}")
            insulation = geometry.Insulation(written.effective_emissivity, coating, written.heat_capacity)
        return geometry.Side(find(coatings, block.coating, "coating", where), block.enclosure, insulation)

    plates: list[geometry.Plate] = []
    joints: list[geometry.Joint] = []
    for name, box in content.boxes.items():
        where = f"boxes.{name}"
        outside = side_of(box.outside, where)
        assert outside is not None
        plates += geometry.box(
            name,
            box.corner,
            box.size,
            thickness=box.thickness,
            material=find(materials, box.material, "material", where),
            mesh=box.mesh,
            outside=outside,
            inside=find(coatings, box.inside, "coating", where),
        )
        joints += geometry.box_joints(name, box.joints)
    for name, plate in content.plates.items():
        where = f"plates.{name}"
        plates.append(
            geometry.Plate(
                name,
                plate.corner,
                plate.size,
                plate.thickness,
                find(materials, plate.material, "material", where),
                plate.mesh,
                side_of(plate.positive, where),
                side_of(plate.negative, where),
            )
        )
    joints += [geometry.Joint(*joint.between, joint.conductance) for joint in content.joints]
    return plates, joints


def _software(block: SoftwareBlock) -> onboard.OnboardSoftware:
    return onboard.OnboardSoftware(
        period=block.period,
        sensors=tuple(onboard.VotedSensor(name, **dict(sensor)) for name, sensor in block.sensors.items()),
        heaters=tuple(
            onboard.HeaterLine(
                name,
                heater.sensor,
                _law(heater),
                tuple(heater.branches),
                math.inf if heater.failure_time is None else heater.failure_time,
                heater.failure_rise,
                heater.without_sensor,
            )
            for name, heater in block.heaters.items()
        ),
        enabled=block.enabled,
        initial_mode=block.initial_mode,
        timeline=tuple((command.at, command.mode) for command in sorted(block.timeline, key=lambda item: item.at)),
        transitions=tuple(onboard.TemperatureTransition(**dict(item)) for item in block.transitions),
    )


def _law(heater: HeaterBlock) -> onboard.OnOff | onboard.PulseWidth:
    if heater.thermostat is not None:
        return onboard.OnOff(**dict(heater.thermostat))
    assert heater.pulse_width is not None
    law = dict(heater.pulse_width)
    return onboard.PulseWidth(**{**law, "integral_time": law["integral_time"] or math.inf})


def _thermistor(name: str, block: ThermistorBlock) -> simulator.Thermistor:
    failures = tuple(
        simulator.ThermistorFailure(
            item.at, item.kind, next((value for value in (item.stuck_at, item.rate) if value is not None), math.nan)
        )
        for item in block.failures
    )
    return simulator.Thermistor(name, block.node, block.bias, block.noise, failures)
