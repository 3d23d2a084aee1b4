"""What of a scenario could be read, block by block, so that one error does not hide the others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from pydantic import ValidationError

from .document import Issue, Location
from .environment import Environment
from .external import ExternalHeater, ExternalModel, Input, Output, kind_of_simulator
from .fields import reader_of
from .heat import Heat
from .network import Conductor, Face, Heater, Load, ModeChange, Node, ReducedNumber, SimulatorModel, SwitchedHeater
from .residuals import Discrepancy, Noise
from .schema import Observation, Parameter, Scenario
from .telemetry import Channel, Packet
from .windows import Window
from .wording import problems_of

T = TypeVar("T")
_OF_NETWORK = ("nodes", "conductors", "faces", "heaters", "heater_input", "modes", "timeline", "loads")
_NO_NETWORK = SimulatorModel.model_construct(nodes={})


@dataclass(frozen=True)
class External:
    """What of an external simulator could be read; None as in `Blocks`."""

    kind: str
    """The key that tells its kind: callable, executable, fmu or umbridge; "": none of them is there."""
    block: Any
    """What stands under that key, as an object; null where it cannot be read."""
    inputs: Mapping[str, Input | None]
    outputs: Mapping[str, Output | None]
    heaters: Mapping[str, ExternalHeater | None]


@dataclass(frozen=True)
class Blocks:
    """The blocks of a scenario. None: the block is there, but cannot be read; its name counts as known."""

    files: tuple[str, ...]
    """Of telemetry that has no packets."""
    packets: Mapping[str, Packet | None] | None
    """null: something is written there that is no mapping."""
    channels: Mapping[str, Channel | None]
    environment: Environment | None
    nodes: Mapping[str, Node | None]
    conductors: tuple[Conductor | None, ...]
    faces: Mapping[str, Face | None]
    heaters: Mapping[str, Heater | SwitchedHeater | None]
    heater_input: Any
    modes: Mapping[str, Mapping[str, float] | None]
    timeline: tuple[ModeChange | None, ...]
    loads: Mapping[str, Load | None]
    observations: Mapping[str, Observation | None]
    windows: Mapping[str, Window | None]
    parameters: Mapping[str, Parameter | None] = field(default_factory=dict)
    external: External | None = None
    """null: the simulator is a thermal network."""
    reduced: Mapping[str, ReducedNumber | None] | None = None
    """Numbers of a reduced order model; null: the simulator is none."""
    full_nodes: tuple[str, ...] = ()
    """Nodes of the network that it stands for."""
    noise: Noise | None = None
    discrepancy: Discrepancy | None = None
    """null: there is none, or it cannot be read."""
    heat: Heat | None = None
    """null: none is written, or it cannot be read."""
    has_errors: bool = False
    """Whether the simulator has errors against the one that it stands in for."""


def blocks_of(scenario: Scenario) -> Blocks:
    """The blocks of a whole scenario."""
    model, external = scenario.simulator, None
    if isinstance(model, ExternalModel):
        kind = kind_of_simulator(model) or ""
        external = External(kind, getattr(model, kind), model.inputs, model.outputs, model.heaters)
        model = _NO_NETWORK
    return Blocks(
        files=scenario.telemetry.file,
        packets=scenario.telemetry.packets,
        channels=scenario.telemetry.channels,
        environment=scenario.environment,
        **{key: getattr(model, key) for key in _OF_NETWORK},
        observations=scenario.observations,
        windows=scenario.windows,
        parameters=scenario.parameters,
        external=external,
        reduced=model.reduced_numbers if model.reduced_model is not None else None,
        full_nodes=model.full_nodes,
        noise=scenario.noise,
        discrepancy=scenario.discrepancy if isinstance(scenario.discrepancy, Discrepancy) else None,
        heat=scenario.heat if isinstance(scenario.heat, Heat) else None,
        has_errors=bool(model.errors),
    )


def readable(blocks: Mapping[str, T | None]) -> dict[str, T]:
    """The blocks that could be read."""
    return {name: block for name, block in blocks.items() if block is not None}


def read_block(kind: Any, value: Any, location: Location, problems: list[Issue]) -> Any:
    """What stands at `location` as an object; None where it cannot be read, and `problems` then say why."""
    try:
        return reader_of(kind).validate_python(value)
    except ValidationError as error:
        problems += problems_of(error, location)
        return None
