"""The last check of a calibration through a reduced model: posterior draws flown on the operational simulator."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import FlightcalError
from ..operational import Mission, Spacecraft, fly
from ..scenario import AnyBlock, Parameter, SimulatorModel, numbers_of, settable
from ..simulator import FloatArray, Times, Trajectory


@dataclass(frozen=True)
class Flown:
    """One theta on the operational simulator, at the samples of a window."""

    temperatures: FloatArray
    """[T, N] K, of the sensors' nodes, without noise; the thermistors' biases are in."""
    duty: FloatArray
    """[H] share of the window's time that each heater line gives power."""


def fly_at(
    mission: Mission,
    parameters: Mapping[str, Parameter],
    theta: FloatArray,
    sensors: Sequence[str],
    times: Times,
) -> Flown:
    """Fly the mission with the parameters of the full network at theta [d], and look at `sensors` at `times` [T].

    The flight begins where the mission does, so initial temperatures are the spacecraft file's.
    Raises FlightcalError for times before the mission's start.
    """
    if times[0] < mission.start:
        raise FlightcalError(f"check: found {times[0]}, before the mission's start {mission.start}")
    craft = spacecraft_at(mission.spacecraft, parameters, theta)
    seconds: FloatArray = (times - mission.start) / np.timedelta64(1, "ns") * 1e-9
    duration = math.ceil(seconds[-1] / craft.software.period) * craft.software.period + craft.software.period
    flight = fly(craft, mission.start, duration, seed=mission.seed)
    thermistors = [craft.thermistors[name] for name in sensors]
    columns = [flight.nodes.index(item.node) for item in thermistors]
    temperatures = np.stack(
        [np.interp(seconds, flight.cycle_times, flight.temperatures[:, column]) for column in columns], axis=1
    )
    within = (flight.cycle_times >= seconds[0]) & (flight.cycle_times < seconds[-1])
    biases = np.array([item.bias for item in thermistors])
    return Flown(temperatures + biases, np.asarray((flight.power[within] > 0.0).mean(axis=0)))


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


def compare(
    flown: Sequence[Flown], reduced: Sequence[Trajectory], sensors: Sequence[str], heaters: Sequence[str]
) -> list[dict[str, float | str]]:
    """Reduced minus operational over draws: a record for each sensor (K) and heater (share of the time)."""
    errors = np.stack([b.temperatures - a.temperatures for a, b in zip(flown, reduced, strict=True)])
    duty = np.stack([b.duty_cycle - a.duty for a, b in zip(flown, reduced, strict=True)])
    return [
        {
            "channel": name,
            "mean": float(difference[..., k].mean()),
            "rms": float(np.sqrt(np.mean(difference[..., k] ** 2))),
            "quantile_95": float(np.quantile(np.abs(difference[..., k]), 0.95)),
            "worst": float(np.abs(difference[..., k]).max()),
            "unit": unit,
        }
        for names, difference, unit in ((sensors, errors, "K"), (heaters, duty, "1"))
        for k, name in enumerate(names)
    ]
