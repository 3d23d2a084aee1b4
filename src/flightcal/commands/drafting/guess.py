"""What telemetry tells of a satellite: its period, which status is a heater's and of which node, and first windows."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from itertools import combinations, product, takewhile
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...errors import TelemetryError
from ...scenario import ICE_POINT

if TYPE_CHECKING:
    import xarray

_LONGEST, _ORBITS = np.timedelta64(10, "h"), 6
"""Of telemetry that the windows take at first, or so many orbits: the first run is short."""
_ENOUGH = 600
"""Samples that they take at least, where samples are far apart."""
_LONGEST_OF_PASSES = np.timedelta64(4, "D")
"""The same where samples come in passes alone."""
_SHORT = np.timedelta64(90, "m")
"""An orbit, about: where no longer time, nor half of all, is without gaps, samples come in passes."""
_MANY, _SHORTEST_GAP = 10, 15 * 60e9
"""An interval of more than so many usual ones, and of more ns than this, is a gap that a window had better not have."""
_HEATER, _SUN = re.compile("htr|heat|thermostat"), re.compile("ecl|sun|umbra|shadow|day|night")
_SHADOW = re.compile("(^|_)ecl|umbra|shadow|night")
_SOME = 3
"""Temperatures, of which more than half seem to obey what tells the Sun."""
_SAME, _SWITCHES = 0.8, 4
"""Share of the time that two statuses are on, in which both are, and changes of each, that tell one heater."""
_SHORTEST_WORD = 3
"""Letters that a heater's name and its node's have in common, such as bat of battery."""
_EXACT = 0.1
"""K by which what a sensor reads at its heater's switches differs anyway."""
_PERIODS = (85 * 60.0, 25 * 3600.0)
"""s, of the lowest orbit and of a geostationary one."""
_SIDEREAL_DAY, _OF_A_DAY = 86164.1, 0.2
"""s, of a geostationary orbit; share of it within which a period that is found is that."""
_LOOKED_AT, _SAMPLES, _FEWEST, _TURNS = 10 * 86400.0, 4000, 50, 2.5
"""s of telemetry, samples of a channel at most and at least, and turns in it, by which a period is told."""
_STANDS_OUT = 0.3
"""Share of the variance of half of the temperatures, that a wave of the period has."""
_Stretch = tuple[np.datetime64, np.datetime64]


def heaters(dataset: xarray.Dataset, statuses: Sequence[str], nodes: Sequence[str]) -> dict[str, str]:
    """The statuses that are a heater's, by their names or because a temperature obeys them, each with its node."""
    return {
        name: _node_of(name, nodes) or _switching(dataset, name, nodes)
        for name in statuses
        if _HEATER.search(name) or _obeyed(dataset, name, nodes)
    }


def tells_shadow(status: str) -> bool:
    """Whether a status is on in the shadow, by its name."""
    return bool(_SHADOW.search(status)) and not _HEATER.search(status)


def same_heaters(dataset: xarray.Dataset, nodes: Mapping[str, str]) -> dict[str, str]:
    """Statuses that are on and off as one before them is, each with that: such as a command and a current.

    nodes: of each status; those of one node are compared.
    """
    import pandas as pd

    on = {name: pd.Series(dataset[name].values).ffill().to_numpy(float) for name in nodes}
    found: dict[str, str] = {}
    for one, other in combinations(nodes, 2):
        known = np.isfinite(on[one]) & np.isfinite(on[other])
        first, second = on[one][known] > 0.5, on[other][known] > 0.5
        switches = min(np.count_nonzero(np.diff(first)), np.count_nonzero(np.diff(second)))
        alike = np.count_nonzero(first & second) > _SAME * np.count_nonzero(first | second)
        if nodes[one] == nodes[other] and switches >= _SWITCHES and alike and one not in found:
            found.setdefault(other, one)
    return found


def _obeyed(dataset: xarray.Dataset, status: str, nodes: Sequence[str]) -> bool:
    """Whether a temperature is low when a status becomes on and high when it goes off, as a thermostat has it.

    Of the Sun nearly all temperatures are so.
    """
    if _SUN.search(status):
        return False
    found = []
    for node in nodes:
        on, off, spread = _at_switches(dataset["time"].values, dataset[node].values, dataset[status].values)
        found.append(off - on > max(spread, _EXACT))
    return any(found) and (len(nodes) < _SOME or 2 * sum(found) <= len(nodes))


def _node_of(heater: str, nodes: Sequence[str]) -> str | None:
    """The node whose name is most like the heater's, first in the words that few nodes have; None: no word is."""
    words = {node: set(node.split("_")) for node in nodes}
    often = {word for label in words.values() for word in label if sum(word in other for other in words.values()) > 1}
    telling = set(heater.split("_")) - often - {"heater", "htr"}

    def likeness(node: str) -> tuple[int, float]:
        alike = (_begins_alike(one, other) for one, other in product(telling, words[node]))
        return max(alike, default=0), difflib.SequenceMatcher(None, heater, node).ratio()

    best = max(nodes, key=likeness)
    return best if likeness(best)[0] >= _SHORTEST_WORD else None


def _switching(dataset: xarray.Dataset, heater: str, nodes: Sequence[str]) -> str:
    """The node that is coldest when the heater comes on, warmest when it goes off, and at each of them always the same.

    The heat of an orbit moves other nodes in step with the heater, but not as exactly.
    """

    def swing(node: str) -> tuple[float, float]:
        kelvins = dataset[node].values
        on, off, spread = _at_switches(dataset["time"].values, kelvins, dataset[heater].values)
        cold, warm = np.nanquantile(kelvins, (0.05, 0.95))
        share = (off - on) / (warm - cold) if np.isfinite(on + off) and warm > cold else -1.0
        return share / (spread + _EXACT) if share > 0.0 else share, difflib.SequenceMatcher(None, heater, node).ratio()

    return max(nodes, key=swing)


def _begins_alike(one: str, other: str) -> int:
    """How many letters two words begin with alike, or without their vowels: tank is tnk."""
    ones, others = (one, _without_vowels(one)), (other, _without_vowels(other))
    return max(sum(1 for _ in takewhile(_same, zip(*pair, strict=False))) for pair in zip(ones, others, strict=True))


def _same(letters: tuple[str, str]) -> bool:
    return letters[0] == letters[1]


def _without_vowels(word: str) -> str:
    return word[:1] + re.sub("[aeiou]", "", word[1:])


def windows(dataset: xarray.Dataset, packets: Mapping[str, str], period: float | None) -> tuple[str, str, str]:
    """Start, middle and end of a stretch without long gaps in any packet, at most `_LONGEST` or `_ORBITS` of it.

    Where samples come in passes alone, of these: each half begins and ends with one. packets: of each channel.
    period: of an orbit, s. Raises TelemetryError where the packets have no time in common.
    """
    times = dataset["time"].values
    valid = {name: times[np.isfinite(dataset[name].values)] for name in packets}
    apart = min(
        (float(np.median(np.diff(flags)) / np.timedelta64(1, "s")) for flags in valid.values() if len(flags) > 1),
        default=0.0,
    )
    longest = max(_LONGEST, np.timedelta64(round(max(_ORBITS * (period or 0.0), _ENOUGH * apart)), "s"))
    stretches = {name: _stretches(flags) for name, flags in valid.items()}
    common: list[_Stretch] | None = None
    for stretch in stretches.values():
        common = stretch if common is None else _overlaps(common, stretch)
    if not common:
        raise TelemetryError(
            f"found files whose times do not overlap ({_spans(stretches, packets)}), expected some time that all of "
            "them have: leave one out, or write its channels into a scenario with the epoch of its clock"
        )
    start, end = max(common, key=lambda one: min(one[1] - one[0], longest))  # the first of equals
    if end - start < _SHORT and 2 * (end - start) < np.sum([b - a for a, b in common]):
        start = common[0][0]
        end = max(begin for _, begin in common if begin <= start + _LONGEST_OF_PASSES)
        half = start + (end - start) // 2
        middle = min((begin for begin, _ in common if half < begin < end), default=half)
    else:
        end = min(end, start + longest)
        middle = start + (end - start) // 2
    first, half_way, last = (np.datetime_as_string(time.astype("datetime64[ms]")) for time in (start, middle, end))
    return str(first), str(half_way), str(last)


def _spans(stretches: Mapping[str, list[_Stretch]], packets: Mapping[str, str]) -> str:
    """From when to when each packet has samples, in words."""
    words = []
    for packet in dict.fromkeys(packets.values()):
        of_packet = [one for name, stretch in stretches.items() if packets[name] == packet for one in stretch]
        if of_packet:
            ends = min(one[0] for one in of_packet), max(one[1] for one in of_packet)
            first, last = (str(np.datetime_as_string(end, unit="m")) for end in ends)
            words.append(f"{packet}: {first} to {last}")
    return ", ".join(words)


def period(dataset: xarray.Dataset, nodes: Sequence[str]) -> float | None:
    """Seconds after which temperatures come again, by their spectrum (Lomb 1976); None: nothing stands out in it.

    Searched for between those of the lowest orbits and of a geostationary one.
    """
    from scipy.signal import lombscargle

    times = dataset["time"].values
    seconds = (times - times[0]) / np.timedelta64(1, "s")
    first = seconds < _LOOKED_AT
    span = float(seconds[first][-1])
    if span < _TURNS * _PERIODS[0]:
        return None
    apart = 0.2 / span
    rates = np.arange(max(_TURNS / span, 1.0 / _PERIODS[1]), 1.0 / _PERIODS[0], apart)
    shares = []
    for name in nodes:
        known = np.flatnonzero(first & np.isfinite(dataset[name].values))
        known = known[:: max(1, len(known) // _SAMPLES)]
        if len(known) < _FEWEST:
            continue
        at, values = seconds[known], dataset[name].values[known]
        values = values - np.polyval(np.polyfit(at - at.mean(), values, 1), at - at.mean())
        if values.std() > 0.0:
            shares.append(lombscargle(at, values, 2.0 * np.pi * rates, normalize=True))
    if not shares or not len(rates):
        return None
    share = np.median(shares, axis=0)
    best = int(np.argmax(share))
    if share[best] < _STANDS_OUT:
        return None
    # Between the rates the top is that of a parabola.
    before, top, after = share[np.clip([best - 1, best, best + 1], 0, len(share) - 1)]
    bend = before - 2.0 * top + after
    beside = 0.5 * (before - after) / bend if bend < 0.0 else 0.0
    found = float(1.0 / (rates[best] + beside * apart))
    # A few days tell no better than this, and no satellites but geostationary ones are near it.
    return _SIDEREAL_DAY if abs(found - _SIDEREAL_DAY) < _OF_A_DAY * _SIDEREAL_DAY else found


def _stretches(times: NDArray[np.datetime64]) -> list[_Stretch]:
    """From when to when increasing times have no long gap."""
    steps = np.diff(times).astype("timedelta64[ns]").astype(np.int64)
    usual = float(np.median(steps)) if len(steps) else 0.0
    gaps = np.flatnonzero(steps > max(_MANY * usual, _SHORTEST_GAP))
    starts, ends = [0, *(gaps + 1).tolist()], [*gaps.tolist(), len(times) - 1]
    return [(times[a], times[b]) for a, b in zip(starts, ends, strict=True) if b > a]


def _overlaps(ones: Sequence[_Stretch], others: Sequence[_Stretch]) -> list[_Stretch]:
    found = [(max(one[0], other[0]), min(one[1], other[1])) for one in ones for other in others]
    return [(start, end) for start, end in found if end > start]


def thresholds(times: np.ndarray, kelvins: np.ndarray, status: np.ndarray) -> tuple[str, str]:
    """Two thresholds, degC: what a channel reads when a status changes, else within what it shows."""
    on, off, _ = _at_switches(times, kelvins, status)
    low, high = (on, off) if on < off else np.nanquantile(kelvins - ICE_POINT, (0.1, 0.5))
    return f"{low:.1f}", f"{max(high, low + 1.0):.1f}"


def _at_switches(times: np.ndarray, kelvins: np.ndarray, status: np.ndarray) -> tuple[float, float, float]:
    """What a channel reads, degC, when a status becomes on, and off, and K by which that differs from time to time.

    NaN: it does not become both. The two may come in packets of their own, at different times.
    """
    read, known = np.isfinite(kelvins), np.isfinite(status)
    turns = np.diff((status[known] > 0.5).astype(int))
    if not ((turns > 0).any() and (turns < 0).any()):
        return np.nan, np.nan, np.nan
    seconds = (times - times[0]) / np.timedelta64(1, "s")
    then = np.interp(seconds[known], seconds[read], kelvins[read] - ICE_POINT)[1:]
    at = [then[turns == sign] for sign in (1, -1)]
    on, off = (float(np.median(time)) for time in at)
    return on, off, sum(float(np.ptp(np.quantile(time, (0.25, 0.75)))) for time in at)
