"""Reads what parameters and observations say in units that follow from what they refer to."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from .blocks import Draft
from .document import Location, Problem
from .numbers import Settable, is_difference
from .priors import Normal, read_prior
from .uncertain import read_noise
from .units import Quantity, did_you_mean

_FIELDS = {
    "nodes": ("capacity", "boundary"),
    "conductors": ("conductance", "radiative"),
    "faces": ("area", "absorptivity", "emissivity"),
    "heaters": ("power", "on_below", "off_above"),
    "loads": ("coefficient",),
    "observations": ("bias", "lag"),
}
_STAND_IN = Normal(mean=0.0, standard_deviation=1.0)
_STAND_IN_NUMBER = 0.1
"""For a prior or a number with problems of its own, so that the rest of its block is still checked."""


# --- observations ---------------------------------------------------------------------------------------------


def read_observations(blocks: Mapping[str, Any]) -> tuple[dict[str, Any], list[Problem]]:
    """Observations with their noise and bias in K; the rest as it is written."""
    read: dict[str, Any] = {}
    problems: list[Problem] = []
    for name, block in blocks.items():
        read[name] = block
        if not isinstance(block, dict):
            continue
        read[name] = dict(block)
        for key, reader in (("noise", read_noise), ("bias", _read_bias)):
            if block.get(key) is not None:
                read[name][key], found = reader(block[key], ("observations", name, key))
                problems += found
        likelihood = block.get("likelihood")
        if isinstance(likelihood, dict) and isinstance(likelihood.get("switch_times"), dict):
            location = ("observations", name, "likelihood", "switch_times")
            switch_times, found = _read_switch_times(likelihood["switch_times"], location)
            read[name]["likelihood"] = {**likelihood, "switch_times": switch_times}
            problems += found
    return read, problems


def _read_bias(value: Any, location: Location) -> tuple[Any, list[Problem]]:
    return _read_quantity(value, location, Quantity("K", difference=True))


def _read_switch_times(block: Mapping[str, Any], location: Location) -> tuple[dict[str, Any], list[Problem]]:
    read, problems = dict(block), []
    for key, quantity in (("timing", Quantity("s", above=0.0)), ("error_rate", Quantity("", above=0.0, at_most=0.5))):
        if key in block:
            read[key], found = _read_known_or_prior(block[key], (*location, key), quantity)
            problems += found
    return read, problems


def _read_known_or_prior(value: Any, location: Location, quantity: Quantity) -> tuple[Any, list[Problem]]:
    if not isinstance(value, dict):
        return _read_quantity(value, location, quantity)
    prior = read_prior(value, quantity.unit, location, difference=quantity.difference)
    return (_STAND_IN_NUMBER, prior) if isinstance(prior, list) else (prior, [])


def _read_quantity(value: Any, location: Location, quantity: Quantity) -> tuple[Any, list[Problem]]:
    try:
        return quantity.read(value), []
    except ValueError as error:
        return _STAND_IN_NUMBER, [Problem(location, str(error))]


# --- parameters -----------------------------------------------------------------------------------------------


def read_parameters(
    blocks: Mapping[str, Any], numbers: Mapping[str, Settable], draft: Draft
) -> tuple[dict[str, Any], list[Problem]]:
    """Parameters with their priors in the SI unit of what they set; unknown paths are among the problems."""
    read: dict[str, Any] = {}
    problems: list[Problem] = []
    for name, block in blocks.items():
        read[name] = block
        if isinstance(block, dict):
            read[name], found = _read_parameter(block, ("parameters", name), numbers, draft)
            problems += found
    return read, problems


def _read_parameter(
    block: dict[str, Any], location: Location, numbers: Mapping[str, Settable], draft: Draft
) -> tuple[dict[str, Any], list[Problem]]:
    block = dict(block)
    problems = []
    if "unit" in block:
        message = "unknown key 'unit', expected none: the unit follows from the path that the parameter sets"
        problems.append(Problem((*location, "unit"), message))
    for key in ("sets", "scales"):
        problems += _unknown_paths(block.get(key), (*location, key), numbers, draft)
        if isinstance(block.get(key), str):
            block[key] = [block[key]]
    unit, found = _unit_of(block, location, numbers)
    problems += found
    if "prior" in block:
        prior: Any = _STAND_IN
        if unit is not None:
            difference = any(is_difference(path) for path in _paths(block, "sets"))
            prior = read_prior(block["prior"], unit, (*location, "prior"), difference=difference)
        if isinstance(prior, list):
            problems += prior
            prior = _STAND_IN
        block["prior"] = prior
    return {**block, "unit": unit or ""}, problems


def _unit_of(
    block: dict[str, Any], location: Location, numbers: Mapping[str, Settable]
) -> tuple[str | None, list[Problem]]:
    """SI unit of what the parameter sets, "" when it only scales; None where that cannot be known."""
    paths = _paths(block, "sets")
    if not paths:
        return ("" if _paths(block, "scales") else None), []
    known = {path: numbers[path].unit for path in paths if path in numbers}
    units = list(dict.fromkeys(known.values()))
    if len({(unit, is_difference(path)) for path, unit in known.items()}) > 1:
        kinds = {path: "temperature difference" if is_difference(path) else unit for path, unit in known.items()}
        found = " and ".join(f"{path} ({kind or 'dimensionless'})" for path, kind in kinds.items())
        return None, [Problem((*location, "sets"), f"found {found}, expected paths of one unit")]
    if units and units[0] and _paths(block, "scales"):
        message = f"found 'scales' beside 'sets' in {units[0]}, expected a plain number to do both, or two parameters"
        return units[0], [Problem((*location, "scales"), message)]
    return (units[0] if units else None), []


def _paths(block: dict[str, Any], key: str) -> list[str]:
    value = block.get(key)
    return [path for path in value if isinstance(path, str)] if isinstance(value, list) else []


def _unknown_paths(
    written: Any, location: Location, numbers: Mapping[str, Settable], draft: Draft
) -> Iterator[Problem]:
    places = {location: written} if isinstance(written, str) else {}
    if isinstance(written, list):
        places = {(*location, k): path for k, path in enumerate(written)}
    for place, path in places.items():
        if isinstance(path, str) and path not in numbers and not _may_exist(path, draft):
            yield Problem(place, _unknown_path(path, numbers, draft))


def _may_exist(path: str, draft: Draft) -> bool:
    """Whether the number may stand in a block that could not be read, whose own problems are reported."""
    section, _, rest = path.partition(".")
    if section == "environment":
        return draft.environment is None and draft.external is None
    if section == "inputs":
        return draft.external is not None and rest in draft.external.inputs and draft.external.inputs[rest] is None
    if section == "conductors":
        return None in draft.conductors
    if section == "loads":
        return rest.removesuffix(".coefficient") in draft.loads
    if section not in ("nodes", "faces", "heaters", "modes", "observations"):
        return False
    blocks = getattr(draft, section)
    name = rest.partition(".")[0]
    return name in blocks and blocks[name] is None


def _unknown_path(path: str, numbers: Mapping[str, Settable], draft: Draft) -> str:
    section, _, rest = path.partition(".")
    name, _, field = rest.rpartition(".")
    names = getattr(draft, section, ()) if section != "conductors" else {c.label for c in draft.conductors if c}
    if section == "nodes" and name in names and field == "initial":
        wanted = "another number: every window's initial temperatures are estimated, 'initial_state' is their prior"
        return f"found {path!r}, expected {wanted}"
    if section in _FIELDS and name in names and field in _FIELDS[section]:
        wanted = f"a number that stands in the scenario: write {field!r} in {section}.{name} first"
        return f"found {path!r}, expected {wanted}"
    if section == "environment" and name == "attitude_offset" and field in ("x", "y", "z"):
        wanted = "a number that stands in the scenario: write 'attitude_offset: {x: 0 deg}' in environment first"
        return f"found {path!r}, expected {wanted}"
    if section == "inputs" and draft.external is not None and rest in draft.external.inputs:
        wanted = "another input: every window's initial temperatures are estimated, 'initial_state' is their prior"
        return f"found {path!r}, expected {wanted}"
    like = next(iter(numbers), "inputs.link" if draft.external else "nodes.battery.capacity")
    return f"unknown path {path!r}, expected one such as {like!r}{did_you_mean(path, numbers)}"
