"""The spacecraft file: geometry, network, on-board software and downlink of the operational simulator, in YAML.

Numbers with a dimension are written with their unit, as in a scenario; blocks that both have are the scenario's.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import Field

from ..errors import FlightcalError, ScenarioError
from ..scenario import (
    Body,
    Conductor,
    Count,
    Duration,
    Environment,
    Face,
    Issue,
    MeshError,
    Node,
    Power,
    Scenario,
    SimulatorModel,
    TelemetryFile,
    Temperature,
    Time,
    TimeColumn,
    file_error,
    mesh_plates,
    read_file,
)
from .onboard import OnboardSoftware
from .simulator import Downlink, Spacecraft, Thermistor


class SpacecraftFile(Body):
    """The whole file."""

    name: str
    description: str = ""
    start: Time
    duration: Duration
    seed: Count = 0
    step: Duration = 30.0
    """Longest time step of the integration between two control cycles."""
    environment: Environment = Environment()
    initial: Temperature = 290.0
    """Of every node that does not say otherwise."""
    nodes: dict[str, Node] = Field(default_factory=dict)
    """Besides the plates' cells, ``plate[row,column]``."""
    conductors: tuple[Conductor, ...] = ()
    faces: dict[str, Face] = Field(default_factory=dict)
    modes: dict[str, dict[str, Power]] = Field(default_factory=dict)
    """Mode -> node -> dissipation."""
    software: OnboardSoftware
    thermistors: dict[str, Thermistor] = Field(default_factory=dict)
    downlink: Downlink


@dataclass(frozen=True)
class Mission:
    """A spacecraft, and when it is flown."""

    spacecraft: Spacecraft
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
    try:
        content, document = read_file(Path(path), SpacecraftFile)
        return _mission(content, Path(path).parent)
    except MeshError as error:
        raise file_error(Path(path), document, [Issue(error.location, error.message)]) from None
    except ScenarioError:
        raise
    except FlightcalError as error:
        raise ScenarioError(f"{path}: {error}") from None


def _mission(content: SpacecraftFile, folder: Path) -> Mission:
    mesh = mesh_plates(content)
    both = set(mesh.nodes) & set(content.nodes)
    if both:
        raise FlightcalError(f"nodes: found '{min(both)}', which is a cell of a plate")
    cold = {"initial": content.initial}
    nodes = {
        name: node if node.capacity is None or node.initial is not None else node.model_copy(update=cold)
        for name, node in {**mesh.nodes, **content.nodes}.items()
    }
    for name, node in nodes.items():
        if node.capacity_slope is not None:
            expected = "expected none: the capacities of a flight do not depend on temperature"
            raise MeshError(("nodes", name, "capacity_slope"), f"found {node.capacity_slope:g} 1/K, {expected}")
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
        telemetry=TelemetryFile.model_construct(file=(), time=TimeColumn.model_construct(column=("",)), channels={}),
        parameters={},
        observations={},
        heat="none",
        windows={},
        folder=folder,
    )
    craft = Spacecraft(scenario, content.software, content.thermistors, content.downlink)
    return Mission(craft, np.datetime64(content.start, "ns"), content.duration, content.seed, mesh.openness)
