"""Observations: which channel measures what."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from .._document import Problem
from .._priors import support
from .._reading import Reading
from ..schema import Observation
from ._common import channel_of_kind, readable, unknown


def check(reading: Reading, folder: Path) -> Iterator[Problem]:
    """Channels exist and suit what they measure; at least one temperature is observed."""
    draft = reading.draft
    for name, observation in readable(draft.observations).items():
        location = ("observations", name)
        wrong = channel_of_kind(draft, name, "status" if observation.node is None else "temperature")
        if wrong:
            yield Problem(location, wrong)
        if observation.heater is not None:
            yield from _check_status(observation, name)
            if observation.heater not in draft.heaters:
                yield Problem((*location, "heater"), unknown("heater", observation.heater, draft.heaters))
            continue
        assert observation.node is not None
        if observation.node not in draft.nodes:
            yield Problem((*location, "node"), unknown("node", observation.node, draft.nodes))
        elif (node := draft.nodes[observation.node]) is not None and node.boundary is not None:
            message = f"found the boundary node {observation.node!r}, expected one that is simulated"
            yield Problem((*location, "node"), message)
        noise = observation.noise
        if noise is not None and not isinstance(noise, float) and support(noise)[0] < 0:
            message = f"found a {noise.kind} prior with negative values, expected one of positive values: half_normal"
            yield Problem((*location, "noise"), f"{message}, lognormal or truncated_normal")
    observations = draft.observations.values()
    if draft.observations and not any(observation is None or observation.node for observation in observations):
        message = "found no temperature channel, expected at least one: the likelihood is that of temperatures"
        yield Problem(("observations",), message)


def _check_status(observation: Observation, name: str) -> Iterator[Problem]:
    for key in ("noise", "bias"):
        if key in observation.model_fields_set:
            yield Problem(("observations", name, key), f"found {key!r} for a heater's status, expected none")
