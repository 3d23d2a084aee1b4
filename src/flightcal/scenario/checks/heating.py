"""Heaters, operational modes and loads: what puts heat into nodes."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

from ..blocks import Draft
from ..document import Location, Problem
from ..network import Heater
from ..numbers import load_coefficient
from ..reading import Reading
from ..units import celsius
from .common import channel_of_kind, heated_node, readable, unknown

_TIMELINE: Location = ("simulator", "timeline")


def check(reading: Reading, folder: Path) -> Iterator[Problem]:
    """Heaters, modes and loads heat nodes that exist, by channels and a timeline that exist."""
    draft = reading.draft
    for name, heater in readable(draft.heaters).items():
        yield from _check_heater(draft, heater, ("simulator", "heaters", name))
    for mode, powers in readable(draft.modes).items():
        for node in powers if draft.reduced is None else ():
            wrong = heated_node(draft, node, "dissipation")
            if wrong:
                yield Problem(("simulator", "modes", mode, node), wrong)
    yield from _check_timeline(draft)
    yield from _check_loads(draft)


def _check_heater(draft: Draft, heater: Heater, location: Location) -> Iterator[Problem]:
    wrong = heated_node(draft, heater.node, "a heater")
    if wrong:
        yield Problem((*location, "node"), wrong)
    sensor = draft.nodes.get(heater.sensor)
    if heater.sensor not in draft.nodes:
        yield Problem((*location, "sensor"), unknown("node", heater.sensor, draft.nodes))
    elif sensor is not None and sensor.capacity is None:
        message = f"found {heater.sensor!r}, a node without a capacity, expected one with a capacity"
        yield Problem((*location, "sensor"), message)
    if not heater.on_below < heater.off_above:
        found = f"on_below {celsius(heater.on_below)} and off_above {celsius(heater.off_above)}"
        yield Problem((*location, "on_below"), f"found {found}, expected on_below under off_above")
    if heater.measured_by is not None:
        wrong = channel_of_kind(draft, heater.measured_by, "status")
        if wrong:
            yield Problem((*location, "measured_by"), wrong)
    elif draft.heater_input == "measured":
        yield Problem(
            location, "missing key 'measured_by', expected the heater's status channel: heater_input is measured"
        )


def _check_timeline(draft: Draft) -> Iterator[Problem]:
    if len(draft.modes) > 1 and not draft.timeline:
        modes = ", ".join(draft.modes)
        message = (
            f"found {len(draft.modes)} modes ({modes}) without a 'timeline', expected one that says when each holds"
        )
        yield Problem(("simulator", "modes"), message)
    for k, change in enumerate(draft.timeline):
        if change is not None and change.mode not in draft.modes:
            yield Problem((*_TIMELINE, k, "mode"), unknown("mode", change.mode, draft.modes))
    for k, (earlier, later) in enumerate(pairwise(draft.timeline)):
        if earlier is not None and later is not None and not earlier.at < later.at:
            message = f"found {later.at.isoformat()} after {earlier.at.isoformat()}, expected times in ascending order"
            yield Problem((*_TIMELINE, k + 1, "at"), message)
    first = draft.timeline[0] if draft.timeline else None
    for name, window in readable(draft.windows).items():
        if len(draft.modes) > 1 and first is not None and window.start < first.at:
            found = f"found {window.start.isoformat()}, before the timeline's first entry {first.at.isoformat()}"
            yield Problem(("windows", name, "start"), f"{found}, expected a mode to be known from the start")


def _check_loads(draft: Draft) -> Iterator[Problem]:
    for name, load in readable(draft.loads).items():
        location = ("simulator", "loads", name)
        wrong = heated_node(draft, load.node, "a load")
        if wrong:
            yield Problem((*location, "node"), wrong)
        wrong = channel_of_kind(draft, load.driver, "driver")
        if wrong:
            yield Problem((*location, "driver"), wrong)
            continue
        try:
            load_coefficient(load, draft.channels[load.driver])
        except ValueError as error:
            yield Problem((*location, "coefficient"), str(error))
