"""Channels that are biased, swapped, of another node or satellite, or in another unit."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from itertools import combinations, permutations, product

import numpy as np

from ...scenario import ICE_POINT, Scenario, SimulatorModel
from ...simulator import FloatArray
from ...words import listed, number
from ..compared_window import ComparedWindow
from ..evidence import Fit, Scale
from ..network_view import Moved, View
from .wrong import Kind, Words, Wrong

_BIASES = ((8.0, 0.8), (40.0, 0.2))
"""K, prior deviations of a channel's bias, and how often: of a poor calibration, and of a wrong one."""
_OTHER_UNIT = 20.0
"""K, of a bias that may be one unit read as another."""
_MOST_BIAS = 100.0
"""K, beyond which it is no bias."""
_DRIFT = 8.0
"""K, prior deviation of a channel's drift over the window."""
_CURVE = 6.0
"""K, prior deviation of a channel's curve at both ends of what it reads."""
_BEND = 1.5
"""K, from which a curve is worth a word."""
_GAIN, _MOST_GAIN = 0.3, 0.8
"""Prior deviation of a channel's gain from one; by how much a gain is off at most that is no unit."""
_PIVOTS = (0.0, 25.0)
"""degC, where a channel with a gain reads right: thermistors are of one resistance at 25 degC, whatever their curve."""
_MOST_OF_CURVE = 0.45
"""By how much a gain from there is off at most: thermistors' constants B are from 3,000 to 4,500 K."""
_REFERENCE = 20.0
"""So many times as rare as other wrongs is one of what reads all sensors: a model that is wrong is too warm or too cold
in many places."""
_STRANGE, _STRANGE_TIME = ((15.0, 4.0), (5.0, 25.0)), 2400.0
"""K, deviations of mean and wandering of a channel that is not of this satellite; s, its correlation time."""
_PART, _ALL = 0.25, 0.9
"""Shares of the way to another node, from which a channel is between, and from which it is there."""
COLDEST, HOTTEST = 100.0, 500.0
"""K, that a satellite may be."""
_MOST_SWAPPED = 10
"""Channels, of which any three may be each other's."""
_OR_ITS_OWN = ", or has a node of its own"
"""What else may be of a channel that is not the only one of its node."""
_MOST_NODES = 15
"""Of a network whose channels are tried at every node."""


def biases(view: ComparedWindow) -> Iterator[Wrong]:
    """Each channel reads too high or too low by a constant."""
    t = len(view.rows.kept)
    for (k, channel), (size, often) in product(enumerate(view.channels), _BIASES):
        column = view.misread(k, np.full(t, size))

        def words(fit: Fit, channel: str = channel, size: float = size) -> Words:
            bias = size * float(fit.added[0])
            how, others = "high" if bias > 0 else "low", _beside(view, channel)
            checks = [f"'unit' of {channel}"] if abs(bias) > _OTHER_UNIT else []
            checks += [f"whether {channel} and {listed(others)} are of one node"] if others else []
            first = f"Check {' and '.join(checks)}, then" if checks else "Check"
            return Words(
                f"{channel} reads {number(abs(bias), 2)} K too {how}{_OR_ITS_OWN if others else ''}",
                f"A constant bias of {bias:+.1f} K of {channel} alone explains the telemetry best; the other channels "
                "agree with the model.",
                f"{first} the sensor's calibration curve; or write "
                f"'observations: {{{channel}: {{bias: {bias:.1f} K}}}}'",
            )

        yield Wrong(
            "bias", channel, words, columns=column, least=1.0 / size, most=_MOST_BIAS / size,
            tries=len(view.channels) / often,
        )  # fmt: skip


def _beside(view: ComparedWindow, channel: str) -> list[str]:
    """Other channels that read the same node."""
    of = view.window.scenario.observations
    node = of[channel].node
    return [other for other in view.channels if other != channel and node is not None and of[other].node == node]


def gains(view: ComparedWindow) -> Iterator[Wrong]:
    """Each channel is so many times its temperature in degC, or so many times as far from 25 degC."""
    for (k, channel), pivot in product(enumerate(view.channels), _PIVOTS):
        column = view.misread(k, _GAIN * (view.modelled_of(k) - ICE_POINT - pivot))

        def words(fit: Fit, channel: str = channel, pivot: float = pivot) -> Words:
            gain = 1.0 + _GAIN * float(fit.added[0])
            what, also, numbers = "what it should, in degC", "", f"gain: {gain:.3f}"
            if pivot:
                what, also = f"as far from {pivot:g} degC as it should", ", and whether it is that of this sensor"
                numbers += f", bias: {pivot * (1.0 - gain):.2f} K"
            write = f"; or write 'observations: {{{channel}: {{{numbers}}}}}'" if view.are_nodes([channel]) else ""
            return Words(
                f"{channel} reads {number(gain, 3)} times {what}",
                f"With that put right in {channel} alone, all channels agree with the model.",
                f"Check the sensor's calibration curve{also}{write}",
            )

        yield Wrong(
            "gain", channel, words, columns=column, least=0.1 / _GAIN,
            most=(_MOST_OF_CURVE if pivot else _MOST_GAIN) / _GAIN, tries=len(_PIVOTS) * len(view.channels),
        )  # fmt: skip


def of_all(view: ComparedWindow) -> Iterator[Wrong]:
    """Every temperature reads too high or too low by a constant, or so many times as much too."""
    every, t = range(len(view.channels)), len(view.rows.kept)
    if len(every) < 2:
        return
    (size, _), *_ = _BIASES
    offset = np.sum([view.misread(k, np.full(t, size)) for k in every], axis=0)
    slope = np.sum([view.misread(k, _GAIN * (view.modelled_of(k) - ICE_POINT)) for k in every], axis=0)
    advice = "Check what reads the sensors, as the reference of its converter, and the 'unit' of every temperature"

    def biased(fit: Fit) -> Words:
        bias = size * float(fit.added[0])
        return Words(
            f"Every temperature reads {number(abs(bias), 2)} K too {'high' if bias > 0 else 'low'}",
            f"A constant bias of {bias:+.1f} K of all channels explains the telemetry best.",
            advice,
        )

    def scaled(fit: Fit) -> Words:
        gain, bias = 1.0 + _GAIN * float(fit.added[0]), size * float(fit.added[1])
        return Words(
            f"Every temperature reads {number(gain, 3)} times what it should, in degC",
            f"Less {bias:+.1f} K and divided by {number(gain, 3)}, all channels agree with the model.",
            advice,
        )

    who = "every temperature"
    yield Wrong("bias", who, biased, columns=offset, least=1.0 / size, most=_MOST_BIAS / size, tries=_REFERENCE)
    both = np.concatenate([slope, offset], axis=1)
    yield Wrong("gain", who, scaled, columns=both, least=0.05 / _GAIN, most=_MOST_GAIN / _GAIN, tries=_REFERENCE)


def curves(view: ComparedWindow) -> Iterator[Wrong]:
    """Each channel is right in the middle of what it reads, and as far off at both ends."""
    for k, channel in enumerate(view.channels):
        modelled = view.modelled_of(k)
        half = 0.5 * float(np.ptp(modelled))
        if half < _BEND:
            continue
        column = view.misread(k, _CURVE * ((modelled - modelled.min() - half) / half) ** 2)

        def words(fit: Fit, channel: str = channel) -> Words:
            off = _CURVE * float(fit.added[0])
            return Words(
                f"{channel} has the curve of another sensor",
                f"It reads {number(abs(off), 2)} K {'more' if off > 0 else 'less'} at both ends of its range than in "
                "the middle, beside the model; the other channels agree with it.",
                f"Check the calibration curve of {channel}",
            )

        yield Wrong("curve", channel, words, columns=column, least=_BEND / _CURVE, tries=len(view.channels))


def drifts(view: ComparedWindow) -> Iterator[Wrong]:
    """Each channel's readings drift away from the temperature at a constant rate."""
    seconds = view.rows.seconds
    for k, channel in enumerate(view.channels):
        column = view.of_channel(k, _DRIFT * (seconds / seconds[-1])[:, None])

        def words(fit: Fit, channel: str = channel) -> Words:
            drift = _DRIFT * float(fit.added[0])
            return Words(
                f"{channel} drifts by {number(abs(drift), 2)} K",
                f"From the first to the last sample {channel} alone goes {drift:+.1f} K away from the model.",
                f"Check the sensor; leave {channel} out of 'observations' to calibrate without it",
            )

        yield Wrong("drift", channel, words, columns=column, least=1.0 / _DRIFT, tries=len(view.channels))


def swaps(view: ComparedWindow) -> Iterator[Wrong]:
    """Two or three channels are each other's, or all are their neighbours'."""
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
    trios = list(permutations(range(len(view.channels)), 3)) if 3 < len(view.channels) <= _MOST_SWAPPED else []
    for trio in trios:
        # Of the six orders of three, two are turns; each begins with its first channel once.
        if trio[0] != min(trio):
            continue
        names, observed = [view.channels[k] for k in trio], view.observed.copy()
        observed[:, trio] = view.observed[:, np.roll(trio, -1)]
        words = Words(
            f"{listed(names)} are each other's",
            f"With the readings of {names[1]} for {names[0]}, of {names[2]} for {names[1]} and of {names[0]} for "
            f"{names[2]}, the model explains the telemetry.",
            f"Check 'column' of {listed(names)} in 'telemetry: channels'",
        )
        yield Wrong("swapped", " ".join(names), words, observed=observed, tries=len(trios) / 3.0)
    for shift in (-1, 1) if len(view.channels) > 2 else ():
        words = Words(
            "Every channel is its neighbour's",
            f"With each channel's readings taken as those of the one {'after' if shift > 0 else 'before'} it, in the "
            "order of 'observations', the model explains the telemetry.",
            "Check every 'column' in 'telemetry: channels': a column may be missing in the file or in its header",
        )
        observed = np.roll(view.observed, shift, axis=1)
        yield Wrong("swapped", " ".join(view.channels), words, observed=observed, tries=2.0)


def other_nodes(view: View) -> Iterator[Wrong]:
    """A channel is of another node than the scenario says."""
    simulator = view.network
    sensors = simulator.observation.sensors
    nodes = simulator.network.own_nodes
    read = [view.window.scenario.observations[channel].node for channel in view.channels]
    for k, (channel, read_node) in enumerate(zip(view.channels, read, strict=True)):
        for node in nodes:
            if node == read_node or len(nodes) > _MOST_NODES:
                continue
            near = f"; or it has a node of its own, near {node}, which the scenario lacks"
            states = sensors.state.copy()
            states[k] = simulator.network.nodes.index(node)
            observation = replace(simulator.observation, sensors=sensors._replace(state=states))
            window = view.simulated_by(observation=observation)
            words = Words(
                f"{channel} is of {node}, not of {read_node}",
                f"{channel} does what the model says of {node}{near if _beside(view, channel) else ''}.",
                f"Correct 'node' of {channel} in 'observations'",
            )
            tries = len(nodes) * len(view.channels)
            kind: Kind = "doubled" if node in read and read.count(read_node) == 1 else "other node"
            begun = () if node in read else _begun(view, k, node)
            yield Wrong(kind, channel, words, window=window, moved=begun, tries=tries)


def _begun(view: View, channel: int, node: str) -> Moved:
    """Where a node is at the beginning that another channel would read: what the scenario writes may be far off."""
    name, valid = f"initial.{node}", np.flatnonzero(np.isfinite(view.observed[:, channel]))
    if name not in view.problem.names or not len(valid):
        return ()
    entry = view.problem.names.index(name)
    return ((entry, float(view.observed[valid[0], channel] / view.median[entry])),)


def between(view: ComparedWindow) -> Iterator[Wrong]:
    """A channel reads something between its node and another channel's: it is mounted there, or a mean."""
    for a, b in permutations(range(len(view.channels)), 2):
        channel, other = view.channels[a], view.channels[b]
        column = view.misread(a, view.modelled_of(b) - view.modelled_of(a))

        def words(fit: Fit, channel: str = channel, other: str = other) -> Words:
            share = float(fit.added[0])
            return Words(
                f"{channel} reads something between its node and {other}",
                f"By {share:.0%} of what is between the two, {channel} is nearer to {other} than the model has it.",
                f"Check where the sensor of {channel} is, and whether it is a mean of several",
            )

        tries = len(view.channels) * (len(view.channels) - 1)
        yield Wrong("between", channel, words, columns=column, least=_PART, most=_ALL, lacked=True, tries=tries)


def _drivers_of(scenario: Scenario, channel: str) -> list[str]:
    """Drivers of the loads of a channel's node."""
    loads = scenario.simulator.loads.values() if isinstance(scenario.simulator, SimulatorModel) else ()
    return list(dict.fromkeys(load.driver for load in loads if load.node == scenario.observations[channel].node))


def unrelated(view: ComparedWindow) -> Iterator[Wrong]:
    """A channel that has nothing to do with its node: of another satellite, or of a broken sensor.

    Other channels have to agree without it.
    """
    for k, channel in enumerate(view.channels if len(view.channels) > 1 else ()):
        apart = np.abs(view.rows.seconds[:, None] - view.rows.seconds)
        drivers = _drivers_of(view.window.scenario, channel)
        followed = f", or {listed(drivers)}, which a load of it follows, is another column" if drivers else ""
        others = _beside(view, channel)
        also = f", and whether {listed(others)} {'is' if len(others) == 1 else 'are'} of the same one" if others else ""
        words = Words(
            f"{channel} does not belong to its node{_OR_ITS_OWN if others else ''}",
            f"{channel} goes its own way, and all other channels agree with the model without it: it may be of another "
            f"place, another satellite, or a broken sensor; or numbers of its node are far off{followed}.",
            f"Check which sensor {channel} is, and the numbers of its node{also}; leave it out of 'observations' to "
            "calibrate without it",
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


def units(view: ComparedWindow) -> Iterator[Wrong]:
    """Channels in another unit, one or all."""
    observed, every = view.observed, range(len(view.channels))
    for change, factor, how in _UNITS.values():
        for chosen in [*([k] for k in every), list(every)]:
            if len(chosen) == 1 == len(view.channels) or not np.isfinite(observed[:, chosen]).any():
                continue
            read = observed.copy()
            read[:, chosen] = change(read[:, chosen])
            if not _are_of_a_satellite(read):
                continue
            who = view.channels[chosen[0]] if len(chosen) == 1 else "every temperature"
            words = _in_unit(who, how, observed[:, chosen], read[:, chosen])
            scale = Scale(factor, int(np.isfinite(read[:, chosen]).sum()))
            yield Wrong("unit", who, words, read, scale=scale, tries=len(_UNITS) * len(view.channels))


def in_other_units(channel: str, read: FloatArray) -> Iterator[tuple[FloatArray, Wrong]]:
    """Readings [T] K of a channel as they would be in another unit, the usual ones first, with what was then wrong."""
    for change, _, how in _UNITS.values():
        changed = change(read)
        if np.isfinite(read).any() and _are_of_a_satellite(changed):
            yield changed, Wrong("unit", channel, _in_unit(channel, how, read, changed))


def _are_of_a_satellite(read: FloatArray) -> bool:
    """Whether temperatures, K, some of which are known, may all be of one."""
    return bool(np.nanmin(read) >= COLDEST and np.nanmax(read) <= HOTTEST)


def _in_unit(who: str, how: str, before: FloatArray, after: FloatArray) -> Words:
    return Words(
        f"{who} is {how}",
        f"Converted, {who} goes from {_span(before)} to {_span(after)}, as the model has it.",
        f"Correct 'unit' of {who} in 'telemetry: channels'",
    )


def _span(values: FloatArray) -> str:
    low, high = np.nanmin(values) - ICE_POINT, np.nanmax(values) - ICE_POINT
    return f"{number(float(low), 3)}..{number(float(high), 3)} degC"


OF_ANY = (biases, gains, of_all, curves, drifts, swaps, units, between, unrelated)
"""What looks for them beside any simulator,"""
WRONGS = (*OF_ANY, other_nodes)
"""and beside a network."""
