"""Heaters that are not what the scenario says: their status, their power, their node, their thresholds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations

import numpy as np

from ...simulator import FloatArray
from ...telemetry import status_fraction
from ...words import number
from ..compared_window import known_thermostats
from ..evidence import Fit
from ..network_view import View
from .heat import about_switches, by_temperature
from .wrong import AROUND, FACTORS, FEW_TIMES, POWER, Words, Wrong, at_node, driven_otherwise, status_channels

_NOTHING = 0.05
"""Share of its power, below which a heater does not heat."""
_MOST = 0.6
"""Share of a heater's heat, from which it is all of it."""
_THRESHOLD = 8.0
"""K, prior deviation of thresholds that are wrong."""
_REACHED = 0.2
"""Of the way between its thresholds, by which a reading may stay short of one at which a heater switches."""
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
            f"Correct {view.window.scenario.telemetry.channels[channel].says_on} of {channel} in 'telemetry: channels'",
        )
        yield from driven_otherwise("status inverted", channel, words, view, tries=len(channels), telemetry=data)
    for a, b in combinations(channels.values(), 2):
        data = view.telemetry.assign({a: view.telemetry[b], b: view.telemetry[a]})
        one, other = (view.window.scenario.telemetry.channels[name] for name in (a, b))
        key = "bits" if (one.packet, one.column) == (other.packet, other.column) else "column"
        words = Words(
            f"{a} and {b} are swapped",
            f"With the status of {a} and {b} exchanged, the model explains the telemetry.",
            f"Exchange '{key}' of {a} and {b} in 'telemetry: channels'",
        )
        yield from driven_otherwise("statuses swapped", a, words, view, tries=len(channels), telemetry=data)


def heaters(view: View) -> Iterator[Wrong]:
    """A heater has another power, or heats another node."""
    blocks = view.window.scenario.network.heaters
    for name, block in blocks.items():
        on = np.nan_to_num(view.network.drive.measured[:, view.switch_of[name]])
        if block.node not in view.heat.nodes or not on.any() or name in view.unknown:
            continue

        def words(fit: Fit, name: str = name, power: float = block.power) -> Words:
            return _of_power(name, 1.0 + float(fit.added[0]), power)

        if view.network.network.paths.index(f"heaters.{name}.power") in view.network.mapping.set_positions:
            waves = block.power * np.repeat(on, 2)[None]
            responses = view.response(view.window, view.middle, block.node, waves)
            yield Wrong("heater", name, words, columns=responses, least=POWER, tries=len(blocks))
        else:
            yield from _powers(view, name, [name], (0.0, *FEW_TIMES, *FACTORS), len(blocks))
        yield from _from_then_on(view, name, np.linspace(0.0, view.network.drive.times[-1], _PARTS + 1)[1:-1], _PARTS)
        for node in view.heat.nodes:
            if node != block.node:
                yield _elsewhere(view, name, node)
    if len(blocks) > 1 and not view.unknown:
        yield from _powers(view, "every heater", list(blocks), FEW_TIMES, len(FEW_TIMES))


def _elsewhere(view: View, name: str, node: str) -> Wrong:
    """A heater heats another node."""
    blocks = view.window.scenario.network.heaters
    written = blocks[name].node
    words = Words(
        f"{name} heats {node}, not {written}",
        f"While {name} is on, {node} rises as {written} should.",
        f"Correct 'node' of {name} in 'simulator: heaters'",
    )
    window = at_node(view, "heaters", name, node)
    return Wrong("heater", name, words, window=window, tries=len(blocks) * len(view.heat.nodes))


def _from_then_on(view: View, name: str, starts: Sequence[float] | FloatArray, parts: float) -> Iterator[Wrong]:
    """A heater has another power from a time on, s from the window's start: a string of it fails, or all of it.

    parts: of the window, between whose ends the time is.
    """
    block, drive = view.window.scenario.network.heaters[name], view.network.drive
    on, length = np.nan_to_num(drive.measured[:, view.switch_of[name]]), float(drive.times[-1])
    lasting = np.stack([on * (drive.times[:-1] >= start) for start in starts])
    # Before and after, it has to heat often enough to be told.
    told = [k for k, lasts in enumerate(lasting) if _TOLD < lasts.sum() / on.sum() < 1.0 - _TOLD]
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
        yield Wrong("heater", about, words, columns=effect, least=POWER, tries=tries, closer=near)


def _powers(view: View, name: str, heaters: Sequence[str], factors: Sequence[float], tries: float) -> Iterator[Wrong]:
    """Heaters of other powers, each as the simulator has it; name: of them all."""
    places = [view.network.network.paths.index(f"heaters.{heater}.power") for heater in heaters]
    written = float(view.network.mapping.written[places].sum())
    for factor in factors:
        if abs(factor - 1.0) < POWER:
            continue
        words = _of_power(name, factor, written)
        near = partial(_powers, view, name, heaters, [factor * more for more in AROUND], tries)
        yield Wrong("heater", name, words, window=view.window.multiplied(places, factor), tries=tries, closer=near)


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
        columns = _about_its_switches(view, name, status_fraction(data, status, view.utc(view.network.drive.times)))
        for wrong in driven_otherwise("thermostat", name, words, view, tries=len(view.network.heaters), telemetry=data):
            yield replace(wrong, columns=columns)


def _about_its_switches(view: View, switch: str, on: FloatArray) -> FloatArray:
    """[R, k] K of a heater's heat when it switches, of which the times are not known well; on: in each step [K]."""
    found, series = [np.empty((len(view.as_read), 0))], about_switches(view, on)
    for name in view.window.scenario.network.on_switch(switch):
        heater = view.window.scenario.network.heaters[name]
        if heater.node in view.heat.nodes and len(series):
            found.append(heater.power * view.response(view.window, view.middle, heater.node, series))
    return np.concatenate(found, axis=1)


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


def unmeasured(view: View) -> Iterator[Wrong]:
    """A heater without a status is of another node, or switches where by its sensor and thresholds it never does."""
    told = dict(by_temperature(view))
    for name in view.inferred:
        block, on = view.window.scenario.network.heaters[name], view.network.drive.measured[:, view.switch_of[name]]
        if block.node not in view.heat.nodes:
            continue
        if name in view.unknown:
            for node in view.heat.nodes:
                if node != block.node:
                    yield _unknown_elsewhere(view, name, node, told.get(node))
            continue
        half = _heat_of(view, name, block.node, (0.5 - np.nan_to_num(on))[None])
        at_any_time = view.any_heat(view.window, view.middle, name, block.node, np.ones_like(on))
        yield _switching(view, name, np.concatenate([half, at_any_time], axis=1), POWER)
        if block.node in told:
            columns = _as_told(view, name, block.node, told[block.node])
            columns[:, :1] -= _heat_of(view, name, block.node, np.nan_to_num(on)[None])
            yield _switching(view, name, columns, _MOST)


def _unknown_elsewhere(view: View, name: str, node: str, told: FloatArray | None) -> Wrong:
    """What nobody knows of a heater's heat is in another node, and not in the one that is written.

    told: [K] when the node's temperature says that something heats it.
    """
    columns = [view.unknown_heat(view.window, view.middle, name, node)]
    if told is not None:
        columns.append(_as_told(view, name, node, told))
    return replace(_elsewhere(view, name, node), columns=np.concatenate(columns, axis=1))


def _as_told(view: View, name: str, node: str, told: FloatArray) -> FloatArray:
    """[R, k] K of a heater that is on [K] as temperatures tell it, and of what they do not tell of its switches."""
    return _heat_of(view, name, node, np.concatenate([told[None], about_switches(view, told)[:, ::2]]))


def _heat_of(view: View, name: str, node: str, on: FloatArray) -> FloatArray:
    """[R, k] K of a heater in a node that is on for shares [k, K] of the steps."""
    power = view.window.scenario.network.heaters[name].power
    return power * view.response(view.window, view.middle, node, np.repeat(on, 2, axis=1))


def _switching(view: View, name: str, columns: FloatArray, least: float) -> Wrong:
    """A heater switches though its sensor keeps it on or off all the time; columns: [R, k] of its heat."""
    on = np.nanmean(view.network.drive.measured[:, view.switch_of[name]]) > 0.5
    where, state = ("below", "on") if on else ("above", "off")
    words = Words(
        f"{name} does not switch at its thresholds",
        f"Its sensor is always {where} 'on_below', so {name} should be {state}; with {name} on and off, the model "
        "explains the telemetry.",
        f"Check 'on_below', 'off_above' and 'sensor' of {name} and their units, and those of the sensor's telemetry",
    )
    tries = 2.0 * len(view.inferred)
    return Wrong("thresholds", name, words, columns=columns, least=least, lacked=True, tries=tries)


def thresholds(view: View) -> Iterator[Wrong]:
    """A heater switches at other temperatures than its thresholds."""
    for row, thermostat in enumerate(view.thermostats):
        column = np.zeros((len(view.as_read), 1))
        column[len(column) - len(view.thermostats) + row] = _THRESHOLD

        def words(fit: Fit, heater: str = thermostat.heater) -> Words:
            above = _THRESHOLD * float(fit.added[0])
            return Words(
                f"{heater} switches {number(abs(above), 2)} K {'above' if above > 0 else 'below'} its thresholds",
                f"When its status changes, its sensor reads {number(abs(above), 2)} K "
                f"{'more' if above > 0 else 'less'} than 'on_below' and 'off_above' say.",
                f"Check 'on_below', 'off_above' and 'sensor' of {heater}",
            )

        tries = len(view.thermostats)
        yield Wrong("thresholds", thermostat.heater, words, columns=column, least=2.0 / _THRESHOLD, tries=tries)


WRONGS = (statuses, heaters, useless_statuses, thresholds, unmeasured)
"""What looks for them."""
