"""What is believed of a number before there is telemetry: priors, and how they are written.

``{uniform: [0.5 W/K, 2 W/K]}`` becomes a prior in SI, and back.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any, Literal, cast, get_args

from pydantic import Field
from pydantic_core import core_schema

from .document import Issue, Location
from .fields import Block, Number
from .units import LARGEST, Quantity, did_you_mean, example, quantity_schema, show, to_si, written
from .wording import refusal


class Uniform(Block):
    """Uniform between two bounds."""

    kind: Literal["uniform"] = "uniform"
    lower: Number
    upper: Number


class Normal(Block):
    """Normal."""

    kind: Literal["normal"] = "normal"
    mean: Number
    standard_deviation: Number = Field(gt=0)


class TruncatedNormal(Block):
    """Normal cut at two bounds."""

    kind: Literal["truncated_normal"] = "truncated_normal"
    mean: Number
    standard_deviation: Number = Field(gt=0)
    lower: Number
    upper: Number


class LogNormal(Block):
    """Log-normal: about 68% of the probability lies between median / factor and median * factor."""

    kind: Literal["lognormal"] = "lognormal"
    median: Number = Field(gt=0)
    factor: Number = Field(gt=1)


class HalfNormal(Block):
    """Half-normal."""

    kind: Literal["half_normal"] = "half_normal"
    scale: Number = Field(gt=0)


class HalfStudentT(Block):
    """Half of Student's t distribution: like a half-normal near zero, with a heavy tail."""

    kind: Literal["half_student_t"] = "half_student_t"
    scale: Number = Field(gt=0)
    degrees_of_freedom: Number = Field(gt=0)


class Beta(Block):
    """Beta distribution on [lower, upper]."""

    kind: Literal["beta"] = "beta"
    alpha: Number = Field(gt=0)
    beta: Number = Field(gt=0)
    lower: Number = 0.0
    upper: Number = 1.0


Prior = Uniform | Normal | TruncatedNormal | LogNormal | HalfNormal | HalfStudentT | Beta

# --- how they are written ----------------------------------------------------------------------------------------

FORMS: dict[str, tuple[type[Prior], dict[str, str]]] = {
    "uniform": (Uniform, {"lower": "value", "upper": "value"}),
    "normal": (Normal, {"mean": "value", "standard_deviation": "spread"}),
    "truncated_normal": (
        TruncatedNormal,
        {"mean": "value", "standard_deviation": "spread", "lower": "value", "upper": "value"},
    ),
    "lognormal": (LogNormal, {"median": "value", "factor": "number"}),
    "half_normal": (HalfNormal, {"scale": "spread"}),
    "half_student_t": (HalfStudentT, {"scale": "spread", "degrees_of_freedom": "number"}),
    "beta": (Beta, {"alpha": "number", "beta": "number", "lower": "value", "upper": "value"}),
}
"""Distribution -> its class, and what each of its arguments is: a value, a spread or a plain number."""
_ABOVE = {
    "standard_deviation": 0.0,
    "scale": 0.0,
    "median": 0.0,
    "factor": 1.0,
    "degrees_of_freedom": 0.0,
    "alpha": 0.0,
    "beta": 0.0,
}
_AT_MOST = {"factor": 1e3, "degrees_of_freedom": 1e6, "alpha": 1e6, "beta": 1e6}
"""Wider, or narrower, nobody means a prior to be."""
_NAMES = ", ".join(FORMS)


def read_prior(value: Any, unit: str, *, difference: bool = False) -> Prior:
    """The prior written as `value` for a quantity in SI `unit`; one that has been read stays as it is.

    difference: of two temperatures. Standard deviations and scales always are differences.
    Raises ValidationError, with the places in `value`.
    """
    if isinstance(value, get_args(Prior)):
        return cast(Prior, value)
    if not isinstance(value, dict) or len(value) != 1:
        found = "none" if value == {} else " and ".join(map(repr, value)) if isinstance(value, dict) else show(value)
        wanted = f"one distribution such as {{uniform: [{example(unit)}, ...]}}: {_NAMES}"
        raise refusal(Issue((), f"found {found}, expected {wanted}"))
    ((kind, arguments),) = value.items()
    if kind not in FORMS:
        message = f"unknown distribution {kind!r}, expected one of {_NAMES}{did_you_mean(kind, FORMS)}"
        raise refusal(Issue((kind,), message))
    make, fields = FORMS[kind]
    places: dict[str, Location] = {name: (kind, name) for name in fields}
    if kind == "uniform":
        if not isinstance(arguments, list) or len(arguments) != 2:
            raise refusal(Issue((kind,), f"found {show(arguments)}, expected two bounds [lower, upper]"))
        places = {"lower": (kind, 0), "upper": (kind, 1)}
        arguments = dict(zip(fields, arguments, strict=True))
    elif kind == "half_normal":
        places = {"scale": (kind,)}
        arguments = {"scale": arguments}
    elif not isinstance(arguments, dict):
        raise refusal(Issue((kind,), f"found {show(arguments)}, expected a mapping with {', '.join(fields)}"))
    if kind == "beta" and not unit:
        arguments = {"lower": 0.0, "upper": 1.0, **arguments}
    problems = [
        Issue((kind, key), f"unknown key {key!r}, expected {', '.join(fields)}{did_you_mean(key, fields)}")
        for key in arguments
        if key not in fields
    ]
    numbers = {}
    for name, role in fields.items():
        if name not in arguments:
            problems.append(Issue((kind,), f"missing key {name!r}"))
            continue
        try:
            numbers[name] = _read_number(arguments[name], name, role, unit, difference)
        except ValueError as error:
            problems.append(Issue(places[name], str(error)))
    if not problems and not numbers.get("lower", -math.inf) < numbers.get("upper", math.inf):
        found = f"found {show(arguments['lower'])} and {show(arguments['upper'])}"
        problems.append(Issue(places["upper"], f"{found}, expected a lower bound below the upper one"))
    if problems:
        raise refusal(*problems)
    return make(**numbers)


def _read_number(value: Any, name: str, role: str, unit: str, difference: bool) -> float:
    if role == "number":
        number = to_si(value, "")
    else:
        number = to_si(value, unit, difference=unit == "K" and (difference or role == "spread"))
    if name in _ABOVE and not number > _ABOVE[name]:
        raise ValueError(f"found {show(value)}, expected more than {_ABOVE[name]:g}")
    if number > _AT_MOST.get(name, LARGEST):
        raise ValueError(f"found {show(value)}, expected at most {_AT_MOST.get(name, LARGEST):g}")
    return number


def written_prior(prior: Prior, unit: str) -> dict[str, Any]:
    """The prior as a user writes it; `read_prior` gives it back."""
    _, fields = FORMS[prior.kind]
    values = {
        name: getattr(prior, name) if role == "number" else written(getattr(prior, name), unit)
        for name, role in fields.items()
    }
    if prior.kind == "uniform":
        return {"uniform": [values["lower"], values["upper"]]}
    return {prior.kind: values["scale"] if prior.kind == "half_normal" else values}


def support(prior: Prior) -> tuple[float, float]:
    """The interval outside of which the prior has no probability, SI."""
    if isinstance(prior, (Uniform, TruncatedNormal, Beta)):
        return prior.lower, prior.upper
    return (0.0 if isinstance(prior, (LogNormal, HalfNormal, HalfStudentT)) else -math.inf), math.inf


def prior_schema() -> dict[str, Any]:
    """JSON Schema of a written prior, whatever its unit."""
    value = {"anyOf": [quantity_schema(""), quantity_schema("K")]}
    kinds = []
    for name, (make, fields) in FORMS.items():
        properties = {field: {"type": "number"} if role == "number" else value for field, role in fields.items()}
        form: dict[str, Any] = {
            "type": "object",
            "properties": properties,
            "required": [field for field in fields if name != "beta" or field in ("alpha", "beta")],
            "additionalProperties": False,
        }
        if name == "uniform":
            form = {"type": "array", "prefixItems": [value, value], "minItems": 2, "maxItems": 2}
        elif name == "half_normal":
            form = value
        kinds.append(
            {
                "type": "object",
                "description": make.__doc__,
                "properties": {name: form},
                "required": [name],
                "additionalProperties": False,
            }
        )
    return {
        "description": f"A prior: one of {_NAMES}; numbers carry the unit of what the parameter sets.",
        "oneOf": kinds,
    }


# --- an uncertain number ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Uncertain(Quantity):
    """Marks a number that is known or has a prior: a float or a Prior in SI, and how both are written."""

    def read(self, value: Any) -> Any:
        """The written number or prior in SI. Raises ValueError."""
        if isinstance(value, (dict, *get_args(Prior))):
            return read_prior(value, self.unit, difference=self.difference)
        return super().read(value)

    def write(self, number: Any) -> Any:
        """The number or prior as a user writes it."""
        return super().write(number) if isinstance(number, float) else written_prior(number, self.unit)

    def __get_pydantic_json_schema__(self, schema: core_schema.CoreSchema, handler: Any) -> dict[str, Any]:
        return {"anyOf": [quantity_schema(self.unit), prior_schema()]}


UncertainDeviation = Annotated[Prior | float, Uncertain("K", above=0.0, difference=True)]
UncertainDuration = Annotated[Prior | float, Uncertain("s", above=0.0)]
UncertainNumber = Annotated[Prior | float, Uncertain("", above=0.0)]
