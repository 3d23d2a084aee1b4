"""The files that a scenario's results depend on, beside the scenario itself."""

from __future__ import annotations

from pathlib import Path

from .external import simulator_files
from .network import SimulatorModel
from .schema import Scenario


def input_files(scenario: Scenario) -> list[Path]:
    """Telemetry, orbit and attitude files and those that the simulator is made of, as paths that can be opened."""
    environment = scenario.environment
    named = [*scenario.telemetry.file]
    for block, field in ((environment.orbit, "positions"), (environment.attitude, "quaternions")):
        if hasattr(block, field):
            named.append(getattr(block, field))
    if isinstance(scenario.simulator, SimulatorModel):
        model = scenario.simulator
        named += [name for name in (model.reduced_model, model.checked_on) if name is not None]
    return [*(scenario.folder / name for name in named), *simulator_files(scenario.simulator, scenario.folder)]
