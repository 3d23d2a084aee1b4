"""What does not fit the schema, in plain words."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from types import UnionType
from typing import Annotated, Any, get_args, get_origin

from pydantic import ValidationError

from . import environment, external, network, priors, residuals, schema
from .document import Location, Problem
from .fields import FILLED_IN, Block
from .units import did_you_mean, show

_EXPECTED = {
    "string_type": "text",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "finite_number": "a finite number",
    "bool_type": "true or false",
    "dict_type": "a mapping (key: value)",
    "model_type": "a mapping (key: value)",
    "tuple_type": "a list",
    "greater_than": "more than {gt:g}",
    "greater_than_equal": "at least {ge:g}",
    "less_than": "less than {lt:g}",
    "less_than_equal": "at most {le:g}",
    "too_short": "at least one entry",
}
_TAGS = {
    f"<{name}>": kind
    for module in (environment, external, network, priors, residuals, schema)
    for name, kind in vars(module).items()
    if isinstance(kind, type) and issubclass(kind, Block)
}
_TAGS |= dict.fromkeys(("<named>", "<vector>", "<all>", "<number>"), Block)
"""What pydantic puts into a location to say which part of a union it chose."""


UNREADABLE = object()
"""Stands for a part of a block that could not be read; what is wrong with it has been said."""


def problems_of(error: ValidationError, kind: Any = schema.Scenario, location: Location = ()) -> list[Problem]:
    """One problem per place of a schema error; `kind` is what was to be read, and `location` its place."""
    told = [_translate(d, kind) for d in error.errors(include_url=False) if d["input"] is not UNREADABLE]
    return [Problem((*location, *inside), message) for inside, message in told]


def _translate(detail: Mapping[str, Any], root: Any) -> tuple[Location, str]:
    kind, value, context = detail["type"], detail["input"], detail.get("ctx", {})
    location = tuple(part for part in detail["loc"] if part not in _TAGS)
    if kind == "missing":
        return location[:-1], f"missing key {location[-1]!r}"
    if kind == "extra_forbidden":
        keys = _keys_at(detail["loc"][:-1], root)
        return location, unknown_key(str(detail["loc"][-1]), keys)
    if kind == "value_error":
        return location, str(context["error"])
    if kind == "told":
        return location, detail["msg"]
    if kind == "literal_error":
        valid = re.findall(r"'([^']*)'", context["expected"])
        hint = did_you_mean(value, valid) if isinstance(value, str) else ""
        return location, f"found {show(value)}, expected {context['expected'].replace(chr(39), '')}{hint}"
    if kind == "no_such_block":
        return location, f"found {show(value)}, expected {detail['msg']}"
    expected = _EXPECTED.get(kind, "something else").format(**context)
    quotes = " (in quotes)" if kind == "string_type" and isinstance(value, (int, float)) else ""
    return location, f"found {show(value)}, expected {expected}{quotes}"


def unknown_key(key: str, keys: Iterable[str]) -> str:
    """Message about a key that a block does not have."""
    return f"unknown key {show(key)}, expected {', '.join(keys)}{did_you_mean(key, keys)}"


def written_keys(block: type[Block]) -> list[str]:
    """What a user may write in a block: all fields but those that flightcal fills in."""
    return [name for name, field in block.model_fields.items() if FILLED_IN not in field.metadata]


def _keys_at(location: Location, root: Any) -> list[str]:
    """Valid keys of the block at a location as pydantic gives it, with the tags of unions."""
    here = _bare(root)
    for part in location:
        if part in _TAGS:
            here = _TAGS[str(part)]
        elif isinstance(here, type) and issubclass(here, Block):
            here = here.model_fields[str(part)].annotation
        else:  # dict[str, X] or tuple[X, ...]
            here = next(kind for kind in get_args(here) if kind is not str)
        here = _bare(here)
    return written_keys(here)


def _bare(kind: Any) -> Any:
    """A block or a collection of blocks, whatever surrounds it."""
    if get_origin(kind) is Annotated:
        return _bare(get_args(kind)[0])
    if isinstance(kind, UnionType):  # X | None
        return _bare(next(part for part in get_args(kind) if part is not type(None)))
    return kind
