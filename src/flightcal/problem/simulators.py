"""The simulator that a scenario describes, whatever its kind, with its error where it has one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import xarray

from ..external import build_external
from ..reduction import load, network_for, shapes
from ..scenario import Scenario, SimulatorModel, heat_of
from ..simulator import FloatArray, Simulator, Times, network_simulator


def heated_nodes(scenario: Scenario) -> tuple[str, ...]:
    """Nodes that take heat which no block describes."""
    heat = heat_of(scenario)
    if heat is None:
        return ()
    return heat.nodes or tuple(name for name, node in scenario.network.nodes.items() if node.capacity is not None)


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
    heated = heated_nodes(scenario)
    exact = network_simulator(
        scenario, telemetry, start, end, samples, period=period, network=network, heated=heated, tried=tried
    )
    if not model.errors:
        return exact
    seconds: FloatArray = (samples - start) / np.timedelta64(1, "ns") * 1e-9
    basis, variance = shapes(model.errors, exact.channels, seconds)
    return replace(exact, error_basis=basis, error_variance=variance)
