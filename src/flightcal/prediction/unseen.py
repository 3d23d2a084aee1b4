"""Where a window lies outside of what was trained on: modes, attitudes, powers, sunlight, temperatures, by name."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..environment import attitude_names, orbit_phase, seconds_later, sunlit_share
from ..problem import Window
from ..run import read_tree
from ..scenario import AttitudeTimeline, heat_of
from ..simulator import FloatArray

AGES = 30.0
"""Days after training, from which on how a satellite ages may be seen."""
ANY = "any"
"""Name of the share of time in which at least one thing is outside."""
_WIDER = 0.05
"""Of what was trained on: by how much its range is widened."""
_HARDLY = 0.01
"""Of what was trained on, if that hardly varies: sunlight that follows the distance to the Sun is not new."""
_KELVIN = 2.0
"""K, by which the range of a channel's telemetry, or of a boundary's, is widened."""
_GRAZING = 27.0
"""W/m^2, by which that of sunlight is widened at least: a face that the Sun grazes has so much more a degree later."""
_LEAST = 0.005
"""Share of time below which nothing is said."""
_PLACES = np.array([0.125, 0.375, 0.625, 0.875])
"""In each step of the integration, where one looks."""
_SECTORS = 36
"""Parts of the orbit, in each of which sunlight and eclipse may be new."""
_WORDS = {"mode": "mode", "driver": "power of", "solar": "sunlight on", "temperature": "boundary temperature of"}

Booleans = NDArray[np.bool_]


@dataclass(frozen=True)
class Unseen:
    """What of a window was not trained on."""

    name: str
    """In words, or `ANY`."""
    share: float
    """Of the window's time."""


def unseen(trained: Sequence[Window], window: Window, mean: FloatArray | None = None) -> tuple[Unseen, ...]:
    """What of a window of a thermal network was not trained on, the largest share of its time first.

    Modes and attitudes that training lacks; the driver that heat is over, powers, sunlight on faces and boundary
    temperatures outside of its range; sunlight where in the orbit it had none, and the other way round; with mean
    [T, N], K, temperatures that are predicted outside of the telemetry's range. Shares below 0.5% are left out. Empty
    where all is as it was.
    """
    if not window.is_network:
        return ()
    durations, series = _looked_at(window)
    known = [ranges for ranges in (_looked_at(other)[1] for other in trained) if ranges]
    outside: dict[str, Booleans] = {}
    for column, values in series.items():
        kind, _, which = column.partition(".")
        if kind in _WORDS:
            before = np.concatenate([ranges[column] for ranges in known if column in ranges] or [np.empty(0)])
            wider = _KELVIN if kind == "temperature" else None
            least = _GRAZING if kind == "solar" else 0.0
            new = (values > 0.5) & ~(before > 0.5).any() if kind == "mode" else _beyond(values, before, wider, least)
            outside[f"{_WORDS[kind]} {which}"] = new
    outside |= _attitudes(trained, window)
    outside |= _course(trained, window)
    outside |= _sun(trained, window)
    if mean is not None:
        outside |= _temperatures(trained, window, mean)
    whole = reduce(np.logical_or, outside.values(), np.zeros(len(durations), bool))
    shares = {name: float(durations @ where / durations.sum()) for name, where in {ANY: whole, **outside}.items()}
    found = [Unseen(name, share) for name, share in shares.items() if share >= _LEAST]
    return tuple(sorted(found, key=lambda item: -item.share))


def unseen_attribute(trained: Mapping[str, Window], window: Window, mean: FloatArray) -> dict[str, str]:
    """`unseen` as an attribute of the prediction of a window that was not trained on; none where it is not known."""
    if window.name in trained or not window.is_network:
        return {}
    return {"unseen": json.dumps([vars(item) for item in unseen(list(trained.values()), window, mean)])}


def read_unseen(file: Path) -> dict[str, tuple[Unseen, ...]]:
    """What a run's prediction says of each window in which something was not trained on."""
    attributes = {name: group.attrs for name, group in read_tree(file).children.items()}
    found = {name: json.loads(attribute["unseen"]) for name, attribute in attributes.items() if "unseen" in attribute}
    return {name: tuple(Unseen(**item) for item in items) for name, items in found.items() if items}


def _looked_at(window: Window) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Time [P] s that each place stands for, and the inputs there by column [P]; none of another simulator."""
    if not window.is_network:
        return np.empty(0), {}
    drive = window.network.drive
    begin, end = drive.inputs[:, 0], drive.inputs[:, 1]
    values = begin[:, None] + _PLACES[:, None] * (end - begin)[:, None]
    values = values.reshape(-1, values.shape[2])
    durations = np.repeat(np.diff(drive.times) / len(_PLACES), len(_PLACES))
    return durations, {column: values[:, k] for k, column in enumerate(window.network.network.columns)}


def _times(window: Window) -> NDArray[np.datetime64]:
    """[P] of the same places, UTC."""
    grid = window.network.drive.times
    seconds = (grid[:-1, None] + _PLACES * np.diff(grid)[:, None]).ravel()
    return seconds_later(window.start, seconds)


def _beyond(values: FloatArray, before: FloatArray, wider: float | None = None, least: float = 0.0) -> Booleans:
    """Whether values are outside of the range of earlier ones, NaN left out; False where there are no earlier ones.

    wider: by how much the range is widened; None: by a share of it, or `least`.
    """
    before = before[np.isfinite(before)]
    if not len(before):
        return np.zeros(len(values), bool)
    low, high = before.min(), before.max()
    if wider is None:
        wider = max(_WIDER * (high - low), _HARDLY * max(abs(low), abs(high)), least)
    return np.asarray((values < low - wider) | (values > high + wider))


def _attitudes(trained: Sequence[Window], window: Window) -> dict[str, Booleans]:
    """Where a timeline has attitudes that training had not."""
    flown = np.array(_flown(window))
    known = {"", *(name for other in trained for name in _flown(other))}
    return {f"attitude {name}": flown == name for name in dict.fromkeys(flown.tolist()) if name not in known}


def _flown(window: Window) -> list[str]:
    """The attitude's name in a timeline at each place [P]; empty without a timeline, or of another simulator."""
    attitude = window.scenario.environment.attitude
    if not window.is_network or not isinstance(attitude, AttitudeTimeline):
        return []
    return attitude_names(attitude, _times(window))


def _course(trained: Sequence[Window], window: Window) -> dict[str, Booleans]:
    """Where the driver that the pattern of heat is over is outside of its range in training."""
    known = [other.course.values for other in trained if other.course is not None]
    heat = heat_of(window.scenario)
    if window.course is None or not known or heat is None or heat.pattern is None:
        return {}
    elapsed = (_times(window) - window.start) / np.timedelta64(1, "ns") * 1e-9
    values = np.interp(elapsed, window.course.seconds, window.course.values)
    return {str(heat.pattern.over): _beyond(values, np.concatenate(known))}


def _sun(trained: Sequence[Window], window: Window) -> dict[str, Booleans]:
    """Where sunlight or eclipse are at places in the orbit at which training had the other alone."""
    origin = min(other.times[0] for other in trained)
    sectors, sunlit = _in_orbit(window, origin)
    had = np.zeros((2, _SECTORS), bool)
    for other in trained:
        if other.is_network:
            of_training, lit = _in_orbit(other, origin)
            had[lit.astype(int), of_training] = True
    if not len(sectors) or not had.any():
        return {}
    dark, bright = had[:, sectors]
    return {
        "sunlight where in the orbit training had eclipse": sunlit & dark & ~bright,
        "eclipse where in the orbit training had sunlight": ~sunlit & bright & ~dark,
    }


def _in_orbit(window: Window, origin: np.datetime64) -> tuple[NDArray[np.int64], Booleans]:
    """Part of the orbit and whether there is sunlight at each place [P]; empty where this is not known."""
    times, environment, folder = _times(window), window.scenario.environment, window.scenario.folder
    phase = orbit_phase(environment, times, folder, origin)
    share = sunlit_share(environment, times, folder)
    if not (np.isfinite(phase).all() and np.isfinite(share).all()):
        return np.empty(0, np.int64), np.empty(0, bool)
    return (phase * _SECTORS).astype(np.int64) % _SECTORS, share > 0.5


def _temperatures(trained: Sequence[Window], window: Window, mean: FloatArray) -> dict[str, Booleans]:
    """Where channels' predicted means [T, N] are outside of the trained telemetry's range."""
    if not len(window.times):
        return {}
    between = window.times[:-1] + np.diff(window.times) / 2
    nearest = np.searchsorted(between, _times(window))
    before = np.concatenate([other.observed for other in trained])
    return {
        f"temperature of {channel}": _beyond(mean[:, k], before[:, k], _KELVIN)[nearest]
        for k, channel in enumerate(window.simulator.channels)
    }
