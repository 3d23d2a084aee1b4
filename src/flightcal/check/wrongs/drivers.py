"""Measured loads whose driver is not what the scenario says: its unit, sign, size, column."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from itertools import combinations, product

import numpy as np

from ...errors import FlightcalError
from ...problem import Window
from ...scenario import Heat, Load, load_coefficient
from ...simulator import FloatArray
from ...words import number
from ..evidence import Fit
from ..network_view import View, pieces
from ..sunlight import FINE
from .wrong import (
    AROUND,
    FACTORS,
    FEW_TIMES,
    LACKED,
    PIECES,
    POWER,
    Words,
    Wrong,
    at_node,
    driver_values,
    flow_through,
    load_series,
    put,
)

_MOST_POINTS = 6
"""Of a table, any two of which may be exchanged."""
_VARIES = 0.5
"""Of the largest value of a driver, that by which it has to vary: else it heats as anything constant does."""
_OF_UNIT = 8
"""Ways in which a driver may be of another unit or sign."""

_OTHER_WAY_ROUND = ("has the wrong sign", "which way round {} counts", -1.0, 0.0)
_OF_ANGLES = (
    ("is in rad, not in deg", "'unit' of {}", 180.0 / np.pi, 0.0),
    ("is in deg, not in rad", "'unit' of {}", np.pi / 180.0, 0.0),
    _OTHER_WAY_ROUND,
    ("is that from the opposite axis", "from which axis {} counts", -1.0, np.pi),
    ("is that from an axis at 90 deg", "from which axis {} counts", -1.0, 0.5 * np.pi),
    ("counts from the other end", "from where {} counts", 1.0, np.pi),
    ("counts from the other end", "from where {} counts", 1.0, -np.pi),
)
"""What a driver, or an angle, may be, what to check, and factor and offset (rad) of what it reads."""


def drivers(view: View) -> Iterator[Wrong]:
    """A measured load has the wrong unit or sign, or is not as its driver."""
    loads = view.window.scenario.network.loads
    for name, load in loads.items():
        column = view.network.network.columns.index(f"driver.{name}")
        yield from _driver_of_any_size(view, name, column, len(loads))
        yield from _unlike_driver(view, name, column, len(loads))
        yield from _driver_times(view, name, column, (*FEW_TIMES, *FACTORS), len(loads))
        for factor, how in ((-1.0, "has the wrong sign"), (0.0, "does nothing")):
            words = _of_unit(load.driver, name, factor, how)
            window, tries = _with_driver(view, column, factor), _OF_UNIT * len(loads)
            # Beside much too much heat a little looks like none.
            near = partial(_driver_times, view, name, column, FACTORS[:3], len(loads)) if factor == 0.0 else None
            yield Wrong("driver", load.driver, words, window=window, tries=tries, closer=near)
        yield from _by_its_size(view, name, column, _OF_UNIT * len(loads))


def _by_its_size(view: View, load: str, column: int, tries: float) -> Iterator[Wrong]:
    """A load is as large as its driver, whichever way that goes: a battery loses heat while it charges, too."""
    block, inputs = view.window.scenario.network.loads[load], view.network.drive.inputs
    if block.table or not inputs[:, :, column].min() < 0.0 < inputs[:, :, column].max():
        return
    words = Words(
        f"Load {load} follows the size of {block.driver}, whatever its sign",
        f"With {block.driver} as heat both below and above zero, the model explains the telemetry.",
        f"Write 'absolute: true' in load {load}",
    )
    sized = inputs.copy()
    sized[:, :, column] = np.abs(sized[:, :, column])
    yield Wrong("driver", f"{block.driver} size", words, window=view.with_inputs(sized), tries=tries)


def _with_driver(view: View, column: int, factor: float) -> Window:
    """The window with so many times the driver in a column of its inputs."""
    inputs = view.network.drive.inputs.copy()
    inputs[:, :, column] *= factor
    return view.with_inputs(inputs)


def _watts(view: View, load: str, column: int) -> FloatArray:
    """[1, 2 K] of a load with the driver in a column of the inputs, as the scenario writes it."""
    place = view.network.network.paths.index(f"loads.{load}.coefficient")
    return float(view.network.mapping.written[place]) * view.network.drive.inputs[:, :, column].reshape(1, -1)


def _driver_of_any_size(view: View, load: str, column: int, tries: float) -> Iterator[Wrong]:
    """A measured load is so many times what it should be, as in another unit."""
    block, watts = view.window.scenario.network.loads[load], _watts(view, load, column)
    flow = flow_through(view, block.node)
    if not flow or not watts.any():
        return
    # What comes is so large, and not what is written: a unit may make that small.
    size = max(flow / float(np.abs(watts).max()), 1.0)
    effect = view.response(view.window, view.middle, block.node, size * watts)

    def words(fit: Fit) -> Words:
        return _of_driver(block.driver, load, 1.0 + size * float(fit.added[0]))

    yield Wrong("driver", block.driver, words, columns=effect, least=POWER / size, tries=tries)


def _unlike_driver(view: View, load: str, column: int, tries: float) -> Iterator[Wrong]:
    """A load's heat is another in each piece of the window, and not at all as its driver says."""
    block = view.window.scenario.network.loads[load]
    size = float(np.ptp(_watts(view, load, column)))
    if block.node not in view.heat.nodes or size < LACKED * flow_through(view, block.node):
        return
    edges = np.linspace(0.0, view.network.drive.times[-1], PIECES + 1)
    each = size * view.response(view.window, view.middle, block.node, pieces(view.window, edges))

    def words(fit: Fit) -> Words:
        return Words(
            f"The heat of load {load} is not as its driver {block.driver} says",
            f"What heats {block.node} changes at other times than {block.driver} does.",
            f"Check which column {block.driver} is, its unit and how its gaps are filled",
        )

    columns = np.column_stack([each.sum(axis=1), each])
    window = _with_driver(view, column, 0.0)
    yield Wrong("driver", block.driver, words, window=window, columns=columns, tries=tries)


def _driver_times(
    view: View, load: str, column: int, factors: Sequence[float] | FloatArray, tries: float
) -> Iterator[Wrong]:
    """The same as the simulator has it: much more heat does not do so many times as much."""
    driver = view.window.scenario.network.loads[load].driver
    for factor in map(float, factors):
        if abs(factor - 1.0) < POWER:
            continue
        window = _with_driver(view, column, factor)
        others = np.union1d(factor * np.array(AROUND), FACTORS)
        near = partial(_driver_times, view, load, column, others[others != factor], tries)
        words, ways = _of_driver(driver, load, factor), 1
        if factor in FACTORS:
            words = _of_unit(driver, load, factor, f"is {number(1.0 / factor, 4)} times what it should be")
            ways = _OF_UNIT
        yield Wrong("driver", driver, words, window=window, tries=ways * tries, closer=near)


def _of_unit(driver: str, load: str, factor: float, how: str) -> Words:
    return Words(
        f"The driver {driver} {how}",
        f"With {factor:g} times {driver}, the heat of load {load} explains the telemetry.",
        f"Check 'unit' of {driver} and 'coefficient' of load {load}",
    )


def _of_driver(driver: str, load: str, times: float) -> Words:
    return Words(
        f"The heat of the driver {driver} is {number(times, 2)} times what the scenario says",
        f"With {number(times, 2)} times {driver}, load {load} explains the telemetry.",
        f"Check 'unit' of {driver} and 'coefficient' of load {load}",
    )


def other_columns(view: View) -> Iterator[Wrong]:
    """A load follows another driver than the scenario says, or two loads each other's."""
    scenario = view.window.scenario
    loads = scenario.network.loads
    measured = [name for name, channel in scenario.telemetry.channels.items() if channel.kind == "driver"]
    others = [(name, channel) for name, load in loads.items() for channel in measured if channel != load.driver]
    for name, channel in others:
        driver = loads[name].driver
        words = Words(
            f"Load {name} follows {channel}, not {driver}",
            f"With {channel} as its driver, the heat of load {name} explains the telemetry.",
            f"Check 'driver' of load {name}, and which columns {channel} and {driver} are",
        )
        yield from _driven(view, {name: (loads[name], channel)}, words, len(others))
    pairs = [(a, b) for a, b in combinations(loads, 2) if loads[a].driver != loads[b].driver]
    for a, b in pairs:
        first, second = loads[a].driver, loads[b].driver
        words = Words(
            f"The drivers {first} and {second} are exchanged",
            f"With {second} as the driver of load {a}, and {first} of {b}, the model explains the telemetry.",
            f"Check which columns {first} and {second} are, and 'driver' of loads {a} and {b}",
        )
        yield from _driven(view, {a: (loads[a], second), b: (loads[b], first)}, words, len(pairs))


def other_nodes(view: View) -> Iterator[Wrong]:
    """A load heats another node than the scenario says."""
    loads, nodes = view.window.scenario.network.loads, view.heat.nodes
    for name, node in product(loads, nodes):
        load = loads[name]
        if load.node not in nodes or load.node == node:
            continue
        words = Words(
            f"Load {name} heats {node}, not {load.node}",
            f"With what {load.driver} says in {node}, the model explains the telemetry.",
            f"Correct 'node' of {name} in 'simulator: loads'",
        )
        # Of the heaters' kind: a model that is only too simple asks for it too, and for no slip of a driver.
        window = at_node(view, "loads", name, node)
        yield Wrong("heater", name, words, window=window, tries=len(loads) * len(nodes))


def left_out(view: View) -> Iterator[Wrong]:
    """Something heats a node as a driver says that no load follows."""
    scenario = view.window.scenario
    over = scenario.heat.pattern.over if isinstance(scenario.heat, Heat) and scenario.heat.pattern else None
    followed = {over, *(load.driver for load in scenario.network.loads.values())}
    known = [
        name
        for name, channel in scenario.telemetry.channels.items()
        if channel.kind == "driver"
        and not channel.is_angle
        and name not in followed
        and name in view.telemetry
        and np.isfinite(view.telemetry[name].to_numpy()).any()
    ]
    for name in known:
        with suppress(FlightcalError):
            values = driver_values(view, name, view.network.drive.times)
            parts = {name: values}
            if values.min() < 0.0 < values.max():
                # A current heats a battery while it discharges, or either way.
                below, above = np.maximum(-values, 0.0), np.maximum(values, 0.0)
                parts |= {
                    f"{name} below zero": below,
                    f"{name} above zero": above,
                    f"the size of {name}": above + below,
                }
            for node, (part, series) in product(view.heat.nodes, parts.items()):
                yield from _as_driver_says(
                    view, name, part, node, series, len(known) * len(view.heat.nodes) * len(parts)
                )


def _as_driver_says(view: View, driver: str, part: str, node: str, values: FloatArray, tries: float) -> Iterator[Wrong]:
    """A node takes heat in proportion to a driver, or to a part of it, called so.

    values: [K + 1] of that at the edges of the simulation's steps.
    """
    largest, flow = float(np.abs(values).max()), flow_through(view, node)
    if np.ptp(values) < _VARIES * largest or not flow:
        return
    series = np.stack([values[:-1], values[1:]], axis=1).reshape(1, -1) / largest
    effect = flow * view.response(view.window, view.middle, node, series)
    add = ", with a 'table' or 'absolute: true'" if part != driver else ""

    def words(fit: Fit) -> Words:
        power = number(flow * float(fit.added[0]), 2)
        return Words(
            f"A load of {node} is missing in the scenario: {part} heats it",
            f"{node} takes {power} W where {part} is largest, and no load follows {driver}.",
            f"Add a load of {node} with 'driver: {driver}' to 'simulator: loads'{add}",
        )

    yield Wrong("missing heat", f"{driver} {node}", words, columns=effect, least=LACKED, lacked=True, tries=tries)


def tables(view: View) -> Iterator[Wrong]:
    """Two factors in the table of a load are each other's."""
    loads = {name: load for name, load in view.window.scenario.network.loads.items() if load.table}
    tried = [
        (name, a, b)
        for name, load in loads.items()
        if len(load.table) <= _MOST_POINTS
        for a, b in combinations(range(len(load.table)), 2)
        if load.table[a][1] != load.table[b][1]
    ]
    for name, a, b in tried:
        load, table = loads[name], list(loads[name].table)
        (first, factor), (second, other) = table[a], table[b]
        table[a], table[b] = (first, other), (second, factor)
        one, two = (place if isinstance(place, str) else f"{place:g}" for place in (first, second))
        words = Words(
            f"Two factors in the table of load {name} are exchanged",
            f"With {other:g} at {one} and {factor:g} at {two}, load {name} explains the telemetry.",
            f"Check 'table' of load {name}",
        )
        changed = load.model_copy(update={"table": tuple(table)})
        yield from _driven(view, {name: (changed, load.driver)}, words, len(tried))


def tabled(view: View) -> Iterator[Wrong]:
    """A driver that a load has a table over counts the other way round; an angle is of another unit or axis."""
    scenario = view.window.scenario
    drivers = {name: channel for name, channel in scenario.telemetry.channels.items() if channel.kind == "driver"}
    loads = {name: load for name, load in scenario.network.loads.items() if load.table and load.driver in drivers}
    of_angles = {name: load for name, load in loads.items() if drivers[load.driver].is_angle}
    others = {name: load for name, load in loads.items() if name not in of_angles and not load.absolute}
    for what, over, ways in (("angle", of_angles, _OF_ANGLES), ("driver", others, (_OTHER_WAY_ROUND,))):
        for (name, load), (said, advice, scale, offset) in product(over.items(), ways):
            words = Words(
                f"The {what} {load.driver} {said}",
                f"So taken, the heat of load {name} explains the telemetry.",
                f"Check {advice.format(load.driver)} and 'table' of load {name}",
            )
            yield from _driven(view, {name: (load, load.driver)}, words, len(over) * len(ways), (scale, offset))


def _driven(
    view: View,
    by: Mapping[str, tuple[Load, str]],
    words: Words,
    tries: float,
    line: tuple[float, float] = (1.0, 0.0),
) -> Iterator[Wrong]:
    """Some loads are others, by other drivers; nothing where one is in another unit than that which is written.

    line: factor and offset of the drivers, SI.
    """
    scenario, drive = view.window.scenario, view.network.drive
    inputs, fine = drive.inputs.copy(), np.union1d(np.arange(0.0, drive.times[-1], FINE), drive.times)
    for name, (load, channel) in by.items():
        known = scenario.telemetry.channels
        try:
            written, other = (load_coefficient(load, known[driver]) for driver in (load.driver, channel))
            if written != other:
                return
            series = load_series(view, load, channel, fine, lambda values: line[0] * values + line[1])
        except (FlightcalError, ValueError):
            return
        put(inputs, view.network.network.columns, fine, {f"driver.{name}": series}, drive.times)
    about = " ".join((*by, *(channel for _, channel in by.values())))
    yield Wrong("driver", about, words, window=view.with_inputs(inputs), tries=tries)


WRONGS = (drivers, other_columns, other_nodes, left_out, tables, tabled)
"""What looks for them."""
