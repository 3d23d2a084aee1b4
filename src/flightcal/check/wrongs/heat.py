"""Heat of another size, time or place than written: heaters and their status, modes, measured loads."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations, permutations
from math import comb
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...report import listed, number
from ...simulator import FloatArray
from ...telemetry import status_or_unknown
from ..evidence import Fit
from ..view import View, known_thermostats
from .wrong import FACTORS, FEW_TIMES, SHIFTS, Words, Wrong, driven_otherwise, duration, multiplied, status_channels

_POWER = 0.25
"""Share by which a heater's power is off, from which it is worth a word."""
_NOTHING = 0.05
"""Share of its power, below which a heater does not heat."""
_THRESHOLD = 8.0
"""K, prior deviation of thresholds that are wrong."""
_REACHED = 0.2
"""Of the way between its thresholds, by which a reading may stay short of one at which a heater switches."""
_ALL_THE_TIME = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Of what flows through a node, heat that it may lack all the time,"""
_LACKED = 0.2
"""and the least that is worth a word."""
_PIECES = 48
"""Of a window, each with heat of its own."""
_NOW_AND_THEN = 0.5
"""Share of the time, up to which heat comes and goes."""
_DATES = tuple(sign * 3600.0 * hours for hours in (*range(3, 15), 24) for sign in (-1.0, 1.0))
"""s, by which a timeline is off that is of another time zone or day."""
_PARTED = 0.85
"""Share of the variance of heat over time that lies between on and off; of a sine it is 0.81, of normal noise 0.64."""
_SECOND = 30.0
"""So many times as rare as a first heater of a node is a second one that the scenario lacks,"""
_UNSEEN = 20.0
"""and as heat at times that a status or the timeline gives is heat whose times only the temperatures tell."""
_TOLD = 0.15
"""Share of a heater's time on, before a change of its power and after it, from which the change is told."""
_PARTS = 6
"""Of a window, after each of which a heater may have another power."""


def statuses(view: View) -> Iterator[Wrong]:
    """A status is inverted, or two are each other's."""
    channels = status_channels(view)
    for heater, channel in channels.items():
        data = view.telemetry.assign({channel: 1.0 - view.telemetry[channel]})
        words = Words(
            f"{channel} is inverted",
            f"The temperatures rise while {channel} says that {heater} is off: it is on for "
            f"{100 * (1 - float(np.nanmean(view.telemetry[channel]))):.0f}% of the time, not for "
            f"{100 * float(np.nanmean(view.telemetry[channel])):.0f}%.",
            f"Correct 'on' of {channel} in 'telemetry: channels'",
        )
        yield from driven_otherwise("status inverted", channel, words, view, tries=len(channels), telemetry=data)
    for a, b in combinations(channels.values(), 2):
        data = view.telemetry.assign({a: view.telemetry[b], b: view.telemetry[a]})
        words = Words(
            f"{a} and {b} are swapped",
            f"With the status of {a} and {b} exchanged, the model explains the telemetry.",
            f"Exchange 'column' of {a} and {b} in 'telemetry: channels'",
        )
        yield from driven_otherwise("statuses swapped", a, words, view, tries=len(channels), telemetry=data)


def heaters(view: View) -> Iterator[Wrong]:
    """A heater has another power, or heats another node."""
    blocks = view.window.scenario.network.heaters
    centre = view.middle
    for name, block in blocks.items():
        on = np.nan_to_num(view.network.drive.measured[:, view.switch_of[name]])
        if block.node not in view.heat.nodes or not on.any() or name in view.unknown:
            continue
        waves = block.power * np.repeat(on, 2)[None]
        own = view.response(view.window, centre, block.node, waves)

        def words(fit: Fit, name: str = name, power: float = block.power) -> Words:
            return _of_power(name, 1.0 + float(fit.added[0]), power)

        if view.network.network.paths.index(f"heaters.{name}.power") in view.network.mapping.set_positions:
            yield Wrong("heater", name, words, columns=own, least=_POWER, tries=len(blocks))
        else:
            yield from _powers(view, name, [name], (0.0, *FEW_TIMES, *FACTORS), len(blocks))
        yield from _from_then_on(view, name, np.linspace(0.0, view.network.drive.times[-1], _PARTS + 1)[1:-1], _PARTS)
        for node in view.heat.nodes:
            if node == block.node:
                continue
            other = view.response(view.window, centre, node, waves) - own

            def moved(fit: Fit, name: str = name, node: str = node, block: Any = block) -> Words:
                return Words(
                    f"{name} heats {node}, not {block.node}",
                    f"While {name} is on, {node} rises as {block.node} should.",
                    f"Correct 'node' of {name} in 'simulator: heaters'",
                )

            yield Wrong("heater", name, moved, columns=other, least=0.6, tries=len(blocks) * len(view.heat.nodes))
    if len(blocks) > 1 and not view.unknown:
        yield from _powers(view, "every heater", list(blocks), FEW_TIMES, len(FEW_TIMES))


def _from_then_on(view: View, name: str, starts: Sequence[float] | FloatArray, parts: float) -> Iterator[Wrong]:
    """A heater has another power from a time on, s from the window's start: a string of it fails, or all of it.

    parts: of the window, between whose ends the time is.
    """
    block, drive = view.window.scenario.network.heaters[name], view.network.drive
    on, length = np.nan_to_num(drive.measured[:, view.switch_of[name]]), float(drive.times[-1])
    lasting = np.stack([on * (drive.times[:-1] >= start) for start in starts])
    # Before and after, it has to heat often enough to be told.
    told = [k for k, own in enumerate(lasting) if _TOLD < own.sum() / on.sum() < 1.0 - _TOLD]
    if not told:
        return
    effects = view.response(view.window, view.middle, block.node, block.power * np.repeat(lasting[told], 2, axis=1))
    for k, start in enumerate(np.asarray(starts)[told].tolist()):
        when = np.datetime_as_string(view.utc(np.array([start]))[0], unit="m")

        def words(fit: Fit, when: str = when) -> Words:
            factor = 1.0 + float(fit.added[0])
            text = f"{number(factor, 2)} times the power that the scenario says"
            return Words(
                f"{name} {'does not heat' if abs(factor) < _NOTHING else f'has {text}'} from {when} on",
                f"From about {when} UTC on the temperatures rise as with {number(factor * block.power, 3)} W while its "
                f"status says 'on', not with {number(block.power, 3)} W.",
                f"Look for a failure of {name} then, such as of one of its strings; or end the window before",
            )

        near = partial(_from_then_on, view, name, start + np.linspace(-0.5, 0.5, 7) * length / parts, 4.0 * parts)
        tries = _PARTS * len(view.window.scenario.network.heaters)
        effect, about = effects[:, [k]], f"{name} from a time on"
        yield Wrong("heater", about, words, columns=effect, least=_POWER, tries=tries, closer=near)


def _powers(view: View, name: str, heaters: Sequence[str], factors: Sequence[float], tries: float) -> Iterator[Wrong]:
    """Heaters of other powers, each as the simulator has it; name: of them all."""
    places = [view.network.network.paths.index(f"heaters.{heater}.power") for heater in heaters]
    written = float(view.network.mapping.written[places].sum())
    for factor in factors:
        if abs(factor - 1.0) < _POWER:
            continue
        words = _of_power(name, factor, written)
        near = partial(_powers, view, name, heaters, [factor * 2.0**more for more in np.linspace(-0.4, 0.4, 7)], tries)
        yield Wrong("heater", name, words, window=multiplied(view, places, factor), tries=tries, closer=near)


def _of_power(heater: str, factor: float, written: float) -> Words:
    title = f"{heater} has {number(factor, 2)} times the power that the scenario says"
    text = f"The temperatures rise as with {number(factor * written, 3)} W, not {number(written, 3)} W."
    if abs(factor) < _NOTHING:
        title = f"{heater} does not heat"
        text = f"The temperatures do not rise while the status says that {heater} is on."
    return Words(title, text, f"Check 'power' of {heater} and what its status channel stands for")


def useless_statuses(view: View) -> Iterator[Wrong]:
    """A status that has nothing to do with what its thermostat does by the telemetry of its sensor."""
    statuses_of = status_channels(view)
    for name, _, channel in known_thermostats(view.window):
        heater, observation = view.window.scenario.network.switches[name], view.window.scenario.observations[channel]
        status = statuses_of.get(name, "")
        read = view.telemetry[channel].to_numpy() - observation.bias
        valid = np.flatnonzero(np.isfinite(read))
        obeyed = obedient(read[valid], heater.on_below, heater.off_above)
        if obeyed is None or not status:
            continue
        on = obeyed[np.maximum(np.searchsorted(valid, np.arange(len(read)), side="right") - 1, 0)]
        words = Words(
            f"The status of {name} is not of this heater",
            f"With {name} on and off as its thresholds and {channel} say, the model explains the telemetry; its status "
            f"says 'on' in {100 * float(np.nanmean(view.telemetry[status])):.0f}% of the time.",
            f"Check which column {status} is, and how it says 'on'; or leave it out",
        )
        data = view.telemetry.assign({status: ("time", on)})
        yield from driven_otherwise("thermostat", name, words, view, tries=len(view.network.heaters), telemetry=data)


def obedient(values: FloatArray, below: float, above: float) -> FloatArray | None:
    """[T] 1 where a thermostat is on that reads values [T], else 0; None: it does not switch on and off again.

    Between two samples they may not reach a threshold: then it switches where they turn, near by.
    """
    margin = _REACHED * (above - below)
    cold, warm = values < below + margin, values > above - margin
    beyond = np.flatnonzero(cold | warm)
    if not len(beyond):
        return None
    last = beyond[np.maximum(np.searchsorted(beyond, np.arange(len(values)), side="right") - 1, 0)]
    on = cold[last].astype(float)
    changes = np.flatnonzero(np.diff(on)) + 1
    if len(changes) < 2:
        return None
    found = on.copy()
    for first in changes.tolist():
        beyond_by = below - values if on[first] else values - above
        near = beyond_by[first:] > -margin
        length = len(near) if near.all() else int(np.argmin(near))
        found[first : first + _turn(beyond_by, first, length)] = 1.0 - on[first]
    return found


def _turn(beyond: FloatArray, first: int, length: int) -> int:
    """Samples after the first of so many near a threshold, until it is reached; else until they turn back."""
    reached = np.flatnonzero(beyond[first : first + length] >= 0.0)
    if len(reached):
        return int(reached[0])
    turn = int(np.argmax(beyond[first : first + length]))
    before, after = beyond[max(first + turn - 1, 0)], beyond[min(first + turn + 1, len(beyond) - 1)]
    # It turned between this sample and that neighbour which is more like it.
    return turn + int(after > before)


def thresholds(view: View) -> Iterator[Wrong]:
    """A heater switches at other temperatures than its thresholds."""
    for row, own in enumerate(view.thermostats):
        column = np.zeros((len(view.flat(view.observed)), 1))
        column[len(column) - len(view.thermostats) + row] = _THRESHOLD

        def words(fit: Fit, heater: str = own.heater) -> Words:
            above = _THRESHOLD * float(fit.added[0])
            return Words(
                f"{heater} switches {number(abs(above), 2)} K {'above' if above > 0 else 'below'} its thresholds",
                f"When its status changes, its sensor reads {number(abs(above), 2)} K "
                f"{'more' if above > 0 else 'less'} than 'on_below' and 'off_above' say.",
                f"Check 'on_below', 'off_above' and 'sensor' of {heater}",
            )

        tries = len(view.thermostats)
        yield Wrong("thresholds", own.heater, words, columns=column, least=2.0 / _THRESHOLD, tries=tries)


def modes(view: View) -> Iterator[Wrong]:
    """A mode lacks power in a node, or the timeline is not of this flight."""
    model, centre = view.window.scenario.network, view.middle
    for mode, powers in model.modes.items():
        column = view.network.network.columns.index(f"mode.{mode}")
        active = view.network.drive.inputs[:, :, column].reshape(1, -1)
        if active.min() == active.max():
            continue
        responses = {node: view.response(view.window, centre, node, active) for node in view.heat.nodes}
        yield from _mode_elsewhere(view, mode, responses)
        for node in view.heat.nodes:
            written = powers.get(node, 0.0)
            flow = float(view.heat.flow[view.heat.nodes.index(node)])
            size = max(0.5 * flow, abs(written), 1.0)
            effect = size * responses[node]

            def words(fit: Fit, mode: str = mode, node: str = node, size: float = size, was: float = written) -> Words:
                power = was + size * float(fit.added[0])
                return Words(
                    f"Mode '{mode}' has another power in {node}",
                    f"While the timeline says '{mode}', {node} takes {number(power, 3)} W, not {number(was, 3)} W.",
                    f"Check 'modes: {mode}: {node}', and that the timeline is of this flight",
                )

            least = max(0.5 * abs(written - _common(view, node)), 0.15 * flow) / size
            yield Wrong("mode", mode, words, columns=effect, least=least, tries=len(model.modes) * len(view.heat.nodes))
    if len({change.mode for change in model.timeline}) < 2:
        return
    yield from _exchanged(view)
    for late in (*SHIFTS, *_DATES):
        how = "early" if late > 0 else "late"
        words_of = Words(
            f"The timeline of modes is {duration(late)} {how}",
            f"Modes begin and end {duration(late)} {'after' if late > 0 else 'before'} what the timeline says.",
            "Check the times in 'simulator: timeline', and their zone",
        )
        yield from driven_otherwise("mode", "timeline", words_of, view, tries=len(SHIFTS) + len(_DATES), modes=late)


def _common(view: View, node: str) -> float:
    """W that all modes have in common in a node, which is no matter of any mode."""
    return min(own.get(node, 0.0) for own in view.window.scenario.network.modes.values())


def _mode_elsewhere(view: View, mode: str, responses: Mapping[str, FloatArray]) -> Iterator[Wrong]:
    """What a mode has more than others in a node is dissipated in another; responses: by node, to 1 W in the mode."""
    modes, nodes = view.window.scenario.network.modes, view.heat.nodes
    for node, other in permutations(nodes, 2):
        power = modes[mode].get(node, 0.0) - _common(view, node)
        if power <= 0.0:
            continue
        words = Words(
            f"Mode '{mode}' heats {other}, not {node}",
            f"While the timeline says '{mode}', {other} rises as {node} should, by {number(power, 3)} W.",
            f"Correct 'modes: {mode}'",
        )
        effect = power * (responses[other] - responses[node])
        yield Wrong("mode", mode, words, columns=effect, least=0.6, tries=len(modes) * len(nodes) ** 2)


def _exchanged(view: View) -> Iterator[Wrong]:
    """Two modes are each other's."""
    columns = view.network.network.columns
    pairs = list(combinations(view.window.scenario.network.modes, 2))
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
    waves: list[tuple[str, str, FloatArray]] = []
    for name, channel in scenario.telemetry.channels.items():
        if channel.kind == "status" and name not in used and name in view.telemetry:
            on = status_or_unknown(view.telemetry, name, view.utc(grid))
            if np.isfinite(on).any() and np.nanmin(on) < np.nanmax(on):
                waves += [(name, node, np.nan_to_num(on)) for node in view.heat.nodes]
    for k, channel_name in enumerate(view.channels):
        node = scenario.observations[channel_name].node
        rising = turning(view.window.observed[:, k], 4.0 * float(view.rows.noise[k]) + 0.3)
        if node in view.heat.nodes and rising is not None and heated.get(str(node)) not in view.unknown:
            waves.append(("", str(node), shares(view.network.observation.times, rising, grid)))
    for name, node, on in waves:
        flow = float(view.heat.flow[view.heat.nodes.index(node)])
        size = max(flow, 1.0)
        effect = size * view.response(view.window, centre, node, np.repeat(on, 2)[None])

        def words(fit: Fit, name: str = name, node: str = node, size: float = size, on: Any = on) -> Words:
            power, times = size * float(fit.added[0]), int((np.diff((np.asarray(on) > 0.5).astype(int)) > 0).sum())
            what = f"as {name} says, which no heater of the scenario has" if name else f"{times} times in the window"
            return Words(
                f"A heater of {node} is missing in the scenario",
                f"About {number(abs(power), 2)} W come and go in {node}, {what}.",
                f"Check the status of {heated[node]}"
                if node in heated and not name
                else f"Add the heater of {node} to 'simulator: heaters', with its status as 'measured_by'",
            )

        tries = 2 * len(waves) * (1.0 if name else _UNSEEN * (_SECOND if node in heated else 1.0))
        yield Wrong("missing heat", node, words, columns=effect, least=0.2 * flow / size, tries=tries)


def shares(seconds: FloatArray, states: FloatArray, grid: FloatArray) -> FloatArray:
    """[K] share of each step of a grid [K + 1] in which states [T], each from its time on, are 1: heat adds up."""
    edges = np.union1d(seconds, grid)
    state = states[np.maximum(np.searchsorted(seconds, edges[:-1], side="right") - 1, 0)]
    so_far = np.concatenate([[0.0], np.cumsum(state * np.diff(edges))])
    length = np.diff(grid)
    return np.divide(np.diff(np.interp(grid, edges, so_far)), length, out=np.zeros_like(length), where=length > 0.0)


def bursts(view: View, z: FloatArray, weights: Callable[[FloatArray], FloatArray]) -> Iterator[Wrong]:
    """Heat that a node gets now and then, of a mode or a heater that the scenario lacks.

    Its times are read from the telemetry: the heat of each piece of the window is estimated, and pieces of much heat
    are taken as one burst. z: [d], around which. weights: of effects [R, k] of unknown size, the most probable [k]
    beside everything that may be usual.
    """
    edges = np.linspace(0.0, view.network.drive.times[-1], _PIECES + 1)
    pieces = view.pieces(edges)
    unknown = [view.window.scenario.network.heaters[name].node for name in view.unknown]
    for node, flow in zip(view.heat.nodes, view.heat.flow.tolist(), strict=True):
        if node in unknown:
            continue
        size = max(flow, 1.0)
        effects = size * view.response(view.window, z, node, pieces)
        on, parted = upper(weights(effects))
        turns = np.flatnonzero(np.diff(on.astype(int), prepend=0, append=0))
        if on.mean() > _NOW_AND_THEN or parted < _PARTED:
            continue
        times = np.datetime_as_string(view.utc(edges[turns]), unit="m").reshape(-1, 2)
        spans = [f"{first} to {last[11:]}" for first, last in times[:3].tolist()]
        more = f" and {len(times) - 3} more" if len(times) > 3 else ""

        def words(fit: Fit, node: str = node, size: float = size, when: str = listed(spans) + more) -> Words:
            return Words(
                f"A mode or a heater of {node} is missing in the scenario",
                f"About {number(size * float(fit.added[0]), 2)} W come and go in {node}: {when} (UTC).",
                f"Add what is on in {node} then, to 'simulator: modes' and 'timeline' or to 'simulator: heaters'",
            )

        tries = 2.0 * len(view.heat.nodes) * comb(_PIECES, len(turns))
        effect = effects @ on.astype(float)[:, None]
        yield Wrong("missing heat", node, words, columns=effect, least=0.2 * flow / size, lacked=True, tries=tries)


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
    """Something heats a node all the time that the scenario lacks, such as electronics that are never off."""
    for node, flow in zip(view.heat.nodes, view.heat.flow.tolist(), strict=True):
        yield from _always(view, node, [max(share * flow, 0.1) for share in _ALL_THE_TIME])


def _always(view: View, node: str, powers: Sequence[float]) -> Iterator[Wrong]:
    """So many W more in a node, all the time, as the simulator has it: with more heat every link does more."""
    network, k = view.network, view.heat.nodes.index(node)
    for power in powers:
        if power < _LACKED * view.heat.flow[k]:
            continue
        heat = np.zeros((len(network.network.heated), 2 * len(network.drive.inputs)))
        heat[network.network.heated.index(node)] = power
        words = Words(
            f"{node} takes {number(power, 2)} W more than the scenario says, all the time",
            f"With {number(power, 2)} W more in {node}, the model explains the telemetry.",
            f"Check what dissipates in {node}, in 'simulator: modes', and what it absorbs",
        )
        window = replace(view.window, simulator=network.with_heat(heat))
        near = partial(_always, view, node, [power * 2.0**more for more in np.linspace(-0.6, 0.6, 7)])
        tries = len(_ALL_THE_TIME) * len(view.heat.nodes)
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


def drivers(view: View) -> Iterator[Wrong]:
    """A measured load has the wrong unit or sign."""
    drive, loads = view.network.drive, view.window.scenario.network.loads
    for name, load in loads.items():
        column = view.network.network.columns.index(f"driver.{name}")
        yield from _driver_of_any_size(view, name, column, len(loads))
        yield from _driver_times(view, name, column, FEW_TIMES, len(loads))
        for factor in (-1.0, 0.0, *FACTORS):
            inputs = drive.inputs.copy()
            inputs[:, :, column] *= factor
            how = {-1.0: "has the wrong sign", 0.0: "does nothing"}.get(
                factor, f"is {number(1.0 / (factor or 1.0), 4)} times what it should be"
            )
            words = Words(
                f"The driver {load.driver} {how}",
                f"With {factor:g} times {load.driver}, the heat of load {name} explains the telemetry.",
                f"Check 'unit' of {load.driver} and 'coefficient' of load {name}",
            )
            yield Wrong("driver", load.driver, words, window=view.with_inputs(inputs), tries=8 * len(loads))


def _driver_of_any_size(view: View, load: str, column: int, tries: float) -> Iterator[Wrong]:
    """A measured load is so many times what it should be, as in another unit."""
    block, network = view.window.scenario.network.loads[load], view.network.network
    coefficient = float(view.network.mapping.written[network.paths.index(f"loads.{load}.coefficient")])
    watts = coefficient * view.network.drive.inputs[:, :, column].reshape(1, -1)
    flow = float(view.heat.flow[view.heat.nodes.index(block.node)]) if block.node in view.heat.nodes else 0.0
    if not flow or not watts.any():
        return
    # What comes is so large, and not what is written: a unit may make that small.
    size = max(flow / float(np.abs(watts).max()), 1.0)
    effect = view.response(view.window, view.middle, block.node, size * watts)

    def words(fit: Fit) -> Words:
        return _of_driver(block.driver, load, 1.0 + size * float(fit.added[0]))

    yield Wrong("driver", block.driver, words, columns=effect, least=_POWER / size, tries=tries)


def _driver_times(
    view: View, load: str, column: int, factors: Sequence[float] | FloatArray, tries: float
) -> Iterator[Wrong]:
    """The same as the simulator has it: much more heat does not do so many times as much."""
    driver = view.window.scenario.network.loads[load].driver
    for factor in factors:
        if abs(factor - 1.0) < _POWER:
            continue
        inputs = view.network.drive.inputs.copy()
        inputs[:, :, column] *= factor
        words, window = _of_driver(driver, load, factor), view.with_inputs(inputs)
        near = partial(_driver_times, view, load, column, factor * 2.0 ** np.linspace(-0.4, 0.4, 7), tries)
        yield Wrong("driver", driver, words, window=window, tries=tries, closer=near)


def _of_driver(driver: str, load: str, times: float) -> Words:
    return Words(
        f"The heat of the driver {driver} is {number(times, 2)} times what the scenario says",
        f"With {number(times, 2)} times {driver}, load {load} explains the telemetry.",
        f"Check 'unit' of {driver} and 'coefficient' of load {load}",
    )


WRONGS = (statuses, heaters, useless_statuses, thresholds, modes, missing_heat, constant_heat, drivers)
"""What looks for them."""
