"""What a column of a telemetry file is, by its name and its values: a kind and a unit, or a word of bits."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import reduce
from operator import and_, or_
from typing import Literal

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ..scenario import Channel, is_temperature
from ._times import is_text
from ._units import known_unit
from ._values import NULL_WORDS, is_status, with_units
from .modes import lasting
from .readers import Source
from .time_columns import is_numeric, is_second_time

_STATUS_NAME = re.compile(r"(?i)htr|heater|status|state|switch|enable|flag|ecl|umbra|(^|[_. ])(on|sw)($|[_. ])")
_HEATER_NAME = re.compile(
    r"(?i)(htr|heater).*(cur|amp|pow|_i\b|\b[mk]?[AW]\b|_[mk]?[AW]$)|(cur|pow|^[iIpP]_).*(htr|heater)"
)
"""Of a heater's current or power."""
_INPUT_NAME = re.compile(r"(?i)[_. ](i|v|cur|curr|current|volt|voltage|pwr|power)\d*$")
_OF_HEATER = re.compile(r"(?i)htr|heat")
_ON_WORD = re.compile(r"(?i)^on|^heat|act|run|enab|clos|yes|true")
_OFF_WORD = re.compile(r"(?i)off|^no|idle|inact|st(an)?d?by|stop|cool|disab|open|false")
"""Words that a heater's status has; what looks like both is off, as INACTIVE is."""
_LEVELS = 5
"""A word of few bits, which has no unit, has fewer values."""
_TEMPERATURE_NAME = re.compile(
    r"(?i)temp|therm|thm|tmp|^t$|(^|\.)t[th]?[_.\d-]|^(ntc|rtd|prt)|[_. ]tt?\d*([_ /][ckf])?$|^pt\d|deg\.? ?c|°c"
    r"|^t(bat[a-z]*|obc|eps|pcb|cpu|pan[a-z]*|trx|rad[a-z]*|pay[a-z]*|cam|tank|[pm][xyz]|[xyz][pm])\d*$"
    r"|^t(pnl|panel|north|south|east|west|top|bottom|front|rear|zenith|nadir|str|struct|ccd|det|mli)(_?[a-z\d]{1,2})?$"
)
_THERMOCOUPLE_NAME = re.compile(r"(?i)^tc[_.\d-]")
"""Counters of telecommands are called so too, and are whole."""
_KELVIN_NAME = re.compile(r"[_ ./]K$")
_KELVINS = (150.0, 450.0)
"""Of a satellite: what ends in K and is between these is a temperature."""
_CELSIUSES = (-200.0, 200.0)
"""What is called a temperature, and is neither between these nor those, are raw readings."""
_WORD_NAME = re.compile(r"(?i)(htr|heater).*(word|bits|mask|flags)|(word|bits|mask|flags).*(htr|heater)")
_MAY_BE_WORD = re.compile(r"(?i)status|state|word|bits|mask|flags")
_WORDS = {0: re.compile(r"(?i)0x[0-9a-f]+|0b[01]+"), 10: re.compile("[0-9]+"), 16: re.compile(r"(?i)[0-9a-f]+")}
"""Words that are text, by the base of their digits; 0: they say it."""
_NO_STATE = 8
"""Bits that all values of a status have in common are those of a word from this on."""
_MOST_BITS = 8
"""Of a word that heaters switch; where more change, it is a counter."""
# A last letter alone is more often the name of a branch than a unit, but of what begins with a voltage or a power.
_UNIT = re.compile(
    r"[\[(]\s*([^\[\]()]+?)\s*[\])]|[_ ](degC|mA|mV|mW|kW|mK|AU|(?i:deg|degc|w_m2)|MA|MV)$"
    r"|^(?:V|U|VOLT[A-Z]*)_.*_(V)$|^(?:P|PWR|POW[A-Z]*)_.*_(W)$"
)
_AT_THE_END = {"ma": "mA", "mv": "mV", "deg": "deg", "w_m2": "W/m^2"}


@dataclass(frozen=True)
class FoundColumn:
    """A column that can be a channel."""

    name: str
    kind: Literal["temperature", "status", "driver"]
    unit: str | None
    """null: of a status that is no number."""
    on_above: str | None = None
    """Of a status that is a heater's current or power: between its two levels, with the unit."""
    on_off: tuple[str, str] | None = None
    """The word for on and that for off, of a heater's status with words of its own."""
    raw: tuple[float, float] | None = None
    """Lowest and highest of a temperature's readings that are no degC or K, such as counts of a converter."""
    bit: int | None = None
    """Of a status that is a bit of a word."""
    base: int | None = None
    """Of the word's digits, where they have no 0x and are not decimal."""
    called: str | None = None
    """What it is, where the name of its file says so and that of the column does not."""

    @property
    def is_called_an_input(self) -> bool:
        """Whether its name is that of a current, a voltage or a power."""
        return bool(_INPUT_NAME.search(self.name))


def column_of(name: str, column: pa.ChunkedArray, source: Source, said: str | None = None) -> FoundColumn | None:
    """What a column is; null: nothing that a channel can be, such as a second time or a comment.

    said: its unit, where a row below the header has units, or is in degF by its name.
    """
    if column.null_count == len(column):
        return None
    if is_text(column) and (found := with_units(column)) is not None:
        column, said = found
    if is_text(column) or pa.types.is_boolean(column.type) or pa.types.is_dictionary(column.type):
        if is_status(column, Channel(column=name, kind="status")):
            return FoundColumn(name, "status", None)
        by_words = _on_off(column) if _OF_HEATER.search(name) else None
        return None if by_words is None else FoundColumn(name, "status", None, on_off=by_words)
    if not is_numeric(column) or is_second_time(name, column, source):
        return None
    values = column.drop_null().to_numpy()
    values = values[np.isfinite(values)]
    if not len(values):
        return None
    if _STATUS_NAME.search(name) and np.isin(values, (0, 1)).all():
        return FoundColumn(name, "status", None)
    unit = known_unit(said or "") or _unit(name)
    if unit is not None and is_temperature(unit):
        return FoundColumn(name, "temperature", unit)
    middle = float(np.median(values))
    in_kelvins = _KELVINS[0] < middle < _KELVINS[1]
    named = _TEMPERATURE_NAME.search(name) or (in_kelvins and _KELVIN_NAME.search(name))
    if unit is None and (named or (_THERMOCOUPLE_NAME.search(name) and (values % 1.0).any())):
        if not in_kelvins and not _CELSIUSES[0] < middle < _CELSIUSES[1]:
            low, high = np.quantile(values, (0.02, 0.98))
            return FoundColumn(name, "temperature", None, raw=(float(low), float(max(high, low + 1.0))))
        return FoundColumn(name, "temperature", "K" if in_kelvins else "degC")
    if _HEATER_NAME.search(name) and (level := _between_levels(values, unit)) is not None:
        return FoundColumn(name, "status", unit or "1", f"{level:.3g} {unit or ''}".strip())
    return FoundColumn(name, "driver", unit or "1")


def is_called_by_kind(name: str) -> bool:
    """Whether a column is called as a temperature or a status."""
    return bool(_TEMPERATURE_NAME.search(name) or _STATUS_NAME.search(name))


def may_be_word(name: str) -> bool:
    """Whether a column is called as a word of bits may be."""
    return _MAY_BE_WORD.search(name) is not None


def parts_of(name: str, column: FoundColumn | None, cells: pa.ChunkedArray) -> Iterator[FoundColumn]:
    """Each bit of a word that changes; else the column itself, if it can be a channel."""
    words, base = _words(name, cells) if column is None or column.kind == "driver" else (None, None)
    changing: list[int] = []
    if words:
        changed = reduce(or_, words) ^ reduce(and_, words)
        changing = [bit for bit in range(changed.bit_length()) if changed >> bit & 1]
    if 0 < len(changing) <= _MOST_BITS:
        yield from (FoundColumn(name, "status", None, bit=bit, base=base) for bit in changing)
    elif column is not None:
        yield column


def _words(name: str, cells: pa.ChunkedArray) -> tuple[list[int] | None, int | None]:
    """A column's different words, and the base of their digits where these do not tell it; null: none.

    Numbers are words by the column's name, which of a status is enough where a bit is always set that is not one of the
    lowest: states are counted from 0 or 1. Text is also where it begins with 0x or 0b.
    """
    named = _WORD_NAME.search(name)
    if named and pa.types.is_integer(cells.type):
        return list(lasting(cells.drop_null().to_pylist())), None
    found = list(lasting(_told(cells)))
    for base, shape in _WORDS.items() if named else ((0, _WORDS[0]),):
        if found and all(shape.fullmatch(cell) for cell in found):
            return [int(cell, base) for cell in found], base if base == 16 else None
    if _MAY_BE_WORD.search(name) and found and all(_WORDS[10].fullmatch(cell) for cell in found):
        words = [int(cell) for cell in found]
        return (words if reduce(and_, words) >= _NO_STATE else None), None
    return None, None


def _told(cells: pa.ChunkedArray) -> list[str]:
    """What stands in the cells of a text column that say something; empty: it is none."""
    read = [cell.strip() for cell in cells.drop_null().to_pylist()] if is_text(cells) else []
    return [cell for cell in read if cell not in NULL_WORDS]


def _between_levels(values: NDArray[np.float64], unit: str | None) -> float | None:
    """The middle between the two levels of a current that is on or off; null: it has not two."""
    found = np.unique(values)
    if len(found) < (_LEVELS if unit is None else 2) or found[-1] <= 0:
        return None
    gaps = np.diff(found)
    widest = int(np.argmax(gaps))
    return float(found[widest] + gaps[widest] / 2) if gaps[widest] > 0.5 * (found[-1] - found[0]) else None


def _on_off(cells: pa.ChunkedArray) -> tuple[str, str] | None:
    """The word for on and that for off, of a column with two words; null: what they mean is not plain."""
    words = set(_told(cells))
    off = {word for word in words if _OFF_WORD.search(word)}
    on = {word for word in words - off if _ON_WORD.search(word)}
    return (min(on), min(off)) if len(words) == 2 and on and off else None


def _unit(name: str) -> str | None:
    """The unit that stands in a column's name, in brackets or at its end; null: none does."""
    match = _UNIT.search(name)
    if match is None:
        return None
    in_brackets, *at_the_end = match.groups()
    found = in_brackets or next(filter(None, at_the_end))
    return known_unit(found if in_brackets else _AT_THE_END.get(found.lower(), found))


def fahrenheit(name: str, names: list[str]) -> str | None:
    """The unit of a temperature whose name ends in F, where no other differs from it in this letter alone."""
    if not _TEMPERATURE_NAME.search(name) or not re.search(r"(?i)[_. ]f$", name):
        return None
    branches = [other for other in names if other[:-1] == name[:-1] and other[-1:].isalpha()]
    return "degF" if len(branches) == 1 else None
