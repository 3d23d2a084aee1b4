"""From a scenario file to its blocks, the whole scenario, and what is wrong with it, in one pass.

Each block is read once. What is made of blocks, up to the scenario, is made of the objects that were read; a part that
cannot be read is `UNREADABLE` there, and nothing more is said of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from .blocks import Blocks, External, read_block
from .document import Document, Issue, read_document
from .environment import Environment
from .external import KINDS, WrittenHeater, WrittenInput, WrittenOutput, is_external, kind_of_simulator
from .fields import FileNames, keys_of
from .heat import Heat, WrittenHeat
from .meshed import with_mesh
from .network import AnyHeater, Conductor, Face, Load, ModeChange, Node, Powers, ReducedNumber, SimulatorModel
from .numbers import Settable, settable_of
from .parameters import read_parameters
from .reduced import fill_in
from .residuals import Discrepancy, Noise, WrittenDiscrepancy
from .schema import AnySimulator, Observation, Scenario
from .telemetry import Channel, Packet, TelemetryFile
from .timeline import with_attitudes, with_timeline
from .units import show
from .windows import Window, flat_windows
from .wording import UNREADABLE, unknown_key

_ENTRIES: dict[str, Any] = {
    "nodes": Node,
    "faces": Face,
    "heaters": AnyHeater,
    "modes": Powers,
    "loads": Load,
    "reduced_numbers": ReducedNumber,
}
_ITEMS: dict[str, Any] = {"conductors": Conductor, "timeline": ModeChange}
"""The parts of a thermal network."""


@dataclass(frozen=True)
class Reading:
    """A scenario file as far as it could be read."""

    document: Document
    blocks: Blocks
    numbers: dict[str, Settable]
    """What parameters may set, from the blocks that could be read."""
    scenario: Scenario | None
    """null: the file does not fit the schema."""
    problems: tuple[Issue, ...]
    """What is wrong with YAML, schema and units; references between blocks are not looked at."""


def read_scenario(path: Path, telemetry: Path | None = None) -> Reading:
    """The scenario file at `path`; nothing wrong with it is raised.

    telemetry: replaces where telemetry is read from: a file, or a folder with files of the same names.
    """
    document = read_document(path)
    reader = _Reader(list(document.problems))
    data = document.data
    if not isinstance(data, dict):
        if not reader.problems:
            reader.problems.append(Issue((), f"found {show(data)}, expected a mapping (key: value)"))
        return Reading(document, _Reader().blocks({})[0], {}, None, tuple(reader.problems))
    if "folder" in data:
        reader.problems.append(Issue(("folder",), unknown_key("folder", keys_of(Scenario))))
    data = {**data, "folder": path.parent}
    if telemetry is not None:
        data["telemetry"] = _elsewhere(data.get("telemetry"), telemetry.absolute())
    if isinstance(data.get("simulator"), dict):
        for filled in (fill_in, with_timeline):
            data["simulator"], found = filled(data["simulator"], path.parent)
            reader.problems += found
        data["simulator"], found = with_mesh(data)
        reader.problems += found
        data["simulator"] = _with_status(data["simulator"], data)
    if isinstance(data.get("environment"), dict):
        data["environment"], found = with_attitudes(data["environment"], path.parent)
        reader.problems += found
    if "windows" in data:
        data["windows"] = flat_windows(data["windows"], document.lines)
    blocks, parts = reader.blocks(data)
    numbers = settable_of(blocks)
    # The unit of a parameter follows from what it sets, so parameters come last.
    parameters, found = read_parameters(_mapping(data, "parameters"), numbers, blocks)
    reader.problems += found
    scenario = reader.whole(Scenario, data, {**parts, "parameters": parameters})
    problems = tuple(reader.problems)
    return Reading(document, replace(blocks, parameters=parameters), numbers, None if problems else scenario, problems)


def _with_status(model: dict[str, Any], data: Mapping[str, Any]) -> dict[str, Any]:
    """A network whose heaters are measured by the first status that observes them, where nothing else is written."""
    if is_external(model):
        return model
    heaters, channels = dict(_mapping(model, "heaters")), _mapping(_mapping(data, "telemetry"), "channels")
    for channel, written in _mapping(data, "observations").items():
        name = str(written.get("heater")) if isinstance(written, dict) else ""
        is_status = _mapping(channels, channel).get("kind") == "status"
        if is_status and isinstance(heaters.get(name), dict) and "switched_with" not in heaters[name]:
            heaters[name] = {"measured_by": channel, **heaters[name]}
    return {**model, "heaters": heaters} if heaters else model


@dataclass
class _Reader:
    """Reads blocks and collects what is wrong with them."""

    problems: list[Issue] = field(default_factory=list)

    def block(self, kind: Any, value: Any, *location: str | int) -> Any:
        return read_block(kind, value, location, self.problems)

    def entries(self, kind: Any, parent: Mapping[str, Any], *location: str) -> dict[str, Any]:
        """The blocks in a mapping, by name; `location` ends with its key."""
        return {
            name: self.block(kind, value, *location, name) for name, value in _mapping(parent, location[-1]).items()
        }

    def items(self, kind: Any, parent: Mapping[str, Any], *location: str) -> tuple[Any, ...]:
        """The blocks in a list."""
        values = parent.get(location[-1])
        return tuple(
            self.block(kind, v, *location, k) for k, v in enumerate(values if isinstance(values, list) else ())
        )

    def whole(self, kind: Any, written: Mapping[str, Any], parts: Mapping[str, Any], *location: str) -> Any:
        """A block whose parts have been read; {} where nothing is written, or no mapping.

        A part that is {} or () is left as it is written, so that it is said what is wrong with it.
        """
        if not written:
            return {}
        kept = {key: _kept(part) for key, part in parts.items() if key in written and part not in ({}, ())}
        return self.block(kind, {**written, **kept}, *location)

    def blocks(self, data: Mapping[str, Any]) -> tuple[Blocks, dict[str, Any]]:
        """All blocks but parameters, and those that a scenario is made of, by key."""
        telemetry, model = _mapping(data, "telemetry"), _mapping(data, "simulator")
        files = self.block(FileNames, telemetry["file"], "telemetry", "file") if "file" in telemetry else ()
        packets = self.entries(Packet, telemetry, "telemetry", "packets")
        channels = self.entries(Channel, telemetry, "telemetry", "channels")
        external, network = None, {} if is_external(model) else model
        in_network: dict[str, Any] = {
            key: self.entries(kind, network, "simulator", key) for key, kind in _ENTRIES.items()
        }
        in_network |= {key: self.items(kind, network, "simulator", key) for key, kind in _ITEMS.items()}
        if is_external(model):
            external, simulator = self.external(model)
        else:
            simulator = self.whole(SimulatorModel, model, in_network, "simulator")
        parts = {
            "telemetry": self.whole(
                TelemetryFile, telemetry, {"file": files, "packets": packets, "channels": channels}, "telemetry"
            ),
            "environment": self.block(Environment, data.get("environment", {}), "environment"),
            "simulator": simulator,
            "observations": self.entries(Observation, data, "observations"),
            "noise": self.block(Noise, data.get("noise", {}), "noise"),
            "windows": self.entries(Window, data, "windows"),
        }
        if data.get("discrepancy") is not None:
            parts["discrepancy"] = self.block(WrittenDiscrepancy, data["discrepancy"], "discrepancy")
        if data.get("heat") is not None:
            parts["heat"] = self.block(WrittenHeat, data["heat"], "heat")
        reduced = in_network.pop("reduced_numbers")
        blocks = Blocks(
            files=files or (),
            packets=packets if isinstance(telemetry.get("packets", {}), dict) else None,
            channels=channels,
            environment=parts["environment"],
            **in_network,
            heater_input=network.get("heater_input", "simulated"),
            observations={
                name: _without_numbers(data["observations"][name]) if block is None else block
                for name, block in parts["observations"].items()
            },
            windows=parts["windows"],
            external=external,
            reduced=reduced if "reduced_model" in network else None,
            full_nodes=tuple(network.get("full_nodes", ())),
            noise=parts["noise"],
            discrepancy=discrepancy if isinstance(discrepancy := parts.get("discrepancy"), Discrepancy) else None,
            heat=heat if isinstance(heat := parts.get("heat"), Heat) else None,
            has_errors=bool(network.get("errors")),
        )
        return blocks, parts

    def external(self, model: Mapping[str, Any]) -> tuple[External, Any]:
        """An external simulator, in parts and whole; where it is of no kind, that alone is said of it."""
        kind = kind_of_simulator(model) or ""
        reader = self if kind else _Reader()
        parts = {
            "inputs": reader.entries(WrittenInput, model, "simulator", "inputs"),
            "outputs": reader.entries(WrittenOutput, model, "simulator", "outputs"),
            "heaters": reader.entries(WrittenHeater, model, "simulator", "heaters"),
        }
        block = None
        if kind:
            block = self.block(KINDS[kind].model_fields[kind].annotation, model[kind], "simulator", kind)
        whole = self.whole(AnySimulator, model, {**parts, kind: block}, "simulator")
        return External(kind, block, **parts), whole


def _without_numbers(observation: Any) -> Any:
    """An observation that cannot be read, for what it refers to; None where more than its numbers is wrong."""
    if not isinstance(observation, dict):
        return None
    kept = {key: value for key, value in observation.items() if key not in ("bias", "likelihood")}
    # A noise of its own, or it would seem to have the scenario's.
    return _Reader().block(Observation, kept | ({"noise": "1 K"} if "noise" in kept else {}))


def _kept(part: Any) -> Any:
    if isinstance(part, dict):
        return {name: UNREADABLE if block is None else block for name, block in part.items()}
    if isinstance(part, tuple):
        return [UNREADABLE if block is None else block for block in part]
    return UNREADABLE if part is None else part


def _mapping(value: Any, key: str) -> Mapping[str, Any]:
    found = value.get(key)
    return found if isinstance(found, dict) else {}


def _elsewhere(telemetry: Any, place: Path) -> Any:
    if not isinstance(telemetry, dict):
        return telemetry
    if isinstance(packets := telemetry.get("packets"), dict):
        return {**telemetry, "packets": {name: _elsewhere(packet, place) for name, packet in packets.items()}}
    files = telemetry.get("file")
    names = [files] if isinstance(files, str) else files
    if not place.is_dir() or not isinstance(names, list):
        return {**telemetry, "file": [str(place)]}
    return {**telemetry, "file": [str(place / Path(str(name)).name) for name in names]}
