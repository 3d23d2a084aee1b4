"""Measured loads whose driver is not what the scenario says: its unit, sign, size, column."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import combinations

import numpy as np

from ...errors import FlightcalError
from ...problem import Window
from ...report import number
from ...scenario import load_coefficient
from ...simulator import FloatArray
from ..evidence import Fit
from ..sunlight import FINE
from ..view import View, pieces
from .wrong import FACTORS, FEW_TIMES, LACKED, PIECES, POWER, Words, Wrong, flow_through, load_series, put


def drivers(view: View) -> Iterator[Wrong]:
    """A measured load has the wrong unit or sign, or is not as its driver."""
    loads = view.window.scenario.network.loads
    for name, load in loads.items():
        column = view.network.network.columns.index(f"driver.{name}")
        yield from _driver_of_any_size(view, name, column, len(loads))
        yield from _unlike_driver(view, name, column, len(loads))
        yield from _driver_times(view, name, column, FEW_TIMES, len(loads))
        for factor in (-1.0, 0.0, *FACTORS):
            how = {-1.0: "has the wrong sign", 0.0: "does nothing"}.get(
                factor, f"is {number(1.0 / (factor or 1.0), 4)} times what it should be"
            )
            words = Words(
                f"The driver {load.driver} {how}",
                f"With {factor:g} times {load.driver}, the heat of load {name} explains the telemetry.",
                f"Check 'unit' of {load.driver} and 'coefficient' of load {name}",
            )
            window = _with_driver(view, column, factor)
            yield Wrong("driver", load.driver, words, window=window, tries=8 * len(loads))


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
    for factor in factors:
        if abs(factor - 1.0) < POWER:
            continue
        words, window = _of_driver(driver, load, factor), _with_driver(view, column, factor)
        near = partial(_driver_times, view, load, column, factor * 2.0 ** np.linspace(-0.4, 0.4, 7), tries)
        yield Wrong("driver", driver, words, window=window, tries=tries, closer=near)


def _of_driver(driver: str, load: str, times: float) -> Words:
    return Words(
        f"The heat of the driver {driver} is {number(times, 2)} times what the scenario says",
        f"With {number(times, 2)} times {driver}, load {load} explains the telemetry.",
        f"Check 'unit' of {driver} and 'coefficient' of load {load}",
    )


def other_columns(view: View) -> Iterator[Wrong]:
    """A load follows another driver than the scenario says, or two loads each other's."""
    scenario = view.window.scenario
    loads = {name: load.driver for name, load in scenario.network.loads.items()}
    measured = [name for name, channel in scenario.telemetry.channels.items() if channel.kind == "driver"]
    others = [(load, channel) for load, own in loads.items() for channel in measured if channel != own]
    for load, channel in others:
        words = Words(
            f"Load {load} follows {channel}, not {loads[load]}",
            f"With {channel} as its driver, the heat of load {load} explains the telemetry.",
            f"Check 'driver' of load {load}, and which columns {channel} and {loads[load]} are",
        )
        yield from _following(view, {load: channel}, words, len(others))
    pairs = [(a, b) for a, b in combinations(loads, 2) if loads[a] != loads[b]]
    for a, b in pairs:
        words = Words(
            f"The drivers {loads[a]} and {loads[b]} are exchanged",
            f"With {loads[b]} as the driver of load {a}, and {loads[a]} of {b}, the model explains the telemetry.",
            f"Check which columns {loads[a]} and {loads[b]} are, and 'driver' of loads {a} and {b}",
        )
        yield from _following(view, {a: loads[b], b: loads[a]}, words, len(pairs))


def _following(view: View, drivers_of: Mapping[str, str], words: Words, tries: float) -> Iterator[Wrong]:
    """Some loads follow other drivers; nothing where a driver is in another unit than the one that is written."""
    scenario, drive = view.window.scenario, view.network.drive
    inputs, fine = drive.inputs.copy(), np.union1d(np.arange(0.0, drive.times[-1], FINE), drive.times)
    for name, channel in drivers_of.items():
        load, known = scenario.network.loads[name], scenario.telemetry.channels
        try:
            written, other = (load_coefficient(load, known[own]) for own in (load.driver, channel))
            if written != other:
                return
            series = load_series(view, name, channel, fine)
        except (FlightcalError, ValueError):
            return
        put(inputs, view.network.network.columns, fine, {f"driver.{name}": series}, drive.times)
    yield Wrong(
        "driver", " ".join((*drivers_of, *drivers_of.values())), words, window=view.with_inputs(inputs), tries=tries
    )


WRONGS = (drivers, other_columns)
"""What looks for them."""
