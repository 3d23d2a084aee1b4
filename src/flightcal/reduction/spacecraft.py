"""The spacecraft as a calibration may know it, and with its numbers at any theta."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ..errors import FlightcalError
from ..operational import Spacecraft
from ..probability import Priors
from ..scenario import AnyBlock, Parameter, Scenario, SimulatorModel, numbers_of, settable
from ..simulator import FloatArray


def without_flaws(craft: Spacecraft) -> Spacecraft:
    """The spacecraft as it was built: thermistors without bias that do not fail, and heaters that do not fail.

    A real satellite does not tell its ground what these are. Noise stays: it is in a data sheet.
    """
    thermistors = {name: replace(item, bias=0.0, failures=()) for name, item in craft.thermistors.items()}
    heaters = {
        name: replace(line, branches={key: replace(item, fails_at=None) for key, item in line.branches.items()})
        for name, line in craft.software.heaters.items()
    }
    return replace(craft, thermistors=thermistors, software=replace(craft.software, heaters=heaters))


def at_medians(craft: Spacecraft, parameters: Mapping[str, Parameter]) -> Spacecraft:
    """The spacecraft with what parameters set at their priors' medians. A factor is relative to what is written."""
    set_ones = {name: item for name, item in parameters.items() if item.sets}
    return spacecraft_at(craft, set_ones, _medians(set_ones))


def medians_of(scenario: Scenario) -> FloatArray:
    """Prior medians of the parameters [d]."""
    return _medians(scenario.parameters)


def _medians(parameters: Mapping[str, Parameter]) -> FloatArray:
    return Priors(tuple(parameters), tuple(item.prior for item in parameters.values())).median()


def spacecraft_at(craft: Spacecraft, parameters: Mapping[str, Parameter], theta: FloatArray) -> Spacecraft:
    """The spacecraft with its numbers as theta [d] sets and scales them."""
    entries = [(parameter.sets, parameter.scales) for parameter in parameters.values()]

    def moved(values: Mapping[str, float]) -> dict[str, float]:
        numbers = numbers_of(values, entries)
        at = numbers.at(theta)
        return {numbers.paths[k]: float(at[k]) for k in np.flatnonzero(numbers.moved())}

    numbers = moved({path: number.value for path, number in settable(craft.scenario).items()})
    scenario = craft.scenario.model_copy(
        update={
            "simulator": _network_at(craft.scenario.network, numbers),
            "environment": _block_at(craft.scenario.environment, "environment", numbers),
        }
    )
    touched = {path for entry in entries for paths in entry for path in paths}
    heaters = {}
    for name, line in craft.software.heaters.items():
        thermostat = line.thermostat
        paths = {f"heaters.{name}.{limit}": limit for limit in ("on_below", "off_above")}
        if thermostat is not None:
            limits = moved({path: getattr(thermostat, limit) for path, limit in paths.items()})
            thermostat = replace(thermostat, **{paths[path]: limit for path, limit in limits.items()})
        elif touched & paths.keys():
            raise FlightcalError(f"check: found parameters on the thresholds of '{name}', which is no thermostat")
        path = f"heaters.{name}.power"
        branches = {
            key: replace(
                branch, power={node: moved({path: watts}).get(path, watts) for node, watts in branch.power.items()}
            )
            for key, branch in line.branches.items()
        }
        heaters[name] = replace(line, thermostat=thermostat, branches=branches)
    return replace(craft, scenario=scenario, software=replace(craft.software, heaters=heaters))


def _block_at(block: AnyBlock, prefix: str, numbers: Mapping[str, float]) -> AnyBlock:
    update = {name: numbers[path] for name in type(block).model_fields if (path := f"{prefix}.{name}") in numbers}
    return block.model_copy(update=update) if update else block


def _network_at(model: SimulatorModel, numbers: Mapping[str, float]) -> SimulatorModel:
    return model.model_copy(
        update={
            "nodes": {name: _block_at(block, f"nodes.{name}", numbers) for name, block in model.nodes.items()},
            "conductors": tuple(_block_at(c, f"conductors.{c.label}", numbers) for c in model.conductors),
            "faces": {name: _block_at(block, f"faces.{name}", numbers) for name, block in model.faces.items()},
            "modes": {
                mode: {node: numbers.get(f"modes.{mode}.{node}", watts) for node, watts in powers.items()}
                for mode, powers in model.modes.items()
            },
        }
    )
