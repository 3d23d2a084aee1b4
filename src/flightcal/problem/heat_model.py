"""Unmodelled heat of a calibration: which functions of time it is made of, and how windows respond to them."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from ..probability import Follows, Profile, Shaped, Slow, Tilt
from ..reduction import load
from ..scenario import HalfNormal, HalfStudentT, Heat, Prior, Scenario, time_error_of
from ..simulator import (
    FloatArray,
    IntArray,
    flow_through,
    heat_of_inputs,
)
from .window import Change, Course, Window

LEAST_POWER = 1e-9
"""W, below which nothing flows."""
_KNOTS = 3.0
"""So many knots there are in the correlation time of what is slow."""
_SLOW = 10800.0
"""s, correlation time of what is slow, where none is written."""
_FREEDOM = 3.0
"""Of the prior of how much heat wanders: most satellites' hardly does, and that of some does ten times as much."""
_OF_RANGE = 0.2
"""Of a driver's range: the correlation length of heat over it."""
_BEYOND = 3.0
"""Correlation lengths, after which nothing is known any longer."""
Part = Literal["constant", "pattern", "gains", "slow", "slow_pattern", "switches", "changes", "gaps", "error"]
SLOW = ("slow", "slow_pattern")
"""Parts that wander: a drift, and the pattern."""


@dataclass(frozen=True)
class Group:
    """Functions of time whose weights have one scale."""

    part: Part
    scale: str
    """The scale's name in theta; "": it is one."""
    size: float
    """Of the prior of the scale: W, of gains a share."""
    node: int = -1
    """Of `HeatModel.nodes`; -1: each function has its own."""
    window: str = ""
    """The window that has them, of switches, changes of mode, gaps and the simulator's error."""

    @property
    def prior(self) -> Prior:
        """Of the scale: a half-normal, of a drift half of Student's t."""
        if self.part == "slow":
            return HalfStudentT(scale=self.size, degrees_of_freedom=_FREEDOM)
        return HalfNormal(scale=self.size)


@dataclass(frozen=True)
class Gain:
    """Heat that the scenario describes, and whose size may be off: series into a node."""

    node: int
    columns: tuple[str, ...]
    watts: tuple[float, ...]
    """For each series' unit."""

    def flow(self, series: Mapping[str, FloatArray]) -> FloatArray:
        """W [..., t] of input series [..., t] by column."""
        return np.asarray(sum(w * series[column] for column, w in zip(self.columns, self.watts, strict=True)))


@dataclass(frozen=True)
class Held:
    """What heaters do in an open loop while their status is not measured."""

    window: str
    gaps: tuple[tuple[float, float, int], ...]
    """Begin and end, s from the window's start, of what is not measured of a heater."""
    on: tuple[tuple[float, float, int], ...]
    """The same of the parts of these in which it is on."""
    switches: tuple[tuple[float, int, float], ...]
    """s from the window's start, heater, and within how many seconds."""


@dataclass(frozen=True)
class Followed:
    """How the response to heat grows with a parameter; see `probability.Follows`."""

    logarithmic: bool
    at: float
    slope: FloatArray
    """[m] of each kept weight."""


@dataclass(frozen=True)
class HeatModel:
    """The functions of time that heat is made of, and, once it has been looked at, what was found of their weights.

    The functions of a group have weights N(0, scale^2). Of these only the directions are kept of which the telemetry
    tells something; the others stay as their prior has them.
    """

    nodes: tuple[str, ...]
    """[h] that take heat."""
    flow: FloatArray
    """[h] W, mean absolute heat through each at the prior's median."""
    origin: np.datetime64
    """From which times are counted."""
    harmonics: int
    """Of the orbit; 0 where the pattern is over a driver."""
    over: str
    """The driver channel that the pattern is over; "": it is over the orbit's phase."""
    profile: Profile | None
    """Of the pattern over a driver."""
    slow: Slow | None
    of_pattern: float
    """By how much the pattern wanders, over its size."""
    gains: tuple[Gain, ...]
    groups: tuple[Group, ...]
    kept: tuple[FloatArray, ...] = ()
    """Of each group [f, k]: orthonormal directions in the weights of its f functions."""
    centre: FloatArray = field(default_factory=lambda: np.empty(0))
    """[m] weights of the kept directions, of all groups, around which windows were linearised; of errors 0."""
    shapes: tuple[Shaped, ...] = ()
    """[N] of each channel's noise."""
    held: tuple[Held, ...] = ()
    """Of windows in open loop with gaps in the status."""
    tilted: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Of parameters: the slope by z of what the log density lacks where the response to heat is taken as the same for
    all theta (with a smaller capacity the same heat does more), and the z where that is zero."""
    most: float = 1.0
    """By which the log density changes so."""
    followed: Mapping[str, Followed] = field(default_factory=dict)
    """Of parameters: how the response to heat grows with them; empty: it is the same for all theta."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of the scales in theta."""
        return tuple(dict.fromkeys(group.scale for group in self.groups if group.scale))

    @property
    def scales(self) -> tuple[str, ...]:
        """[g] the same, and last "" of what has a fixed one."""
        return (*self.names, "")

    @property
    def priors(self) -> dict[str, Prior]:
        """Of the scales."""
        return {group.scale: group.prior for group in self.groups if group.scale}

    def tilt_of(self, names: Sequence[str]) -> Tilt:
        """That of entries of theta with these names."""
        slopes, centres = zip(*(self.tilted.get(name, (0.0, 0.0)) for name in names), strict=True)
        return Tilt(slopes, centres, self.most)

    def follows_of(self, names: Sequence[str]) -> Follows | None:
        """How the response follows those of the entries of a window's theta with these names."""
        found = {name: follower for name, follower in self.followed.items() if name in names}
        if not found:
            return None
        logarithmic = np.array([follower.logarithmic for follower in found.values()])
        at = np.array([follower.at for follower in found.values()])
        slope = np.stack([follower.slope for follower in found.values()], axis=1)
        return Follows(tuple(found), logarithmic, at, slope, self.centre)

    @property
    def group(self) -> IntArray:
        """[m] whose scale each kept weight has, of `scales`."""
        scales = self.scales
        counts = [kept.shape[1] for kept in self.kept]
        return np.repeat([scales.index(group.scale) for group in self.groups], counts).astype(np.int64)


def heat_model(scenario: Scenario, written: Heat, windows: Sequence[Window], theta: FloatArray) -> HeatModel:
    """That of a scenario's `heat` for a calibration on windows; theta: [q] of the first at the prior's median."""
    simulator = windows[0].network
    nodes = simulator.network.heated
    flow, brought = _heat_through(windows[0], theta)
    origin = np.datetime64(scenario.windows[scenario.train_windows[0]].start)
    groups: list[Group] = []
    slow, of_pattern = None, 0.0
    profile = _profile(windows[0].course)
    harmonics = 0 if written.pattern is None or profile is not None else written.pattern.harmonics
    if written.pattern is not None:
        # What is constant has a size of its own: harmonics that are not there tell nothing of it.
        varies = written.pattern.harmonics or written.pattern.over
        parts: tuple[Part, ...] = ("constant", "pattern") if varies else ("constant",)
        for part in parts:
            for k, node in enumerate(nodes):
                groups.append(Group(part, f"heat.{node}.{part}", written.pattern.scale * flow[k], k))
    gains = _gains(simulator.network.columns, brought)
    if written.gains is not None and gains:
        groups.append(Group("gains", "heat.gains", written.gains.scale))
    if written.slow is not None:
        time = written.slow.time
        if time is None:
            # A pattern that were another one within an orbit would not be one.
            time = max(_SLOW, windows[0].period) if harmonics else _SLOW
        slow = Slow(_knots([_span(window, origin) for window in windows], time), time)
        groups += [Group("slow", f"heat.{n}.slow", written.slow.scale * flow[k], k) for k, n in enumerate(nodes)]
        if harmonics:
            # A pattern wanders more the larger it is: its weights have the pattern's size.
            of_pattern = written.slow.of_pattern
            groups += [replace(group, part="slow_pattern") for group in groups if group.part == "pattern"]
    for window in windows:
        if window.switching is not None and (len(window.switching.time) or window.unmeasured):
            groups.append(Group("switches", "", 1.0, window=window.name))
    groups += [group for window in windows for group in own_groups(window, gains)]
    groups += [
        Group("error", "", 1.0, window=window.name) for window in windows if window.simulator.error_basis is not None
    ]
    over = (written.pattern and written.pattern.over) or ""
    return HeatModel(nodes, flow, origin, harmonics, over, profile, slow, of_pattern, gains, tuple(groups))


def _profile(course: Course | None) -> Profile | None:
    """Over the range that a driver has in all telemetry, and three lengths beyond: later telemetry may go there."""
    if course is None:
        return None
    low, high = course.range
    length = max(_OF_RANGE * (high - low), np.finfo(float).tiny)
    count = round(_KNOTS * (1.0 / _OF_RANGE + 2.0 * _BEYOND)) + 1
    return Profile(np.linspace(low - _BEYOND * length, high + _BEYOND * length, count), length, (low, high))


def own_groups(window: Window, gains: Sequence[Gain]) -> tuple[Group, ...]:
    """What is unknown of a window's own inputs: when modes change, and what flows while drivers have gaps."""
    found: list[Part] = []
    if any(uncertainty(window, change) and heat_changed(change, gains) for change in window.changes):
        found.append("changes")
    if any(gain.columns == (f"driver.{gap.load}",) for gap in window.bridged for gain in gains):
        found.append("gaps")
    return tuple(Group(part, "", 1.0, window=window.name) for part in found)


def uncertainty(window: Window, change: Change) -> float:
    """s, the deviation of when a change of mode was: that of time tags, and of the time that it lies in."""
    return math.hypot(time_error_of(window.scenario) or 0.0, change.within / math.sqrt(12.0))


def heat_changed(change: Change, gains: Sequence[Gain]) -> dict[int, float]:
    """W that a change of mode brings to nodes of the model, of those that it brings something to."""
    found: dict[int, float] = defaultdict(float)
    for mode, sign in ((change.before, -1.0), (change.after, 1.0)):
        for gain in gains:
            if gain.columns == (f"mode.{mode}",):
                found[gain.node] += sign * gain.watts[0]
    return {node: watts for node, watts in found.items() if abs(watts) > LEAST_POWER}


def knots_of(model: HeatModel, window: Window) -> FloatArray:
    """The knots of what is slow in a window, s from the model's origin; none where nothing is."""
    return np.empty(0) if model.slow is None else _knots([_span(window, model.origin)], model.slow.time)


def _span(window: Window, origin: np.datetime64) -> tuple[float, float]:
    """Beginning and end of a window, s from `origin`."""
    first = float((window.start - origin) / np.timedelta64(1, "ns") * 1e-9)
    return first, first + float(window.network.drive.times[-1])


def _knots(spans: Sequence[tuple[float, float]], time: float) -> FloatArray:
    """On a common lattice, those that spans need."""
    apart = time / _KNOTS
    parts = [np.arange(np.floor(a / apart), np.ceil(b / apart) + 1.0) for a, b in spans]
    return np.unique(np.concatenate(parts)) * apart


def _heat_through(window: Window, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Of heated nodes at theta [q]: heat [h] W that flows through each, and [h, q] W of a unit of each input series.

    Of a reduced model's nodes its file knows: those are nodes of the full network.
    """
    simulator, model = window.network, window.scenario.network
    nodes = simulator.network.heated
    if model.reduced_model is not None:
        known = load(window.scenario.folder / model.reduced_model).heat
        places = [known.nodes.index(name) for name in nodes]
        brought = np.zeros((len(nodes), len(simulator.network.columns)))
        brought[:, : known.brought.shape[1]] = known.brought[places]
        return known.flow[places], brought
    inside = theta[window.simulated]
    return flow_through(simulator, window.scenario, nodes, inside), heat_of_inputs(simulator, nodes, inside)


def _gains(columns: Sequence[str], brought: FloatArray) -> tuple[Gain, ...]:
    """Absorbed fluxes by kind, modes and loads of each node; brought: [h, q] W of a unit of each input series."""
    found: dict[tuple[int, str], list[tuple[str, float]]] = {}
    for k, place in zip(*np.nonzero(brought), strict=True):
        column, watts = columns[place], float(brought[k, place])
        kind, _, which = column.partition(".")
        if kind in ("solar", "albedo", "infrared"):
            found.setdefault((int(k), kind), []).append((column, watts))
        elif kind in ("mode", "driver"):
            found.setdefault((int(k), f"{kind}.{which}"), []).append((column, watts))
    return tuple(Gain(k, tuple(c for c, _ in series), tuple(w for _, w in series)) for (k, _), series in found.items())
