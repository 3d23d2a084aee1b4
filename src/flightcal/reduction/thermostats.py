"""Heater lines of the on-board software as thermostats of the canonical form, and what that form cannot hold."""

from __future__ import annotations

import numpy as np

from ..errors import FlightcalError
from ..operational import HeaterLine, Mission, OnOff, Spacecraft, Thermistor, fly
from ..scenario import Heater


def canonical_heaters(spacecraft: Spacecraft, band: float) -> tuple[dict[str, Heater], list[str]]:
    """A hysteresis thermostat for each heater line, and notes on what of the software it leaves out.

    Control by pulse width holds the set point; hysteresis `band` (K) wide around it gives the same mean heat. The
    certificate measures what that costs. Thresholds are the software's; `switching_shifts` says where it switches.
    Raises FlightcalError for a line that heats or watches more than one node.
    """
    heaters, notes = {}, []
    for name, line in spacecraft.software.heaters.items():
        where = f"heater line '{name}'"
        branch = next(iter(line.branches))
        power = line.branches[branch].power
        if len(power) != 1:
            raise FlightcalError(
                f"{where}: found {len(power)} nodes that branch '{branch}' heats, expected one: a thermostat "
                "of the canonical form heats one node"
            )
        ((node, watts),) = power.items()
        sensor = _watched(spacecraft, name)
        lower, upper = _thresholds(line, band)
        heaters[name] = Heater.model_construct(
            node=node,
            power=watts,
            sensor=sensor,
            on_below=lower,
            off_above=upper,
            initially_on=False,
            measured_by=None,
        )
        notes += [f"{where}: {note}" for note in _left_out(spacecraft, name, band)]
    if spacecraft.software.transitions:
        notes.append("changes of mode by temperature are left out: modes follow the timeline")
    return heaters, notes


def switching_shifts(mission: Mission) -> dict[str, tuple[float, float]]:
    """How far from its thresholds (on, off) each heater line switches, K: a median over a flight of the mission.

    The temperature of the node that it watches, less the threshold. Noisy thermistors, voted on and read once in a
    control cycle, switch early or late.
    """
    craft = mission.spacecraft
    flight = fly(craft, mission.start, mission.duration, seed=mission.seed)
    shifts = {}
    for k, (heater, line) in enumerate(craft.software.heaters.items()):
        temperature = flight.temperatures[:, flight.nodes.index(_watched(craft, heater))]
        change = np.diff((flight.power[:, k] > 0.0).astype(int), prepend=0)
        found = []
        for sign, name in ((1, "on_below"), (-1, "off_above")):
            there = temperature[change == sign]
            measured = line.thermostat is not None and len(there) > 0
            found.append(float(np.median(there) - getattr(line.thermostat, name)) if measured else 0.0)
        shifts[heater] = (found[0], found[1])
    return shifts


def _thermistors(spacecraft: Spacecraft, heater: str) -> list[Thermistor]:
    """Those that a heater line watches."""
    software = spacecraft.software
    voted = software.sensors[software.heaters[heater].sensor].thermistors
    return [item for name, item in spacecraft.thermistors.items() if name in voted]


def _watched(spacecraft: Spacecraft, heater: str) -> str:
    """Node of the line's thermistors."""
    nodes = {item.node for item in _thermistors(spacecraft, heater)}
    if len(nodes) != 1:
        raise FlightcalError(
            f"heater line '{heater}': found thermistors on {', '.join(sorted(nodes))}, expected one node: a "
            "thermostat of the canonical form watches one"
        )
    return nodes.pop()


def _thresholds(line: HeaterLine, band: float) -> tuple[float, float]:
    if isinstance(line.law, OnOff):
        return line.law.on_below, line.law.off_above
    return line.law.set_point - 0.5 * band, line.law.set_point + 0.5 * band


def _left_out(spacecraft: Spacecraft, heater: str, band: float) -> list[str]:
    notes, line = [], spacecraft.software.heaters[heater]
    if not isinstance(line.law, OnOff):
        notes.append(f"control by pulse width is a hysteresis of {band:g} K around the set point")
    elif line.law.minimum_on > 0.0 or line.law.minimum_off > 0.0:
        notes.append("minimum times on and off are left out")
    noise = max(item.noise for item in _thermistors(spacecraft, heater))
    if noise > 0.0:
        notes.append(f"noise of {noise:g} K on its thermistors switches it early, always by as much as in the median")
    if len(line.branches) > 1:
        notes.append(f"only its branch '{next(iter(line.branches))}' is there; failures and redundancy are left out")
    off = [mode for mode, lines in spacecraft.software.enabled.items() if heater not in lines]
    if off:
        notes.append(f"switched off in {', '.join(off)} by the enable table; its thermostat acts in every mode")
    return notes
