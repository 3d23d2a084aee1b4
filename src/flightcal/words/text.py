"""Numbers, units and names as people read them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence, Sized
from pathlib import PurePath, PureWindowsPath
from typing import Final

SUPERSCRIPTS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


_STEP: Final = r"""[^\s\\/'",;:<>()\[\]{}]+"""
_PATH: Final = re.compile(rf"(?<![\w.:/\\])(?:~|[A-Za-z]:)?[\\/]+(?:{_STEP}[\\/]+)+({_STEP})?")
"""An absolute path of two steps or more, and its last step. A unit as W/m^2/K begins with a letter."""


def without_paths(text: str, known: Iterable[str] = ()) -> str:
    """The text with the last step of each absolute path alone; known: paths that may have spaces."""
    for path in sorted(known, key=len, reverse=True):
        if PureWindowsPath(path).name and (PurePath(path).is_absolute() or PureWindowsPath(path).is_absolute()):
            below = rf"{re.escape(path)}(?:[\\/]+{_STEP})*(?![\w-])"
            text = re.sub(below, lambda found: PureWindowsPath(found[0]).name, text)
    return _PATH.sub(lambda found: found[1] or "", text)


def number(value: float | None, digits: int = 4) -> str:
    """A number with so many significant digits; a dash for None or NaN."""
    if value is None or not math.isfinite(value):
        return "–"
    if value == 0:
        return "0"
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    if 1e-4 <= abs(value) < 1e7:
        text = f"{value:.{max(0, digits - 1 - int(exponent))}f}"
    else:
        text = f"{mantissa}·10{str(int(exponent)).translate(SUPERSCRIPTS)}"
    return text.replace("-", "−")


def count(value: float | None) -> str:
    """A number of things, in groups of three digits; a dash for None or NaN."""
    if value is None or not math.isfinite(value):
        return "–"
    return f"{value:,.0f}".replace(",", "\u202f").replace("-", "−")


def percent(share: float | None, digits: int = 1) -> str:
    """A share from 0 to 1 as percent; a dash for None or NaN."""
    if share is None or not math.isfinite(share):
        return "–"
    return f"{100 * share:.{digits}f}%".replace("-", "−")


def signed_percent(share: float | None) -> str:
    """A difference of shares as percentage points with its sign."""
    text = percent(share)
    return text if text.startswith(("−", "–")) else f"+{text}"


def unit(text: str) -> str:
    """A unit as it is set in print: ``W/m^2`` as ``W/m²``; "1" and "" as nothing."""
    out, power = "", False
    for character in {"degC": "°C", "1": "", "dimensionless": ""}.get(text, text).replace("**", "^"):
        if character == "^":
            power = True
        elif power and (character.isdigit() or character == "-"):
            out += character.translate(SUPERSCRIPTS)
        else:
            power = False
            out += "·" if character == "*" else character
    return out


def labelled(name: str, si_unit: str) -> str:
    """A name with its unit for an axis: ``battery_link, W/K``; without a unit ``name, –``."""
    return f"{name}, {unit(si_unit) or '–'}"


def duration(seconds: float) -> str:
    """A time: ``42.5 s``, ``3 min``, ``3 min 20 s``, ``2 h 5 min``."""
    if seconds < 99.95:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    first, second = (f"{hours} h", f"{minutes} min") if hours else (f"{minutes} min", f"{rest} s")
    return first if second.startswith("0 ") else f"{first} {second}"


def listed(items: Sequence[str]) -> str:
    """``a``, ``a and b``, ``a, b and c``."""
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} and {items[-1]}" if items else ""


def moment(text: object) -> str:
    """A time of a record or of numpy, UTC, to the second; a dash where there is none."""
    return str(text).replace("T", " ")[:19] if text else "–"


def minute(text: object) -> str:
    """The same to the minute."""
    return moment(text)[:16]


def chance(p_value: float) -> str:
    """``p = 0.031``"""
    return "p < 0.0001" if p_value < 1e-4 else f"p = {number(p_value, 2)}"


def shown(value: object) -> str:
    """A value of any type, as of a gate of convergence."""
    if isinstance(value, float) and not value.is_integer():
        return number(value, 5)
    return count(value) if isinstance(value, int | float) and not isinstance(value, bool) else str(value)


def letter(index: int, items: Sized) -> str:
    """``a``, ``b``, ... of a figure that is one of several; nothing of one alone."""
    return chr(ord("a") + index % 26) if len(items) > 1 else ""


def interval(middle: float, low: float, high: float) -> str:
    """``0.4213 [0.4131, 0.4298]``, all with the significant digits that the width asks for."""
    shown, lower, upper = in_digits(low, high, middle, low, high)
    return "–" if lower == "–" else f"{shown} [{lower}, {upper}]"


def in_digits(low: float, high: float, *values: float) -> list[str]:
    """Values with the digits that the width from `low` to `high` asks for; dashes where it is not known."""
    width = high - low
    if not math.isfinite(width):
        return ["–"] * len(values)
    largest = max(abs(low), abs(high), 1e-300)
    digits = 4 if width <= 0 else min(max(math.ceil(math.log10(largest / width)) + 2, 3), 8)
    return [number(value, digits) for value in values]
