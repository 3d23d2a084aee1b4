"""Quantities with written units become SI floats at the door; nothing inside flightcal carries a unit."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Annotated, Any

import pint
from pydantic import BeforeValidator, WithJsonSchema


@lru_cache(maxsize=1)
def registry() -> pint.UnitRegistry:
    """The one unit registry (building it takes 0.2 s, so only when a unit is read)."""
    return pint.UnitRegistry(autoconvert_offset_to_baseunit=True)


def to_si(value: Any, unit: str) -> float:
    """A written quantity such as ``"0.8 W/K"`` as a float in the SI unit `unit`.

    `unit` "" means dimensionless: a plain number. Raises ValueError saying what was found and what was expected.
    """
    expected = f"a quantity in {unit} or a unit convertible to it, such as '{example(unit)}'" if unit else "a number"
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise ValueError(f"found {value!r}, expected {expected}")
    if isinstance(value, (int, float)):
        if unit:
            raise ValueError(f"found {value!r} without a unit, expected {expected}")
        return _finite(float(value), value)
    try:
        number, written_unit = _split(value)
        converted = float(registry().Quantity(number, written_unit or "dimensionless").to(unit or "dimensionless").magnitude)
    except pint.DimensionalityError:
        raise ValueError(f"found {value!r}, whose unit is {_dimension(value)}; expected {expected}") from None
    except pint.UndefinedUnitError as error:
        raise ValueError(f"found {value!r}: unknown unit {', '.join(error.unit_names)!r}; expected {expected}") from None
    except Exception:
        raise ValueError(f"found {value!r}, expected {expected}") from None
    if unit and not written_unit:
        raise ValueError(f"found {value!r} without a unit, expected {expected}")
    return _finite(converted, value)


def example(unit: str) -> str:
    """A quantity a user might write where `unit` is wanted."""
    return {"K": "20 degC", "s": "60 s", "m": "693 km", "rad": "98.2 deg"}.get(unit, f"1 {unit}")


def _split(text: str) -> tuple[float, str]:
    number, _, unit = text.strip().partition(" ")
    return float(number), unit.strip()


def _dimension(text: str) -> str:
    dimension = str(registry().Unit(_split(text)[1]).dimensionality)
    return "dimensionless" if dimension == "dimensionless" else dimension


def _finite(number: float, found: Any) -> float:
    if not math.isfinite(number):
        raise ValueError(f"found {found!r}, expected a finite number")
    return number


def quantity(unit: str, *, above: float | None = None, at_least: float | None = None, at_most: float | None = None) -> Any:
    """An annotated float: read from a written quantity, converted to SI `unit`, checked against its bounds (SI)."""

    def read(value: Any) -> float:
        number = to_si(value, unit)
        if above is not None and not number > above:
            raise ValueError(f"found {value!r}, expected more than {above:g} {unit}".rstrip())
        if at_least is not None and number < at_least:
            raise ValueError(f"found {value!r}, expected at least {at_least:g} {unit}".rstrip())
        if at_most is not None and number > at_most:
            raise ValueError(f"found {value!r}, expected at most {at_most:g} {unit}".rstrip())
        return number

    schema = (
        {"type": "string", "description": f"a quantity in {unit}", "examples": [example(unit)]}
        if unit
        else {"type": "number"}
    )
    return Annotated[float, BeforeValidator(read), WithJsonSchema(schema)]


Temperature = quantity("K", at_least=0.0)
Duration = quantity("s", above=0.0)
Angle = quantity("rad")
