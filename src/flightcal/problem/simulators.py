"""The simulator that a scenario describes, whatever its kind, with its error where it has one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import xarray

from ..external import build_external
from ..reduction import load, network_for, shapes
from ..scenario import Scenario, SimulatorModel
from ..simulator import FloatArray, Simulator, Times, network_simulator


def build_simulator(
    scenario: Scenario,
    telemetry: xarray.Dataset,
    start: np.datetime64,
    end: np.datetime64,
    samples: Times,
    *,
    period: float,
    tried: Callable[[tuple[str, ...]], FloatArray] | None = None,
) -> Simulator:
    """The simulator of a scenario on the window [start, end], observed at `samples` [T] (UTC).

    tried: see `network_simulator`. Raises ScenarioError and TelemetryError.
    """
    model = scenario.simulator
    if not isinstance(model, SimulatorModel):
        return build_external(scenario, telemetry, start, end, samples, period=period)
    network = None
    if model.reduced_model is not None:
        network = network_for(load(scenario.folder / model.reduced_model).model, scenario)
    exact = network_simulator(scenario, telemetry, start, end, samples, period=period, network=network, tried=tried)
    if not model.errors:
        return exact
    seconds: FloatArray = (samples - start) / np.timedelta64(1, "ns") * 1e-9
    basis, variance = shapes(model.errors, exact.channels, seconds)
    return replace(exact, error_basis=basis, error_variance=variance)
