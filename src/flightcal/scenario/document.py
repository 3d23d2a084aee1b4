"""A YAML 1.2 file as plain Python values that remember their lines."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .units import show

if TYPE_CHECKING:
    from ruamel.yaml import YAML
    from ruamel.yaml.nodes import Node

Location = tuple[str | int, ...]

_MAX_VALUES = 100_000
"""A scenario has thousands; anchors that multiply themselves are cut off here."""
_HINTS = {
    "'\\t'": "indent with spaces, not tabs",
    "mapping values are not allowed": "a value with ': ' in it stands in quotes; keys of a block start in one column",
    "another document": "a scenario is one document, so without a second '---'",
}
_TOKEN = re.compile(r"\(?'<([a-z ]+)>',?\)?")
_TOKEN_NAMES = {"scalar": "a value", "stream end": "the end of the file", "document start": "'---'"}
_MAX_DIGITS = 18
"""Of a whole number: what 64 bits hold."""
_BASES = {"0x": 16, "0o": 8, "0b": 2}
_KINDS = ("str", "int", "float", "bool", "null", "timestamp", "merge", "value")


@dataclass(frozen=True)
class Issue:
    """Something wrong, or doubtful, at a place in the document."""

    location: Location
    message: str
    line: int | None = None
    """Where the place has no line of its own (syntax); null: the line of the location."""
    warning: bool = False
    """It could be meant, so the file can be used as it is."""


@dataclass(frozen=True)
class Document:
    """What a YAML file says: mappings as dict, sequences as list, scalars as str, int, float, bool or None."""

    data: Any
    lines: dict[Location, int]
    """Line (from 1) on which each key or list item stands."""
    problems: tuple[Issue, ...]
    """Syntax errors, duplicate keys, unknown tags."""

    def line(self, location: Location) -> int | None:
        """The line of `location`, or of the nearest thing around it."""
        return next(
            (self.lines[location[:k]] for k in range(len(location), -1, -1) if location[:k] in self.lines), None
        )


def read_document(path: Path) -> Document:
    """The YAML file at `path`; anything wrong with it as YAML is among the problems, and never raised."""
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except IsADirectoryError:
        return _unreadable("found a folder, expected a scenario file")
    except OSError as error:
        return _unreadable(f"cannot be read: {error.strerror}")
    except UnicodeDecodeError as error:
        line = path.read_bytes()[: error.start].count(b"\n") + 1
        return _unreadable(f"found the byte 0x{error.object[error.start]:02x}, expected text encoded as UTF-8", line)
    return parse_document(text)


def parse_document(text: str) -> Document:
    """YAML text; see `read_document`."""
    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError, YAMLError

    yaml = YAML(typ="safe", pure=True)
    try:
        root = yaml.compose(text)
        reader = _Reader(yaml)
        data = None if root is None else reader.read(root, (), ())
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        what = _TOKEN.sub(_name_token, " ".join(str(error.problem or error.context or "unreadable").split()))
        hint = next((f" ({hint})" for symptom, hint in _HINTS.items() if symptom in what), "")
        return _unreadable(f"not well-formed YAML: {what}{hint}", mark.line + 1 if mark else None)
    except (YAMLError, ValueError) as error:
        return _unreadable(f"not well-formed YAML: {str(error).splitlines()[0]}")
    except RecursionError:
        return _unreadable("not a scenario: values are nested too deeply")
    if data is None and not reader.problems:
        return _unreadable("found an empty file, expected a scenario", 1)
    return Document(data, reader.lines, tuple(reader.problems))


def _name_token(match: re.Match[str]) -> str:
    return _TOKEN_NAMES.get(match[1], f"the {match[1]}")


def walk(value: Any, location: Location = ()) -> Iterator[tuple[Location, Any]]:
    """Every value in nested mappings and lists, with its location, outermost first."""
    yield location, value
    parts = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, part in parts:
        yield from walk(part, (*location, key))


def _unreadable(message: str, line: int | None = None) -> Document:
    return Document(None, {}, (Issue((), message, line),))


@dataclass
class _Reader:
    """Turns YAML nodes into values and collects lines and problems on the way."""

    yaml: YAML
    lines: dict[Location, int] = field(default_factory=dict)
    problems: list[Issue] = field(default_factory=list)

    def read(self, node: Node, location: Location, parents: tuple[int, ...]) -> Any:
        self.lines.setdefault(location, node.start_mark.line + 1)
        if id(node) in parents:
            raise ValueError("an alias contains itself")
        if len(self.lines) > _MAX_VALUES:
            raise ValueError(f"more than {_MAX_VALUES} values")
        kind = str(node.tag).removeprefix("tag:yaml.org,2002:")
        parents = (*parents, id(node))
        if kind == "map":
            return self._mapping(node, location, parents)
        if kind == "seq":
            return [self.read(item, (*location, k), parents) for k, item in enumerate(node.value)]
        if isinstance(node.value, str) and kind in _KINDS:
            return _scalar(kind, node.value)
        self.problems.append(Issue(location, f"found the YAML tag {show(str(node.tag))}, expected a plain value"))
        return None

    def _mapping(self, node: Node, location: Location, parents: tuple[int, ...]) -> dict[str, Any]:
        mapping: dict[str, Any] = {}
        for key_node, value_node in node.value:
            line = key_node.start_mark.line + 1
            if not isinstance(key_node.value, str):
                self.problems.append(Issue(location, "found a list or mapping as a key, expected a name", line))
                continue
            key, here = key_node.value, (*location, key_node.value)
            if key == "<<" and not key_node.style:
                self.problems.append(Issue(here, "merge keys (<<) are not YAML 1.2; write the values out", line))
                continue
            if key in mapping:
                first = self.lines[here]
                self.problems.append(Issue(here, f"found the key twice, first on line {first}", line))
                continue
            self.lines[here] = line
            mapping[key] = self.read(value_node, here, parents)
        return mapping


def _scalar(kind: str, text: str) -> Any:
    """A scalar of YAML's core schema; a time stamp stays text, as does what only looks like a number."""
    if kind == "null":
        return None
    if kind == "bool" and text.lower() in ("true", "false"):
        return text.lower() == "true"
    digits = text.replace("_", "").lower()
    try:
        if kind == "int" and len(digits) <= _MAX_DIGITS:
            return int(digits, _BASES.get(digits.lstrip("+-")[:2], 10))
        if kind in ("int", "float"):
            return float(digits.replace(".inf", "inf").replace(".nan", "nan"))
    except ValueError:
        pass
    return text
