"""Reads parameters: their units follow from the numbers that they set.

In a path `*` stands for any text, `?` for one character; brackets are part of the names of cells.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from .blocks import Blocks, read_block
from .document import Issue, Location
from .network import SwitchedHeater
from .numbers import Settable, fields_in
from .priors import Normal
from .schema import Parameter, is_difference
from .units import did_you_mean

_NOT_READ = Normal(mean=0.0, standard_deviation=1.0)
"""In the place of a prior whose unit is not known."""


def read_parameters(
    written: Mapping[str, Any], numbers: Mapping[str, Settable], blocks: Blocks
) -> tuple[dict[str, Parameter | None], list[Issue]]:
    """Parameters with their priors in the SI unit of what they set, None where one is wrong, and what is wrong."""
    problems: list[Issue] = []
    return {
        name: _read(value, ("parameters", name), numbers, blocks, problems) for name, value in written.items()
    }, problems


def matching(pattern: str, names: Iterable[str]) -> list[str]:
    """The names that fit, in their order."""
    expression = "".join({"*": ".*", "?": "."}.get(character, re.escape(character)) for character in pattern)
    fits = re.compile(expression).fullmatch
    return [name for name in names if fits(name)]


def set_twice(parameters: Mapping[str, Parameter]) -> Iterator[Issue]:
    """Numbers that several parameters set, or that one sets and another scales."""
    setter: dict[str, str] = {}
    for name, parameter in parameters.items():
        for path in parameter.sets:
            if path in setter:
                message = f"found {path!r}, which {setter[path]!r} already sets, expected one parameter for it"
                yield Issue(("parameters", name, "sets"), message)
            setter.setdefault(path, name)
    for name, parameter in parameters.items():
        for k, path in enumerate(parameter.scales):
            if path in setter:
                message = f"found {path!r}, which {setter[path]!r} sets, expected either to set or to scale it"
                yield Issue(("parameters", name, "scales"), message)
            elif path in parameter.scales[:k]:
                yield Issue(("parameters", name, "scales"), f"found {path!r} twice, expected it once")


def _read(
    value: Any, location: Location, numbers: Mapping[str, Settable], blocks: Blocks, problems: list[Issue]
) -> Parameter | None:
    if not isinstance(value, dict):
        read: Parameter | None = read_block(Parameter, value, location, problems)
        return read
    value, found = _written_out(value, location, numbers, blocks)
    if "unit" in value:
        message = "unknown key 'unit', expected none: the unit follows from the path that the parameter sets"
        found.append(Issue((*location, "unit"), message))
    for key in ("sets", "scales"):
        found += [
            Issue(place, _unknown_path(path, numbers, blocks))
            for place, path in _paths(value, key, location).items()
            if path not in numbers and not _is_pattern(path) and not _may_exist(path, blocks)
        ]
    unit, wrong = _unit_of(value, location, numbers)
    found += wrong
    if unit is None and "prior" in value:
        value = {**value, "prior": _NOT_READ}
    read = read_block(Parameter, {**value, "unit": unit or ""}, location, found)
    if read is not None and not found and not (read.sets or read.scales):
        message = "found neither 'sets' nor 'scales', expected a path such as nodes.battery.capacity"
        found.append(Issue(location, message))
    problems += found
    return None if found or unit is None else read


def _written_out(
    block: dict[str, Any], location: Location, numbers: Mapping[str, Settable], blocks: Blocks
) -> tuple[dict[str, Any], list[Issue]]:
    """The block with all paths that fit in the place of each pattern, and the patterns that fit none."""
    problems: list[Issue] = []
    block = dict(block)
    for key in ("sets", "scales"):
        paths = block.get(key)
        if not any(map(_is_pattern, _paths(block, key, location).values())):
            continue
        found: list[Any] = []
        for path in [paths] if isinstance(paths, str) else paths or []:
            fits = matching(path, numbers) if _is_pattern(path) else [path]
            if not fits and not _is_unread(path.partition(".")[0], blocks):
                problems.append(Issue((*location, key), f"found {path!r}, which fits no number"))
            found += fits or [path]
        block[key] = found
    return block, problems


def _is_unread(section: str, blocks: Blocks) -> bool:
    """Whether a block of the section could not be read, whose own problems are reported."""
    held = getattr(blocks, section, ())
    return None in (held.values() if isinstance(held, dict) else held if isinstance(held, tuple) else ())


def _is_pattern(path: Any) -> bool:
    return isinstance(path, str) and ("*" in path or "?" in path)


def _unit_of(
    block: dict[str, Any], location: Location, numbers: Mapping[str, Settable]
) -> tuple[str | None, list[Issue]]:
    """SI unit of what the parameter sets, "" when it only scales; None where that cannot be known."""
    paths, scales = (_paths(block, key, location) for key in ("sets", "scales"))
    if not paths and scales:
        return "", []
    known = {path: numbers[path].unit for path in paths.values() if path in numbers}
    units = list(dict.fromkeys(known.values()))
    if len({(unit, is_difference(path)) for path, unit in known.items()}) > 1:
        kinds = {path: "temperature difference" if is_difference(path) else unit for path, unit in known.items()}
        found = " and ".join(f"{path} ({kind or 'dimensionless'})" for path, kind in kinds.items())
        return None, [Issue((*location, "sets"), f"found {found}, expected paths of one unit")]
    if units and units[0] and scales:
        message = f"found 'scales' beside 'sets' in {units[0]}, expected a plain number to do both, or two parameters"
        return units[0], [Issue((*location, "scales"), message)]
    return (units[0] if units else None), []


def _paths(block: dict[str, Any], key: str, location: Location) -> dict[Location, str]:
    """The paths under a key by where they stand, as far as they are text."""
    written, here = block.get(key), (*location, key)
    if isinstance(written, str):
        return {here: written}
    listed = written if isinstance(written, list) else []
    return {(*here, k): path for k, path in enumerate(listed) if isinstance(path, str)}


def _may_exist(path: str, blocks: Blocks) -> bool:
    """Whether the number may stand in a block that could not be read, whose own problems are reported."""
    section, _, rest = path.partition(".")
    if section == "environment":
        return blocks.environment is None and blocks.external is None
    if section == "inputs":
        return blocks.external is not None and rest in blocks.external.inputs and blocks.external.inputs[rest] is None
    if section == "conductors":
        return None in blocks.conductors
    if section == "loads":
        return rest.removesuffix(".coefficient") in blocks.loads
    if section not in ("nodes", "faces", "heaters", "modes", "observations"):
        return False
    section_blocks = getattr(blocks, section)
    name = rest.partition(".")[0] if section == "modes" else rest.rpartition(".")[0]
    return name in section_blocks and section_blocks[name] is None


def _unknown_path(path: str, numbers: Mapping[str, Settable], blocks: Blocks) -> str:
    section, _, rest = path.partition(".")
    name, _, field = rest.rpartition(".")
    names = getattr(blocks, section, ()) if section != "conductors" else {c.label for c in blocks.conductors if c}
    if section == "nodes" and name in names and field == "initial":
        wanted = "another number: every window's initial temperatures are estimated, 'initial_state' is their prior"
        return f"found {path!r}, expected {wanted}"
    has_thermostat = section != "heaters" or not isinstance(blocks.heaters.get(name), SwitchedHeater)
    if name in names and field in fields_in(section) and has_thermostat:
        wanted = f"a number that stands in the scenario: write {field!r} in {section}.{name} first"
        return f"found {path!r}, expected {wanted}"
    if section == "environment" and name == "attitude_offset" and field in ("x", "y", "z"):
        wanted = "a number that stands in the scenario: write 'attitude_offset: {x: 0 deg}' in environment first"
        return f"found {path!r}, expected {wanted}"
    if section == "inputs" and blocks.external is not None and rest in blocks.external.inputs:
        wanted = "another input: every window's initial temperatures are estimated, 'initial_state' is their prior"
        return f"found {path!r}, expected {wanted}"
    turned = f"conductors.{'-'.join(reversed(name.split('-')))}.{field}"
    if section == "conductors" and turned in numbers:
        return f"found {path!r}, expected {turned!r}: a conductor's nodes in the order in which its 'between' has them"
    like = next(iter(numbers), "inputs.link" if blocks.external else "nodes.battery.capacity")
    return f"unknown path {path!r}, expected one such as {like!r}{did_you_mean(path, numbers)}"
