"""What of a scenario can be read block by block, so that one error does not hide the others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

from pydantic import TypeAdapter, ValidationError

from .environment import Environment
from .external import (
    KINDS,
    ExternalHeater,
    ExternalModel,
    Input,
    Output,
    WrittenHeater,
    WrittenInput,
    WrittenOutput,
    is_external,
    kind_of_simulator,
)
from .fields import Names
from .network import Conductor, Face, Heater, Load, ModeChange, Node, ReducedNumber, SimulatorModel
from .residuals import Discrepancy, Noise
from .schema import Channel, Observation, Parameter, Scenario
from .units import Power
from .windows import Window

_NO_NETWORK = SimulatorModel.model_construct(nodes={})


@dataclass(frozen=True)
class External:
    """What of an external simulator can be read; None as in `Draft`."""

    kind: str
    """The key that tells its kind: callable, executable, fmu or umbridge; "": none of them is there."""
    block: Any
    """What stands under that key, as an object; null where it cannot be read."""
    inputs: Mapping[str, Input | None]
    outputs: Mapping[str, Output | None]
    heaters: Mapping[str, ExternalHeater | None]


@dataclass(frozen=True)
class Draft:
    """The blocks of a scenario. None: the block is there, but cannot be read; its name counts as known."""

    files: tuple[str, ...]
    channels: Mapping[str, Channel | None]
    environment: Environment | None
    nodes: Mapping[str, Node | None]
    conductors: tuple[Conductor | None, ...]
    faces: Mapping[str, Face | None]
    heaters: Mapping[str, Heater | None]
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
    noise: Noise | None = None
    discrepancy: Discrepancy | None = None
    """null: there is none, or it cannot be read."""
    has_errors: bool = False
    """Whether the simulator has errors against the one that it stands in for."""


def draft_of_scenario(scenario: Scenario) -> Draft:
    """The blocks of a whole scenario."""
    model, external = scenario.simulator, None
    if isinstance(model, ExternalModel):
        kind = kind_of_simulator(model) or ""
        external = External(kind, getattr(model, kind), model.inputs, model.outputs, model.heaters)
        model = _NO_NETWORK
    return Draft(
        files=scenario.telemetry.file,
        channels=scenario.telemetry.channels,
        environment=scenario.environment,
        nodes=model.nodes,
        conductors=model.conductors,
        faces=model.faces,
        heaters=model.heaters,
        heater_input=model.heater_input,
        modes=model.modes,
        timeline=model.timeline,
        loads=model.loads,
        observations=scenario.observations,
        windows=scenario.windows,
        parameters=scenario.parameters,
        external=external,
        reduced=model.reduced_numbers if model.reduced_model is not None else None,
        noise=scenario.noise,
        discrepancy=scenario.discrepancy,
        has_errors=bool(model.errors),
    )


def draft_of_data(data: Any) -> Draft:
    """The blocks of what a file says, whatever it says. Priors have been read into objects (see `_priors`)."""
    telemetry, model = _mapping(data, "telemetry"), _mapping(data, "simulator")
    external = None
    if is_external(model):
        kind = kind_of_simulator(model) or ""
        external = External(
            kind,
            _block(KINDS[kind].model_fields[kind].annotation, model[kind]) if kind else None,
            _entries(WrittenInput, model, "inputs"),
            _entries(WrittenOutput, model, "outputs"),
            _entries(WrittenHeater, model, "heaters"),
        )
        model = {}
    return Draft(
        files=_block(Names, telemetry.get("file")) or (),
        channels=_entries(Channel, telemetry, "channels"),
        environment=_block(Environment, _mapping(data).get("environment", {})),
        nodes=_entries(Node, model, "nodes"),
        conductors=_items(Conductor, model, "conductors"),
        faces=_entries(Face, model, "faces"),
        heaters=_entries(Heater, model, "heaters"),
        heater_input=model.get("heater_input", "simulated"),
        modes=_entries(dict[str, Power], model, "modes"),
        timeline=_items(ModeChange, model, "timeline"),
        loads=_entries(Load, model, "loads"),
        observations=_entries(Observation, data, "observations"),
        windows=_entries(Window, data, "windows"),
        parameters=_entries(Parameter, data, "parameters"),
        external=external,
        reduced=_entries(ReducedNumber, model, "reduced_numbers") if "reduced_model" in model else None,
        noise=_block(Noise, _mapping(data).get("noise", {})),
        discrepancy=_block(Discrepancy, _mapping(data).get("discrepancy")),
        has_errors=bool(model.get("errors")),
    )


def _mapping(value: Any, key: str | None = None) -> Mapping[str, Any]:
    if key is not None:
        value = _mapping(value).get(key)
    return value if isinstance(value, dict) else {}


def _entries(kind: Any, parent: Any, key: str) -> dict[str, Any]:
    return {name: _block(kind, value) for name, value in _mapping(parent, key).items()}


def _items(kind: Any, parent: Any, key: str) -> tuple[Any, ...]:
    values = _mapping(parent).get(key)
    return tuple(_block(kind, value) for value in values) if isinstance(values, list) else ()


def _block(kind: Any, value: Any) -> Any:
    try:
        return _adapter(kind).validate_python(value)
    except ValidationError:
        return None


@lru_cache(maxsize=100)
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)
