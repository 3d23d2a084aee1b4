"""Heater lines of the on-board software as thermostats of the canonical form, and what that form cannot hold."""

from __future__ import annotations

import numpy as np

from ..errors import FlightcalError
from ..operational import HeaterLine, Mission, OnOff, Spacecraft, fly
from ..scenario import Heater


def canonical_heaters(spacecraft: Spacecraft, band: float) -> tuple[dict[str, Heater], list[str]]:
    """A hysteresis thermostat for each heater line, and notes on what of the software it leaves out.

    Control by pulse width holds the set point; hysteresis `band` (K) wide around it gives the same mean heat. The
    certificate measures what that costs. Thresholds are the software's; `switching_shifts` says where it switches.
    Raises FlightcalError for a line that heats or watches more than one node.
    """
    heaters, notes = {}, []
    for line in spacecraft.software.heaters:
        where = f"heater line '{line.name}'"
        power = next(b.power for b in spacecraft.branches if (b.line, b.name) == (line.name, line.branches[0]))
        if len(power) != 1:
            raise FlightcalError(
                f"{where}: found {len(power)} nodes that branch '{line.branches[0]}' heats, expected one: a thermostat "
                "of the canonical form heats one node"
            )
        ((node, watts),) = power.items()
        sensor, _ = _watched(spacecraft, line)
        lower, upper = _thresholds(line, band)
        heaters[line.name] = Heater.model_construct(
            node=node,
            power=watts,
            sensor=sensor,
            on_below=lower,
            off_above=upper,
            initially_on=False,
            measured_by=None,
        )
        notes += [f"{where}: {note}" for note in _left_out(spacecraft, line, band)]
    if spacecraft.software.transitions:
        notes.append("changes of mode by temperature are left out: modes follow the timeline")
    return heaters, notes


def switching_shifts(mission: Mission) -> dict[str, tuple[float, float]]:
    """How far from its thresholds (on, off) each heater line switches, K: a median over the mission's flight.

    The temperature of the node that it watches, less the threshold. Biased, noisy thermistors, voted on and read once
    in a control cycle, switch early or late; a line that does not switch in the flight is shifted by its bias alone.
    """
    craft = mission.spacecraft
    flight = fly(craft, mission.start, mission.duration, seed=mission.seed)
    shifts = {}
    for k, line in enumerate(craft.software.heaters):
        node, bias = _watched(craft, line)
        temperature = flight.temperatures[:, flight.nodes.index(node)]
        change = np.diff((flight.power[:, k] > 0.0).astype(int), prepend=0)
        found = []
        for sign, name in ((1, "on_below"), (-1, "off_above")):
            there = temperature[change == sign]
            measured = isinstance(line.law, OnOff) and len(there) > 0
            found.append(float(np.median(there) - getattr(line.law, name)) if measured else -bias)
        shifts[line.name] = (found[0], found[1])
    return shifts


def _watched(spacecraft: Spacecraft, line: HeaterLine) -> tuple[str, float]:
    """Node of the line's thermistors, and the bias (K) of their voted reading."""
    voted = next(sensor for sensor in spacecraft.software.sensors if sensor.name == line.sensor)
    thermistors = [item for item in spacecraft.thermistors if item.name in voted.thermistors]
    nodes = {item.node for item in thermistors}
    if len(nodes) != 1:
        raise FlightcalError(
            f"heater line '{line.name}': found thermistors on {', '.join(sorted(nodes))}, expected one node: a "
            "thermostat of the canonical form watches one"
        )
    return nodes.pop(), float(np.median([item.bias for item in thermistors]))


def _thresholds(line: HeaterLine, band: float) -> tuple[float, float]:
    if isinstance(line.law, OnOff):
        return line.law.on_below, line.law.off_above
    return line.law.set_point - 0.5 * band, line.law.set_point + 0.5 * band


def _left_out(spacecraft: Spacecraft, line: HeaterLine, band: float) -> list[str]:
    notes = []
    if not isinstance(line.law, OnOff):
        notes.append(f"control by pulse width is a hysteresis of {band:g} K around the set point")
    elif line.law.minimum_on > 0.0 or line.law.minimum_off > 0.0:
        notes.append("minimum times on and off are left out")
    voted = next(sensor for sensor in spacecraft.software.sensors if sensor.name == line.sensor)
    thermistors = [item for item in spacecraft.thermistors if item.name in voted.thermistors]
    noise = max(item.noise for item in thermistors)
    if noise > 0.0:
        notes.append(f"noise of {noise:g} K on its thermistors switches it early, always by as much as in the median")
    if any(item.failures for item in thermistors):
        notes.append("failures of its thermistors shift its thresholds as in the median, whenever they happen")
    if len(line.branches) > 1:
        notes.append(f"only its branch '{line.branches[0]}' is there; failures and redundancy are left out")
    off = [mode for mode, lines in spacecraft.software.enabled.items() if line.name not in lines]
    if off:
        notes.append(f"switched off in {', '.join(off)} by the enable table; its thermostat acts in every mode")
    return notes
