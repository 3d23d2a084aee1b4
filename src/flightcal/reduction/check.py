"""The last check of a calibration through a reduced model: posterior draws flown on the operational simulator."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import FlightcalError
from ..operational import Mission, fly
from ..scenario import Parameter
from ..simulator import FloatArray, Times, Trajectory
from .names import node_name
from .spacecraft import spacecraft_at


@dataclass(frozen=True)
class Flown:
    """One theta on the operational simulator, in a window."""

    temperatures: FloatArray
    """[T, N] K, of the sensors' nodes at the samples."""
    duty: FloatArray
    """[H] share of the window's time that each heater line gives power."""
    start: Mapping[str, float]
    """Plain name of each node -> K, at the window's start."""
    on: Mapping[str, float]
    """Heater line -> 0 or 1, whether it gives power then."""


def fly_at(
    mission: Mission,
    parameters: Mapping[str, Parameter],
    theta: FloatArray,
    sensors: Sequence[str],
    times: Times,
    span: tuple[np.datetime64, np.datetime64],
) -> Flown:
    """Fly the mission with the parameters of the full network at theta [d], and look at `sensors` at `times` [T].

    span: the window's start and end, UTC. The flight begins where the mission does, so initial temperatures are the
    spacecraft file's.
    Raises FlightcalError for a window that starts before the mission.
    """
    if span[0] < mission.start:
        raise FlightcalError(f"check: found {span[0]}, before the mission's start {mission.start}")
    craft = spacecraft_at(mission.spacecraft, parameters, theta)
    seconds, (start, end) = (
        (instants - mission.start) / np.timedelta64(1, "ns") * 1e-9 for instants in (times, np.array(span))
    )
    duration = math.ceil(end / craft.software.period) * craft.software.period + craft.software.period
    flight = fly(craft, mission.start, duration, seed=mission.seed)
    columns = [flight.nodes.index(craft.thermistors[name].node) for name in sensors]
    temperatures = np.stack(
        [np.interp(seconds, flight.cycle_times, flight.temperatures[:, column]) for column in columns], axis=1
    )
    within = (flight.cycle_times >= start) & (flight.cycle_times < end)
    first = np.array([np.interp(start, flight.cycle_times, series) for series in flight.temperatures.T])
    cycle = int(np.searchsorted(flight.cycle_times, start, side="right")) - 1
    return Flown(
        temperatures,
        np.asarray((flight.power[within] > 0.0).mean(axis=0)),
        dict(zip(map(node_name, flight.nodes), first.tolist(), strict=True)),
        dict(zip(craft.software.heaters, (flight.power[cycle] > 0.0).astype(float).tolist(), strict=True)),
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
