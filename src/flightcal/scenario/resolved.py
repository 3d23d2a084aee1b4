"""The scenario as it was understood: defaults filled in, SI units written."""

from __future__ import annotations

from io import StringIO
from typing import Any

from .attitude import AttitudeTimeline
from .defaults import default_noise
from .heat import Heat
from .meshed import MESHED
from .network import SimulatorModel
from .priors import written_prior
from .residuals import NEEDS, Noise
from .schema import Scenario
from .windows import grouped_windows

_WIDTH = 10_000
"""Lines are not broken: long text such as two-line elements must stay whole."""


def resolved_yaml(scenario: Scenario, *, absolute: bool = False) -> str:
    """YAML text that `load_scenario` reads as an equal scenario, with every default written out.

    absolute: paths of files are made absolute, so that the text can stand in another folder.
    """
    from ruamel.yaml import YAML

    yaml: Any = YAML(typ="safe", pure=True)
    yaml.default_flow_style = None
    yaml.sort_base_mapping_type_on_output = False
    yaml.width = _WIDTH
    text = StringIO()
    yaml.dump(_written(scenario, absolute), text)
    return text.getvalue()


def _written(scenario: Scenario, absolute: bool) -> dict[str, Any]:
    """The scenario as a user writes it, as plain values."""
    data = scenario.model_dump(mode="json", exclude_none=True, context=scenario.folder if absolute else None)
    for key in ("packets", "file"):
        if not data["telemetry"][key]:
            del data["telemetry"][key]
    for name, channel in scenario.telemetry.channels.items():
        block = data["telemetry"]["channels"][name]
        for key, kind in (("on", "status"), ("off", "status"), ("fill", "driver")):
            if channel.kind != kind:
                del block[key]
        if channel.threshold is not None or channel.bits is not None:
            del block["off"]
            if "on" not in channel.model_fields_set:
                del block["on"]
        if channel.stale_after is None:
            block["stale_after"] = None
    for name, parameter in scenario.parameters.items():
        block = data["parameters"][name]
        block["prior"] = written_prior(parameter.prior, parameter.unit)
        data["parameters"][name] = {key: value for key, value in block.items() if key != "unit" and value != []}
    for name, observation in scenario.observations.items():
        block = data["observations"][name]
        for error in ("gain", "bias", "time_offset") if observation.heater is not None else ():
            del block[error]
        if isinstance(observation.noise, Noise):
            block["noise"] = _written_noise(block["noise"])
    if isinstance(scenario.environment.attitude, AttitudeTimeline):
        data["environment"]["attitude"].pop("timeline_file", None)
    data["windows"] = grouped_windows(data["windows"])
    data["noise"] = _written_noise(data["noise"])
    if default_noise(scenario) is not scenario.noise:
        del data["noise"]  # what is written counts, and the default is another
    if isinstance(scenario.heat, Heat):
        data["heat"] |= {part: None for part in ("pattern", "gains", "slow") if getattr(scenario.heat, part) is None}
    if isinstance(scenario.simulator, SimulatorModel):
        data["simulator"] = _written_network(data["simulator"])
    return data


def _written_noise(noise: dict[str, Any]) -> dict[str, Any]:
    """With what its model and distribution have."""
    left_out = {key for key, (needed, value) in NEEDS.items() if noise[needed] != value}
    return {key: value for key, value in noise.items() if key not in left_out}


def _written_network(model: dict[str, Any]) -> dict[str, Any]:
    """Without what comes from the file of a reduced model; the timeline is that of its file."""
    model.pop("timeline_file", None)
    model = {key: value for key, value in model.items() if key not in MESHED and (key != "reduced" or value)}
    if "reduced_model" not in model:
        return {
            key: value
            for key, value in model.items()
            if key not in ("reduced_numbers", "full_nodes", "errors") or value
        }
    nodes = {name: {"initial": node["initial"]} for name, node in model["nodes"].items() if "initial" in node}
    left_out = ("reduced_numbers", "full_nodes", "conductors", "faces", "loads")
    heaters = {
        name: {key: value for key, value in heater.items() if key not in ("node", "sensor")}
        for name, heater in model["heaters"].items()
    }
    return {**{k: v for k, v in model.items() if k not in left_out}, "nodes": nodes, "heaters": heaters}
