"""The reduction file, and the full network that it reduces as a scenario."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from ..environment import orbital_period
from ..errors import FlightcalError, ScenarioError
from ..operational import Command, Mission, SpacecraftFile, load_spacecraft
from ..scenario import (
    Issue,
    ModeChange,
    Observation,
    Parameter,
    Scenario,
    blocks_of,
    file_error,
    read_document,
    read_file,
    read_parameters,
    set_twice,
    settable,
)
from ..telemetry import window_bounds
from .schema import FlightWindow, Reduction
from .spacecraft import at_medians, without_flaws
from .thermostats import canonical_heaters


@dataclass(frozen=True)
class Task:
    """What is reduced, and all that is wanted of the result."""

    reduction: Reduction
    mission: Mission
    """As a calibration may know it: without the flaws of what flies, and at the priors' medians."""
    scenario: Scenario
    """The full network, its heaters as thermostats; an observation for each sensor; no telemetry."""
    period: float
    """s, of an orbit."""
    settling: float
    """s"""
    notes: tuple[str, ...]
    """What of the on-board software the thermostats leave out."""

    def bounds(self, window: FlightWindow) -> tuple[np.datetime64, np.datetime64]:
        """Start and end (UTC)."""
        return window_bounds(window, self.period)

    def with_timeline(self, window: FlightWindow) -> Scenario:
        """The scenario with the window's mode changes."""
        software = self.mission.spacecraft.software
        changes = window.timeline
        commands = software.commands if changes is None else changes
        start = self.bounds(window)[0]
        timeline = [
            ModeChange.model_construct(
                at=written_time(start + np.timedelta64(round(item.at * 1e6), "us")), mode=item.mode
            )
            for item in (Command(0.0, software.initial_mode), *commands)
        ]
        model = self.scenario.network.model_copy(update={"timeline": tuple(timeline)})
        return self.scenario.model_copy(update={"simulator": model})


def written_time(time: np.datetime64) -> datetime:
    """As a scenario's blocks hold it."""
    found: datetime = time.astype("datetime64[us]").item()
    return found


def is_reduction(path: str | Path) -> bool:
    """Whether the YAML file at `path` is a reduction and not a scenario."""
    data = read_document(Path(path)).data
    return isinstance(data, dict) and "spacecraft" in data


def load_task(path: str | Path) -> Task:
    """The reduction file at `path` and the spacecraft that it names.

    Raises ScenarioError, whose message lists what is wrong with the file, a line each.
    """
    place = Path(path)
    reduction, document = read_file(place, Reduction)
    flown = load_spacecraft(place.parent / reduction.spacecraft)
    _refuse_slopes(place.parent / reduction.spacecraft)
    mission = replace(flown, spacecraft=without_flaws(flown.spacecraft), seed=reduction.training.seed)
    try:
        if mission.spacecraft.scenario.environment.attitude_offset is not None:
            raise FlightcalError(
                f"{reduction.spacecraft}: environment.attitude_offset: found one, expected none: a reduced model knows "
                "its faces' directions only"
            )
        scenario, notes = _full_network(mission, reduction)
        period = orbital_period(scenario.environment, scenario.folder)
    except FlightcalError as error:
        raise ScenarioError(f"{path}: {error}") from None
    parameters, problems = _parameters(reduction.parameters, scenario)
    problems += _unknown_modes(reduction, mission) or _disabling_modes(reduction, mission)
    settling = period if reduction.settling is None else reduction.settling
    problems += _too_short(reduction, period, settling)
    if problems:
        raise file_error(place, document, problems)
    try:
        mission = replace(mission, spacecraft=at_medians(mission.spacecraft, parameters))
        scenario, _ = _full_network(mission, reduction)
    except FlightcalError as error:
        raise ScenarioError(f"{path}: {error}") from None
    if flown.spacecraft != without_flaws(flown.spacecraft):
        notes.append("biases of thermistors, and failures: those of what flies are not known before the calibration")
    scenario = scenario.model_copy(update={"parameters": parameters})
    return Task(reduction, mission, scenario, period, settling, tuple(notes))


def spacecraft_of(path: Path) -> Path:
    """The spacecraft file that the reduction file at `path` names. Raises ScenarioError as `load_task`."""
    return path.parent / read_file(path, Reduction)[0].spacecraft


def _refuse_slopes(spacecraft: Path) -> None:
    """Raises ScenarioError where a conductance of a spacecraft file depends on temperature."""
    content, document = read_file(spacecraft, SpacecraftFile)
    expected = "expected none: a reduced model's conductances do not depend on temperature"
    problems = [
        Issue(("conductors", k, "conductance_slope"), f"found {conductor.conductance_slope:g} 1/K, {expected}")
        for k, conductor in enumerate(content.conductors)
        if conductor.conductance_slope is not None
    ]
    if problems:
        raise file_error(spacecraft, document, problems)


def _full_network(mission: Mission, reduction: Reduction) -> tuple[Scenario, list[str]]:
    craft = mission.spacecraft
    heaters, notes = canonical_heaters(craft, reduction.pulse_width_band)
    nodes = craft.scenario.network.nodes
    for name, heater in heaters.items():
        if nodes[heater.sensor].capacity is None:
            raise FlightcalError(f"heater line '{name}': found sensor node '{heater.sensor}', expected a capacity")
    thermistors = craft.thermistors
    observations = {}
    for name in reduction.sensors or craft.downlink.thermistors:
        if name not in thermistors:
            raise FlightcalError(f"sensors: found '{name}', expected one of {', '.join(thermistors)}")
        item = thermistors[name]
        if item.node in nodes and nodes[item.node].boundary is not None:
            raise FlightcalError(f"sensors: found '{name}' on the boundary '{item.node}', expected a node")
        observations[name] = Observation.model_construct(node=item.node, heater=None, bias=0.0, noise=None)
    model = craft.scenario.network.model_copy(update={"heaters": heaters})
    return craft.scenario.model_copy(update={"simulator": model, "observations": observations}), notes


def _parameters(blocks: dict[str, Any], scenario: Scenario) -> tuple[dict[str, Parameter], list[Issue]]:
    """The parameters of the full network; what is wrong with them."""
    read, problems = read_parameters(blocks, settable(scenario), blocks_of(scenario))
    parameters = {name: parameter for name, parameter in read.items() if parameter is not None}
    return parameters, [*problems, *set_twice(parameters)]


def _windows(reduction: Reduction) -> dict[tuple[str, ...], FlightWindow]:
    return {
        (kind, "windows", name): window
        for kind in ("training", "held_out")
        for name, window in getattr(reduction, kind).windows.items()
    }


def _unknown_modes(reduction: Reduction, mission: Mission) -> list[Issue]:
    modes = set(mission.spacecraft.software.enabled)
    return [
        Issue((*place, "timeline", k, "mode"), f"found '{item.mode}', expected one of {', '.join(sorted(modes))}")
        for place, window in _windows(reduction).items()
        for k, item in enumerate(window.timeline or ())
        if item.mode not in modes
    ]


def _disabling_modes(reduction: Reduction, mission: Mission) -> list[Issue]:
    """Modes of the windows and of the flight in which the enable table switches a heater off: none may."""
    software = mission.spacecraft.software
    disabling = {software.initial_mode, *(command.mode for command in software.timeline)}
    used = {("spacecraft",): disabling} | {
        (*place, "timeline"): {item.mode for item in window.timeline or ()}
        for place, window in _windows(reduction).items()
    }
    return [
        Issue(
            place,
            f"found the mode '{mode}', in which the enable table switches heater line '{line}' off, expected "
            "modes that leave every line on: a reduced model's thermostats act in every mode",
        )
        for place, modes in used.items()
        for mode in sorted(modes)
        for line in software.heaters
        if line not in software.enabled[mode]
    ]


def _too_short(reduction: Reduction, period: float, settling: float) -> list[Issue]:
    problems = []
    for place, window in _windows(reduction).items():
        start, end = window_bounds(window, period)
        length = float((end - start) / np.timedelta64(1, "s"))
        if length < 1.5 * settling:
            problems.append(
                Issue(place, f"found {length:.0f} s, expected half as much again as the {settling:.0f} s of settling")
            )
    return problems
