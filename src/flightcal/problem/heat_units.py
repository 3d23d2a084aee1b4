"""What a weight of unmodelled heat does in a window: heat in its steps, and how its temperatures respond."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.sparse import csr_array

from ..environment import orbit_phase, seconds_later
from ..probability import pattern, waves
from ..simulator import FloatArray, IntArray, SimulationFailure, spread, step_weights
from .heat_model import LEAST_POWER, HeatModel, heat_changed, uncertainty
from .window import Window

_FINE = 20.0
"""s, how far apart functions of time are looked up at most often: linear in between."""
_LOOKS = 20_000
"""In a window, at most so many."""
_NUDGE = 0.02
"""Of the heat that flows through a node: what its response is looked at with."""
_NOTHING = 1e-12
"""Of the largest heat: what does nothing."""
_MOST_CHANGED = 1e3
"""K, by which that much heat changes a temperature at most: what goes on from there overflows."""
_ON, _SAMPLES = 0.5, 4.0
"""Of the time on of a heater whose status is not measured: it may be off by as much in all, where fewer samples than
these show when it is on."""
_AT_ONCE = 2**22
"""Numbers of heat that simulations are made with at once: 32 MiB."""
_PIECE = 600.0
"""s, of a gap in a driver, whose heat is unknown in each piece alone: a pass of a transmitter lasts as long."""
_AT_A_STROKE = 0.5
"""s, of a step of the integration that is no step for massless nodes to settle."""
_MOST_PIECES = 40
"""Of gaps, and of changes of mode, in a window; where there are more, those in which most heat may be missing."""


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
        return np.where(self.share.any(axis=1), np.abs(self.share).argmax(axis=1), -1)


def unit_heats(model: HeatModel, window: Window) -> tuple[Units, ...]:
    """Of each group, in a window of a thermal network."""
    drive, start = window.network.drive, window.start
    grid = drive.times
    fine = np.unique(np.concatenate([grid, np.arange(0.0, grid[-1], max(_FINE, grid[-1] / _LOOKS))]))
    times = seconds_later(start, fine)
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
        wandering = waves(phase, model.harmonics) if known else ()
        around_it = np.concatenate([around_it, *(model.of_pattern * wave * of_slow for wave in wandering)])
    weights = step_weights(fine, grid)
    in_all = {
        "constant": _in_steps(weights, of_pattern[:1]),
        "pattern": _in_steps(weights, of_pattern[1:]),
        "slow": _in_steps(weights, of_slow),
        "slow_pattern": _in_steps(weights, around_it),
    }
    found = []
    for group in model.groups:
        if group.part in in_all:
            series = in_all[group.part]
            found.append(Units(_one_node(model, [group.node] * len(series)), series))
        elif group.part == "gains":
            series_of = dict(zip(window.network.network.columns, drive.series, strict=True))
            flows = [gain.flow(series_of) for gain in model.gains]
            found.append(Units(_one_node(model, [gain.node for gain in model.gains]), np.stack(flows)))
        elif group.part == "changes":
            found.append(_change_heats(model, window, group.window == window.name))
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


def _in_steps(weights: csr_array, values: FloatArray) -> FloatArray:
    """[f, 2 K] of values [f, M], by what `step_weights` gives."""
    in_order = np.ascontiguousarray(np.moveaxis(spread(weights, values), 1, 2))
    return in_order.reshape(len(values), weights.shape[0])


def _switch_heats(model: HeatModel, window: Window, whole: bool) -> Units:
    """What a shift of each switch by its deviation adds: the power of its heaters for that time, around the switch."""
    switching, grid = window.switching, window.network.drive.times
    shares, series = [np.empty((0, len(model.nodes)))], [np.empty((0, 2 * (len(grid) - 1)))]
    for k in heated_switches(model, window) if whole else ():
        assert switching is not None
        watts = heater_watts(model, window, switching.heater[k])
        power = max(watts.sum(), LEAST_POWER)
        time, interval = switching.time[k], switching.interval[k]
        # Energy: power times the shift's deviation, interval / sqrt(12), spread over the interval.
        inside = _inside(time - 0.5 * interval, time + 0.5 * interval, grid)
        series.append(np.repeat(power / np.sqrt(12.0) * inside, 2)[None])
        shares.append(watts[None] / power)
    for heater in window.unmeasured if whole else ():
        watts = heater_watts(model, window, window.network.heaters[heater])
        on = np.nan_to_num(window.network.drive.measured[:, heater])
        spells = int((np.diff(on, prepend=0.0) > 0.0).sum())
        if watts.sum() > LEAST_POWER and on @ np.diff(grid) < spells * _SAMPLES * window.interval:
            series.append(np.repeat(_ON * watts.sum() * on, 2)[None])
            shares.append(watts[None] / watts.sum())
    return Units(np.concatenate(shares), np.concatenate(series))


def _inside(begin: float, end: float, grid: FloatArray) -> FloatArray:
    """[K] share of each step that lies between two times."""
    return np.diff(np.clip(grid, begin, end)) / np.diff(grid)


def _change_heats(model: HeatModel, window: Window, whole: bool) -> Units:
    """What each change of mode adds that is early by the deviation of a time: the heat that it changes, for so long."""
    grid = window.network.drive.times
    found: list[tuple[float, FloatArray, FloatArray]] = []
    for change in window.changes if whole else ():
        step = np.zeros(len(model.nodes))
        for node, watts in heat_changed(change, model.gains).items():
            step[node] = watts
        power, early = np.abs(step).sum(), uncertainty(window, change)
        if power * early == 0.0:
            continue
        if change.within > 0.0:
            half = 0.5 * change.within
            inside = _inside(change.time - half, change.time + half, grid)
            moved = np.repeat(power * early / change.within * inside, 2)
        else:
            # All at once where the first step begins that is one: as much heat in it, and the same first moment.
            steps = np.flatnonzero((grid[:-1] > change.time - 1e-3) & (np.diff(grid) > _AT_A_STROKE))[:1]
            sudden = np.zeros((len(grid) - 1, 2))
            sudden[steps] = np.array([4.0, -2.0]) * power * early / np.diff(grid)[steps, None]
            moved = sudden.ravel()
        found.append((power * early, step / power, moved))
    found = sorted(found, key=lambda change: -change[0])[:_MOST_PIECES]
    shares = np.reshape([change[1] for change in found], (-1, len(model.nodes)))
    return Units(shares, np.reshape([change[2] for change in found], (-1, 2 * (len(grid) - 1))))


def heated_switches(model: HeatModel, window: Window) -> tuple[int, ...]:
    """Which of a window's switches [E] put heat into nodes of the model."""
    if window.switching is None:
        return ()
    switched = {name: window.scenario.network.on_switch(name).values() for name in set(window.switching.heater)}
    heated = {name for name, blocks in switched.items() if any(heater.node in model.nodes for heater in blocks)}
    return tuple(k for k, name in enumerate(window.switching.heater) if name in heated)


def shifts_of_weights(model: HeatModel, window: Window, weights: Sequence[FloatArray]) -> FloatArray:
    """[..., E] s by which each switch of a window's `switching` was later, or its heater longer on.

    weights: [..., f] of each group's functions.
    """
    for group, group_weights in zip(model.groups, weights, strict=True):
        if group.part == "switches" and group.window == window.name and window.switching is not None:
            shifts = np.zeros((*group_weights.shape[:-1], len(window.switching.interval)))
            uncertain = np.array(heated_switches(model, window), np.int64)
            shifts[..., uncertain] = (
                group_weights[..., : len(uncertain)] * window.switching.interval[uncertain] / np.sqrt(12.0)
            )
            return shifts
    return np.zeros((*weights[0].shape[:-1], 0))


def heater_watts(model: HeatModel, window: Window, heater: str) -> FloatArray:
    """[h] W into each of the model's nodes while a heater is on, as the scenario writes it."""
    watts = np.zeros(len(model.nodes))
    for block in window.scenario.network.on_switch(heater).values():
        if block.node in model.nodes:
            watts[model.nodes.index(block.node)] += block.power
    return watts


def _gap_heats(model: HeatModel, window: Window, whole: bool) -> Units:
    """What a driver's deviation adds through its load, in each piece of a gap."""
    grid = window.network.drive.times
    found: list[tuple[float, int, FloatArray]] = []
    for gap in window.bridged if whole else ():
        edges = np.linspace(gap.begin, gap.end, 1 + max(1, round((gap.end - gap.begin) / _PIECE)))
        for gain in model.gains:
            if gain.columns != (f"driver.{gap.load}",):
                continue
            watts = abs(gain.watts[0]) * gap.deviation
            for begin, end in pairwise(edges.tolist()):
                found.append((watts * (end - begin), gain.node, np.repeat(watts * _inside(begin, end, grid), 2)))
    found = sorted(found, key=lambda piece: -piece[0])[:_MOST_PIECES]
    series = np.reshape([piece[2] for piece in found], (-1, 2 * (len(grid) - 1)))
    return Units(_one_node(model, [piece[1] for piece in found]), series)


def _errors(model: HeatModel, window: Window, whole: bool) -> Units:
    """The shapes of the simulator's error, each of its prior size."""
    basis, variance = window.network.error_basis, window.network.error_variance
    if basis is None or not whole:
        basis, variance = np.empty((*window.observed.shape, 0)), np.empty(0)
    series = np.zeros((len(variance), 2 * (len(window.network.drive.times) - 1)))
    return Units(np.zeros((len(variance), len(model.nodes))), series, basis * np.sqrt(variance))


def errors_of_weights(units: Sequence[Units], weights: Sequence[FloatArray]) -> FloatArray | float:
    """The simulator's errors [..., T, N] K of weights [..., f] of each group's functions; 0.0: it has none."""
    found: FloatArray | float = 0.0
    for group_units, of_group in zip(units, weights, strict=True):
        if group_units.error is not None:
            found = found + np.einsum("tnf,...f->...tn", group_units.error, of_group[..., : len(group_units.series)])
    return found


def heat_of_weights(model: HeatModel, units: Sequence[Units], weights: Sequence[FloatArray]) -> FloatArray:
    """Heat [..., h, 2 K] W of weights [..., f] of each group's functions."""
    leading = weights[0].shape[:-1]
    heat = np.zeros((*leading, len(model.nodes), units[0].series.shape[1]))
    for group_units, of_group in zip(units, weights, strict=True):
        for node in np.flatnonzero(group_units.share.any(axis=0)):
            here = np.flatnonzero(group_units.share[:, node])
            heat[..., node, :] += (of_group[..., here] * group_units.share[here, node]) @ group_units.series[here]
    return heat


def split(model: HeatModel, kept: FloatArray) -> list[FloatArray]:
    """Weights [..., f] of each group's functions from those [..., m] of the kept directions."""
    ends = np.cumsum([directions.shape[1] for directions in model.kept])
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


def responses(
    window: Window,
    theta: FloatArray,
    model: HeatModel,
    units: Sequence[Units],
    read: Callable[[FloatArray], FloatArray] = np.asarray,
) -> list[FloatArray]:
    """What each function of each group does to the temperatures, [T, N, f] K, at theta [q]: central differences.

    An error of the simulator is what it does. read: what is kept of temperatures [T, N, k], as [..., k].

    Raises SimulationFailure.
    """
    series = np.concatenate([group_units.series for group_units in units])
    share = np.concatenate([group_units.share for group_units in units])
    # Of the node whose flow it changes most.
    largest = np.abs(series).max(axis=1, initial=0.0) * (np.abs(share) / model.flow).max(axis=1)
    # Months after another window, what was slow there has fallen to numbers that cannot be divided by.
    least = _NOTHING * largest.max(initial=0.0)
    at_once = max(1, _AT_ONCE // max(1, 2 * len(model.nodes) * series.shape[1]))
    found = np.zeros((*read(np.zeros((*window.observed.shape, 0))).shape[:-1], len(series)))
    for first in range(0, len(series), at_once):
        part = first + np.flatnonzero(largest[first : first + at_once] > least)
        if not len(part):
            continue
        nudged = _NUDGE / largest[part]
        heat = np.empty((2, len(part), len(model.nodes), series.shape[1]))
        np.multiply((nudged[:, None] * share[part])[:, :, None], series[part, None, :], out=heat[0])
        np.negative(heat[0], out=heat[1])
        thetas = np.tile(theta[window.simulated], (2 * len(part), 1))
        runs = window.network.simulate_many(thetas, heat.reshape(-1, *heat.shape[2:]))
        succeeded = [run.temperatures for run in runs if run is not None]
        if len(succeeded) < len(runs):
            raise SimulationFailure("a simulation with a little more heat fails")
        changes = np.stack([a - b for a, b in zip(succeeded[: len(part)], succeeded[len(part) :], strict=True)])
        if np.abs(changes).max() > _MOST_CHANGED:
            raise SimulationFailure(f"a little more heat changes a temperature by more than {_MOST_CHANGED:g} K")
        changes /= 2.0 * nudged[:, None, None]
        # Where all of them do something a slice is filled, which takes a tenth of the time.
        whole = part[-1] - part[0] + 1 == len(part)
        found[..., slice(part[0], part[-1] + 1) if whole else part] = read(np.moveaxis(changes, 0, 2))
    of_heat = np.split(found, np.cumsum([len(group_units.series) for group_units in units])[:-1], axis=-1)
    return [
        heat if group_units.error is None else read(group_units.error)
        for group_units, heat in zip(units, of_heat, strict=True)
    ]


def responses_in(
    window: Window, theta: FloatArray, model: HeatModel, units: Sequence[Units], bases: Sequence[FloatArray]
) -> FloatArray:
    """What heat in the directions of bases [f, k] of all groups does to the temperatures, [T, N, m] K, at theta [q].

    Raises SimulationFailure.
    """
    combined = [_in_directions(group_units, basis) for group_units, basis in zip(units, bases, strict=True)]
    found = responses(
        window, theta, model, [combined_units or one for combined_units, one in zip(combined, units, strict=True)]
    )
    kept = [
        of if combined_units else of @ basis[: of.shape[2]]
        for combined_units, of, basis in zip(combined, found, bases, strict=True)
    ]
    return np.concatenate(kept, axis=2)


def _in_directions(group_units: Units, basis: FloatArray) -> Units | None:
    """Heat of one node in the directions of a basis [f, k]; None: it is not all of one."""
    one_node = (
        group_units.error is None
        and len(group_units.share) > 0
        and bool((group_units.share == group_units.share[0]).all())
    )
    if not one_node:
        return None
    series = basis[: len(group_units.series)].T @ group_units.series
    return Units(np.repeat(group_units.share[:1], len(series), axis=0), series)
