"""A scenario's text with calibrated numbers in it. Everything else in the text, comments too, stays as it is."""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from decimal import ROUND_DOWN, ROUND_HALF_EVEN, Context
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import ScenarioError
from .document import Location, walk
from .numbers import settable
from .priors import FORMS
from .schema import Parameter, Scenario, is_difference
from .units import WrittenUnit, read_any, unit_in, written_unit

if TYPE_CHECKING:
    from ruamel.yaml.nodes import Node

_DIGITS = 6
_LISTED = ("lower", "upper")
_PLAIN = re.compile(r"[A-Za-z]\w*")
"""Keys that need no quotes."""


class RewritingError(ScenarioError):
    """The text has a form in which single numbers cannot be replaced."""


def parameter_units(text: str, scenario: Scenario) -> dict[str, WrittenUnit]:
    """The unit in which a scenario's text writes each parameter's prior."""
    written = _Text(text)
    found = {}
    for name, parameter in scenario.parameters.items():
        prior = written.node(("parameters", name, "prior"))
        units = [unit_in(node.value) for node in _scalars(prior) if parameter.unit]
        chosen = next(filter(None, units), parameter.unit)
        found[name] = written_unit(chosen, parameter.unit, difference=any(map(is_difference, parameter.sets)))
    return found


def written_values(scenario: Scenario) -> dict[str, float]:
    """Each parameter as the scenario writes what it sets, SI (of several numbers the first); 1 where it only scales."""
    numbers = settable(scenario)
    return {
        name: numbers[parameter.sets[0]].value if parameter.sets else 1.0
        for name, parameter in scenario.parameters.items()
    }


def number_in(text: str, path: str) -> float | None:
    """The SI value of a number by its dotted path, in a scenario's text; None: it does not stand there."""
    written = _Text(text)
    try:
        node = written.node(_place(path, written))
        return None if node is None else read_any(node.value)[1]
    except (RewritingError, ValueError):
        return None


def calibrated_text(text: str, scenario: Scenario, means: Mapping[str, float], header: str = "") -> str:
    """The text of a scenario with its parameters at `means` (by name, SI), and paths of files absolute.

    A number that a parameter sets becomes the mean. One that it only scales is multiplied by the mean, and the prior
    of the factor is divided by it. So what is believed of every number is as before, and a calibration finds the same.
    means: ``initial.<node>`` replaces a node's `initial`, where one is written. header: stands above, as a comment.
    Raises RewritingError where numbers do not each stand at a place of their own.
    """
    written, numbers = _Text(text), settable(scenario)
    set_ones = {path for parameter in scenario.parameters.values() for path in parameter.sets}
    for path, value in calibrated_numbers(scenario, means).items():
        # What is scaled may stand at its bound: rounded down, no draw of the factor passes it.
        rounding = ROUND_HALF_EVEN if path in set_ones else ROUND_DOWN
        place = _place(path, written)
        unit, difference = numbers[path].unit, is_difference(path)
        written.put(place, _quantity(written.node(place), value, unit, difference=difference, rounding=rounding))
    for name, parameter in scenario.parameters.items():
        if not parameter.sets:
            _divide_prior(written, name, parameter, means[name])
    for name, mean in means.items():
        place = ("simulator", "nodes", name.removeprefix("initial."), "initial")
        if name.startswith("initial.") and written.node(place) is not None:
            written.put(place, _quantity(written.node(place), mean, "K"))
    for location, file in _files(scenario):
        written.put(location, json.dumps(str(file), ensure_ascii=False))
    comment = "".join(f"# {line}".rstrip() + "\n" for line in header.splitlines())
    return comment + written.text()


def calibrated_numbers(scenario: Scenario, means: Mapping[str, float]) -> dict[str, float]:
    """Dotted path -> SI value of every number that parameters at `means` (by name, SI) set, or only scale."""
    numbers, found = settable(scenario), {}
    for name, parameter in scenario.parameters.items():
        found.update(dict.fromkeys(parameter.sets, means[name]))
    for name, parameter in scenario.parameters.items():
        for path in () if parameter.sets else parameter.scales:
            found[path] = found.get(path, numbers[path].value) * means[name]
    return found


def _divide_prior(written: _Text, name: str, parameter: Parameter, mean: float) -> None:
    """Write a factor's prior over the mean; bounds are rounded inwards, so that no number passes its own."""
    if not mean > 0:
        raise RewritingError(f"{name}: scales by {mean:g}")
    kind = parameter.prior.kind
    for argument, role in FORMS[kind][1].items():
        if role == "number":
            continue
        location: Location = ("parameters", name, "prior", kind)
        if kind == "uniform":
            location = (*location, _LISTED.index(argument))
        elif kind != "half_normal":
            location = (*location, argument)
        value = getattr(parameter.prior, argument) / mean
        inwards = {"lower": -1, "upper": 1}.get(argument, 0) * math.copysign(1, value)
        written.put(location, _number(value, {-1: "ROUND_UP", 1: "ROUND_DOWN"}.get(int(inwards), ROUND_HALF_EVEN)))


def _place(path: str, written: _Text) -> Location:
    """Where in a scenario's text the number of a dotted path stands."""
    section, _, rest = path.partition(".")
    name, _, key = rest.rpartition(".")
    if section == "environment":
        return (section, *rest.split("."))
    if section == "observations":
        return (section, name, key)
    if section == "reduced":
        return ("simulator", section, rest)
    if section == "inputs":
        place: Location = ("simulator", section, rest)
        return (*place, "value") if written.is_mapping(place) else place
    if section == "conductors":
        return ("simulator", section, written.conductor(name), key)
    if section == "modes":
        modes = (mode for mode in written.keys(("simulator", section)) if rest.startswith(f"{mode}."))
        for mode in modes:
            if written.node(("simulator", section, mode, rest.removeprefix(f"{mode}."))) is not None:
                return ("simulator", section, mode, rest.removeprefix(f"{mode}."))
    return ("simulator", section, name, key)


def _files(scenario: Scenario) -> Iterator[tuple[Location, Path]]:
    """Where files are named, and their absolute paths."""
    for packet, block in scenario.telemetry.sources.items():
        place: Location = ("telemetry", "packets", packet, "file") if packet else ("telemetry", "file")
        for k, name in enumerate(block.file):
            yield (*place, k), (scenario.folder / name).absolute()
    written = scenario.model_dump(mode="json", exclude={"telemetry"})
    absolute = dict(walk(scenario.model_dump(mode="json", exclude={"telemetry"}, context=scenario.folder)))
    for location, value in walk(written):
        if isinstance(value, str) and value != absolute[location]:
            yield location, Path(absolute[location])


def _quantity(
    node: Node | None, value: float, unit: str, *, difference: bool = False, rounding: str = ROUND_HALF_EVEN
) -> str:
    """An SI value in the unit and the quotes of what stands there; in SI where nothing does."""
    name = unit if node is None else unit_in(node.value)
    number = _number(written_unit(name, unit, difference=difference).of(value), rounding)
    quote = getattr(node, "style", None) or ""
    return f"{quote}{f'{number} {name}'.strip()}{quote}"


def _number(value: float, rounding: str = ROUND_HALF_EVEN) -> str:
    """A number of six digits."""
    # First to what the sum of floats means: 0.011 * 1.1 is 0.0121, and not rounded down to 0.0120999.
    return f"{float(Context(prec=_DIGITS, rounding=rounding).create_decimal(f'{value:.12g}')):.{_DIGITS}g}"


def _scalars(node: Node | None) -> Iterator[Node]:
    """All scalars that are no keys."""
    if node is None or isinstance(node.value, str):
        yield from () if node is None else (node,)
        return
    for item in node.value:
        yield from _scalars(item[1] if isinstance(item, tuple) else item)


@dataclass
class _Text:
    """YAML text with the places of its values, and what is to stand there instead."""

    original: str
    root: Node = field(init=False)
    uses: Counter[int] = field(init=False)
    """Of each value: in how many places it stands; an alias is the value that it is of."""
    edits: dict[tuple[int, int], str] = field(default_factory=dict)
    """From and to which character -> what stands there instead."""
    added: dict[Location, dict[str, Any]] = field(default_factory=dict)
    """Mapping -> keys that it gets, with their values."""

    def __post_init__(self) -> None:
        from ruamel.yaml import YAML

        self.root = YAML(typ="safe", pure=True).compose(self.original)
        self.uses = Counter(_uses(self.root))

    def node(self, location: Location) -> Node | None:
        """What stands at a place; null: nothing. Of a list that is written as one value, its first is that value."""
        node = self.root
        for key in location:
            if isinstance(node.value, str):
                if key == 0:
                    continue
                return None
            if isinstance(key, int):
                if key >= len(node.value):
                    return None
                node = node.value[key]
            else:
                found = [value for name, value in self._items(node) if name == key]
                if not found:
                    return None
                node = found[0]
        return node

    def keys(self, location: Location) -> list[str]:
        """Of the mapping at a place."""
        node = self.node(location)
        return [] if node is None else [name for name, _ in self._items(node)]

    def is_mapping(self, location: Location) -> bool:
        """Whether a mapping stands there."""
        return bool(self.keys(location))

    def conductor(self, label: str) -> int:
        """Place in the list of conductors of the first one of this label."""
        conductors = self.node(("simulator", "conductors"))
        for k, node in enumerate(conductors.value if conductors is not None else ()):
            items = dict(self._items(node))
            ends = "-".join(str(end.value) for end in items["between"].value)
            if (items["name"].value if "name" in items else ends) == label:
                return k
        raise RewritingError(f"conductors: found no {label!r}")

    def put(self, location: Location, value: str) -> None:
        """Have a value stand at a place, where there is one or none."""
        node = self.node(location)
        if node is not None and not isinstance(node.value, str):
            raise RewritingError(f"{location}: found more than a value")
        if self._shared(location):
            raise RewritingError(f"{location}: found an alias")
        if node is not None:
            self.edits[node.start_mark.index, node.end_mark.index] = value
            return
        around = location[:-1]
        while self.node(around) is None:
            around = around[:-1]
        mapping, keys = self.node(around), location[len(around) :]
        if mapping is None or isinstance(mapping.value, str) or any(isinstance(key, int) for key in keys):
            raise RewritingError(f"{location}: found no mapping to write it in")
        inside = self.added.setdefault(around, {})
        for key in map(str, keys[:-1]):
            inside = inside.setdefault(key, {})
        inside[str(keys[-1])] = value

    def text(self) -> str:
        """The text with all that was put in."""
        edits = dict(self.edits)
        for around, values in self.added.items():
            place, after = self._beginning(around)
            edits[place, place] = "".join(f"{_key(key)}: {_flow(value)}{after}" for key, value in values.items())
        text = self.original
        for (start, end), value in sorted(edits.items(), reverse=True):
            text = text[:start] + value + text[end:]
        return text

    def _beginning(self, location: Location) -> tuple[int, str]:
        """Where a mapping's first key stands, and what is to stand between a new key and that."""
        mapping = self.node(location)
        if mapping is None or not mapping.value:
            raise RewritingError(f"{location}: found an empty mapping")
        start = mapping.value[0][0].start_mark
        return start.index, ", " if getattr(mapping, "flow_style", False) else "\n" + " " * start.column

    def _shared(self, location: Location) -> bool:
        """Whether what stands at a place, or around it, also stands elsewhere."""
        around = [self.node(location[:k]) for k in range(1, len(location) + 1)]
        return any(self.uses[id(node)] > 1 for node in around if node is not None)

    @staticmethod
    def _items(node: Node) -> list[tuple[str, Node]]:
        if isinstance(node.value, str) or any(not isinstance(item, tuple) for item in node.value):
            return []
        return [(key.value, value) for key, value in node.value]


def _key(name: str) -> str:
    return name if _PLAIN.fullmatch(name) else json.dumps(name, ensure_ascii=False)


def _flow(value: Any) -> str:
    """A value, or nested mappings of values, on one line."""
    if isinstance(value, str):
        return value
    return "{" + ", ".join(f"{_key(key)}: {_flow(inside)}" for key, inside in value.items()) + "}"


def _uses(node: Node) -> Iterator[int]:
    """Every value in a tree of nodes, as often as it is used."""
    yield id(node)
    for item in () if isinstance(node.value, str) else node.value:
        yield from _uses(item[1] if isinstance(item, tuple) else item)
