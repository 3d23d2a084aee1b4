"""Kinds of fields in the scenario file, each with one plain sentence for what does not fit."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields
from datetime import UTC, datetime
from functools import lru_cache, partial
from typing import Annotated, Any, Self, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ModelWrapValidatorHandler,
    PlainSerializer,
    SerializationInfo,
    TypeAdapter,
    ValidationError,
    WithJsonSchema,
    model_validator,
)
from pydantic.json_schema import SkipJsonSchema
from pydantic_core import core_schema

from .units import did_you_mean, show, to_si
from .wording import in_plain_words

_FIRST_EPOCH = 1858
_FIRST_YEAR, _LAST_YEAR = 1957, 2200
"""Of spaceflight, and within what nanosecond time stamps can hold."""


class Block(BaseModel):
    """A block of the scenario file: immutable, and an unknown key is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True)

    @model_validator(mode="wrap")
    @classmethod
    def _in_plain_words(cls, value: Any, read: ModelWrapValidatorHandler[Self]) -> Self:
        try:
            return read(value)
        except ValidationError as error:
            raise in_plain_words(error, keys_of(cls)) from None


def keys_of(block: type[Block]) -> list[str]:
    """What a user may write in a block: all fields but those that flightcal fills in."""
    return [name for name, field in block.model_fields.items() if FILLED_IN not in field.metadata]


class Part:
    """A block that is a plain dataclass: read from a file like a `Block`, and made of SI numbers in code, unread."""

    __pydantic_config__ = ConfigDict(extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True)

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Any) -> core_schema.CoreSchema:
        def read(value: Any, inner: Callable[[Any], Any]) -> Any:
            try:
                return inner(value)
            except ValidationError as error:
                raise in_plain_words(error, [field.name for field in fields(source)]) from None

        return core_schema.no_info_wrap_validator_function(read, handler(source))


@lru_cache(maxsize=100)
def reader_of(kind: Any) -> TypeAdapter[Any]:
    """What reads a block or field."""
    return TypeAdapter(kind)


def _read_time(value: Any, first_year: int = _FIRST_YEAR) -> datetime:
    """ISO 8601 text as a naive UTC datetime."""
    try:
        time = value if isinstance(value, datetime) else datetime.fromisoformat(value.strip())
        utc = time if time.tzinfo is None else time.astimezone(UTC).replace(tzinfo=None)
    except (AttributeError, ValueError, OverflowError):
        raise ValueError(f"found {show(value)}, expected a UTC time such as 2024-03-01T00:00:00") from None
    if not first_year <= utc.year <= _LAST_YEAR:
        raise ValueError(f"found the year {utc.year}, expected one from {first_year} to {_LAST_YEAR}")
    return utc


TIME_FORMATS = ("iso8601", "unix", "unix-ms", "unix-us", "unix-ns", "year-doy", "decimal-doy", "clock")
"""How times are written, besides patterns."""


def _read_time_format(value: Any) -> str:
    """One of TIME_FORMATS, or a pattern that tells a day."""
    if not isinstance(value, str) or (value not in TIME_FORMATS and "%" not in value):
        hint = did_you_mean(value, TIME_FORMATS) if isinstance(value, str) else ""
        wanted = f"{', '.join(TIME_FORMATS)}, or a pattern such as '%d.%m.%Y %H:%M:%S'"
        raise ValueError(f"found {show(value)}, expected {wanted}{hint}")
    if value not in TIME_FORMATS:
        day = datetime(2024, 2, 29, 13, 14, 15, tzinfo=UTC)
        try:
            read = datetime.strptime(day.strftime(value), value)
        except ValueError:
            read = None
        if read is None or read.date() != day.date():
            raise ValueError(f"found {show(value)}, expected a pattern with a year (%Y) and a day (%m and %d, or %j)")
    return value


def _read_names(value: Any) -> Any:
    if isinstance(value, str):
        return (value,)
    if not isinstance(value, (list, tuple)):
        raise ValueError(f"found {show(value)}, expected text in quotes or a list of text")
    return value


def _read_marker(value: Any) -> float | str:
    if isinstance(value, str):
        return value
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ValueError(f"found {show(value)}, expected a number or text in quotes")
    to_si(value, "")  # finite
    return value


def _read_markers(value: Any) -> Any:
    return value if isinstance(value, (list, tuple)) else (value,)


def _read_driver_unit(value: Any) -> Any:
    return "dimensionless" if value in (1, "1", "") and not isinstance(value, bool) else value


def read_empty(value: Any) -> Any:
    """A block of which nothing but the key is written, as an empty one."""
    return {} if value is None else value


def from_folder(name: str, info: SerializationInfo) -> str:
    """A file's name as it is written: absolute, where a folder is given as the context."""
    return name if info.context is None else str((info.context / name).absolute())


def of_length(length: int, what: str) -> BeforeValidator:
    """Marks a list of so many entries."""

    def check(value: Any) -> Any:
        if not isinstance(value, (list, tuple)) or len(value) != length:
            raise ValueError(f"found {show(value)}, expected {what}")
        return value

    return BeforeValidator(check)


def _not_zero(vector: tuple[float, ...]) -> tuple[float, ...]:
    if not any(vector):
        raise ValueError("found a vector of length zero, expected a direction")
    return vector


@dataclass(frozen=True)
class OneOf:
    """Marks a union, one part of which is chosen by what is written, so that its errors alone are reported."""

    choose: Callable[[Any], Any]
    """What is written -> the part; None: none of them."""
    expected: str

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        def read(value: Any, _: Any) -> Any:
            kind = type(value) if isinstance(value, Block) else self.choose(value)
            if kind is None:
                raise ValueError(f"found {show(value)}, expected {self.expected}")
            return reader_of(kind).validate_python(value)

        return core_schema.no_info_wrap_validator_function(read, handler(source))


FILLED_IN = SkipJsonSchema()
"""Marks a field that flightcal fills in: no user may write it."""

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Count = Annotated[int, Field(strict=True)]
Flag = Annotated[bool, Field(strict=True)]

_TIME = {"type": "string", "pattern": r"^\d{4}-?\d{2}", "examples": ["2024-03-01T00:00:00"]}
Time = Annotated[datetime, BeforeValidator(_read_time), WithJsonSchema(_TIME)]
Epoch = Annotated[datetime, BeforeValidator(partial(_read_time, first_year=_FIRST_EPOCH)), WithJsonSchema(_TIME)]
"""From when a clock counts: dates of a spreadsheet from 1899, modified Julian dates from 1858."""
TimeFormat = Annotated[
    str,
    BeforeValidator(_read_time_format),
    WithJsonSchema({"anyOf": [{"enum": list(TIME_FORMATS)}, {"type": "string", "pattern": "%"}]}),
]
Vector = Annotated[tuple[Number, Number, Number], of_length(3, "three numbers [x, y, z]"), AfterValidator(_not_zero)]
Pair = Annotated[tuple[str, str], of_length(2, "the names of two nodes [first, second]")]
# Names of things, or paths of numbers: one, or several.
_NAMES = {"anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}, "minItems": 1}]}
Names = Annotated[tuple[str, ...], BeforeValidator(_read_names), Field(min_length=1), WithJsonSchema(_NAMES)]
FileName = Annotated[str, PlainSerializer(from_folder, when_used="json")]
FileNames = Annotated[tuple[FileName, ...], BeforeValidator(_read_names), Field(min_length=1), WithJsonSchema(_NAMES)]
Paths = Annotated[
    tuple[str, ...],
    BeforeValidator(lambda value: (value,) if isinstance(value, str) else value),
    WithJsonSchema(_NAMES),
]
Marker = Annotated[float | str, BeforeValidator(_read_marker)]
_MARKER = {"type": ["number", "string"]}
Markers = Annotated[
    tuple[Marker, ...],
    BeforeValidator(_read_markers),
    WithJsonSchema({"anyOf": [_MARKER, {"type": "array", "items": _MARKER}]}),
]
_BIT = {"type": "integer", "minimum": 0, "maximum": 63}
Bits = Annotated[
    tuple[Annotated[Count, Field(ge=0, le=63)], ...],
    BeforeValidator(_read_markers),
    Field(min_length=1),
    WithJsonSchema({"anyOf": [_BIT, {"type": "array", "items": _BIT, "minItems": 1}]}),
]
Range = Annotated[tuple[Marker, Marker], of_length(2, "two values [lowest, highest]")]
ChannelUnit = Annotated[
    str, BeforeValidator(_read_driver_unit), WithJsonSchema({"anyOf": [{"type": "string"}, {"const": 1}]})
]


AnyBlock = TypeVar("AnyBlock", bound=Block)


def exactly_one(block: AnyBlock, keys: Iterable[str], expected: str) -> AnyBlock:
    """The block. Raises ValueError, for a validator, unless one of the keys is there (a flag: is true)."""
    found = [key for key in keys if getattr(block, key) is not None and getattr(block, key) is not False]
    if len(found) != 1:
        raise ValueError(f"found {' and '.join(map(repr, found)) or 'none of them'}, expected {expected}")
    return block
