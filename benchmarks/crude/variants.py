"""Ways to be wrong: models that are too crude, wrongs that `flightcal check` looks for, and wrongs that it does not.

A variant takes a satellite to the one that flies and the scenario that is written of it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import pandas as pd

from .satellites import Satellite, telemetry, written
from .simulation import Array

Group = Literal["right", "crude", "listed", "unlisted"]
Written = dict[str, Any]


@dataclass(frozen=True)
class Set:
    """A satellite's telemetry, and what is written of it."""

    table: pd.DataFrame
    scenario: Written


@dataclass(frozen=True)
class Variant:
    """One way to be wrong."""

    name: str
    group: Group
    make: Callable[[Satellite], Set]
    kinds: tuple[str, ...] = ()
    """That name it rightly; those of a crude model name a part of what is wrong."""


def _as_is(satellite: Satellite) -> Set:
    return Set(telemetry(satellite), deepcopy(written(satellite)))


def _scenario(change: Callable[[Satellite, Written], None]) -> Callable[[Satellite], Set]:
    def make(satellite: Satellite) -> Set:
        found = _as_is(satellite)
        change(satellite, found.scenario)
        return found

    return make


def _flight(change: Callable[[Satellite], Mapping[str, Any]]) -> Callable[[Satellite], Set]:
    """Of another craft than is written."""

    def make(satellite: Satellite) -> Set:
        other = replace(satellite, craft=replace(satellite.craft, **change(satellite)))
        return Set(telemetry(other), deepcopy(written(satellite)))

    return make


def _table(change: Callable[[Satellite, pd.DataFrame], None]) -> Callable[[Satellite], Set]:
    def make(satellite: Satellite) -> Set:
        found = _as_is(satellite)
        change(satellite, found.table)
        return found

    return make


# --- what a satellite has ----------------------------------------------------------------------------------------


def _linked(satellite: Satellite) -> list[str]:
    """Nodes, those with most links first."""
    nodes = list(satellite.craft.capacities)
    ends = [end for pair in satellite.craft.links for end in pair]
    return sorted(nodes, key=lambda name: -ends.count(name))


def _outermost(satellite: Satellite) -> str:
    """The observed node with fewest links and no heater."""
    heated = {heater.node for heater in satellite.craft.heaters.values()}
    return next(name for name in reversed(_linked(satellite)) if name not in heated and name in satellite.observed)


def _lit(satellite: Satellite) -> str:
    """The face that would absorb most."""
    faces = satellite.craft.faces
    return max(faces, key=lambda name: faces[name].area * faces[name].absorptivity)


def _swing(satellite: Satellite) -> list[str]:
    """Channels, those that vary most first."""
    table = telemetry(satellite)
    return sorted((f"{node}_temp" for node in satellite.observed), key=lambda name: -float(table[name].std()))


def _forget(scenario: Written, keep: Callable[[str], bool]) -> None:
    """Parameters that set nothing any more."""
    kept = {}
    for name, item in scenario["parameters"].items():
        paths = [path for path in np.atleast_1d(item["sets"]).tolist() if keep(path)]
        if paths:
            kept[name] = item | {"sets": paths if len(paths) > 1 else paths[0]}
    scenario["parameters"] = kept


def _no_status(satellite: Satellite, scenario: Written) -> None:
    """Heaters have no status: their sensors alone say when they are on."""
    for heater in scenario["simulator"]["heaters"].values():
        channel = heater.pop("measured_by")
        scenario["telemetry"]["channels"].pop(channel)
        scenario["observations"].pop(channel, None)


# --- crude models ------------------------------------------------------------------------------------------------


def _lump(satellite: Satellite, scenario: Written, gone: str, into: str) -> None:
    """One node is a part of another."""
    model = scenario["simulator"]
    left = model["nodes"].pop(gone)
    if into in model["nodes"]:
        more = float(left["capacity"].split()[0]) + float(model["nodes"][into]["capacity"].split()[0])
        model["nodes"][into]["capacity"] = f"{more} J/K"
    kept: list[Written] = []
    changed: dict[str, str] = {}
    for link in model["conductors"]:
        before = "-".join(link["between"])
        link["between"] = [into if end == gone else end for end in link["between"]]
        if link["between"][0] != link["between"][1] and set(link["between"]) not in [set(k["between"]) for k in kept]:
            kept.append(link)
            changed[f"conductors.{before}.conductance"] = f"conductors.{'-'.join(link['between'])}.conductance"
    model["conductors"] = kept
    for face in model["faces"].values():
        face["node"] = into if face["node"] == gone else face["node"]
    for powers in model["modes"].values():
        if gone in powers:
            more = float(powers.pop(gone).split()[0]) + float(powers.get(into, "0 W").split()[0])
            powers[into] = f"{more} W"
    for heater in model["heaters"].values():
        heater["node"] = into if heater["node"] == gone else heater["node"]
        heater["sensor"] = into if heater["sensor"] == gone else heater["sensor"]
    for item in scenario["parameters"].values():
        if isinstance(item["sets"], str) and item["sets"].startswith("conductors."):
            item["sets"] = changed.get(item["sets"], "")
    _forget(
        scenario, lambda path: bool(path) and not path.startswith(f"nodes.{gone}.") and path != f"nodes.{into}.capacity"
    )
    scenario["observations"].pop(f"{gone}_temp", None)
    scenario["telemetry"]["channels"].pop(f"{gone}_temp", None)


def _lumped(satellite: Satellite, scenario: Written) -> None:
    gone = _outermost(satellite)
    into = next(a if b == gone else b for a, b in satellite.craft.links if gone in (a, b))
    _lump(satellite, scenario, gone, into)


def _missing_node(satellite: Satellite, scenario: Written) -> None:
    """A node, its faces and its links are left out."""
    gone = _outermost(satellite)
    model = scenario["simulator"]
    del model["nodes"][gone]
    model["conductors"] = [link for link in model["conductors"] if gone not in link["between"]]
    lost = [name for name, face in model["faces"].items() if face["node"] == gone]
    for name in lost:
        del model["faces"][name]
    for powers in model["modes"].values():
        powers.pop(gone, None)
    known = {"-".join(link["between"]) for link in model["conductors"]}
    _forget(
        scenario,
        lambda path: (
            not path.startswith(f"nodes.{gone}.")
            and not any(path.startswith(f"faces.{name}.") for name in lost)
            and (not path.startswith("conductors.") or path.split(".")[1] in known)
        ),
    )
    scenario["observations"].pop(f"{gone}_temp", None)
    scenario["telemetry"]["channels"].pop(f"{gone}_temp", None)


def _one_node(satellite: Satellite, scenario: Written) -> None:
    """All is one node; only its own channel is looked at."""
    middle = _linked(satellite)[0]
    for node in list(satellite.craft.capacities):
        if node != middle:
            _lump(satellite, scenario, node, middle)
    for name, heater in satellite.craft.heaters.items():
        if heater.node != middle:
            scenario["simulator"]["heaters"][name]["sensor"] = middle


def _no_radiation(satellite: Satellite, scenario: Written) -> None:
    model = scenario["simulator"]
    model["conductors"] = [link for link in model["conductors"] if "radiative" not in link]


def _faces_merged(satellite: Satellite, scenario: Written) -> None:
    """One face that looks everywhere is written for each node."""
    first: dict[str, str] = {}
    for name, face in list(scenario["simulator"]["faces"].items()):
        if face["node"] in first:
            kept = scenario["simulator"]["faces"][first[face["node"]]]
            kept["area"] = f"{float(kept['area'].split()[0]) + float(face['area'].split()[0])} m^2"
            del scenario["simulator"]["faces"][name]
        else:
            first[face["node"]] = name
            face["normal"] = "all"
    known = set(first.values())
    _forget(scenario, lambda path: not path.startswith("faces.") or path.split(".")[1] in known)


def _no_earth(satellite: Satellite, scenario: Written) -> None:
    """Neither albedo nor infrared of the Earth, with parameters of nothing to make up for them."""
    scenario["environment"] |= {"albedo": 0.02, "earth_infrared": "20 W/m^2"}


# --- wrongs that are looked for ----------------------------------------------------------------------------------


def _fahrenheit(satellite: Satellite, table: pd.DataFrame) -> None:
    channel = _swing(satellite)[0]
    table[channel] = 1.8 * table[channel] + 32.0


def _bias(satellite: Satellite, table: pd.DataFrame) -> None:
    table[_swing(satellite)[-1]] += 6.0


def _late(satellite: Satellite, table: pd.DataFrame) -> None:
    times = pd.to_datetime(table["time"]) + pd.Timedelta(minutes=12)
    table["time"] = times.dt.strftime("%Y-%m-%dT%H:%M:%S")


def _swapped(satellite: Satellite, table: pd.DataFrame) -> None:
    a, b = _swing(satellite)[:2]
    table[[a, b]] = table[[b, a]].to_numpy()


def _another_attitude(satellite: Satellite, scenario: Written) -> None:
    scenario["environment"]["attitude"] = "sun_pointing" if satellite.craft.attitude != "sun_pointing" else "nadir"


def _altitude(satellite: Satellite, scenario: Written) -> None:
    orbit = scenario["environment"]["orbit"]
    height = float(orbit["semi_major_axis"].split()[0]) - 6378137.0
    orbit["semi_major_axis"] = f"{6378137.0 + 1.5 * height} m"


def _link_missing(satellite: Satellite, scenario: Written) -> None:
    a, b = max(satellite.craft.links, key=lambda pair: satellite.craft.links[pair])
    model = scenario["simulator"]
    model["conductors"] = [link for link in model["conductors"] if link["between"] != [a, b]]
    _forget(scenario, lambda path: path != f"conductors.{a}-{b}.conductance")


def _no_payload(satellite: Satellite, scenario: Written) -> None:
    modes = scenario["simulator"]["modes"]
    modes["busy"] = dict(modes["idle"])


def _no_bus_power(satellite: Satellite, scenario: Written) -> None:
    """What is on all the time is left out."""
    modes = scenario["simulator"]["modes"]
    for node, power in list(modes["idle"].items()):
        more = float(modes["busy"][node].split()[0]) - float(power.split()[0])
        del modes["idle"][node]
        modes["busy"][node] = f"{max(more, 0.0)} W"


def _half_power(satellite: Satellite, scenario: Written) -> None:
    name = next(iter(satellite.craft.heaters))
    scenario["simulator"]["heaters"][name]["power"] = f"{0.5 * satellite.craft.heaters[name].power} W"


# --- wrongs that are not -----------------------------------------------------------------------------------------


def _sun_on_a_sensor(satellite: Satellite, table: pd.DataFrame) -> None:
    """A sensor is warmed by up to 8 K by sunlight: in proportion to how far the most lit channel is above its mean."""
    first, *_, last = _swing(satellite)
    warm = table[first] - table[first].min()
    table[last] += 8.0 * warm / warm.max()


def _beating(satellite: Satellite, table: pd.DataFrame) -> None:
    """A channel is disturbed by something that comes every 37 minutes."""
    at = np.arange(len(table)) * satellite.every
    table[_swing(satellite)[-1]] += 4.0 * (np.sin(2.0 * np.pi * at / 2220.0) > 0.3)


def _heated_in_sunlight(seconds: Array, lit: Array, node: str, power: float) -> dict[str, Array]:
    return {node: power * lit}


def _power_of(satellite: Satellite) -> float:
    return max(sum(powers.values()) for powers in satellite.craft.modes.values())


def _charging(satellite: Satellite) -> dict[str, Any]:
    """A battery is charged: heat in sunlight alone, in a node of which nobody wrote it."""
    node, power = _linked(satellite)[-1], 0.4 * _power_of(satellite)
    return {"more": lambda seconds, lit: {node: power * lit}}


def _over_a_place(satellite: Satellite) -> dict[str, Any]:
    """A radio is on for a sixth of each orbit; the timeline does not say so."""
    node, power, period = _linked(satellite)[0], 0.5 * _power_of(satellite), satellite.craft.orbit.period
    return {"more": lambda seconds, lit: {node: power * ((seconds / period) % 1.0 < 1.0 / 6.0)}}


def _shaded(satellite: Satellite) -> dict[str, Any]:
    name = _lit(satellite)
    return {"faces": {**satellite.craft.faces, name: replace(satellite.craft.faces[name], shaded=0.8)}}


def _tilted(satellite: Satellite) -> dict[str, Any]:
    return {"turned": (0.45, -0.3, 0.35)}


def _stiff(satellite: Satellite) -> dict[str, Any]:
    return {"stiffening": 0.008}


def _bus_voltage(satellite: Satellite) -> dict[str, Any]:
    return {"bus": 1.5}


VARIANTS = (
    Variant("as it is", "right", _as_is),
    Variant("without status", "right", _scenario(_no_status)),
    Variant("a node lumped into another", "crude", _scenario(_lumped)),
    Variant("a node left out", "crude", _scenario(_missing_node)),
    Variant("all is one node", "crude", _scenario(_one_node)),
    Variant("no radiation inside", "crude", _scenario(_no_radiation)),
    Variant("faces that look everywhere", "crude", _scenario(_faces_merged)),
    Variant("hardly an Earth", "crude", _scenario(_no_earth), ("number",)),
    Variant("degF", "listed", _table(_fahrenheit), ("unit",)),
    Variant("a bias", "listed", _table(_bias), ("bias",)),
    Variant("a late clock", "listed", _table(_late), ("clock",)),
    Variant("two swapped", "listed", _table(_swapped), ("swapped",)),
    Variant("another attitude", "listed", _scenario(_another_attitude), ("attitude",)),
    Variant("another altitude", "listed", _scenario(_altitude), ("orbit",)),
    Variant("a link left out", "listed", _scenario(_link_missing), ("link",)),
    Variant("no payload", "listed", _scenario(_no_payload), ("mode",)),
    Variant("no bus power", "listed", _scenario(_no_bus_power), ("mode", "missing heat", "constant heat")),
    Variant("a heater of half its power", "listed", _scenario(_half_power), ("heater", "number")),
    Variant("sunlight on a sensor", "unlisted", _table(_sun_on_a_sensor)),
    Variant("disturbed every 37 min", "unlisted", _table(_beating)),
    Variant("heat in sunlight alone", "unlisted", _flight(_charging)),
    Variant("a radio over a place", "unlisted", _flight(_over_a_place)),
    Variant("a face that is shaded", "unlisted", _flight(_shaded)),
    Variant("a body that is tilted", "unlisted", _flight(_tilted)),
    Variant("links that grow with temperature", "unlisted", _flight(_stiff)),
    Variant("heaters stronger in sunlight", "unlisted", _flight(_bus_voltage)),
)


def fits(variant: Variant, satellite: Satellite) -> bool:
    """Whether a satellite has what a variant takes."""
    if variant.name in ("without status", "a heater of half its power", "heaters stronger in sunlight"):
        return bool(satellite.craft.heaters)
    if variant.name == "a face that is shaded":
        return satellite.craft.attitude != "sun_pointing"
    if variant.name == "no radiation inside":
        return bool(satellite.craft.radiative)
    if variant.name in ("a node lumped into another", "a node left out", "a link left out"):
        return len(satellite.craft.capacities) > 2
    return True
