"""Quantities with written units become SI floats at the door; nothing inside flightcal carries a unit."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, Any

from pydantic_core import core_schema

if TYPE_CHECKING:
    import pint

# What a unit measures, in words. Its unit is the name that the SI unit of the dimension gets.
_KINDS = {
    "dimensionless": "a plain number",
    "K": "a temperature",
    "s": "a time",
    "m": "a length",
    "m^2": "an area",
    "m^3": "a volume",
    "m/s": "a speed",
    "kg": "a mass",
    "J": "an energy",
    "W": "a power",
    "J/K": "a heat capacity",
    "W/K": "a conductance",
    "W/m^2": "a heat flux",
    "A": "an electric current",
    "V": "a voltage",
    "C": "an electric charge",
    "ohm": "a resistance",
    "F": "a capacitance",
    "Hz": "a frequency",
    "Pa": "a pressure",
    "N": "a force",
    "T": "a magnetic flux density",
}
_EXAMPLES = {"K": "20 degC", "s": "60 s", "m": "693 km", "rad": "98.2 deg"}
_COMMON = (
    *(unit for unit in _KINDS if unit not in ("C", "F", "T", "N")),
    *("degC", "degF", "deg", "rad", "mW", "kW", "kJ/K", "mA", "mV", "min", "hour", "day", "km", "cm^2"),
    *("kelvin", "watt", "joule", "metre", "second", "minute", "ampere", "volt", "W/m^2/K", "percent"),
)
_NUMBER = re.compile(r"\s*([-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*", re.DOTALL)
_UNIT_TEXT = re.compile(r"[\w\s*/^().%°·Ω+-]{1,60}")
# pint evaluates numbers and powers of powers in a unit; a long one could run for ever.
_ARITHMETIC = re.compile(r"\d{3}|[\d)]\s*(\*\*|\^)")
ICE_POINT = 273.15
"""K, at 0 degC."""
LARGEST = 1e30
"""Of any number, SI: powers of it, as those of temperatures, stay finite."""
_OFFSET_UNITS = ("degree_Celsius", "degree_Fahrenheit", "degree_Reaumur")


@lru_cache(maxsize=1)
def registry() -> pint.UnitRegistry:
    """The one unit registry (building it takes 0.2 s, so only when a unit is read)."""
    import pint

    return pint.UnitRegistry(autoconvert_offset_to_baseunit=True)


@lru_cache(maxsize=1000)
def parse_unit(text: str) -> pint.Unit:
    """The unit written as `text`; "" and "1" are dimensionless. Raises ValueError: unknown unit."""
    try:
        if _ARITHMETIC.search(text) or (text and not _UNIT_TEXT.fullmatch(text)):
            raise ValueError
        return registry().parse_units("" if text == "1" else text)
    except Exception as error:  # pint raises half a dozen kinds for text that is no unit
        name = next(iter(getattr(error, "unit_names", ())), text)
        raise ValueError(f"unknown unit {show(name)}{did_you_mean(name, _COMMON)}") from None


def did_you_mean(name: str, valid: Iterable[str]) -> str:
    """A hint at the valid name nearest to `name`, capitals disregarded: "; did you mean 'degC'?", or ""."""
    small = {candidate.lower(): candidate for candidate in valid}
    nearest = difflib.get_close_matches(name.lower(), small, n=1)
    return f"; did you mean {small[nearest[0]]!r}?" if nearest else ""


def is_temperature(unit: str) -> bool:
    """Whether `unit` is one that absolute temperatures are written in (K, degC, degF)."""
    parsed = parse_unit(unit)
    return str(parsed) in ("kelvin", *_OFFSET_UNITS) or (
        parsed.is_compatible_with("K") and not str(parsed).startswith("delta_")
    )


def kind_of(unit: str) -> str:
    """What a unit measures, in words: "an angle", "a power". Raises ValueError: unknown unit."""
    parsed = parse_unit(unit)
    if _is_angle(parsed):
        return "an angle"
    if str(parsed).startswith("delta_"):
        return "a temperature difference"
    name = _si_name(parsed)
    return _KINDS.get(name, f"a quantity in {name}")


def si_unit(unit: str) -> str:
    """The coherent SI unit of what `unit` measures, "" if dimensionless. Raises ValueError: unknown unit.

    si_unit("mA * mV") is "W".
    """
    parsed = parse_unit(unit)
    if _is_angle(parsed):
        return "rad"
    name = _si_name(parsed)
    return "" if name == "dimensionless" else name


def to_si(value: Any, unit: str, *, difference: bool = False) -> float:
    """A written quantity such as ``"0.8 W/K"`` as a float in the SI unit `unit`.

    `unit` "" means dimensionless: a plain number. `difference`: of two temperatures, so 2 degC is 2 K.
    Raises ValueError saying what was found and what was expected.
    """
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise ValueError(f"found {show(value)}, expected {expected(unit, difference)}")
    if not isinstance(value, str):
        if unit:
            wanted = expected(unit, difference, number=show(value))
            raise ValueError(f"found {show(value)} without a unit, expected {wanted}")
        return _finite(value)
    split = _NUMBER.fullmatch(value)
    if split is None:
        raise ValueError(f"found {show(value)}, expected {expected(unit, difference)}")
    number, written = float(split[1]), split[2]
    if unit and not written:
        wanted = expected(unit, difference, number=split[1])
        raise ValueError(f"found {show(value)} without a unit, expected {wanted}")
    try:
        parsed = parse_unit(written)
    except ValueError as error:
        raise ValueError(f"found {show(value)}, expected {expected(unit, difference)}: {error}") from None
    if difference and str(parsed) in _OFFSET_UNITS:
        parsed = parse_unit(f"delta_{parsed}")
    if not _fits(parsed, unit, difference):
        raise ValueError(f"found {show(value)} ({kind_of(written)}), expected {expected(unit, difference)}")
    return _finite(registry().Quantity(number, parsed).to(unit or "dimensionless").magnitude, value)


def unit_in(text: str) -> str:
    """The unit of a written quantity, as it is written; "" of what is none."""
    split = _NUMBER.fullmatch(text)
    return split[2] if split else ""


def read_any(value: Any) -> tuple[str, float]:
    """SI unit ("" if dimensionless) and SI value of a written quantity of whatever unit. Raises ValueError."""
    split = _NUMBER.fullmatch(value) if isinstance(value, str) else None
    if isinstance(value, str) and split is None:
        raise ValueError(f"found {show(value)}, expected a number with its unit, such as '0.8 W/K'")
    unit = si_unit(split[2]) if split else ""
    return unit, to_si(value, unit)


def expected(unit: str, difference: bool = False, number: str = "") -> str:
    """What a reader of `unit` expects, with an example: "a conductance such as '1 W/K'"."""
    if not unit:
        return "a plain number"
    if difference:
        return f"a temperature difference such as '{number or 2} K'"
    kind = "an angle" if unit == "rad" else _KINDS.get(unit, f"a quantity in {unit}")
    return f"{kind} such as '{f'{number} {unit}' if number and unit not in _EXAMPLES else example(unit)}'"


def celsius(temperature: float) -> str:
    """A temperature in K as messages give it."""
    return f"{temperature - ICE_POINT:.6g} degC"


def example(unit: str) -> str:
    """A quantity a user might write where `unit` is wanted."""
    return _EXAMPLES.get(unit, f"1 {unit}".rstrip())


def show(value: Any) -> str:
    """A value as a message quotes it: short, in YAML's words."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, dict):
        return "a mapping"
    if isinstance(value, (list, tuple)):
        return f"a list of {len(value)}"
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


@dataclass(frozen=True)
class Quantity:
    """Marks a float that is written with its unit: read into SI `unit`, checked against its bounds (SI)."""

    unit: str
    above: float | None = None
    at_least: float | None = None
    at_most: float | None = None
    difference: bool = False
    believable: float = LARGEST
    """Largest size of a written number, SI: beyond it an exponent or a unit is wrong. No bound of priors' tails."""

    @property
    def lower(self) -> float:
        """Lowest value, SI."""
        return float(next((bound for bound in (self.above, self.at_least) if bound is not None), -math.inf))

    @property
    def upper(self) -> float:
        """Highest value, SI."""
        return math.inf if self.at_most is None else float(self.at_most)

    def read(self, value: Any) -> float:
        """The written quantity in SI. Raises ValueError."""
        number = to_si(value, self.unit, difference=self.difference)
        for violated, words, bound in (
            (self.above is not None and number <= self.above, "more than", self.above),
            (self.at_least is not None and number < self.at_least, "at least", self.at_least),
            (self.at_most is not None and number > self.at_most, "at most", self.at_most),
        ):
            if violated:
                raise ValueError(f"found {show(value)}, expected {words} {bound:g} {self.unit}".rstrip())
        if abs(number) > self.believable:
            raise ValueError(f"found {show(value)}, expected at most {self.believable:g} {self.unit}".rstrip())
        return number

    def write(self, number: float) -> str | float:
        """The number as a user writes it."""
        return written(number, self.unit)

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        return core_schema.no_info_plain_validator_function(
            self.read,
            serialization=core_schema.plain_serializer_function_ser_schema(self.write, when_used="json"),
        )

    def __get_pydantic_json_schema__(self, schema: core_schema.CoreSchema, handler: Any) -> dict[str, Any]:
        return quantity_schema(self.unit, lower=self.lower, upper=self.upper)


@dataclass(frozen=True)
class QuantityOrName(Quantity):
    """Marks a quantity, or the name of something that has it: text that does not begin like a number."""

    def read(self, value: Any) -> Any:
        """The written quantity in SI, or the name. Raises ValueError."""
        is_text = isinstance(value, str) and bool(value.strip())
        return value if is_text and value.strip()[0] not in "+-.0123456789" else super().read(value)

    def write(self, number: Any) -> str | float:
        """The number, or the name, as a user writes it."""
        return number if isinstance(number, str) else super().write(number)

    def __get_pydantic_json_schema__(self, schema: core_schema.CoreSchema, handler: Any) -> dict[str, Any]:
        return {"type": "string"}


def written(number: float, unit: str) -> str | float:
    """An SI number as a user writes it: with its unit, or plain if it has none; reads back the same."""
    return f"{number!r} {unit}" if unit else number


def quantity_schema(unit: str, lower: float = -math.inf, upper: float = math.inf) -> dict[str, Any]:
    """JSON Schema of a written quantity."""
    if not unit:
        bounds = {"minimum": lower, "maximum": upper}
        return {"type": "number", **{key: bound for key, bound in bounds.items() if math.isfinite(bound)}}
    number = r"^\s*[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?(\s*[^\d\s.+-]|\s+1\s*/).*$"
    return {"type": "string", "pattern": number, "examples": [example(unit)]}


def _fits(parsed: pint.Unit, unit: str, difference: bool) -> bool:
    if _angles(parsed) != _angles(parse_unit(unit)):
        return False
    if unit == "K" and not difference and str(parsed).startswith("delta_"):
        return False
    return bool(parsed.is_compatible_with(unit or "dimensionless"))


def _is_angle(parsed: pint.Unit) -> bool:
    return str(registry().get_root_units(parsed)[1]) == "radian"


def _angles(parsed: pint.Unit) -> float:
    """The power of an angle in a unit: an angle is dimensionless to pint, and W/deg would be 57 W."""
    powers: dict[str, Any] = dict(registry().get_root_units(parsed)[1]._units)
    return float(powers.get("radian", 0.0))


def _si_name(parsed: pint.Unit) -> str:
    base = registry().get_base_units(parsed)[1]
    named = (name for name in _KINDS if parse_unit(name).dimensionality == base.dimensionality)
    return f"{base:~}" if "radian" in str(base) else next(named, f"{base:~}")


def _finite(number: Any, found: Any = None) -> float:
    try:
        converted = float(number)
    except OverflowError:
        converted = math.inf
    if not math.isfinite(converted):
        raise ValueError(f"found {show(number if found is None else found)}, expected a finite number")
    return converted


HOTTEST = 2000.0
"""K: hotter than any part of a spacecraft that is meant to last."""
Temperature = Annotated[float, Quantity("K", at_least=0.0, believable=HOTTEST)]
Kelvins = Annotated[float, Quantity("K", at_least=0.0, difference=True, believable=HOTTEST)]
Duration = Annotated[float, Quantity("s", above=0.0)]
Seconds = Annotated[float, Quantity("s", at_least=0.0)]
Angle = Annotated[float, Quantity("rad")]
STRONGEST = 1e6
"""W: some ten times what the largest spacecraft has in all."""
Power = Annotated[float, Quantity("W", believable=STRONGEST)]


@dataclass(frozen=True)
class WrittenUnit:
    """A unit in which a quantity is written: SI = factor * number + offset."""

    name: str
    factor: float = 1.0
    offset: float = 0.0

    def of(self, si: float) -> float:
        """The number that is written for an SI value."""
        return (si - self.offset) / self.factor

    def si(self, number: float) -> float:
        """The SI value of a number."""
        return self.factor * number + self.offset


def written_unit(name: str, unit: str, *, difference: bool = False) -> WrittenUnit:
    """A unit by its name, of a quantity in the SI `unit`. Raises ValueError."""
    if not name:
        return WrittenUnit("")
    zero, one = (to_si(f"{number} {name}", unit, difference=difference) for number in (0, 1))
    return WrittenUnit(name, one - zero, zero)
