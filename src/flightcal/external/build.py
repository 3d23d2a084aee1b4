"""The simulator that a scenario describes, whatever its kind."""

from __future__ import annotations

from datetime import datetime
from typing import Any

import numpy as np
import xarray

from ..scenario import Scenario
from ..scenario.external import ExecutableSimulator, ExternalModel
from ..simulator import Simulator, network_simulator
from ..simulator.inputs import Times
from ..simulator.system import FloatArray
from .executable import ExecutableProgram
from .program import Program
from .simulator import external_simulator


def build_simulator(
    scenario: Scenario,
    telemetry: xarray.Dataset,
    start: np.datetime64,
    end: np.datetime64,
    samples: Times,
    *,
    period: float,
) -> Simulator:
    """The simulator of a scenario on the window [start, end], observed at `samples` [T] (UTC).

    Nothing that is not ours runs or is imported before the first simulation. Raises ScenarioError and TelemetryError.
    """
    model = scenario.simulator
    if not isinstance(model, ExternalModel):
        return network_simulator(scenario, telemetry, start, end, samples, period=period)
    times = _seconds(samples, start)
    program = _program(scenario, model, start, end, times)
    return external_simulator(scenario, model, program, times, float(_seconds(end, start)))


def _program(
    scenario: Scenario, model: ExternalModel, start: np.datetime64, end: np.datetime64, times: FloatArray
) -> Program:
    outputs = tuple(output.name or name for name, output in model.outputs.items())
    heaters = tuple(heater.name or name for name, heater in model.heaters.items())
    if isinstance(model, ExecutableSimulator):
        folder = scenario.folder.absolute()
        return ExecutableProgram(model.executable, folder, _utc(start), _utc(end), times, outputs, heaters)
    raise NotImplementedError


def _utc(time: np.datetime64) -> datetime:
    utc: datetime = time.astype("datetime64[us]").item()
    return utc


def _seconds(time: Any, start: np.datetime64) -> Any:
    return (time - start) / np.timedelta64(1, "ns") * 1e-9
