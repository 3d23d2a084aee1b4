"""From a scenario and its telemetry to the calibration problem."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import xarray

from ..environment import orbital_period, seconds_later
from ..errors import ScenarioError, TelemetryError
from ..probability import Priors, heater_status, measured_switches, residual_model
from ..reduction import initial_given
from ..reduction import load as load_reduced
from ..scenario import (
    ICE_POINT,
    ExternalModel,
    Normal,
    Prior,
    Scenario,
    SimulatorModel,
    heat_of,
    is_trained,
    load_driver,
    time_error_of,
    uncertain_thermostats,
)
from ..simulator import TIME_ERROR, FloatArray, NetworkSimulator, open_loop
from ..telemetry import (
    SHORT_GAP,
    driver_gaps,
    driver_jumps,
    driver_series,
    select_window,
    usual_interval,
    window_bounds,
)
from .entries import entries_of
from .pinned import fast_heaters, pinned, pinned_heaters, unseen_heaters, without_first_samples
from .problem import Problem
from .simulators import build_simulator
from .window import Bridged, Change, Course, Switching, Window

_USUAL, _ODD = 0.95, 3.0
"""Share of the changes from sample to sample that are usual; a first sample so many times farther off the next is odd.
"""
_BACK = 0.5
"""Share of a change, by which the next one goes back after a spike, and that a later one has where it is usual too."""
_LATER = 20.0
"""K, deviation of where a node without a channel is at a window's first sample, where that is long after its start."""
_DRAWN, _SEED_OF_STEPS = 512, 0
"""Draws of the prior, some of which choose the length of the integration's steps."""


def build_problem(scenario: Scenario, telemetry: xarray.Dataset, *windows: str) -> Problem:
    """The calibration problem of a scenario on some of its windows, by default on all that it trains on.

    Raises ScenarioError and TelemetryError.
    """
    names = windows or scenario.train_windows
    if not names:
        raise ScenarioError("windows: found none to train on, expected 'train'")
    built = [build_window(scenario, telemetry, name) for name in names]
    return problem_of(scenario, built, open_windows(built, telemetry))


def problem_of(scenario: Scenario, windows: Sequence[Window], opened: Sequence[Window] = ()) -> Problem:
    """The problem of windows of one scenario; opened: the same in open loop."""
    entries = entries_of(scenario, windows)
    in_open_loop = Problem(opened[0].scenario, entries, tuple(opened)) if opened else None
    return Problem(scenario, entries, tuple(windows), in_open_loop)


def open_windows(windows: Sequence[Window], telemetry: xarray.Dataset) -> tuple[Window, ...]:
    """The same windows with every heater driven by its measured status; empty where that cannot be.

    Nodes of those that switch more often than that shows are held by their own telemetry: see `pinned`.
    """
    if not windows or not all(_can_be_opened(window.scenario, telemetry) for window in windows):
        return ()
    fast = fast_heaters(windows)
    scenario = windows[0].scenario
    unseen = unseen_heaters(scenario, telemetry, [window.span for window in windows], fast)
    made = [(pinned(open_loop(window.scenario), telemetry, unseen, fast), window.name) for window in windows]
    return tuple(build_window(*driven, name) for driven, name in made)


def build_window(scenario: Scenario, telemetry: xarray.Dataset, name: str, *, span: float | None = None) -> Window:
    """One window of a scenario; span: only its first so many seconds.

    One whose start lies in a gap, which tells nothing of the state there, begins at its first sample.

    Raises ScenarioError and TelemetryError.
    """
    if name not in scenario.windows:
        raise ScenarioError(f"window '{name}' is not in the scenario, which has {', '.join(scenario.windows)}")
    period = orbital_period(scenario.environment, scenario.folder)
    chosen = select_window(telemetry, scenario.windows[name], period, name)
    channels = tuple(channel for channel, item in scenario.observations.items() if item.heater is None)
    written, end = window_bounds(scenario.windows[name], period)
    begun = _first_known(scenario, chosen, channels, written)
    start = written if _goes_on(scenario, written, period) else begun
    if span is not None:
        end = min(end, begun + np.timedelta64(round(span * 1e9), "ns"))
    chosen = chosen.sel(time=slice(start, end))
    times = chosen["time"].values
    observed = np.stack([chosen[channel].values for channel in channels], axis=1)
    if is_trained(name) and not np.isfinite(observed).any():
        raise TelemetryError(f"windows.{name}: found no valid temperature, expected some to train on")
    told = scenario
    if start > written:
        # What the scenario says of nodes without a channel is of the start that it writes.
        state = scenario.initial_state
        later = state.model_copy(update={"unobserved": max(state.unobserved, _LATER)})
        told = scenario.model_copy(update={"initial_state": later})
    since = (times - start) / np.timedelta64(1, "ns") * 1e-9
    initial = initial_priors(told, channels, since, observed)
    observed = without_first_samples(scenario, channels, since, observed)
    reads: dict[str, Prior] = {parameter: item.prior for parameter, item in scenario.parameters.items()}
    known = reads | initial

    def tried(names: tuple[str, ...]) -> FloatArray:
        # At which times temperatures are read is nothing to the steps.
        drawn = tuple(name for name in names if name != TIME_ERROR)
        priors = Priors(drawn, tuple(known[name] for name in drawn))
        thetas = np.zeros((_DRAWN, len(names)))
        thetas[:, [name in drawn for name in names]] = priors.sample(np.random.default_rng(_SEED_OF_STEPS), _DRAWN)
        return thetas

    error = time_error_of(scenario)
    if error is not None:
        reads[TIME_ERROR] = Normal(mean=0.0, standard_deviation=error)
    simulator = build_simulator(scenario, telemetry, start, end, times, period=period, tried=tried)
    if (
        isinstance(simulator, NetworkSimulator)
        and channels
        and simulator.accuracy
        and np.isnan(simulator.accuracy.error)
    ):
        raise ScenarioError(
            f"windows.{name}: found no simulation that stays finite at draws of the priors, expected some: numbers or "
            f"priors are off by far{_largest_heat(simulator)}"
        )
    residuals, of_residuals = residual_model(scenario, simulator.channels, times, observed)
    reads |= of_residuals
    status = heater_status(scenario, chosen, start)
    reads |= {} if status is None else status.priors
    reads |= initial
    # Nobody knows when these switch.
    unseen = [scenario.network.switches[name].measured_by for name in pinned_heaters(scenario)]
    shown = chosen.assign({channel: np.nan * chosen[channel] for channel in unseen})
    switching = None
    if isinstance(scenario.simulator, SimulatorModel) and scenario.simulator.heater_input == "measured":
        switching = _switching(scenario, shown, start)
    return Window(
        scenario=scenario,
        name=name,
        start=start,
        times=times,
        observed=observed,
        status=measured_status(scenario, chosen),
        simulator=simulator,
        residuals=residuals,
        reads=reads,
        heater_status=status,
        measured_switches=measured_switches(scenario, shown, start),
        switching=switching,
        changes=_changes(scenario, start, end),
        bridged=_bridged(scenario, telemetry, start, end),
        course=_course(scenario, telemetry, start, end),
    )


def _first_known(
    scenario: Scenario, chosen: xarray.Dataset, channels: Sequence[str], start: np.datetime64
) -> np.datetime64:
    """The start, or the first valid sample of channels where that comes too late to tell of the state at the start."""
    valid = np.any([np.isfinite(chosen[channel].values) for channel in channels], axis=0)
    times = chosen["time"].values[valid] if channels else np.empty(0, "datetime64[ns]")
    latest = start + np.timedelta64(round(scenario.calibration.prediction.initial_span * 1e9), "ns")
    return np.datetime64(times[0]) if len(times) and times[0] >= latest else start


def _goes_on(scenario: Scenario, start: np.datetime64, period: float) -> bool:
    """Whether a window that begins so begins where a training window ends, whose state is known."""
    return any(
        window_bounds(scenario.windows[train_window], period)[1] == start for train_window in scenario.train_windows
    )


def _largest_heat(simulator: NetworkSimulator) -> str:
    """The load, heater or mode that heats most, as the scenario writes it, in words; nothing: there is none."""
    inputs, columns, heats = simulator.drive.inputs, simulator.network.columns, {}
    for path, value in zip(simulator.network.paths, simulator.mapping.written.tolist(), strict=True):
        block, name, *_ = path.split(".")
        if block == "loads":
            heats[path] = abs(value) * float(np.abs(inputs[:, :, columns.index(f"driver.{name}")]).max())
        elif block == "modes" or (block == "heaters" and path.endswith(".power")):
            heats[path] = abs(value)
    most = max(heats, key=lambda path: heats[path], default="")
    return f"; the largest heat is up to {heats[most]:.3g} W, from '{most}'" if most else ""


def _course(scenario: Scenario, telemetry: xarray.Dataset, start: np.datetime64, end: np.datetime64) -> Course | None:
    """The driver that the pattern of unmodelled heat is written over, between two times."""
    heat = heat_of(scenario)
    if heat is None or heat.pattern is None or heat.pattern.over is None:
        return None
    channel = heat.pattern.over
    interval = usual_interval(telemetry["time"].values[np.isfinite(telemetry[channel].values)])
    length = (end - start) / np.timedelta64(1, "ns") * 1e-9
    seconds = np.append(np.arange(0.0, length, interval), length)
    known = telemetry[channel].values
    values = driver_series(telemetry, channel, seconds_later(start, seconds))
    return Course(seconds, values, (float(np.nanmin(known)), float(np.nanmax(known))))


def _changes(scenario: Scenario, start: np.datetime64, end: np.datetime64) -> tuple[Change, ...]:
    """Of a network's mode between two times."""
    if not isinstance(scenario.simulator, SimulatorModel):
        return ()
    found = []
    for before, after in pairwise(scenario.simulator.timeline):
        at = np.datetime64(after.at)
        if before.mode != after.mode and start < at < end:
            seconds = float((at - start) / np.timedelta64(1, "ns") * 1e-9)
            found.append(Change(seconds, before.mode, after.mode, after.within or 0.0))
    return tuple(found)


def _bridged(
    scenario: Scenario, telemetry: xarray.Dataset, start: np.datetime64, end: np.datetime64
) -> tuple[Bridged, ...]:
    """Loads of a network whose drivers have gaps between two times, or jump from one sample to the next."""
    if not isinstance(scenario.simulator, SimulatorModel):
        return ()
    found = []
    for name, load in scenario.simulator.loads.items():
        channel = scenario.telemetry.channels[load.driver]
        driver = load.driver, channel.bridge, load_driver(load, channel)
        gaps, deviation = driver_gaps(telemetry, *driver)
        jumps, sizes = driver_jumps(telemetry, *driver)
        # A jump is as likely at each time between its samples.
        deviations = np.concatenate([np.full(len(gaps), deviation), sizes / np.sqrt(12.0)])
        spans = (np.clip(np.concatenate([gaps, jumps]), start, end) - start) / np.timedelta64(1, "ns") * 1e-9
        for (begin, until), spread in zip(spans.tolist(), deviations.tolist(), strict=True):
            if until > begin and spread > 0.0:
                found.append(Bridged(name, begin, until, spread))
    return tuple(found)


def _switching(scenario: Scenario, telemetry: xarray.Dataset, start: np.datetime64) -> Switching:
    """When the heaters that are driven by their measured status switched in a window."""
    found: list[tuple[float, float]] = []
    heaters: list[str] = []
    for name, heater in scenario.network.switches.items():
        if heater.measured_by is None:
            continue
        values = telemetry[heater.measured_by].values
        valid = np.isfinite(values)
        seconds = (telemetry["time"].values[valid] - start) / np.timedelta64(1, "ns") * 1e-9
        gaps = np.diff(seconds)
        usual = float(np.median(gaps)) if len(gaps) else 0.0
        # What it does in a longer gap is simulated: see `held_by`.
        for k in np.flatnonzero(np.diff(values[valid] > 0.5) & (gaps <= SHORT_GAP * usual)):
            interval = min(float(gaps[k]), usual)
            found.append((float(seconds[k + 1]) - 0.5 * interval, interval))
            heaters.append(name)
    times, intervals = np.array(found).reshape(-1, 2).T
    return Switching(times, intervals, tuple(heaters))


def _can_be_opened(scenario: Scenario, telemetry: xarray.Dataset) -> bool:
    """Whether the heaters act in closed loop, and all of them could be driven by their measured status instead.

    With unmodelled heat what one does without a status is found from the temperatures, but not where its thresholds
    are to be found too: thermostats tell of these by acting.
    """
    if isinstance(scenario.simulator, ExternalModel):
        return False
    heaters = scenario.simulator.switches
    if not heaters or scenario.simulator.heater_input != "simulated":
        return False
    measured = [heater.measured_by for heater in heaters.values() if heater.measured_by is not None]
    if any(np.isfinite(telemetry[channel].values).sum() < 2 for channel in measured):
        return False
    unmeasured = {name for name, heater in heaters.items() if heater.measured_by is None}
    if heat_of(scenario) is None:
        return not unmeasured
    return not unmeasured & uncertain_thermostats(scenario)


def initial_priors(
    scenario: Scenario, channels: tuple[str, ...], seconds: FloatArray, observed: FloatArray
) -> dict[str, Prior]:
    """Normal priors of the initial temperatures (K): around the first samples, or around what the scenario writes.

    seconds: [T] of the samples [T, N] since the window's start. A reduced model's file says what the others are like
    where some are observed.
    """
    first: dict[str, float] = {}
    for k, channel in enumerate(channels):
        valid = np.isfinite(observed[:, k])
        observation = scenario.observations[channel]
        place = observation.node or observation.output or ""
        if valid.any() and place not in first:
            reading = _at_start(seconds[valid], observed[valid, k]) - observation.bias
            first[place] = (reading - ICE_POINT) / observation.gain + ICE_POINT
    typical = float(np.mean(list(first.values()))) if first else 293.15
    state, reduced = scenario.initial_state, _typical_of_reduced(scenario, first)
    priors: dict[str, Prior] = {}
    for name, written in initial_temperatures(scenario).items():
        if name in first:
            priors[f"initial.{name}"] = Normal(mean=first[name], standard_deviation=state.observed)
        elif name in reduced:
            mean, deviation = reduced[name]
            priors[f"initial.{name}"] = Normal(mean=mean, standard_deviation=max(deviation, state.unobserved))
        else:
            centre = written if written is not None else typical
            priors[f"initial.{name}"] = Normal(mean=centre, standard_deviation=state.unobserved)
    return priors


def _at_start(seconds: FloatArray, readings: FloatArray) -> float:
    """What readings [T] at seconds [T] would be at zero: the first one, gone back for no longer than to the next.

    One that is far off the next, as a spike is, is passed over.
    """
    if len(readings) == 1:
        return float(readings[0])
    moves = np.diff(readings)
    changes = np.abs(moves)
    # A panel that leaves a shadow moves as fast as a spike, and does not come back at once.
    back = moves[1:] * moves[:-1] < -_BACK * np.maximum(changes[1:], changes[:-1]) ** 2
    lasting = changes * ~(np.append(back, False) | np.append(False, back))
    later = np.append(np.maximum.accumulate(lasting[::-1])[::-1][1:], 0.0)
    usual = np.maximum(_ODD * np.quantile(changes, _USUAL), later / _BACK)
    k = int(np.flatnonzero(changes <= usual)[0])
    interval = seconds[k + 1] - seconds[k]
    return float(readings[k] - (readings[k + 1] - readings[k]) * min(seconds[k] / interval, 1.0))


def _typical_of_reduced(scenario: Scenario, first: dict[str, float]) -> dict[str, tuple[float, float]]:
    """Mean and deviation (K) of a reduced model's states, those at their first samples aside.

    A state whose initial temperature the scenario writes anew is not among them.
    """
    model = scenario.simulator
    if not isinstance(model, SimulatorModel) or model.reduced_model is None:
        return {}
    stored = load_reduced(scenario.folder / model.reduced_model)
    found = initial_given(stored.model, first, scenario.initial_state.observed)
    kept = stored.simulator.nodes
    return {name: bounds for name, bounds in found.items() if model.nodes[name].initial == kept[name].initial}


def initial_temperatures(scenario: Scenario) -> dict[str, float | None]:
    """What has an initial temperature that is estimated, and the one that the scenario writes, K; None: none."""
    model = scenario.simulator
    if isinstance(model, ExternalModel):
        return {item.initial_of: item.si[1] for item in model.inputs.values() if item.initial_of is not None}
    return {name: node.initial for name, node in model.nodes.items() if node.capacity is not None}


def measured_status(scenario: Scenario, telemetry: xarray.Dataset) -> FloatArray:
    """Measured status [T, H] of the heaters, NaN where a heater has no status channel or no valid sample."""
    heaters = tuple(scenario.simulator.switches)
    status = np.full((telemetry.sizes["time"], len(heaters)), np.nan)
    for k, name in enumerate(heaters):
        for channel in status_channels(scenario, name)[:1]:
            status[:, k] = telemetry[channel].values
    return status


def status_channels(scenario: Scenario, heater: str) -> list[str]:
    """Channels that have a heater's measured status: those that observe it first, then the one that may drive it."""
    driving = getattr(scenario.simulator.heaters[heater], "measured_by", None)
    return [*(c for c, item in scenario.observations.items() if item.heater == heater), *filter(None, [driving])]
