"""What does not fit the schema, in plain words."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from typing import Any

from pydantic import ValidationError
from pydantic_core import PydanticCustomError

from .document import Issue, Location
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
    "dataclass_type": "a mapping (key: value)",
    "tuple_type": "a list",
    "greater_than": "more than {gt:g}",
    "greater_than_equal": "at least {ge:g}",
    "less_than": "less than {lt:g}",
    "less_than_equal": "at most {le:g}",
    "too_short": "at least one entry",
}
_TOLD = "told"
"""Kind of an error whose message is in plain words."""

UNREADABLE = object()
"""Stands for a part of a block that could not be read; what is wrong with it has been said."""


def problems_of(error: ValidationError, location: Location = ()) -> list[Issue]:
    """One problem per place of a schema error; `location` is the place of what was to be read."""
    told = in_plain_words(error).errors(include_url=False)
    return [Issue((*location, *d["loc"]), d["msg"]) for d in told if d["input"] is not UNREADABLE]


def in_plain_words(error: ValidationError, keys: Collection[str] = ()) -> ValidationError:
    """A schema error with messages that a user understands.

    keys: what may be written in the block that could not be read; blocks inside it have told what is wrong with them.
    """
    details = error.errors(include_url=False)
    return _error([(*_translate(detail, keys), detail["input"]) for detail in details])


def refusal(*problems: Issue) -> ValidationError:
    """What the reader of a field raises about several places inside it."""
    return _error([(problem.location, problem.message, None) for problem in problems])


def unknown_key(key: str, keys: Collection[str]) -> str:
    """Message about a key that a block does not have."""
    return f"unknown key {show(key)}, expected {', '.join(keys)}{did_you_mean(key, keys)}"


def _error(told: list[tuple[Location, str, Any]]) -> ValidationError:
    return ValidationError.from_exception_data(
        "", [{"type": PydanticCustomError(_TOLD, message), "loc": at, "input": value} for at, message, value in told]
    )


def _translate(detail: Mapping[str, Any], keys: Collection[str]) -> tuple[Location, str]:
    location, kind, value, context = detail["loc"], detail["type"], detail["input"], detail.get("ctx", {})
    if kind == _TOLD:
        return location, detail["msg"]
    if kind == "missing":
        return location[:-1], f"missing key {location[-1]!r}"
    if kind in ("extra_forbidden", "unexpected_keyword_argument"):
        return location, unknown_key(str(location[-1]), keys)
    if kind == "value_error":
        return location, str(context["error"])
    if kind == "literal_error":
        valid = re.findall(r"'([^']*)'", context["expected"])
        hint = did_you_mean(value, valid) if isinstance(value, str) else ""
        return location, f"found {show(value)}, expected {context['expected'].replace(chr(39), '')}{hint}"
    expected = _EXPECTED.get(kind, "something else").format(**context)
    quotes = " (in quotes)" if kind == "string_type" and isinstance(value, (int, float)) else ""
    return location, f"found {show(value)}, expected {expected}{quotes}"
