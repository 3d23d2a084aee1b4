"""Units of a channel: from those of the file to SI."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..scenario import Channel, is_temperature, kind_of, si_unit, to_si

FloatArray = NDArray[np.float64]

_CELSIUS = {"c": "degC", "deg c": "degC", "deg. c": "degC", "degc": "degC", "°c": "degC", "celsius": "degC"}

_HOTTEST = 1e4
"""K, of what a thermistor's reading can mean at most where the scenario gives no `valid_range`."""
_LARGEST = 1e30
"""Of a driver, SI: what is larger overflows in products."""


@dataclass(frozen=True)
class Conversion:
    """SI value = scale * value in the file + offset, or along a curve; with the believable range, SI."""

    scale: float
    offset: float
    unit: str
    """SI."""
    lowest: float = -np.inf
    highest: float = np.inf
    threshold: float | None = None
    """SI; of a status that is made of a number."""
    curve: FloatArray | None = None
    """[2, P] readings and temperatures, K; null: there is none."""

    def to_si(self, in_file: FloatArray) -> FloatArray:
        """SI values of those in the file."""
        return self.scale * in_file + self.offset if self.curve is None else _along(self.curve, in_file)

    def as_in_file(self, si_value: float) -> float:
        """The value that the file has for a value in SI."""
        if self.curve is None:
            return (si_value - self.offset) / self.scale
        back = self.curve[::-1, np.argsort(self.curve[1])]
        return float(_along(back, np.array(si_value)))


def known_unit(text: str) -> str | None:
    """A unit as flightcal writes it; null: it is none."""
    text = _CELSIUS.get(text.strip().lower(), re.sub(r"\bm([23])\b", r"m^\1", text.strip()))
    if not re.search(r"[^\W\d_]|%", text):
        return None
    try:
        si_unit(text)
    except ValueError:
        return None
    return text


def between(found: str, unit: str) -> tuple[float, float] | None:
    """Scale and offset from values in the unit `found` to those in `unit`; null: one is not of the other's kind."""
    known = known_unit(found)
    try:
        si = si_unit(unit)
        zeros, ones = zip(
            *((to_si(f"0 {name}", si), to_si(f"1 {name}", si)) for name in (known or "", unit)), strict=True
        )
    except ValueError:
        return None
    scale = ones[1] - zeros[1]
    return (ones[0] - zeros[0]) / scale, (zeros[0] - zeros[1]) / scale


def conversion(channel: Channel) -> Conversion:
    """How `channel` becomes SI. Raises ValueError that says what was found and what was expected."""
    if channel.is_state:
        return Conversion(1.0, 0.0, "")
    if channel.curve:
        return _of_curve(channel)
    written = channel.unit or ""
    if channel.kind == "temperature" and not written:
        raise ValueError("found no unit, expected degC or K for a temperature")
    try:
        if channel.kind == "temperature" and not is_temperature(written):
            raise ValueError(kind_of(written))
        unit = si_unit(written)
        zero, one, two = (to_si(f"{number} {written}".strip(), unit) for number in (0, 1, 2))
    except ValueError as error:
        wanted = "degC or K for a temperature" if channel.kind == "temperature" else "one such as mA, V, mA * mV"
        raise ValueError(f"found unit '{written}' ({error}), expected {wanted}") from None
    if not np.isclose(two - one, one - zero):
        raise ValueError(f"found unit '{written}', expected one that is proportional to {unit or 'a number'}")
    lowest, highest = (0.0, _HOTTEST) if channel.kind == "temperature" else (-_LARGEST, _LARGEST)
    if channel.valid_range is not None:
        lowest, highest = (_limit(value, unit) for value in channel.valid_range)
        if not lowest < highest:
            raise ValueError(f"found valid_range {list(channel.valid_range)}, expected the lowest value first")
    key = channel.threshold
    threshold = None if key is None else _limit(getattr(channel, key), unit, key)
    return Conversion(one - zero, zero, unit, lowest, highest, threshold)


def _of_curve(channel: Channel) -> Conversion:
    curve = np.transpose(channel.curve)
    lowest, highest = curve[1].min(), curve[1].max()
    if channel.valid_range is not None:
        lowest, highest = (_limit(value, "K") for value in channel.valid_range)
    return Conversion(1.0, 0.0, "K", lowest, highest, curve=curve)


def _along(curve: FloatArray, x: FloatArray) -> FloatArray:
    """Linear between the points of a curve [2, P] with increasing x; its ends go on straight."""
    known, wanted = curve
    left = np.clip(np.searchsorted(known, x) - 1, 0, len(known) - 2)
    slopes = np.diff(wanted) / np.diff(known)
    return wanted[left] + slopes[left] * (x - known[left])


def _limit(value: str | float, unit: str, key: str = "valid_range") -> float:
    try:
        return to_si(value, unit)
    except ValueError as error:
        raise ValueError(f"{key}: {error}") from None
