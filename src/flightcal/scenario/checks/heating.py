"""Heaters, operational modes and loads: what puts heat into nodes."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

from ..blocks import Blocks, readable
from ..document import Issue, Location
from ..network import Heater, SwitchedHeater
from ..numbers import load_coefficient, load_driver
from ..reading import Reading
from ..units import celsius
from .common import channel_of_kind, heated_node, known, node_with_capacity

_TIMELINE: Location = ("simulator", "timeline")


def check(reading: Reading, folder: Path) -> Iterator[Issue]:
    """Heaters, modes and loads heat nodes that exist, by channels and a timeline that exist."""
    blocks = reading.blocks
    heaters: dict[str, Heater | SwitchedHeater] = readable(blocks.heaters)
    for name, heater in heaters.items():
        location = ("simulator", "heaters", name)
        if blocks.reduced is None:
            yield from heated_node(blocks, heater.node, "a heater", (*location, "node"))
        if isinstance(heater, SwitchedHeater):
            yield from _check_switch(blocks, heater.switched_with, (*location, "switched_with"))
        else:
            yield from _check_thermostat(blocks, heater, location)
    for mode, powers in readable(blocks.modes).items():
        for node in powers if blocks.reduced is None else ():
            yield from heated_node(blocks, node, "dissipation", ("simulator", "modes", mode, node))
    yield from _check_timeline(reading)
    yield from _check_loads(blocks)


def _check_switch(blocks: Blocks, name: str, location: Location) -> Iterator[Issue]:
    with_thermostat = [other for other, heater in blocks.heaters.items() if not isinstance(heater, SwitchedHeater)]
    if isinstance(blocks.heaters.get(name), SwitchedHeater):
        message = f"found {name!r}, which has no thermostat, expected a heater that has one"
        yield Issue(location, f"{message}: {', '.join(with_thermostat) or 'the scenario has none'}")
    else:
        yield from known("heater", name, with_thermostat, location)


def _check_thermostat(blocks: Blocks, heater: Heater, location: Location) -> Iterator[Issue]:
    yield from node_with_capacity(blocks, heater.sensor, (*location, "sensor"))
    if not heater.on_below < heater.off_above:
        found = f"on_below {celsius(heater.on_below)} and off_above {celsius(heater.off_above)}"
        yield Issue((*location, "on_below"), f"found {found}, expected on_below under off_above")
    if heater.measured_by is not None:
        yield from channel_of_kind(blocks, heater.measured_by, "status", (*location, "measured_by"))
    elif blocks.heater_input == "measured":
        yield Issue(
            location, "missing key 'measured_by', expected the heater's status channel: heater_input is measured"
        )


def _check_timeline(reading: Reading) -> Iterator[Issue]:
    blocks = reading.blocks
    if len(blocks.modes) > 1 and not blocks.timeline and "timeline_file" not in reading.document.data["simulator"]:
        modes = ", ".join(blocks.modes)
        message = (
            f"found {len(blocks.modes)} modes ({modes}) without a 'timeline', expected one that says when each holds"
        )
        yield Issue(("simulator", "modes"), message)
    for k, change in enumerate(blocks.timeline):
        if change is not None:
            yield from known("mode", change.mode, blocks.modes, (*_TIMELINE, k, "mode"))
    for k, (earlier, later) in enumerate(pairwise(blocks.timeline)):
        if earlier is not None and later is not None and not earlier.at < later.at:
            message = f"found {later.at.isoformat()} after {earlier.at.isoformat()}, expected times in ascending order"
            yield Issue((*_TIMELINE, k + 1, "at"), message)
    first = blocks.timeline[0] if blocks.timeline else None
    for name, window in readable(blocks.windows).items():
        if len(blocks.modes) > 1 and first is not None and window.start < first.at:
            found = f"found {window.start.isoformat()}, before the timeline's first entry {first.at.isoformat()}"
            yield Issue(("windows", name, "start"), f"{found}, expected a mode to be known from the start")


def _check_loads(blocks: Blocks) -> Iterator[Issue]:
    for name, load in readable(blocks.loads).items():
        location = ("simulator", "loads", name)
        yield from heated_node(blocks, load.node, "a load", (*location, "node"))
        if wrong := list(channel_of_kind(blocks, load.driver, "driver", (*location, "driver"))):
            yield from wrong
            continue
        channel = blocks.channels[load.driver]
        if channel is None:
            continue
        try:
            load_coefficient(load, channel)
        except ValueError as error:
            yield Issue((*location, "coefficient"), str(error))
        try:
            load_driver(load, channel)
        except ValueError as error:
            yield Issue((*location, "table"), str(error))
