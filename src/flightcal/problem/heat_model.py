"""Unmodelled heat of a calibration: which functions of time it is made of, and how windows respond to them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Literal

import numpy as np

from ..environment import orbit_phase
from ..probability import Follows, Profile, Shaped, Slow, Tilt, pattern, waves
from ..reduction import load
from ..scenario import HalfNormal, HalfStudentT, Heat, Prior, Scenario
from ..simulator import (
    Drive,
    FloatArray,
    IntArray,
    SimulationFailure,
    Switch,
    flow_through,
    heat_of_inputs,
    in_steps,
    integrate,
)
from ..telemetry import window_bounds
from .window import Course, Switching, Window

_FINE = 20.0
"""s, how far apart functions of time are looked up at most often: linear in between."""
_LEAST_POWER = 1e-9  # W
_LOOKS = 20_000
"""In a window, at most so many."""
_KNOTS = 3.0
"""So many knots there are in the correlation time of what is slow."""
_FREEDOM = 3.0
"""Of the prior of how much heat wanders: most satellites' hardly does, and that of some does ten times as much."""
_NUDGE = 0.02
"""Of the heat that flows through a node: what its response is looked at with."""
_HELD = 300.0
"""s, within which a switch lies that a simulation had where the status is not measured."""
_OF_RANGE = 0.2
"""Of a driver's range: the correlation length of heat over it."""
_BEYOND = 3.0
"""Correlation lengths, after which nothing is known any longer."""
_PIECE = 600.0
"""s, of a gap in a driver, whose heat is unknown in each piece alone: a pass of a transmitter lasts as long."""
_MOST_PIECES = 40
"""Of gaps in a window; where there are more, those in which most heat may be missing."""
Part = Literal["constant", "pattern", "gains", "slow", "slow_pattern", "switches", "gaps", "error"]
SLOW = ("slow", "slow_pattern")
"""Parts that wander: the constant, and the harmonics of the pattern."""


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
    """The window that has them, of switches, gaps and the simulator's error."""

    @property
    def prior(self) -> Prior:
        """Of the scale: a half-normal, of a constant that wanders half of Student's t."""
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


@dataclass(frozen=True)
class Held:
    """What heaters did in an open loop while their status was not measured: as one simulation had it."""

    window: str
    shares: tuple[tuple[int, int, float], ...]
    """Step of the integration, heater, and share of the step that it was on."""
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
        found = {name: own for name, own in self.followed.items() if name in names}
        if not found:
            return None
        logarithmic = np.array([own.logarithmic for own in found.values()])
        at = np.array([own.at for own in found.values()])
        slope = np.stack([own.slope for own in found.values()], axis=1)
        return Follows(tuple(found), logarithmic, at, slope, self.centre)

    @property
    def group(self) -> IntArray:
        """[m] whose scale each kept weight has, of `scales`."""
        scales = self.scales
        counts = [kept.shape[1] for kept in self.kept]
        return np.repeat([scales.index(group.scale) for group in self.groups], counts).astype(np.int64)


# --- what it is made of ---------------------------------------------------------------------------------------


def heat_model(scenario: Scenario, written: Heat, windows: Sequence[Window], theta: FloatArray) -> HeatModel:
    """That of a scenario's `heat` for a calibration on windows; theta: [q] of the first at the prior's median."""
    simulator = windows[0].network
    assert simulator is not None
    nodes = simulator.network.heated
    flow, brought = _heat_through(windows[0], theta)
    origin = np.datetime64(scenario.windows[scenario.train_windows[0]].start)
    groups: list[Group] = []
    slow = None
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
        slow = Slow(_knots([_span(window, origin) for window in windows], written.slow.time), written.slow.time)
        # Sizes of their own here too: of a constant that drifts, harmonics that do not would say that it is small.
        wander: tuple[Part, ...] = ("slow", "slow_pattern") if harmonics else ("slow",)
        for part in wander:
            groups += [
                Group(part, f"heat.{node}.{part}", written.slow.scale * flow[k], k) for k, node in enumerate(nodes)
            ]
    for window in windows:
        if window.switching is not None and len(window.switching.time):
            groups.append(Group("switches", "", 1.0, window=window.name))
    groups += [gaps_of(window) for window in windows if window.bridged]
    groups += [Group("error", "", 1.0, window=own.name) for own in windows if own.simulator.error_basis is not None]
    over = (written.pattern and written.pattern.over) or ""
    return HeatModel(nodes, flow, origin, harmonics, over, profile, slow, gains, tuple(groups))


def _profile(course: Course | None) -> Profile | None:
    """Over the range that a driver has in all telemetry, and three lengths beyond: later telemetry may go there."""
    if course is None:
        return None
    low, high = course.range
    length = max(_OF_RANGE * (high - low), np.finfo(float).tiny)
    count = round(_KNOTS * (1.0 / _OF_RANGE + 2.0 * _BEYOND)) + 1
    return Profile(np.linspace(low - _BEYOND * length, high + _BEYOND * length, count), length, (low, high))


def gaps_of(window: Window) -> Group:
    """The group of the heat that flows unknown while drivers have gaps in a window."""
    return Group("gaps", "", 1.0, window=window.name)


def knots_of(model: HeatModel, window: Window) -> FloatArray:
    """The knots of what is slow in a window, s from the model's origin; none where nothing is."""
    return np.empty(0) if model.slow is None else _knots([_span(window, model.origin)], model.slow.time)


def _span(window: Window, origin: np.datetime64) -> tuple[float, float]:
    """Beginning and end of a window, s from `origin`."""
    begin = _start(window)
    assert window.network is not None
    first = float((begin - origin) / np.timedelta64(1, "ns") * 1e-9)
    return first, first + float(window.network.drive.times[-1])


def _start(window: Window) -> np.datetime64:
    return window_bounds(window.scenario.windows[window.name], window.period)[0]


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
    assert simulator is not None
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
    return tuple(Gain(k, tuple(c for c, _ in own), tuple(w for _, w in own)) for (k, _), own in found.items())


def held_by(window: Window, theta: FloatArray) -> Held | None:
    """What the heaters do at theta [q] where a window in open loop has no status; None: it always has."""
    assert window.network is not None
    drive = window.network.drive
    steps, heaters = np.nonzero(np.isnan(drive.measured))
    if window.switching is None or not len(steps):
        return None
    simulator = window.network
    run = integrate(simulator.network.structure, simulator.system(theta[window.simulated]), drive, derivative=False)
    shares, switches = [], []
    for heater in np.unique(heaters).tolist():
        own = np.sort(steps[heaters == heater])
        for gap in np.split(own, np.flatnonzero(np.diff(own) > 1) + 1):
            first, moments = _in_gap(drive, run.switches, run.status, heater, gap)
            edges = np.array([drive.times[gap[0]], *(time for time, _ in moments), drive.times[gap[-1] + 1]])
            for step in gap.tolist():
                inside = np.diff(np.clip(edges, drive.times[step], drive.times[step + 1]))
                on = float(inside[0 if first else 1 :: 2].sum())
                shares.append((step, heater, on / float(drive.times[step + 1] - drive.times[step])))
            switches += [(time, heater, within) for time, within in moments]
    return Held(window.name, tuple(shares), tuple(switches))


def _in_gap(
    drive: Drive, switches: Switch, status: FloatArray, heater: int, gap: IntArray
) -> tuple[bool, list[tuple[float, float]]]:
    """Whether a heater is on where the steps of a gap in its status begin, and when it switches in it, within how long.

    As the simulation has it, with its status [K+1, H] on the grid. If that leaves the gap in another
    state than the telemetry, it switches once more: any time after its last switch.
    """
    begin, end = drive.times[gap[0]], drive.times[gap[-1] + 1]
    inside = (switches.heater == heater) & (switches.time > begin) & (switches.time < end)
    moments = [(time, _HELD) for time in switches.time[inside].tolist()]
    first = not switches.on[inside][0] if moments else bool(status[gap[0] + 1, heater])
    after = drive.measured[gap[-1] + 1, heater] if gap[-1] + 1 < len(drive.measured) else np.nan
    if after in (0.0, 1.0) and bool(after) != (first ^ bool(len(moments) % 2)):
        last = moments[-1][0] if moments else float(begin)
        moments.append((0.5 * (last + float(end)), float(end) - last))
    return first, moments


def hold(window: Window, held: Held) -> Window:
    """A window in open loop whose heaters do what is held where their status is not known."""
    assert window.network is not None
    assert window.switching is not None
    drive, heaters = window.network.drive, window.network.heaters
    measured = drive.measured.copy()
    for step, heater, share in held.shares:
        measured[step, heater] = share
    own = window.switching
    switching = Switching(
        np.concatenate([own.time, [time for time, _, _ in held.switches]]),
        np.concatenate([own.interval, [within for _, _, within in held.switches]]),
        (*own.heater, *(heaters[heater] for _, heater, _ in held.switches)),
    )
    simulator = replace(window.network, drive=replace(drive, measured=measured))
    return replace(window, simulator=simulator, switching=switching)


# --- in a window ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Units:
    """What a weight of one of f functions is: heat, or an error of the simulator, which no heat makes."""

    share: FloatArray
    """[f, h] of the series that goes to each of the model's nodes; of errors nothing."""
    series: FloatArray
    """[f, 2 K] W, in each step of the window's integration (`in_steps`); of errors nothing."""
    error: FloatArray | None = None
    """[T, N, f] K; None: it is heat."""

    @property
    def node(self) -> IntArray:
        """[f] of the model's nodes, the one that takes most; of errors -1."""
        return np.where(self.share.any(axis=1), self.share.argmax(axis=1), -1)


def unit_heats(model: HeatModel, window: Window) -> tuple[Units, ...]:
    """Of each group, in a window of a thermal network."""
    assert window.network is not None
    drive, start = window.network.drive, _start(window)
    grid = drive.times
    fine = np.unique(np.concatenate([grid, np.arange(0.0, grid[-1], max(_FINE, grid[-1] / _LOOKS))]))
    times = start.astype("datetime64[ns]") + np.round(fine * 1e9).astype("timedelta64[ns]")
    seconds = fine + float((start - model.origin) / np.timedelta64(1, "ns") * 1e-9)
    phase = orbit_phase(window.scenario.environment, times, window.scenario.folder, model.origin)
    known = bool(np.isfinite(phase).all())
    if model.profile is None:
        of_pattern = pattern(phase if known else 0.0 * fine, model.harmonics if known else 0)
    else:
        assert window.course is not None
        values = np.interp(fine, window.course.seconds, window.course.values)
        of_pattern = np.concatenate([np.ones((1, len(fine))), model.profile.at(values)])
    of_slow, around_it = np.empty((2, 0, len(fine)))
    if model.slow is not None:
        of_slow = model.slow.at(seconds)
        harmonics = waves(phase, model.harmonics)[1:] if known else ()
        around_it = np.concatenate([around_it, *(wave * of_slow for wave in harmonics)])
    in_all = {
        "constant": _on_grid(fine, of_pattern[:1], grid),
        "pattern": _on_grid(fine, of_pattern[1:], grid),
        "slow": _on_grid(fine, of_slow, grid),
        "slow_pattern": _on_grid(fine, around_it, grid),
    }
    found = []
    for group in model.groups:
        if group.part in in_all:
            series = in_all[group.part]
            found.append(Units(_one_node(model, [group.node] * len(series)), series))
        elif group.part == "gains":
            place = {name: k for k, name in enumerate(window.network.network.columns)}
            flows = [
                sum(watts * drive.series[place[column]] for column, watts in zip(g.columns, g.watts, strict=True))
                for g in model.gains
            ]
            found.append(Units(_one_node(model, [gain.node for gain in model.gains]), np.stack(flows)))
        elif group.part == "gaps":
            found.append(_gap_heats(model, window, group.window == window.name))
        elif group.part == "error":
            found.append(_errors(model, window, group.window == window.name))
        else:
            found.append(_switch_heats(model, window, group.window == window.name))
    return tuple(found)


def _one_node(model: HeatModel, node: Sequence[int]) -> FloatArray:
    """Shares [f, h] of functions that have one node each."""
    return np.eye(len(model.nodes))[np.array(node, np.int64)]


def _on_grid(times: FloatArray, values: FloatArray, grid: FloatArray) -> FloatArray:
    """[f, 2 K]"""
    in_order = np.ascontiguousarray(np.moveaxis(in_steps(times, values, grid), 1, 2))
    return in_order.reshape(len(values), 2 * (len(grid) - 1))


def _switch_heats(model: HeatModel, window: Window, own: bool) -> Units:
    """What a shift of each switch by its deviation adds: the power of its heaters for that time, around the switch."""
    assert window.network is not None
    switching, grid = window.switching, window.network.drive.times
    shares, series = [np.empty((0, len(model.nodes)))], [np.empty((0, 2 * (len(grid) - 1)))]
    for k in heated_switches(model, window) if own else ():
        assert switching is not None
        watts = _watts(model, window, switching.heater[k])
        power = max(watts.sum(), _LEAST_POWER)
        time, interval = switching.time[k], switching.interval[k]
        edges = np.clip([time - 0.5 * interval, time + 0.5 * interval], grid[0], grid[-1])
        inside = np.diff(np.clip(grid, *edges)) / np.diff(grid).clip(1e-9)
        # Energy: power times the shift's deviation, interval / sqrt(12), spread over the interval.
        series.append(np.repeat(power / np.sqrt(12.0) * inside, 2)[None])
        shares.append(watts[None] / power)
    return Units(np.concatenate(shares), np.concatenate(series))


def heated_switches(model: HeatModel, window: Window) -> tuple[int, ...]:
    """Which of a window's switches [E] put heat into nodes of the model."""
    if window.switching is None:
        return ()
    heated = {name for name in set(window.switching.heater) if _heats(model, window, name)}
    return tuple(k for k, name in enumerate(window.switching.heater) if name in heated)


def _heats(model: HeatModel, window: Window, heater: str) -> bool:
    return any(own.node in model.nodes for own in window.scenario.network.on_switch(heater).values())


def _watts(model: HeatModel, window: Window, heater: str) -> FloatArray:
    """[h] W into each of the model's nodes while a heater is on, as the scenario writes it."""
    watts = np.zeros(len(model.nodes))
    for own in window.scenario.network.on_switch(heater).values():
        if own.node in model.nodes:
            watts[model.nodes.index(own.node)] += own.power
    return watts


def _gap_heats(model: HeatModel, window: Window, own: bool) -> Units:
    """What a driver's deviation adds through its load, in each piece of a gap."""
    assert window.network is not None
    grid = window.network.drive.times
    found: list[tuple[float, int, FloatArray]] = []
    for gap in window.bridged if own else ():
        edges = np.linspace(gap.begin, gap.end, 1 + max(1, round((gap.end - gap.begin) / _PIECE)))
        for gain in model.gains:
            if gain.columns != (f"driver.{gap.load}",):
                continue
            watts = abs(gain.watts[0]) * gap.deviation
            for begin, end in pairwise(edges.tolist()):
                inside = np.diff(np.clip(grid, begin, end)) / np.diff(grid).clip(1e-9)
                found.append((watts * (end - begin), gain.node, np.repeat(watts * inside, 2)))
    found = sorted(found, key=lambda piece: -piece[0])[:_MOST_PIECES]
    series = np.reshape([piece[2] for piece in found], (-1, 2 * (len(grid) - 1)))
    return Units(_one_node(model, [piece[1] for piece in found]), series)


def _errors(model: HeatModel, window: Window, own: bool) -> Units:
    """The shapes of the simulator's error, each of its prior size."""
    assert window.network is not None
    basis, variance = window.network.error_basis, window.network.error_variance
    if basis is None or not own:
        basis, variance = np.empty((*window.observed.shape, 0)), np.empty(0)
    series = np.zeros((len(variance), 2 * (len(window.network.drive.times) - 1)))
    return Units(np.zeros((len(variance), len(model.nodes))), series, basis * np.sqrt(variance))


def errors_of_weights(units: Sequence[Units], weights: Sequence[FloatArray]) -> FloatArray | float:
    """The simulator's errors [..., T, N] K of weights [..., f] of each group's functions; 0.0: it has none."""
    found: FloatArray | float = 0.0
    for own, of_group in zip(units, weights, strict=True):
        if own.error is not None:
            found = found + np.einsum("tnf,...f->...tn", own.error, of_group[..., : len(own.series)])
    return found


def heat_of_weights(model: HeatModel, units: Sequence[Units], weights: Sequence[FloatArray]) -> FloatArray:
    """Heat [..., h, 2 K] W of weights [..., f] of each group's functions."""
    leading = weights[0].shape[:-1]
    heat = np.zeros((*leading, len(model.nodes), units[0].series.shape[1]))
    for own, of_group in zip(units, weights, strict=True):
        for node in np.flatnonzero(own.share.any(axis=0)):
            here = np.flatnonzero(own.share[:, node])
            heat[..., node, :] += (of_group[..., here] * own.share[here, node]) @ own.series[here]
    return heat


def split(model: HeatModel, kept: FloatArray) -> list[FloatArray]:
    """Weights [..., f] of each group's functions from those [..., m] of the kept directions."""
    ends = np.cumsum([own.shape[1] for own in model.kept])
    return [part @ basis.T for basis, part in zip(model.kept, np.split(kept, ends[:-1], axis=-1), strict=True)]


def kept_responses(bases: Sequence[FloatArray], found: Sequence[FloatArray]) -> FloatArray:
    """[T, N, m] in kept directions [f, k], of each group's [T, N, f]; a window may lack the last functions."""
    kept = [response @ basis[: response.shape[2]] for response, basis in zip(found, bases, strict=True)]
    return np.concatenate(kept, axis=2)


def places_of(model: HeatModel, count: int) -> FloatArray:
    """[P] where a pattern is looked at: phases of an orbit, or values over the range of the driver that it is over."""
    return np.linspace(*((0.0, 1.0) if model.profile is None else model.profile.range), count)


def patterns_of(model: HeatModel, kept: FloatArray, places: FloatArray) -> FloatArray:
    """Heat [S, h, P] W that comes again, at places [P] (see `places_of`), of weights [S, m] of the kept directions."""
    if model.profile is None:
        functions = pattern(places, model.harmonics)
    else:
        functions = np.concatenate([np.ones((1, len(places))), model.profile.at(places)])
    found = np.zeros((len(kept), len(model.nodes), len(places)))
    for group, weights in zip(model.groups, split(model, kept), strict=True):
        if group.part in ("constant", "pattern"):
            found[:, group.node] += weights @ (functions[:1] if group.part == "constant" else functions[1:])
    return found


def responses(window: Window, theta: FloatArray, model: HeatModel, units: Sequence[Units]) -> list[FloatArray]:
    """What each function of each group does to the temperatures, [T, N, f] K, at theta [q]: central differences.

    An error of the simulator is what it does.

    Raises SimulationFailure.
    """
    assert window.network is not None
    series = np.concatenate([own.series for own in units])
    share = np.concatenate([own.share for own in units])
    # Of the node whose flow it changes most.
    largest = np.abs(series).max(axis=1, initial=0.0) * (share / model.flow).max(axis=1)
    nudge = np.where(largest > 0.0, _NUDGE / np.where(largest > 0.0, largest, 1.0), 0.0)
    moved = np.flatnonzero(nudge > 0.0)
    heat = np.zeros((2 * len(moved), len(model.nodes), series.shape[1]))
    for row, f in enumerate(moved):
        heat[row] = nudge[f] * share[f, :, None] * series[f]
        heat[len(moved) + row] = -heat[row]
    runs = window.network.simulate_many(np.tile(theta[window.simulated], (len(heat), 1)), heat)
    response = np.zeros((*window.observed.shape, len(series)))
    for row, f in enumerate(moved):
        above, below = runs[row], runs[len(moved) + row]
        if above is None or below is None:
            raise SimulationFailure("a simulation with a little more heat fails")
        response[..., f] = (above.temperatures - below.temperatures) / (2.0 * nudge[f])
    found = np.split(response, np.cumsum([len(own.series) for own in units])[:-1], axis=2)
    return [of_heat if own.error is None else own.error for own, of_heat in zip(units, found, strict=True)]
