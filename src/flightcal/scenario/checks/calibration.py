"""Settings of the methods: what would not fit in memory, and gates that let too much pass."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from ...errors import memory_size, physical_memory
from ..document import Issue, Location
from ..network import SimulatorModel
from ..reading import Reading
from ..schema import Scenario

_NUTS: Location = ("calibration", "nuts")
_COPIES = 3
"""Of all draws: as sampled, in physical units, and as they are written."""
_LOOSE_R_HAT, _FEW_DRAWS = 1.1, 100
"""Vehtari et al. (2021) ask for 1.01 and 400; beyond these estimates of quantiles are of no use."""


def check(reading: Reading, folder: Path) -> Iterator[Issue]:
    """The draws fit in memory; gates mean something."""
    scenario = reading.scenario
    if scenario is None:
        return
    nuts = scenario.calibration.nuts
    size = 8 * _COPIES * nuts.chains * (nuts.draws + nuts.warmup) * _entries(scenario)
    if size > physical_memory():
        found = f"found {nuts.chains} chains of {nuts.draws} draws, which need {memory_size(size)} of memory"
        message = f"{found}, expected at most the {memory_size(physical_memory())} of this machine"
        yield Issue((*_NUTS, "draws"), message)
    if nuts.max_r_hat > _LOOSE_R_HAT:
        message = f"found {nuts.max_r_hat:g}, expected about 1.01: chains that disagree pass this gate"
        yield Issue((*_NUTS, "max_r_hat"), message, warning=True)
    if nuts.min_ess < _FEW_DRAWS:
        message = f"found {nuts.min_ess:g}, expected about 400: with so few effective draws intervals are rough"
        yield Issue((*_NUTS, "min_ess"), message, warning=True)


def _entries(scenario: Scenario) -> int:
    """Of theta, at least: parameters, and initial temperatures in every window to train on."""
    model = scenario.simulator
    nodes = model.nodes.values() if isinstance(model, SimulatorModel) else ()
    initial = sum(node.capacity is not None for node in nodes)
    return max(1, len(scenario.parameters) + initial * len(scenario.train_windows))
