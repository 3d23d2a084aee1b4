"""Condensation: nodes in groups, each of which becomes one node of an ordinary network.

Capacities are summed, and so are the linear conductances and the areas of faces between or on groups. Radiative
couplings are summed and then corrected so that two groups at their mean temperatures exchange the heat that their nodes
exchange at the nominal ones. What a parameter touches stays apart from what it does not, so parameters set and scale
the condensed numbers as they did those of the full network.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import FlightcalError
from ..scenario import Conductor, Face, Node, Parameter, Scenario, SimulatorModel
from ..simulator import Network
from ..simulator.system import FloatArray
from .patterns import plain

_MOST_CORRECTION = 2.0
"""Radiative couplings are corrected by at most this factor: at nearly equal temperatures the ratio says nothing."""


@dataclass(frozen=True)
class Signature:
    """Which parameters touch a number: the one that sets it, and those that scale it."""

    set_by: str | None
    scaled_by: tuple[str, ...]


@dataclass(frozen=True)
class Condensed:
    """The network of groups, as a scenario, and where each of its temperatures comes from."""

    scenario: Scenario
    groups: dict[str, tuple[str, ...]]
    """Group -> nodes of the full network."""


def condense(scenario: Scenario, groups: Mapping[str, Sequence[str]], nominal: Mapping[str, float]) -> Condensed:
    """The network in which each group is one node; nodes in no group stay themselves.

    nominal: temperature of every node, K. Raises FlightcalError where nodes of a group have capacities that different
    parameters touch, or a parameter sets a threshold whose sensor is in a group.
    """
    model = scenario.network
    group_of = _group_of(model, groups)
    members: dict[str, list[str]] = defaultdict(list)
    for name in model.nodes:
        members[group_of[name]].append(name)
    writer = _Writer(scenario)
    temperature = {group: _mean_temperature(model, names, nominal) for group, names in members.items()}
    nodes = {group: _node(writer, model, group, names, temperature[group]) for group, names in members.items()}
    conductors = _conductors(writer, model, group_of, nominal, temperature)
    faces = _faces(writer, model, group_of)
    heaters = {}
    for name, heater in model.heaters.items():
        shift = temperature[group_of[heater.sensor]] - nominal[heater.sensor]
        for field in ("power", "on_below", "off_above"):
            path = f"heaters.{name}.{field}"
            if field != "power" and abs(shift) > 0.0 and writer.signature(path) != _UNTOUCHED:
                raise FlightcalError(
                    f"heater '{name}': found its sensor '{heater.sensor}' in the group '{group_of[heater.sensor]}' and "
                    f"a parameter on {path}, expected a sensor on its own"
                )
            writer.touch(path, path)
        update = {"node": group_of[heater.node], "sensor": group_of[heater.sensor]}
        limits = {"on_below": heater.on_below + shift, "off_above": heater.off_above + shift}
        heaters[name] = heater.model_copy(update={**update, **limits})
    modes = _modes(writer, model, group_of)
    for path in ("environment.albedo", "environment.earth_infrared"):
        writer.touch(path, path)
    observations = {
        name: item.model_copy(
            update={
                "node": group_of[item.node or ""],
                "bias": item.bias + nominal[item.node or ""] - temperature[group_of[item.node or ""]],
            }
        )
        for name, item in scenario.observations.items()
    }
    condensed = model.model_copy(
        update={
            "nodes": nodes,
            "conductors": tuple(conductors),
            "faces": faces,
            "heaters": heaters,
            "modes": modes,
        }
    )
    changes = {"simulator": condensed, "parameters": writer.parameters(), "observations": observations}
    return Condensed(scenario.model_copy(update=changes), {group: tuple(names) for group, names in members.items()})


def restriction_of(condensed: Condensed, full: Network, reduced: Network, capacity: FloatArray) -> FloatArray:
    """[k, n]: initial temperatures of the groups with a capacity, from those of all nodes: means by capacity [n]."""
    matrix = np.zeros((len(reduced.diffusive), len(full.nodes)))
    place = {name: k for k, name in enumerate(full.nodes)}
    for k, state in enumerate(reduced.diffusive):
        columns = [place[name] for name in condensed.groups[reduced.nodes[state]]]
        matrix[k, columns] = capacity[columns] / capacity[columns].sum()
    return matrix


_UNTOUCHED = Signature(None, ())


class _Writer:
    """Collects which condensed numbers each parameter touches, as they are written."""

    def __init__(self, scenario: Scenario) -> None:
        self._parameters = scenario.parameters
        self._set = {path: name for name, parameter in scenario.parameters.items() for path in parameter.sets}
        self._scaled: dict[str, list[str]] = defaultdict(list)
        for name, parameter in scenario.parameters.items():
            for path in parameter.scales:
                self._scaled[path].append(name)
        self._found: dict[str, dict[str, list[str]]] = {
            name: {"sets": [], "scales": []} for name in scenario.parameters
        }

    def signature(self, path: str) -> Signature:
        """Of a number of the full network."""
        return Signature(self._set.get(path), tuple(self._scaled.get(path, ())))

    def touch(self, path: str, condensed: str) -> None:
        """The number at `condensed` is touched as that at `path` of the full network is."""
        signature = self.signature(path)
        if signature.set_by is not None:
            self._note(signature.set_by, "sets", condensed)
        for name in signature.scaled_by:
            self._note(name, "scales", condensed)

    def _note(self, name: str, key: str, path: str) -> None:
        if path not in self._found[name][key]:
            self._found[name][key].append(path)

    def parameters(self) -> dict[str, Parameter]:
        """Raises FlightcalError for a parameter that touches nothing any more."""
        written = {}
        for name, parameter in self._parameters.items():
            found = self._found[name]
            if not found["sets"] and not found["scales"]:
                raise FlightcalError(
                    f"parameter '{name}': all that it touches is inside of groups; expected groups that keep some of it"
                )
            written[name] = parameter.model_copy(update={key: tuple(paths) for key, paths in found.items()})
        return written


def _group_of(model: SimulatorModel, groups: Mapping[str, Sequence[str]]) -> dict[str, str]:
    group_of = {name: plain(name) for name in model.nodes}
    grouped: dict[str, str] = {}
    for group, names in groups.items():
        for name in names:
            if model.nodes[name].boundary is not None:
                raise FlightcalError(f"group '{group}': found '{name}', a boundary, expected nodes")
            if name in grouped:
                raise FlightcalError(f"group '{group}': found '{name}', which is in '{grouped[name]}' already")
            grouped[name] = plain(group)
    group_of |= grouped
    single = {plain(name) for name in model.nodes if name not in grouped}
    for group in groups:
        if plain(group) in single:
            raise FlightcalError(f"group '{group}': found a node of that name outside of it, expected another name")
    return group_of


def _mean_temperature(model: SimulatorModel, names: Sequence[str], nominal: Mapping[str, float]) -> float:
    weights = np.array([model.nodes[name].capacity or 0.0 for name in names])
    if not weights.sum() > 0.0:
        weights = np.ones(len(names))
    return float(weights @ [nominal[name] for name in names] / weights.sum())


def _node(writer: _Writer, model: SimulatorModel, group: str, names: Sequence[str], temperature: float) -> Node:
    if len(names) == 1:
        writer.touch(f"nodes.{names[0]}.capacity", f"nodes.{group}.capacity")
        writer.touch(f"nodes.{names[0]}.boundary", f"nodes.{group}.boundary")
        node = model.nodes[names[0]]
        return node if node.capacity is None else node.model_copy(update={"initial": temperature})
    storing = [name for name in names if model.nodes[name].capacity is not None]
    if not storing:
        return Node.model_construct(capacity=None, initial=None, arithmetic=True, boundary=None)
    signatures = {writer.signature(f"nodes.{name}.capacity") for name in storing}
    if len(signatures) > 1 or any(item.set_by is not None for item in signatures):
        raise FlightcalError(
            f"group '{group}': found capacities that parameters touch differently, expected one group for each"
        )
    writer.touch(f"nodes.{storing[0]}.capacity", f"nodes.{group}.capacity")
    total = sum(model.nodes[name].capacity or 0.0 for name in storing)
    return Node.model_construct(capacity=total, initial=temperature, arithmetic=False, boundary=None)


def _conductors(
    writer: _Writer,
    model: SimulatorModel,
    group_of: Mapping[str, str],
    nominal: Mapping[str, float],
    temperature: Mapping[str, float],
) -> list[Conductor]:
    links: dict[tuple[Any, ...], list[Conductor]] = defaultdict(list)
    for conductor in model.conductors:
        first, second = (group_of[name] for name in conductor.between)
        if first == second:
            continue
        law = "conductance" if conductor.conductance is not None else "radiative"
        signature = writer.signature(f"conductors.{conductor.label}.{law}")
        # What a parameter sets cannot be summed: n links of theta each are n links still.
        apart = conductor.label if signature.set_by is not None else ""
        links[(*sorted((first, second)), law, signature, apart)].append(conductor)
    written: list[Conductor] = []
    labels: dict[str, int] = {}
    for (first, second, law, signature, _), found in links.items():
        total = sum(getattr(conductor, law) for conductor in found)
        if law == "radiative" and len(found) > 1:
            total *= _radiative_correction(found, group_of, nominal, temperature)
        touched = (signature.set_by, *signature.scaled_by)
        label = " ".join([f"{first}-{second}", *(name for name in touched if name is not None)])
        label += " radiation" if law == "radiative" else ""
        labels[label] = labels.get(label, 0) + 1
        if labels[label] > 1:
            label = f"{label} {labels[label]}"
        written.append(
            Conductor.model_construct(
                between=(first, second),
                name=label,
                conductance=total if law == "conductance" else None,
                radiative=total if law == "radiative" else None,
            )
        )
        writer.touch(f"conductors.{found[0].label}.{law}", f"conductors.{label}.{law}")
    return written


def _radiative_correction(
    links: Sequence[Conductor],
    group_of: Mapping[str, str],
    nominal: Mapping[str, float],
    temperature: Mapping[str, float],
) -> float:
    def exchanged(first: str, second: str, here: Mapping[str, float]) -> float:
        return here[first] ** 4 - here[second] ** 4

    by_nodes = by_groups = 0.0
    first_group = group_of[links[0].between[0]]
    for link in links:
        a, b = link.between if group_of[link.between[0]] == first_group else link.between[::-1]
        by_nodes += (link.radiative or 0.0) * exchanged(a, b, nominal)
        by_groups += (link.radiative or 0.0) * exchanged(group_of[a], group_of[b], temperature)
    if by_groups == 0.0 or not 1.0 / _MOST_CORRECTION <= by_nodes / by_groups <= _MOST_CORRECTION:
        return 1.0
    return by_nodes / by_groups


def _faces(writer: _Writer, model: SimulatorModel, group_of: Mapping[str, str]) -> dict[str, Face]:
    alike: dict[tuple[Any, ...], list[str]] = defaultdict(list)
    for name, face in model.faces.items():
        signatures = tuple(writer.signature(f"faces.{name}.{field}") for field in _FACE_NUMBERS)
        apart = name if signatures[0].set_by is not None else ""
        key = (group_of[face.node], face.normal, face.absorptivity, face.emissivity, signatures, apart)
        alike[key].append(name)
    faces: dict[str, Face] = {}
    counts: dict[str, int] = defaultdict(int)
    for (group, *_), names in alike.items():
        face = model.faces[names[0]]
        label = plain(names[0])
        if len(names) > 1:
            counts[group] += 1
            label = f"{group}_face_{counts[group]}"
        area = sum(model.faces[name].area for name in names)
        faces[label] = face.model_copy(update={"node": group, "area": area})
        for field in _FACE_NUMBERS:
            writer.touch(f"faces.{names[0]}.{field}", f"faces.{label}.{field}")
    return faces


_FACE_NUMBERS = ("area", "absorptivity", "emissivity")


def _modes(writer: _Writer, model: SimulatorModel, group_of: Mapping[str, str]) -> dict[str, dict[str, float]]:
    modes: dict[str, dict[str, float]] = {}
    for mode, powers in model.modes.items():
        into: dict[str, list[str]] = defaultdict(list)
        for name in powers:
            into[group_of[name]].append(name)
        modes[mode] = {}
        for group, names in into.items():
            signatures = {writer.signature(f"modes.{mode}.{name}") for name in names}
            if len(signatures) > 1 or (len(names) > 1 and any(item.set_by is not None for item in signatures)):
                raise FlightcalError(
                    f"group '{group}': found dissipation in mode '{mode}' that parameters touch differently, expected "
                    "one group for each"
                )
            modes[mode][group] = sum(powers[name] for name in names)
            writer.touch(f"modes.{mode}.{names[0]}", f"modes.{mode}.{group}")
    return modes
