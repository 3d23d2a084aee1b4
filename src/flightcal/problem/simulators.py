"""The simulator that a scenario describes, whatever its kind, with its error where it has one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import xarray

from ..external import build_external
from ..reduction import load, network_for, shapes
from ..scenario import Scenario, SimulatorModel, heat_of, time_error_of, timed_together
from ..simulator import FloatArray, Simulator, Times, network_simulator


def heated_nodes(scenario: Scenario) -> tuple[str, ...]:
    """Nodes that take heat which no block describes: of a reduced model they are nodes of the full network."""
    heat, model = heat_of(scenario), scenario.simulator
    if heat is None or not isinstance(model, SimulatorModel):
        return ()
    if heat.nodes:
        return heat.nodes
    if model.reduced_model is None:
        return tuple(name for name, node in model.nodes.items() if node.capacity is not None)
    # The telemetry tells little of the others.
    known = [item.node for item in scenario.observations.values()]
    known += [name for heater in model.switches.values() for name in (heater.node, heater.sensor)]
    return tuple(name for name in dict.fromkeys(known) if name in model.full_nodes)


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
    network, heated = None, heated_nodes(scenario)
    if model.reduced_model is not None:
        network = network_for(load(scenario.folder / model.reduced_model).model, scenario, heated)
    timed = () if time_error_of(scenario) is None else timed_together(scenario)
    exact = network_simulator(
        scenario,
        telemetry,
        start,
        end,
        samples,
        period=period,
        network=network,
        heated=heated,
        timed=timed,
        tried=tried,
    )
    if not model.errors:
        return exact
    seconds: FloatArray = (samples - start) / np.timedelta64(1, "ns") * 1e-9
    basis, variance = shapes(model.errors, exact.channels, seconds)
    return replace(exact, error_basis=basis, error_variance=variance)
