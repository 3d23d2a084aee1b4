"""Nodes whose heaters switch more often than telemetry shows: in open loop their own temperature is what drives them.

A thermostat keeps such a node between its thresholds, whatever the node's numbers are, and nobody knows when it heats.
So the telemetry of the node says nothing of these numbers, and all that its neighbours feel of it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import Any

import numpy as np
import xarray

from ..probability import Priors
from ..scenario import ICE_POINT, Channel, Conductor, Heater, Node, Scenario, SimulatorModel, time_error_of
from ..simulator import FloatArray, SimulationFailure
from ..telemetry import SHORT_GAP, is_blurred, smoothed
from .window import PIN, Window

_AT_ONCE = 0.5
"""s, in which a node follows its telemetry."""
_AT_START = 5.0
"""Times this, and the deviation of the time tags' common error, after which it has followed."""
_MOST_GAPS = 0.1
"""Share of the time in which a node that is held may have no telemetry: a line is drawn through it,"""
_ANY_GAP = {"longest_gap_s": np.inf}
"""however long it is."""
_FAST, _BRIEF = 3.0, 2.0
"""Times the interval between samples, below which a thermostat's cycle is not seen, or a time that it is on or off."""


def pinned(
    scenario: Scenario, telemetry: xarray.Dataset, unseen: Iterable[str], fast: Collection[str] = ()
) -> tuple[Scenario, xarray.Dataset]:
    """A scenario in open loop in which measured temperatures hold some nodes, and telemetry that has them.

    unseen: heaters of these nodes, see `unseen_heaters`; fast: those of them that have no measured status.
    """
    model, channel_of = scenario.network, _channels(scenario)
    heaters, nodes, series = dict(model.heaters), dict(model.nodes), dict[str, FloatArray]()
    channels, conductors = dict(scenario.telemetry.channels), list[Conductor]()
    for name in unseen:
        switch, told = model.switches[name], f"{PIN}{name}, status"
        if switch.measured_by is None or name in fast:
            series[told] = _likely_on(switch, _temperature(scenario, telemetry, channel_of[switch.sensor]))
        else:
            series[told] = smoothed(telemetry, switch.measured_by)
        channels[told] = Channel(column=told, kind="status")
        heaters[name] = switch.model_copy(update={"measured_by": told})
        for node in sorted({heater.node for heater in model.on_switch(name).values()}):
            channel, capacity = f"{PIN}{node}", model.nodes[node].capacity
            if channel in nodes or capacity is None:
                continue
            series[channel] = _temperature(scenario, telemetry, channel_of[node])
            channels[channel] = Channel(column=channel, kind="temperature")
            nodes[channel] = Node.model_construct(boundary=channel)
            conductors.append(Conductor.model_construct(between=(node, channel), conductance=capacity / _AT_ONCE))
    if not series:
        return scenario, telemetry
    update: dict[str, Any] = {"nodes": nodes, "heaters": heaters, "conductors": (*model.conductors, *conductors)}
    read = scenario.telemetry.model_copy(update={"channels": channels})
    held = scenario.model_copy(update={"simulator": model.model_copy(update=update), "telemetry": read})
    return held, telemetry.assign({name: ("time", values, _ANY_GAP) for name, values in series.items()})


def _channels(scenario: Scenario) -> dict[str, str]:
    """Of each node that is read, a channel that reads it."""
    return {
        observation.node: channel
        for channel, observation in scenario.observations.items()
        if observation.node is not None
    }


def unseen_heaters(
    scenario: Scenario,
    telemetry: xarray.Dataset,
    spans: Sequence[tuple[np.datetime64, np.datetime64]],
    fast: Collection[str] = (),
) -> tuple[str, ...]:
    """Heaters that switch more often than telemetry shows, and whose nodes can be held in all spans of time.

    They are those that switch more often than their status is sampled, and of `fast`, which have none and switch as
    often. A heater's node can be held where channels observe it and the sensor, with few gaps; of a reduced model none.
    """
    model, channel_of = scenario.network, _channels(scenario)
    if model.reduced_model is not None:
        return ()
    inside, found = [telemetry.sel(time=slice(*span)) for span in spans], []
    for name, switch in model.switches.items():
        status, places = (
            switch.measured_by,
            {switch.sensor, *(heater.node for heater in model.on_switch(name).values())},
        )
        unseen = name in fast or (status is not None and is_blurred(telemetry, status))
        if unseen and places <= set(channel_of):
            gaps = (_gaps(window, channel_of[node]) for window in inside for node in places)
            found += [name] if all(share <= _MOST_GAPS for share in gaps) else []
    return tuple(found)


def _gaps(telemetry: xarray.Dataset, channel: str) -> float:
    """Share of the time between a channel's first and last sample that lies in long gaps; 1: it has none or one."""
    times = telemetry["time"].to_numpy()[np.isfinite(telemetry[channel].to_numpy())]
    apart = np.diff(times) / np.timedelta64(1, "s")
    return float(apart[apart > SHORT_GAP * np.median(apart)].sum() / apart.sum()) if len(apart) else 1.0


def pinned_heaters(scenario: Scenario) -> tuple[str, ...]:
    """Those whose nodes are held in a scenario that `pinned` made."""
    model = scenario.simulator
    if not isinstance(model, SimulatorModel):
        return ()
    return tuple(name for name, heater in model.switches.items() if (heater.measured_by or "").startswith(PIN))


def pinned_nodes(scenario: Scenario) -> set[str]:
    """Those that are held in a scenario that `pinned` made."""
    model = scenario.simulator
    names = model.nodes if isinstance(model, SimulatorModel) else ()
    return {name.removeprefix(PIN) for name in names if name.startswith(PIN)}


def without_first_samples(
    scenario: Scenario, channels: Sequence[str], seconds: FloatArray, observed: FloatArray
) -> FloatArray:
    """Samples [T, N] of channels at seconds [T] since a window's start, less the first ones of nodes that are held.

    From wherever such a node begins it goes to its telemetry at once, by kelvins in a second. A sample just there makes
    much of how late time tags are.
    """
    held = pinned_nodes(scenario)
    within = _AT_START * (_AT_ONCE + (time_error_of(scenario) or 0.0))
    of_held = [scenario.observations[channel].node in held for channel in channels]
    return np.where(np.outer(seconds < within, of_held), np.nan, observed)


def _temperature(scenario: Scenario, telemetry: xarray.Dataset, channel: str) -> FloatArray:
    """[T] K of the node that a channel reads, by what the scenario says of its errors."""
    observation = scenario.observations[channel]
    return (smoothed(telemetry, channel) - observation.bias - ICE_POINT) / observation.gain + ICE_POINT


def _likely_on(heater: Heater, sensor: FloatArray) -> FloatArray:
    """[T] share of time on of a heater whose sensor is at temperatures [T] K: it switches where this is in between."""
    return np.where(sensor > heater.off_above, 0.0, np.where(sensor < heater.on_below, 1.0, 0.5))


def fast_heaters(windows: Iterable[Window]) -> set[str]:
    """Heaters without a measured status that switch, in closed loop at the priors' medians, more often than is seen."""
    found = set()
    for window in windows:
        names = [window.network.heaters[k] for k in window.unmeasured] if window.is_network else []
        if not names:
            continue
        median = Priors(window.names, tuple(window.reads.values())).median()
        try:
            switches = window.simulate(median).switches
        except SimulationFailure:
            continue
        for k, name in zip(window.unmeasured, names, strict=True):
            switches_of = switches.heater == k
            at, on = switches.time[switches_of], switches.on[switches_of][:-1] > 0.5
            cycles, spells = np.diff(at[switches.on[switches_of] > 0.5]), np.diff(at)
            is_fast = len(cycles) and np.median(cycles) < _FAST * window.interval
            is_brief = any(some.any() and np.median(spells[some]) < _BRIEF * window.interval for some in (on, ~on))
            if is_fast or (len(cycles) and is_brief):
                found.add(name)
    return found
