"""The spacecraft file: geometry, network, on-board software and downlink of the operational simulator, in YAML.

Numbers with a dimension are written with their unit, as in a scenario; blocks that both have are the scenario's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from ..errors import FlightcalError, ScenarioError
from ..scenario import (
    Finding,
    Node,
    Problem,
    Scenario,
    SimulatorModel,
    TelemetryFile,
    TimeColumn,
    problems_of,
    read_document,
    show,
)
from . import geometry, onboard, simulator
from .schema import HeaterBlock, SideBlock, SoftwareBlock, SpacecraftFile, ThermistorBlock


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
        findings = (
            Finding(
                str(path),
                problem.line or document.line(problem.location),
                ".".join(map(str, problem.location)),
                problem.message,
            )
            for problem in problems
        )
        raise ScenarioError("\n".join(map(str, findings)))
    try:
        return _mission(content, place.parent)
    except FlightcalError as error:
        raise ScenarioError(f"{path}: {error}") from None


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
