"""Observations: which channel measures what."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

from ..blocks import Blocks, readable
from ..document import Issue, Location
from ..network import SwitchedHeater
from ..priors import support
from ..reading import Reading
from ..schema import Observation
from .common import channel_of_kind, known

_ERRORS = ("bias", "gain", "time_offset", "lag")


def check(reading: Reading, folder: Path) -> Iterator[Issue]:
    """Channels exist and suit what they measure; at least one temperature is observed."""
    blocks = reading.blocks
    for name, observation in readable(blocks.observations).items():
        location = ("observations", name)
        kind = "temperature" if observation.heater is None else "status"
        yield from channel_of_kind(blocks, name, kind, location)
        yield from _check_target(blocks, observation, location)
        if observation.heater is not None:
            yield from _check_status(blocks, observation, name)
            continue
        if observation.likelihood is not None:
            message = "found a 'likelihood' for a temperature, expected one for the status of a heater only"
            yield Issue((*location, "likelihood"), message)
        yield from _check_sensor(blocks, observation, name)
    yield from _check_time_error(reading)
    observations = blocks.observations.values()
    if blocks.observations and not any(
        observation is None or observation.heater is None for observation in observations
    ):
        message = "found no temperature channel, expected at least one: the likelihood is that of temperatures"
        yield Issue(("observations",), message)


def _check_time_error(reading: Reading) -> Iterator[Issue]:
    """The error of all time tags is one of readings of a network's nodes."""
    data = reading.document.data
    if "time_error" not in data:
        return
    if data["time_error"] is None:
        yield Issue(("time_error",), "found nothing, expected none or a duration: without the key it has its default")
    elif data["time_error"] != "none" and reading.blocks.external is not None:
        message = f"found a time error beside an external simulator ({reading.blocks.external.kind})"
        yield Issue(("time_error",), f"{message}, expected none: its readings are of the times of their tags")


def _check_target(blocks: Blocks, observation: Observation, location: Location) -> Iterator[Issue]:
    """What is measured is there."""
    external = blocks.external
    if observation.heater is not None:
        heaters = blocks.heaters if external is None else external.heaters
        yield from known("heater", observation.heater, heaters, (*location, "heater"))
        if isinstance(heater := heaters.get(observation.heater), SwitchedHeater):
            message = f"found {observation.heater!r}, which is switched with {heater.switched_with!r}"
            yield Issue((*location, "heater"), f"{message}, expected the heater that has the thermostat")
    elif observation.output is not None and external is not None:
        yield from known("output", observation.output, external.outputs, (*location, "output"))
    elif observation.output is not None:
        message = "found 'output', expected 'node': the simulator is a thermal network"
        yield Issue((*location, "output"), message)
    elif external is not None:
        message = f"found 'node', expected 'output': the simulator is external ({external.kind})"
        yield Issue((*location, "node"), message)
    else:
        name, here = observation.node or "", (*location, "node")
        yield from known("node", name, blocks.nodes, here)
        if (node := blocks.nodes.get(name)) is not None and node.boundary is not None:
            yield Issue(here, f"found the boundary node {name!r}, expected one that is simulated")


def _check_sensor(blocks: Blocks, observation: Observation, name: str) -> Iterator[Issue]:
    """Errors of the sensor that the simulator cannot give."""
    for key in _ERRORS[1:] if blocks.external is not None else ():
        if getattr(observation, key) != Observation.model_fields[key].default:
            message = (
                f"found {key!r}, expected none but 'bias': an external simulator gives what its sensors would show"
            )
            yield Issue(("observations", name, key), message)
    if observation.lag is None or blocks.external is not None:
        return
    if blocks.reduced is not None:
        message = "found a lag, expected none: the simulator is a reduced order model, which has no sensors of its own"
        yield Issue(("observations", name, "lag"), message)
    elif (node := blocks.nodes.get(observation.node or "")) is not None and node.arithmetic:
        message = f"found a lag behind the massless node {observation.node!r}, expected a node with a capacity"
        yield Issue(("observations", name, "lag"), f"{message}: the sensor starts at its node's initial temperature")


def _check_status(blocks: Blocks, observation: Observation, name: str) -> Iterator[Issue]:
    for key in ("noise", *_ERRORS):
        if key in observation.model_fields_set:
            yield Issue(("observations", name, key), f"found {key!r} for a heater's status, expected none")
    if observation.likelihood is None:
        return
    location = ("observations", name, "likelihood")
    if blocks.external is not None:
        message = (
            f"found a likelihood of status with an external simulator ({blocks.external.kind}), expected a network"
        )
        yield Issue(location, f"{message}: it needs the times at which simulated thermostats switch")
    elif blocks.heater_input == "measured":
        message = "found a likelihood of status with heater_input: measured, expected heater_input: simulated"
        yield Issue(location, f"{message}: a status that drives the heater says nothing of the thermostat")
    form = observation.likelihood.switch_times
    for key, most in (("timing", math.inf), ("error_rate", 0.5)) if form is not None else ():
        prior = getattr(form, key)
        if not isinstance(prior, float) and (support(prior)[0] < 0 or support(prior)[1] > most):
            inside = "of positive values" if key == "timing" else f"within 0 to {most:g}"
            message = f"found a {prior.kind} prior that reaches further, expected one {inside}"
            yield Issue((*location, "switch_times", key), message)
