"""The scenario as it was understood: defaults filled in, SI units written."""

from __future__ import annotations

from io import StringIO
from pathlib import Path
from typing import Any

from .external import KINDS
from .network import SimulatorModel
from .priors import written_prior
from .schema import Observation, Scenario
from .uncertain import written_channel_noise, written_discrepancy, written_noise, written_number
from .units import written
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
    data = scenario.model_dump(mode="json", exclude_none=True)
    for name, channel in scenario.telemetry.channels.items():
        block = data["telemetry"]["channels"][name]
        for key, kind in (("on", "status"), ("fill", "driver")):
            if channel.kind != kind:
                del block[key]
        if channel.stale_after is None:
            block["stale_after"] = None
    for name, parameter in scenario.parameters.items():
        paths = {key: list(getattr(parameter, key)) for key in ("sets", "scales") if getattr(parameter, key)}
        data["parameters"][name] = {**paths, "prior": written_prior(parameter.prior, parameter.unit)}
        if parameter.drift is not None:
            data["parameters"][name]["drift"] = parameter.drift
    for name, observation in scenario.observations.items():
        data["observations"][name] |= _written_errors(observation)
        if observation.heater is not None:
            for error in ("gain", "bias", "time_offset"):
                del data["observations"][name][error]
    data["windows"] = grouped_windows(data["windows"])
    data["noise"] = written_noise(scenario.noise)
    if scenario.discrepancy is not None:
        data["discrepancy"] = written_discrepancy(scenario.discrepancy)
    if isinstance(scenario.simulator, SimulatorModel):
        data["simulator"] = _written_network(data["simulator"])
    if absolute:
        _make_absolute(data, scenario.folder)
    return data


def _written_network(model: dict[str, Any]) -> dict[str, Any]:
    """Without what comes from the file of a reduced model."""
    if "reduced_model" not in model:
        return {key: value for key, value in model.items() if key not in ("reduced_numbers", "errors") or value}
    nodes = {name: {"initial": node["initial"]} for name, node in model["nodes"].items() if "initial" in node}
    left_out = ("reduced_numbers", "conductors", "faces", "loads")
    heaters = {
        name: {key: value for key, value in heater.items() if key not in ("node", "sensor")}
        for name, heater in model["heaters"].items()
    }
    return {**{k: v for k, v in model.items() if k not in left_out}, "nodes": nodes, "heaters": heaters}


def _written_errors(observation: Observation) -> dict[str, Any]:
    errors: dict[str, Any] = {"bias": written(observation.bias, "K")}
    noise = written_channel_noise(observation)
    if noise is not None:
        errors["noise"] = noise
    if observation.likelihood is not None and observation.likelihood.switch_times is not None:
        form = observation.likelihood.switch_times
        switch_times = {
            "timing": written_number(form.timing, "s"),
            "error_rate": written_number(form.error_rate, ""),
        }
        errors["likelihood"] = {"switch_times": switch_times}
    return errors


def _make_absolute(data: dict[str, Any], folder: Path) -> None:
    telemetry, environment = data["telemetry"], data["environment"]
    telemetry["file"] = [str((folder / name).absolute()) for name in telemetry["file"]]
    for block, key in ((environment.get("orbit"), "positions"), (environment["attitude"], "quaternions")):
        if isinstance(block, dict) and key in block:
            block[key] = str((folder / block[key]).absolute())
    _make_simulator_absolute(data["simulator"], folder)


def _make_simulator_absolute(model: dict[str, Any], folder: Path) -> None:
    def absolute(name: str) -> str:
        return str((folder / name).absolute())

    for key in ("reduced_model", "checked_on"):
        if key in model:
            model[key] = absolute(model[key])
    block: dict[str, Any] = next((model[kind] for kind in KINDS if kind in model), {})
    for key in ("file", "keep_failed"):
        if key in block:
            block[key] = absolute(block[key])
    if "command" in block:
        program, *arguments = block["command"]
        block["command"] = [absolute(program) if "/" in program else program, *arguments]
        block["templates"] = {name: absolute(template) for name, template in block["templates"].items()}
        block["files"] = [absolute(name) for name in block["files"]]
