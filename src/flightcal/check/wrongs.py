"""Simple ways in which a scenario and its telemetry may not belong together, each as what it would change."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from typing import Any, Literal

import numpy as np
import xarray

from ..errors import FlightcalError
from ..problem import Window
from ..report import listed, number
from ..scenario import CircularOrbit, Scenario
from ..simulator import ICE_POINT, FloatArray, SimulationFailure, face_series, in_steps
from ..telemetry import status_fraction
from .evidence import FINE, REACH, Fit, View, series_at

Kind = Literal[
    "clock", "status clock", "channel clock", "bias", "swapped", "unit", "other node", "unrelated",
    "status inverted", "statuses swapped", "heater", "missing heat", "mode", "driver", "attitude", "orbit", "number",
]  # fmt: skip
_BIAS = 8.0
"""K, prior deviation of a channel's bias."""
_STRANGE, _STRANGE_TIME = ((15.0, 4.0), (5.0, 25.0)), 2400.0
"""K, deviations of mean and wandering of a channel that is not of this satellite; s, its correlation time."""
_SHIFT = 240.0
"""s, between the shifts of a clock that are tried first."""
_COLDEST, _HOTTEST = 100.0, 500.0
"""K, that a satellite may be."""
_ALIKE = 3.0
"""Samples beside each other that tell as much as one of a change of scale."""
_MOST_NODES = 15
"""Of a network whose channels are tried at every node."""
_FACTORS = (0.001, 0.01, 0.1, 10.0, 100.0, 1000.0)
"""By which a number is off that has the wrong unit or one digit too many."""


@dataclass(frozen=True)
class Words:
    """A wrong in words."""

    title: str
    sentence: str
    advice: str


@dataclass(frozen=True)
class Wrong:
    """One way to be wrong, and what telemetry, simulation or both would be without it."""

    kind: Kind
    about: str
    """What it is about: a channel, a heater, a node."""
    words: Words | Callable[[Fit], Words]
    observed: FloatArray | None = None
    """[t, N] K as the telemetry should be; None: as it is."""
    window: Window | None = None
    """As it should be simulated; None: as it is."""
    columns: FloatArray | None = None
    """[R, k] K, effects of unknown size that a simulation lacks."""
    least: float = 0.0
    """Of the first column's weight: below, it is no wrong worth a word."""
    jacobian: float = 0.0
    """Log of what the telemetry was scaled by."""
    tries: float = 1.0
    """So many alternatives there are of the kind."""
    closer: Callable[[], Iterator[Wrong]] | None = None
    """The same with numbers near by."""


def driven(
    view: View,
    scenario: Scenario | None = None,
    telemetry: xarray.Dataset | None = None,
    *,
    sunlight: float = 0.0,
    modes: float = 0.0,
) -> Window:
    """The view's window with what acts on it by another scenario's faces and timeline, or another telemetry's status.

    sunlight, modes: s by which these come later in the telemetry's time. Raises TelemetryError.
    """
    drive, columns = view.network.drive, view.network.network.columns
    inputs, measured = drive.inputs.copy(), drive.measured
    fine, lit = view.sunlight
    if scenario is not None:
        fine = np.union1d(np.arange(0.0, drive.times[-1], FINE), drive.times)
        _replace(inputs, columns, fine, face_series(scenario, view.utc(fine)), drive.times)
    elif sunlight:
        _replace(inputs, columns, fine + sunlight, lit, drive.times)
    if modes:
        fine = np.arange(-FINE, drive.times[-1] + 2.0 * FINE, FINE)
        _replace(inputs, columns, fine, _modes(view, fine - modes), drive.times)
    if telemetry is not None:
        edges, blocks = view.utc(drive.times), view.window.scenario.network.switches.values()
        measured = np.stack([status_fraction(telemetry, own.measured_by or "", edges) for own in blocks], axis=1)
    return view.simulated_by(drive=replace(drive, inputs=inputs, measured=measured))


def _driven_otherwise(
    kind: Kind,
    about: str,
    words: Words,
    view: View,
    *,
    tries: float,
    closer: Callable[[], Iterator[Wrong]] | None = None,
    **how: Any,
) -> Iterator[Wrong]:
    """The wrong of what acts on the window; nothing where there is no such window. how: see `driven`."""
    try:
        window = driven(view, **how)
    except (FlightcalError, SimulationFailure, ValueError):
        return
    yield Wrong(kind, about, words, window=window, tries=tries, closer=closer)


def _replace(
    inputs: FloatArray, columns: Sequence[str], seconds: FloatArray, series: Mapping[str, FloatArray], grid: FloatArray
) -> None:
    """Put series [M] at seconds [M] into the inputs [K, 2, q] of a grid's steps, in place."""
    known = [column for column in series if column in columns]
    if known:
        inside = (seconds >= grid[0]) & (seconds <= grid[-1])
        edges = np.union1d(seconds[inside], grid[[0, -1]])
        values = np.stack([np.interp(edges, seconds, series[column]) for column in known])
        inputs[:, :, [columns.index(column) for column in known]] = in_steps(edges, values, grid).transpose(2, 1, 0)


def _modes(view: View, seconds: FloatArray) -> dict[str, FloatArray]:
    """1 while in the mode, [M] by column."""
    model = view.window.scenario.network
    if not model.timeline:
        return {}
    changes = np.array([change.at for change in model.timeline], "datetime64[ns]")
    active = [model.timeline[max(k - 1, 0)].mode for k in np.searchsorted(changes, view.utc(seconds), side="right")]
    return {f"mode.{mode}": np.array([float(mode == own) for own in active]) for mode in model.modes}


def all_wrongs(view: View) -> Iterator[Wrong]:
    """Every simple wrong that can be tried on a view."""
    yield from biases(view)
    yield from swaps(view)
    yield from units(view)
    yield from other_nodes(view)
    yield from unrelated(view)
    yield from clocks(view)
    yield from status_clocks(view)
    yield from channel_clocks(view)
    yield from statuses(view)
    yield from heaters(view)
    yield from modes(view)
    yield from missing_heat(view)
    yield from drivers(view)
    yield from attitudes(view)
    yield from orbits(view)
    yield from places(view)
    yield from numbers(view)


# --- channels --------------------------------------------------------------------------------------------------


def biases(view: View) -> Iterator[Wrong]:
    """Each channel reads too high or too low by a constant."""
    t = len(view.rows.kept)
    for k, channel in enumerate(view.channels):
        column = view.of_channel(k, np.full((t, 1), _BIAS))

        def words(fit: Fit, channel: str = channel) -> Words:
            bias = _BIAS * float(fit.added[0])
            how = "high" if bias > 0 else "low"
            return Words(
                f"{channel} reads {number(abs(bias), 2)} K too {how}",
                f"A constant bias of {bias:+.1f} K of {channel} alone explains the telemetry best; the other channels "
                "agree with the model.",
                f"Check the sensor's calibration curve; or write 'observations: {{{channel}: {{bias: {bias:.1f} K}}}}'",
            )

        yield Wrong("bias", channel, words, columns=column, least=1.0 / _BIAS, tries=len(view.channels))


def swaps(view: View) -> Iterator[Wrong]:
    """Two channels are each other's, or one is of another's node."""
    pairs = list(combinations(range(len(view.channels)), 2))
    for a, b in pairs:
        order = np.arange(len(view.channels))
        order[[a, b]] = b, a
        first, second = view.channels[a], view.channels[b]
        words = Words(
            f"{first} and {second} are swapped",
            f"With the columns of {first} and {second} exchanged, the model explains the telemetry.",
            f"Exchange 'column' of {first} and {second} in 'telemetry: channels' (or their nodes in 'observations')",
        )
        yield Wrong("swapped", first, words, observed=view.observed[:, order], tries=len(pairs))


def other_nodes(view: View) -> Iterator[Wrong]:
    """A channel is of another node than the scenario says."""
    simulator = view.network
    sensors = simulator.observation.sensors
    nodes = simulator.network.own_nodes
    for k, channel in enumerate(view.channels):
        own = view.window.scenario.observations[channel].node
        for node in nodes:
            if node == own or len(nodes) > _MOST_NODES:
                continue
            states = sensors.state.copy()
            states[k] = simulator.network.nodes.index(node)
            observation = replace(simulator.observation, sensors=sensors._replace(state=states))
            window = view.simulated_by(observation=observation)
            words = Words(
                f"{channel} is of {node}, not of {own}",
                f"{channel} does what the model says of {node}.",
                f"Correct 'node' of {channel} in 'observations'",
            )
            tries = len(nodes) * len(view.channels)
            yield Wrong("other node", channel, words, window=window, tries=tries)


def unrelated(view: View) -> Iterator[Wrong]:
    """A channel that has nothing to do with its node: of another satellite, or of a broken sensor."""
    for k, channel in enumerate(view.channels):
        apart = np.abs(view.rows.seconds[:, None] - view.rows.seconds)
        words = Words(
            f"{channel} does not belong to its node",
            f"{channel} goes its own way, and all other channels agree with the model without it: it may be of another "
            "place, another satellite, or a broken sensor.",
            f"Check which sensor {channel} is; leave it out of 'observations' to calibrate without it",
        )
        for level, walk in _STRANGE:
            covariance = level**2 + walk**2 * np.exp(-apart / _STRANGE_TIME) + 1e-6 * np.eye(len(apart))
            columns = view.of_channel(k, np.asarray(np.linalg.cholesky(covariance), float))
            yield Wrong("unrelated", channel, words, columns=columns, tries=2 * len(view.channels))


_UNITS: Mapping[str, tuple[Callable[[FloatArray], FloatArray], float, str]] = {
    "degF": (lambda x: (x - ICE_POINT - 32.0) / 1.8 + ICE_POINT, 1.0 / 1.8, "in degF, and is read as degC"),
    "kelvin": (lambda x: x - ICE_POINT, 1.0, "in kelvin, and is read as degC"),
    "degC for kelvin": (lambda x: x + ICE_POINT, 1.0, "in degC, and is read as kelvin"),
    "degC for degF": (lambda x: 1.8 * (x - ICE_POINT) + 32.0 + ICE_POINT, 1.8, "in degC, and is read as degF"),
    "sign": (lambda x: 2.0 * ICE_POINT - x, 1.0, "with the wrong sign"),
    "tenth": (lambda x: (x - ICE_POINT) / 10.0 + ICE_POINT, 0.1, "in tenths of a degree"),
    "ten": (lambda x: (x - ICE_POINT) * 10.0 + ICE_POINT, 10.0, "ten times too small"),
}


def units(view: View) -> Iterator[Wrong]:
    """Channels in another unit, one or all."""
    observed, every = view.observed, range(len(view.channels))
    for change, factor, how in _UNITS.values():
        for chosen in [*([k] for k in every), list(every)]:
            if len(chosen) == 1 == len(view.channels) or not np.isfinite(observed[:, chosen]).any():
                continue
            read = observed.copy()
            read[:, chosen] = change(read[:, chosen])
            if np.nanmin(read) < _COLDEST or np.nanmax(read) > _HOTTEST:
                continue
            who = view.channels[chosen[0]] if len(chosen) == 1 else "every temperature"
            words = Words(
                f"{who} is {how}",
                f"Converted, {who} goes from {_span(observed[:, chosen])} to {_span(read[:, chosen])}, as the model "
                "has it.",
                f"Correct 'unit' of {who} in 'telemetry: channels'",
            )
            jacobian = -float(np.isfinite(read[:, chosen]).sum() * abs(np.log(factor))) / _ALIKE
            yield Wrong("unit", who, words, read, jacobian=jacobian, tries=len(_UNITS) * len(view.channels))


def _span(values: FloatArray) -> str:
    low, high = np.nanmin(values) - ICE_POINT, np.nanmax(values) - ICE_POINT
    return f"{number(float(low), 3)}..{number(float(high), 3)} degC"


# --- clocks ----------------------------------------------------------------------------------------------------


_SHIFTS = tuple(shift for k in range(1, round(REACH / _SHIFT)) for shift in (-k * _SHIFT, k * _SHIFT))
_FEW_SHIFTS = tuple(shift for m in (3, 5, 7, 10, 15, 20, 30, 40) for shift in (-60.0 * m, 60.0 * m))


def closer(shift: float, apart: float) -> FloatArray:
    """s, around a shift that is about right."""
    return shift + np.linspace(-1.0, 1.0, 13) * apart


def clocks(view: View, seconds: Sequence[float] | FloatArray = _SHIFTS) -> Iterator[Wrong]:
    """All time tags are late (positive) or early."""
    for late in map(float, seconds):
        how = "late" if late > 0 else "early"
        words = Words(
            f"The telemetry's clock is {duration(late)} {how}",
            f"Moved {duration(late)} {'back' if late > 0 else 'on'}, the telemetry agrees with sunlight, eclipses and "
            "modes; whole orbits more or less may be as good.",
            f"Check the time column: its zone, its leap seconds, the epoch of the orbit; shift it by {-late:+.0f} s",
        )
        near = partial(clocks, view, closer(late, _SHIFT))
        yield from _driven_otherwise(
            "clock", "time", words, view, tries=len(_SHIFTS), closer=near, sunlight=late, modes=late
        )


def duration(seconds: float) -> str:
    """In minutes where that is enough."""
    return f"{abs(seconds) / 60.0:.1f} min" if abs(seconds) >= 90.0 else f"{abs(seconds):.0f} s"


def status_clocks(view: View, seconds: Sequence[float] | FloatArray = _FEW_SHIFTS) -> Iterator[Wrong]:
    """The heaters' status is late or early beside the temperatures."""
    channels = _status_channels(view)
    if not channels:
        return
    for late in map(float, seconds):
        data = view.telemetry.assign({name: ("time", _shifted(view, name, late)) for name in channels.values()})
        how = "late" if late > 0 else "early"
        words = Words(
            f"The heaters' status is {duration(late)} {how} beside the temperatures",
            f"Temperatures rise {duration(late)} {'before' if late > 0 else 'after'} the status says that a heater is "
            "on.",
            f"Check the time tags of {listed(list(channels.values()))}",
        )
        near = partial(status_clocks, view, closer(late, 240.0))
        yield from _driven_otherwise(
            "status clock", "status", words, view, tries=len(_FEW_SHIFTS), closer=near, telemetry=data
        )


def _shifted(view: View, channel: str, late: float) -> FloatArray:
    """A status [T] as it is so much later."""
    times = view.telemetry["time"].to_numpy()
    values = view.telemetry[channel].to_numpy()
    valid = np.isfinite(values)
    if not valid.any():
        return np.asarray(values)
    at = times + np.timedelta64(round(1e3 * late), "ms")
    place = np.clip(np.searchsorted(times[valid], at, side="right") - 1, 0, valid.sum() - 1)
    return np.asarray(values[valid][place])


def channel_clocks(
    view: View, seconds: Sequence[float] | FloatArray = _FEW_SHIFTS, only: str | None = None
) -> Iterator[Wrong]:
    """One channel's time tags are late or early."""
    for late in map(float, seconds):
        moved = view.readings(late)
        for k, channel in enumerate(view.channels):
            if only not in (None, channel):
                continue
            observed = view.observed.copy()
            observed[:, k] = moved[:, k]
            if len(view.channels) == 1 or np.isfinite(observed[:, k]).sum() < 0.7 * np.isfinite(moved).sum(0).max():
                continue
            how = "late" if late > 0 else "early"
            words = Words(
                f"{channel} is {duration(late)} {how}",
                f"Moved by {duration(late)}, {channel} alone, all channels agree with the model.",
                f"Check the time tags of {channel}; or write 'observations: {{{channel}: {{time_offset: {-late:.0f} "
                "s}}'",
            )
            yield Wrong(
                "channel clock", channel, words, observed, tries=len(_FEW_SHIFTS) * len(view.channels),
                closer=partial(channel_clocks, view, closer(late, 240.0), channel),
            )  # fmt: skip


# --- heaters, modes and heat -----------------------------------------------------------------------------------


def _status_channels(view: View) -> dict[str, str]:
    """Heater -> channel of its status, of those that drive the simulation."""
    heaters = view.window.scenario.network.switches
    known = {name: heater.measured_by or "" for name, heater in heaters.items()}
    return {name: c for name, c in known.items() if c and np.isfinite(view.telemetry[c].to_numpy()).any()}


def statuses(view: View) -> Iterator[Wrong]:
    """A status is inverted, or two are each other's."""
    channels = _status_channels(view)
    for heater, channel in channels.items():
        data = view.telemetry.assign({channel: 1.0 - view.telemetry[channel]})
        words = Words(
            f"{channel} is inverted",
            f"The temperatures rise while {channel} says that {heater} is off: it is on for "
            f"{100 * (1 - float(np.nanmean(view.telemetry[channel]))):.0f}% of the time, not for "
            f"{100 * float(np.nanmean(view.telemetry[channel])):.0f}%.",
            f"Correct 'on' of {channel} in 'telemetry: channels'",
        )
        yield from _driven_otherwise("status inverted", channel, words, view, tries=len(channels), telemetry=data)
    for a, b in combinations(channels.values(), 2):
        data = view.telemetry.assign({a: view.telemetry[b], b: view.telemetry[a]})
        words = Words(
            f"{a} and {b} are swapped",
            f"With the status of {a} and {b} exchanged, the model explains the telemetry.",
            f"Exchange 'column' of {a} and {b} in 'telemetry: channels'",
        )
        yield from _driven_otherwise("statuses swapped", a, words, view, tries=len(channels), telemetry=data)


def heaters(view: View) -> Iterator[Wrong]:
    """A heater has another power, or heats another node."""
    model = view.window.scenario.network
    blocks = model.heaters
    switch = {other: k for k, name in enumerate(view.network.heaters) for other in model.on_switch(name)}
    centre = view.centre(view.observed)
    for name, block in blocks.items():
        on = np.nan_to_num(view.network.drive.measured[:, switch[name]])
        if block.node not in view.heat.nodes or not on.any():
            continue
        waves = block.power * np.repeat(on, 2)[None]
        own = view.response(view.window, centre, block.node, waves)

        def words(fit: Fit, name: str = name, power: float = block.power) -> Words:
            left = 1.0 + float(fit.added[0])
            if abs(left) < 0.2:
                title = f"{name} does not heat"
                text = f"The temperatures do not rise while the status says that {name} is on."
            else:
                title = f"{name} has {number(left, 2)} times the power that the scenario says"
                text = f"The temperatures rise as with {number(left * power, 3)} W, not {number(power, 3)} W."
            return Words(title, text, f"Check 'power' of {name} and what its status channel stands for")

        yield Wrong("heater", name, words, columns=own, least=0.5, tries=len(blocks))
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


def modes(view: View) -> Iterator[Wrong]:
    """A mode lacks power in a node, or the timeline is not of this flight."""
    model, centre = view.window.scenario.network, view.centre(view.observed)
    for mode, powers in model.modes.items():
        column = view.network.network.columns.index(f"mode.{mode}")
        active = view.network.drive.inputs[:, :, column].reshape(1, -1)
        if active.min() == active.max():
            continue
        for node in view.heat.nodes:
            written = powers.get(node, 0.0)
            flow = float(view.heat.flow[view.heat.nodes.index(node)])
            size = max(0.5 * flow, abs(written), 1.0)
            effect = size * view.response(view.window, centre, node, active)

            def words(fit: Fit, mode: str = mode, node: str = node, size: float = size, was: float = written) -> Words:
                power = was + size * float(fit.added[0])
                return Words(
                    f"Mode '{mode}' has another power in {node}",
                    f"While the timeline says '{mode}', {node} takes {number(power, 3)} W, not {number(was, 3)} W.",
                    f"Check 'modes: {mode}: {node}', and that the timeline is of this flight",
                )

            least = max(0.5 * abs(written), 0.15 * flow) / size
            yield Wrong("mode", mode, words, columns=effect, least=least, tries=len(model.modes) * len(view.heat.nodes))
    if len({change.mode for change in model.timeline}) < 2:
        return
    for late in _SHIFTS:
        how = "early" if late > 0 else "late"
        words_of = Words(
            f"The timeline of modes is {duration(late)} {how}",
            f"Modes begin and end {duration(late)} {'after' if late > 0 else 'before'} what the timeline says.",
            "Check the times in 'simulator: timeline', and their zone",
        )
        yield from _driven_otherwise("mode", "timeline", words_of, view, tries=len(_SHIFTS), modes=late)


def missing_heat(view: View) -> Iterator[Wrong]:
    """Something heats a node and then does not: a heater or a mode that the scenario lacks."""
    scenario, centre = view.window.scenario, view.centre(view.observed)
    grid = view.network.drive.times
    middle = 0.5 * (grid[1:] + grid[:-1])
    used = set(_status_channels(view).values())
    waves: list[tuple[str, str, FloatArray]] = []
    for name, channel in scenario.telemetry.channels.items():
        if channel.kind == "status" and name not in used and name in view.telemetry:
            on = series_at(view.telemetry, name, view.utc(middle))
            if np.isfinite(on).any() and np.nanmin(on) < np.nanmax(on):
                waves += [(name, node, np.nan_to_num(on)) for node in view.heat.nodes]
    for k, channel_name in enumerate(view.channels):
        node = scenario.observations[channel_name].node
        rising = turning(view.window.observed[:, k], 4.0 * float(view.rows.noise[k]) + 0.3)
        if node in view.heat.nodes and rising is not None:
            seconds = view.network.observation.times
            waves.append(("", str(node), (np.interp(middle, seconds, rising) > 0.5).astype(float)))
    for name, node, on in waves:
        flow = float(view.heat.flow[view.heat.nodes.index(node)])
        size = max(flow, 1.0)
        effect = size * view.response(view.window, centre, node, np.repeat(on, 2)[None])

        def words(fit: Fit, name: str = name, node: str = node, size: float = size, on: Any = on) -> Words:
            power, times = size * float(fit.added[0]), int((np.diff(np.asarray(on, int)) > 0).sum())
            what = f"as {name} says, which no heater of the scenario has" if name else f"{times} times in the window"
            return Words(
                f"A heater of {node} is missing in the scenario",
                f"About {number(abs(power), 2)} W come and go in {node}, {what}.",
                f"Add the heater of {node} to 'simulator: heaters', with its status as 'measured_by'",
            )

        yield Wrong("missing heat", node, words, columns=effect, least=0.2 * flow / size, tries=2 * len(waves))


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
        for factor in (-1.0, 0.0, *_FACTORS):
            inputs = drive.inputs.copy()
            inputs[:, :, column] *= factor
            window = view.simulated_by(drive=replace(drive, inputs=inputs))
            how = {-1.0: "has the wrong sign", 0.0: "does nothing"}.get(
                factor, f"is {number(1.0 / (factor or 1.0), 4)} times what it should be"
            )
            words = Words(
                f"The driver {load.driver} {how}",
                f"With {factor:g} times {load.driver}, the heat of load {name} explains the telemetry.",
                f"Check 'unit' of {load.driver} and 'coefficient' of load {name}",
            )
            yield Wrong("driver", load.driver, words, window=window, tries=8 * len(loads))


# --- the environment and numbers -------------------------------------------------------------------------------


def attitudes(view: View) -> Iterator[Wrong]:
    """Another attitude than the scenario's."""
    environment = view.window.scenario.environment
    if environment.orbit is None or not view.window.scenario.network.faces:
        return
    for attitude in ("nadir", "sun_pointing"):
        if attitude == environment.attitude:
            continue
        changed = environment.model_copy(update={"attitude": attitude})
        scenario = view.window.scenario.model_copy(update={"environment": changed})
        words = Words(
            f"The satellite flew {attitude.replace('_', '-')}",
            f"With the attitude '{attitude}', sunlight and Earth's heat explain the telemetry.",
            f"Write 'attitude: {attitude}' in 'environment', or check the quaternions",
        )
        yield from _driven_otherwise("attitude", attitude, words, view, tries=2, scenario=scenario)


def orbits(view: View) -> Iterator[Wrong]:
    """Another plane of the orbit, or another place in it."""
    environment = view.window.scenario.environment
    orbit = environment.orbit
    if not isinstance(orbit, CircularOrbit) or not view.window.scenario.network.faces:
        return
    changes: list[tuple[str, str, dict[str, Any]]] = []
    if orbit.ltan is not None:
        hour, minute = (int(part) for part in orbit.ltan.split(":"))
        for more in range(3, 24, 3):
            text = f"{(hour + more) % 24:02d}:{minute:02d}"
            changes.append((f"ltan {text}, not {orbit.ltan}", f"ltan: {text}", {"ltan": text}))
    for height in (0.7, 1.3, 2.0):
        text = f"{orbit.altitude * height / 1e3:.0f} km"
        changes.append((f"an altitude of {text}", f"altitude: {text}", {"altitude": orbit.altitude * height}))
    for what, advice, update in changes:
        changed = environment.model_copy(update={"orbit": orbit.model_copy(update=update)})
        scenario = view.window.scenario.model_copy(update={"environment": changed})
        words = Words(
            "The orbit is another one",
            f"The telemetry agrees with {what}: its sunlight and eclipses are those of the telemetry.",
            f"Check 'environment: orbit' ({advice})",
        )
        about = next(iter(update))
        yield from _driven_otherwise("orbit", about, words, view, tries=len(changes), scenario=scenario)


def places(view: View) -> Iterator[Wrong]:
    """The satellite is at another place of its orbit than the scenario says, while modes are right."""
    if not view.window.scenario.network.faces or not view.window.scenario.network.timeline:
        return
    count = 24
    for k in range(1, count):
        late = (k if k <= count // 2 else k - count) * view.window.period / count
        how = "later" if late > 0 else "earlier"
        words = Words(
            f"Sunlight and eclipses come {duration(late)} {how} than the orbit says",
            f"With the orbit moved by {duration(late)}, and the timeline of modes as it is, the model explains the "
            "telemetry.",
            "Check 'epoch' and 'argument_of_latitude' in 'environment: orbit'",
        )
        yield from _driven_otherwise("orbit", "place", words, view, tries=count, sunlight=late)


def numbers(view: View) -> Iterator[Wrong]:
    """A number of the scenario has the wrong unit, or a digit too many."""
    mapping = view.network.mapping
    moved = set(mapping.set_positions.tolist())
    for k, path in enumerate(view.network.network.paths):
        first, *_, last = path.split(".")
        if first not in ("nodes", "conductors", "faces", "modes", "heaters") or k in moved:
            continue
        if last in ("on_below", "off_above", "boundary") or mapping.written[k] == 0.0:
            continue
        for factor in _FACTORS:
            if last in ("absorptivity", "emissivity") and mapping.written[k] * factor > 1.0:
                continue
            written = mapping.written.copy()
            written[k] *= factor
            window = view.simulated_by(mapping=mapping._replace(written=written))
            words = Words(
                f"{path} is {number(1.0 / factor, 4)} times what it should be",
                f"The telemetry agrees with a value of {number(float(written[k]), 4)} (SI), not "
                f"{number(float(mapping.written[k]), 4)}.",
                f"Check the unit of '{path}'",
            )
            yield Wrong("number", path, words, window=window, tries=50)
