"""What a campaign runs: a simulator on a window, with the hashes of everything that its results depend on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..run import hash_of, hash_of_file
from ..scenario import Scenario, input_files

_TRYING = ("timeout", "retries", "keep_failed")
"""Of an external simulator: how long and how often it is tried and what is kept of it, which a retry may change."""


@dataclass(frozen=True)
class Subject:
    """A simulator as a campaign sees it. Runs of equal `identity` and theta are the same run."""

    parts: Mapping[str, str]
    """Hash of each part of the simulator and its settings, by a name that a message can say."""
    inputs: Mapping[str, str]
    """Hash of each input file's content, by its path; the path itself does not count."""
    parameters: tuple[str, ...]
    """Names of theta's entries [d]."""
    channels: tuple[str, ...]
    """Temperature channels [N]."""
    heaters: tuple[str, ...]
    """[H]."""
    times: Any
    """[T] datetime64, UTC."""
    text: str = ""
    """The scenario, resolved, for whoever reads the campaign's folder; no part of the identity."""

    @cached_property
    def identity(self) -> str:
        """Hash of simulator and inputs."""
        times = np.asarray(self.times, "datetime64[ns]").astype(int).tolist()
        names = (self.parameters, self.channels, self.heaters)
        return hash_of(dict(self.parts), list(self.inputs.values()), *names, times)


def scenario_parts(scenario: Scenario, window: str) -> dict[str, str]:
    """Hashes of a scenario's blocks, of what bears on simulations of a window: no prior, no noise, no method."""
    content = scenario.model_dump(mode="json")
    content["telemetry"].pop("file")
    for block in (content["simulator"], content["simulator"].get("executable", {})):
        for aside in _TRYING:
            block.pop(aside, None)
    for block, aside in (("parameters", "prior"), ("observations", "noise")):
        for item in content[block].values():
            item.pop(aside)
    blocks = {name: content[name] for name in ("telemetry", "environment", "simulator", "parameters", "observations")}
    return {name: hash_of(block) for name, block in (blocks | {f"window {window}": content["windows"][window]}).items()}


def input_hashes(scenario: Scenario) -> dict[str, str]:
    """Hash of each input file's content, by its path."""
    return {str(file): hash_of_file(file) for file in input_files(scenario)}
