"""The scenario as it is compared with its telemetry before any sampling: driven by status, and with room for wrongs."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import combinations
from typing import Any

import numpy as np
import xarray

from ..environment import orbital_period
from ..problem import build_window, fast_heaters, pinned, problem_of, unseen_heaters
from ..scenario import (
    Channel,
    Conductor,
    Heat,
    Parameter,
    Scenario,
    SimulatorModel,
    TruncatedNormal,
    Uniform,
)
from ..telemetry import window_bounds
from .compared_window import INFERRED
from .network_view import HEAT, NO_LINK, SHARES, View, view_of
from .thermostat import inferred

_MOST_LINKED = 14
"""Nodes, of which any two may be linked."""
_ORBITS, _MOST_ORBITS = 4.0, 12.0
"""Of the first training window, that are looked at; where samples come in passes, more."""
_ENOUGH = 60
"""Samples that tell enough of them."""
_BEYOND = 20.0
"""Widths of a bounded prior, by which a value may lie outside of it."""


def prepared(scenario: Scenario, telemetry: xarray.Dataset) -> View | None:
    """The first training window of a thermal network, driven by its heaters' status; None of anything else.

    Of a heater that acts without a measured status nobody knows when it was on, and a model that switches a little
    later is no wrong: its heat is then unknown, unless its sensor is far from its thresholds. Raises FlightcalError.
    """
    model = scenario.simulator
    if not isinstance(model, SimulatorModel) or model.reduced_model is not None or model.errors:
        return None
    name = scenario.train_windows[0]
    scenario, telemetry = _held(scenario, telemetry, name)
    model = scenario.network
    heaters, channels = model.switches, dict(scenario.telemetry.channels)
    for heater, block in heaters.items():
        if block.measured_by is None:
            channel = f"{INFERRED}{heater}"
            telemetry = telemetry.assign({channel: ("time", inferred(scenario, telemetry, heater))})
            channels[channel] = Channel(column=channel, kind="status")
            heaters[heater] = block.model_copy(update={"measured_by": channel})
    update: dict[str, Any] = {"heaters": {**model.heaters, **heaters}}
    update |= {"heater_input": "measured"} if heaters else {}
    update["conductors"] = (*model.conductors, *_of_nothing(model))
    read = scenario.telemetry.model_copy(update={"channels": channels})
    of_all: dict[str, Any] = {
        "simulator": model.model_copy(update=update),
        "telemetry": read,
        "heat": _heat(scenario),
        "parameters": {name: _unbounded(parameter) for name, parameter in scenario.parameters.items()},
    }
    changed = scenario.model_copy(update=of_all)
    window = build_window(changed, telemetry, name)
    seconds = (window.times[window.valid.any(axis=1)] - window.start) / np.timedelta64(1, "s")
    enough = float(seconds[min(_ENOUGH, len(seconds)) - 1]) if len(seconds) else 0.0
    span = float(np.clip(enough, _ORBITS * window.period, _MOST_ORBITS * window.period))
    if window.times[-1] - window.times[0] > np.timedelta64(round(span), "s"):
        window = build_window(changed, telemetry, name, span=span)
    return view_of(problem_of(changed, [window]), telemetry)


def _held(scenario: Scenario, telemetry: xarray.Dataset, window: str) -> tuple[Scenario, xarray.Dataset]:
    """The scenario and its telemetry, as `pinned` makes them."""
    silent = any(heater.measured_by is None for heater in scenario.network.switches.values())
    fast = fast_heaters([build_window(scenario, telemetry, window)]) if silent else ()
    span = window_bounds(scenario.windows[window], orbital_period(scenario.environment, scenario.folder))
    return pinned(scenario, telemetry, unseen_heaters(scenario, telemetry, [span], fast), fast)


def _heat(scenario: Scenario) -> Heat:
    """What is taken as usual, or more where the scenario says so: over a driver, or a larger share of what flows."""
    pattern = scenario.heat.pattern if isinstance(scenario.heat, Heat) else None
    usual = HEAT.pattern
    if pattern is None or usual is None or (pattern.over is None and pattern.scale <= usual.scale):
        return HEAT
    return HEAT.model_copy(update={"pattern": pattern})


def _of_nothing(model: SimulatorModel) -> Iterator[Conductor]:
    """Conductors that conduct nothing yet, between nodes of a small network that are not linked."""
    free = [name for name, node in model.nodes.items() if node.boundary is None]
    linked = {frozenset(conductor.between) for conductor in model.conductors}
    for pair in combinations(free, 2) if len(free) <= _MOST_LINKED else ():
        if frozenset(pair) not in linked:
            yield Conductor(between=pair, conductance=f"{NO_LINK} W/K")


def _unbounded(parameter: Parameter) -> Parameter:
    """With a prior of the same centre and deviation that may be left where it is wrong.

    At a bound nothing tells how far the telemetry would have it.
    """
    prior = parameter.prior
    if not isinstance(prior, Uniform | TruncatedNormal):
        return parameter
    width = prior.upper - prior.lower
    mean, deviation = 0.5 * (prior.lower + prior.upper), width / math.sqrt(12.0)
    if isinstance(prior, TruncatedNormal):
        mean, deviation = prior.mean, prior.standard_deviation
    lower = 0.0 if prior.lower >= 0.0 else prior.lower - _BEYOND * width
    upper = prior.upper + _BEYOND * width
    if any(path.rpartition(".")[2] in SHARES for path in parameter.sets):
        upper = max(1.0, prior.upper)
    soft = TruncatedNormal(mean=mean, standard_deviation=deviation, lower=lower, upper=upper)
    return parameter.model_copy(update={"prior": soft})
