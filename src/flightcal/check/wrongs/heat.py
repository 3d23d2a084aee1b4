"""Heat that is not what the scenario says: of modes, and heat that it lacks."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations, permutations
from math import comb
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...simulator import FloatArray
from ...telemetry import spells, status_or_unknown
from ...words import listed, number
from ..evidence import Fit
from ..network_view import View, pieces
from .wrong import (
    LACKED,
    NARROWER,
    PIECES,
    SHIFT,
    SHIFTS,
    Words,
    Wrong,
    closer,
    driven_otherwise,
    flow_through,
    minutes,
    off,
    status_channels,
)

_ALL_THE_TIME = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Of what flows through a node, heat that it may lack all the time."""
_LESS = (0.25, 0.5, 0.75, 1.0)
"""Of what all modes have in common in a node, that of which there may be less."""
_AT_ANY_TIME = (0.5, 2.0)
"""Of what flows through a node, heat that it may get at any time, in the mean and from piece to piece."""
_NOW_AND_THEN = 0.5
"""Share of the time, up to which heat comes and goes."""
_DATES = tuple(sign * 3600.0 * hours for hours in (*range(3, 15), 24) for sign in (-1.0, 1.0))
"""s, by which a timeline is off that is of another time zone or day."""
_PARTED = 0.85
"""Share of the variance of heat over time that lies between on and off; of a sine it is 0.81, of normal noise 0.64."""
_UNSEEN = 20.0
"""So many times as rare as heat at times that a status or the timeline gives is heat whose times only the
temperatures tell."""
_SHIFTED = 0.5
"""Of a heat, what a node may have had more or less between two rows about a time when it came or went."""
_HEATED = 3.0
"""Of what flows through a node without its heater, the power of that, about."""


def modes(view: View) -> Iterator[Wrong]:
    """A mode lacks power in a node."""
    model, centre = view.window.scenario.network, view.middle
    always = {node: _common(view, node) for node in view.heat.nodes}
    flows = {node: flow_through(view, node) for node in view.heat.nodes}
    in_common: dict[str, FloatArray] = {}
    for mode, powers in model.modes.items():
        column = view.network.network.columns.index(f"mode.{mode}")
        active = view.network.drive.inputs[:, :, column].reshape(1, -1)
        if active.min() == active.max():
            continue
        responses = {node: view.response(view.window, centre, node, active) for node in view.heat.nodes}
        if any(always.values()) and not in_common:
            steady = np.ones_like(active)
            in_common = {node: view.response(view.window, centre, node, steady) for node in view.heat.nodes}
        yield from _mode_elsewhere(view, mode, responses, always, in_common)
        written = {node: powers.get(node, 0.0) for node in flows}
        sizes = {node: max(0.5 * flow, abs(written[node]), 1.0) for node, flow in flows.items()}
        least = {
            node: max(0.5 * abs(written[node] - always[node]), 0.15 * flow) / sizes[node]
            for node, flow in flows.items()
        }
        ones, pairs = combinations(view.heat.nodes, 1), combinations(view.heat.nodes, 2)
        for nodes in (*ones, *pairs):
            columns = np.concatenate([sizes[node] * responses[node] for node in nodes], axis=1)
            first, *also = (least[node] for node in nodes)
            tries = len(model.modes) * comb(len(view.heat.nodes), len(nodes))
            words = partial(_other_powers, mode, {node: (written[node], sizes[node]) for node in nodes})
            yield Wrong("mode", mode, words, columns=columns, least=first, also=tuple(also), tries=tries)


def _other_powers(mode: str, sizes: Mapping[str, tuple[float, float]], fit: Fit) -> Words:
    """sizes: W by node as written, and of a weight of one."""
    takes = [
        f"{node} takes {number(was + size * float(weight), 3)} W, not {number(was, 3)} W"
        for (node, (was, size)), weight in zip(sizes.items(), fit.added, strict=True)
    ]
    fields = ", ".join(f"{mode}: {node}" for node in sizes)
    return Words(
        f"Mode '{mode}' has {'another power' if len(sizes) == 1 else 'other powers'} in {listed(list(sizes))}",
        f"While the timeline says '{mode}', {' and '.join(takes)}.",
        f"Check 'modes: {fields}', and that the timeline is of this flight",
    )


def late_modes(
    view: View, seconds: Sequence[float] | FloatArray = (*SHIFTS, *_DATES), apart: float = SHIFT
) -> Iterator[Wrong]:
    """Modes begin and end later than the timeline says, or earlier. apart: how far around others are tried."""
    for late in map(float, seconds if _takes_turns(view) else ()):
        words = Words(
            f"The timeline of modes is {off(-late)}",
            f"Modes begin and end {minutes(late)} {'after' if late > 0 else 'before'} what the timeline says.",
            "Check the times in 'simulator: timeline', and their zone",
        )
        near = partial(late_modes, view, closer(late, apart), NARROWER * apart)
        tries = len(SHIFTS) + len(_DATES)
        yield from driven_otherwise("mode", "timeline", words, view, tries=tries, closer=near, modes=late)


def _takes_turns(view: View) -> bool:
    """Whether the timeline has two modes."""
    return len({change.mode for change in view.window.scenario.network.timeline}) > 1


def _common(view: View, node: str) -> float:
    """W that all modes have in common in a node, which is no matter of any mode."""
    return min((mode.get(node, 0.0) for mode in view.window.scenario.network.modes.values()), default=0.0)


def _mode_elsewhere(
    view: View,
    mode: str,
    responses: Mapping[str, FloatArray],
    always: Mapping[str, float],
    in_common: Mapping[str, FloatArray],
) -> Iterator[Wrong]:
    """What a mode has more than others in a node is dissipated in another, alone or with what all have in common.

    By node: responses to 1 W in the mode, what all modes have there, W, and `in_common` to 1 W all the time.
    """
    modes, nodes = view.window.scenario.network.modes, view.heat.nodes
    for node, other in permutations(nodes, 2):
        power = modes[mode].get(node, 0.0) - always[node]
        if power <= 0.0:
            continue
        words = Words(
            f"Mode '{mode}' heats {other}, not {node}",
            f"While the timeline says '{mode}', {other} rises as {node} should, by {number(power, 3)} W.",
            f"Correct 'modes: {mode}'",
        )
        effect, tries = power * (responses[other] - responses[node]), len(modes) * len(nodes) ** 2
        yield Wrong("mode", mode, words, columns=effect, least=0.6, tries=tries)
        if always[node] <= 0.0:
            continue

        def of_all(fit: Fit, node: str = node, other: str = other, power: float = power) -> Words:
            rises, in_all = (size * float(share) for size, share in zip((power, always[node]), fit.added, strict=True))
            return Words(
                f"All modes heat {other}, not {node}",
                f"With {number(in_all, 2)} W of all modes in {other}, not in {node}, and {number(rises, 2)} W more "
                f"while the timeline says '{mode}', the model explains the telemetry.",
                f"Check which node is heated by what 'simulator: modes' write for {node}",
            )

        columns = np.concatenate([effect, always[node] * (in_common[other] - in_common[node])], axis=1)
        yield Wrong("mode", mode, of_all, columns=columns, least=0.6, tries=tries)


def exchanged(view: View) -> Iterator[Wrong]:
    """Two modes are each other's."""
    columns = view.network.network.columns
    pairs = list(combinations(view.window.scenario.network.modes, 2)) if _takes_turns(view) else []
    for one, other in pairs:
        words = Words(
            f"Modes '{one}' and '{other}' are exchanged",
            f"With '{one}' where the timeline says '{other}', and '{other}' where it says '{one}', the model explains "
            "the telemetry.",
            f"Exchange '{one}' and '{other}' in 'simulator: modes', or in 'timeline'",
        )
        window = view.exchanged([columns.index(f"mode.{one}")], [columns.index(f"mode.{other}")])
        yield Wrong("mode", f"{one} {other}", words, window=window, tries=len(pairs))


def missing_heat(view: View) -> Iterator[Wrong]:
    """Something heats a node and then does not: a heater or a mode that the scenario lacks."""
    scenario, centre = view.window.scenario, view.middle
    grid = view.network.drive.times
    used = set(status_channels(view).values())
    heated = {heater.node: name for name, heater in scenario.network.heaters.items()}
    powers = [heater.power for heater in scenario.network.heaters.values()]
    waves: list[tuple[str, str, FloatArray]] = []
    for name, channel in scenario.telemetry.channels.items():
        if channel.kind == "status" and name not in used and name in view.telemetry:
            on = status_or_unknown(view.telemetry, name, view.utc(grid))
            if np.isfinite(on).any() and np.nanmin(on) < np.nanmax(on):
                waves += [(name, node, np.nan_to_num(on)) for node in view.heat.nodes]
    waves += [("", node, on) for node, on in by_temperature(view) if heated.get(node) not in view.inferred]
    for name, node, on in waves:
        flow, heater = flow_through(view, node), None if name else heated.get(node)
        size = max(_HEATED * flow, 1.0, *powers)
        series = np.repeat(on, 2)[None]
        if not name:
            series = np.concatenate([series, about_switches(view, on)])
        effect = size * view.response(view.window, centre, node, series)

        def words(
            fit: Fit, name: str = name, node: str = node, size: float = size, on: Any = on, heater: str | None = heater
        ) -> Words:
            power, times = size * float(fit.added[0]), int((np.diff((np.asarray(on) > 0.5).astype(int)) > 0).sum())
            heat = f"About {number(abs(power), 2)} W come and go in {node}"
            if heater:
                return Words(
                    f"{heater} heats when its status does not say so",
                    f"{heat}, {times} times in the window, beside what its status says.",
                    f"Check which column its status is and how it says 'on', or whether {node} has another heater",
                )
            what = f"as {name} says, which no heater of the scenario has" if name else f"{times} times in the window"
            return Words(
                f"A heater of {node} is missing in the scenario",
                f"{heat}, {what}.",
                f"Add the heater of {node} to 'simulator: heaters', with its status as 'measured_by'",
            )

        tries = 2 * len(waves) * (1.0 if name else _UNSEEN)
        lacking = Wrong("missing heat", node, words, columns=effect, least=LACKED * flow / size, tries=tries)
        yield replace(lacking, kind="thermostat", about=heater) if heater else lacking


def by_temperature(view: View) -> Iterator[tuple[str, FloatArray]]:
    """Nodes whose temperature rises and falls, and share of each step [K] in which something heats them by that."""
    for k, channel in enumerate(view.channels):
        node = view.window.scenario.observations[channel].node
        rising = turning(view.window.observed[:, k], 4.0 * float(view.rows.noise[k]) + 0.3)
        if node in view.heat.nodes and rising is not None:
            yield str(node), shares(view.network.observation.times, rising, view.network.drive.times)


def about_switches(view: View, on: FloatArray) -> FloatArray:
    """Series [k, 2 K], shares of a heat that a node may have had more or less when its state [K] changes.

    on: in the simulation's steps, as temperatures tell it: its changes are known to about the time between two rows.
    """
    grid, rows = view.network.drive.times, view.rows.seconds
    half, at = 0.5 * float(np.median(np.diff(rows))), grid[1:-1][np.diff((on > 0.5).astype(int)) != 0]
    near = [pieces(view.window, np.array([time - half, time + half])) for time in at]
    return _SHIFTED * np.concatenate([np.empty((0, 2 * len(on))), *near])


def shares(seconds: FloatArray, states: FloatArray, grid: FloatArray) -> FloatArray:
    """[K] share of each step of a grid [K + 1] in which states [T], each from its time on, are 1: heat adds up."""
    edges = np.union1d(seconds, grid)
    state = states[np.maximum(np.searchsorted(seconds, edges[:-1], side="right") - 1, 0)]
    so_far = np.concatenate([[0.0], np.cumsum(state * np.diff(edges))])
    length = np.diff(grid)
    return np.divide(np.diff(np.interp(grid, edges, so_far)), length, out=np.zeros_like(length), where=length > 0.0)


def now_and_then(view: View, z: FloatArray, weights: Callable[[FloatArray], FloatArray]) -> Iterator[Wrong]:
    """Heat that a node gets now and then, of a mode or a heater that the scenario lacks.

    Its times are read from the telemetry: the heat of each piece of the window is estimated, and pieces of much heat
    are taken as one burst; or it is taken to be another in each of them.
    z: [d], around which. weights: of effects [R, k] of unknown size, the most probable [k] beside everything that may
    be usual.
    """
    edges = np.linspace(0.0, view.network.drive.times[-1], PIECES + 1)
    each = pieces(view.window, edges)
    of_heaters = [view.window.scenario.network.heaters[name].node for name in view.inferred]
    for node, flow in zip(view.heat.nodes, view.heat.flow.tolist(), strict=True):
        if node not in of_heaters:
            effects = view.response(view.window, z, node, each)
            yield from _burst(view, node, flow, effects, edges, weights)
            for share in _AT_ANY_TIME:
                yield _at_any_time(view, node, flow, max(share * flow, 1.0), effects)


def _burst(
    view: View,
    node: str,
    flow: float,
    effects: FloatArray,
    edges: FloatArray,
    weights: Callable[[FloatArray], FloatArray],
) -> Iterator[Wrong]:
    """Pieces of much heat as one burst; effects: [R, k] K of a watt in each piece between edges [k + 1] s."""
    size = max(flow, 1.0)
    each = size * effects
    on, parted = upper(weights(each))
    if on.mean() > _NOW_AND_THEN or parted < _PARTED:
        return
    bursts = spells(on)
    times = np.datetime_as_string(view.utc(edges[bursts]), unit="m")
    spans = [f"{first} to {last[11:]}" for first, last in times[:3].tolist()]
    when = listed(spans) + (f" and {len(times) - 3} more" if len(times) > 3 else "")

    def words(fit: Fit) -> Words:
        power = number(size * float(fit.added[0]), 2)
        return _of_what_lacks(node, f"About {power} W come and go in {node}: {when} (UTC).")

    tries = 2.0 * len(view.heat.nodes) * comb(PIECES, bursts.size)
    effect = each @ on.astype(float)[:, None]
    yield Wrong("missing heat", node, words, columns=effect, least=LACKED * flow / size, lacked=True, tries=tries)


def _at_any_time(view: View, node: str, flow: float, size: float, effects: FloatArray) -> Wrong:
    """Heat of about `size` W that is another in each piece; effects: [R, k] K of a watt in each."""

    def words(fit: Fit) -> Words:
        power = number(size * float(fit.added[0]), 2)
        return _of_what_lacks(node, f"About {power} W in the mean come and go in {node}, at no times that can be told.")

    columns = size * np.column_stack([effects.sum(axis=1), effects])
    tries = len(_AT_ANY_TIME) * len(view.heat.nodes) * _UNSEEN
    return Wrong("missing heat", node, words, columns=columns, least=LACKED * flow / size, lacked=True, tries=tries)


def _of_what_lacks(node: str, sentence: str) -> Words:
    return Words(
        f"A mode or a heater of {node} is missing in the scenario",
        sentence,
        f"Add what is on in {node} then, to 'simulator: modes' and 'timeline' or to 'simulator: heaters'",
    )


def upper(values: FloatArray) -> tuple[NDArray[np.bool_], float]:
    """[k] which of values are of the upper of two groups, so parted that both are as narrow as can be (Otsu 1979).

    And the share of the variance that lies between the two groups.
    """
    order = np.sort(values)
    inside = [k * np.var(order[:k]) + (len(order) - k) * np.var(order[k:]) for k in range(1, len(order))]
    best = int(np.argmin(inside))
    share = 1.0 - float(inside[best]) / max(len(order) * float(np.var(order)), np.finfo(float).tiny)
    return np.asarray(values >= order[1 + best]), share


def constant_heat(view: View) -> Iterator[Wrong]:
    """A node takes more all the time than the scenario says, as of electronics that are never off, or less."""
    for node, flow in zip(view.heat.nodes, view.heat.flow.tolist(), strict=True):
        written = _common(view, node)
        less = [-share * written for share in _LESS if written > 0.0]
        yield from _always(view, node, [*(max(share * flow, 0.1) for share in _ALL_THE_TIME), *less])


def _always(view: View, node: str, powers: Sequence[float]) -> Iterator[Wrong]:
    """So many W more in a node, all the time, as the simulator has it: with more heat every link does more."""
    network, k = view.network, view.heat.nodes.index(node)
    for power in powers:
        if abs(power) < LACKED * view.heat.flow[k]:
            continue
        heat = np.zeros((len(network.network.heated), 2 * len(network.drive.inputs)))
        heat[network.network.heated.index(node)] = power
        more = f"{number(abs(power), 2)} W {'more' if power > 0.0 else 'less'}"
        words = Words(
            f"{node} takes {more} than the scenario says, all the time",
            f"With {more} in {node}, the model explains the telemetry.",
            f"Check what dissipates in {node}, in 'simulator: modes', and what it absorbs",
        )
        window = replace(view.window, simulator=network.with_heat(heat))
        near = partial(_always, view, node, [power * 2.0**finer for finer in np.linspace(-0.6, 0.6, 7)])
        tries = (len(_ALL_THE_TIME) + len(_LESS)) * len(view.heat.nodes)
        yield Wrong("constant heat", node, words, window=window, tries=tries, closer=near)


def turning(values: FloatArray, swing: float) -> FloatArray | None:
    """[T] 1 while values rise from one turn to the next, by at least `swing`, else 0; None: fewer than four turns."""
    valid = np.flatnonzero(np.isfinite(values))
    if len(valid) < 8:
        return None
    turns, low, high, rising = [], valid[0], valid[0], 0
    for i in valid:
        if values[i] > values[high]:
            high = i
        if values[i] < values[low]:
            low = i
        if rising >= 0 and values[i] < values[high] - swing:
            turns.append((high, 0.0))
            rising, low, high = -1, i, i
        elif rising <= 0 and values[i] > values[low] + swing:
            turns.append((low, 1.0))
            rising, low, high = 1, i, i
    if len(turns) < 4:
        return None
    found = np.full(len(values), 1.0 - turns[0][1])
    for place, state in turns:
        found[place:] = state
    return found


WRONGS = (modes, exchanged, late_modes, missing_heat, constant_heat)
"""What looks for them."""
