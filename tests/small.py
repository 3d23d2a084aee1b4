"""A small satellite for the tests: a heated body behind a sunlit panel, and telemetry that its own model makes."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from ruamel.yaml import YAML

from flightcal.check import Suspects
from flightcal.environment import orbital_period
from flightcal.probability import Priors
from flightcal.scenario import Scenario, load_scenario
from flightcal.simulator import NetworkSimulator, network_simulator
from flightcal.telemetry import read_telemetry

START = np.datetime64("2024-03-01T00:00:00", "ns")
PERIOD = 5400.0  # s
TRUTH = {"link": 0.65, "panel_size": 1.1, "power": 28.0, "initial_panel": 262.0}
"""What the telemetry of `telemetry_of` is made with, of the parameters in `content`."""


def content() -> dict[str, Any]:
    """The scenario as its YAML file has it; tests change what they are about."""
    return {
        "name": "small",
        "telemetry": {
            "file": "telemetry.csv",
            "time": {"column": "time"},
            "channels": {
                "body_temp": {"column": "body", "unit": "degC", "kind": "temperature"},
                "panel_temp": {"column": "panel", "unit": "degC", "kind": "temperature"},
                "heater_status": {"column": "heater", "kind": "status"},
                "sun": {"column": "sun", "unit": "A", "kind": "driver"},
            },
        },
        "environment": {"period": "90 min"},
        "simulator": {
            "step": "30 s",
            "nodes": {
                "body": {"capacity": "3000 J/K", "initial": "12 degC"},
                "panel": {"capacity": "800 J/K", "initial": "-10 degC"},
                "space": {"boundary": "4 K"},
            },
            "conductors": [
                {"between": ["body", "panel"], "conductance": "0.6 W/K"},
                {"between": ["panel", "space"], "radiative": "0.05 m^2"},
            ],
            "heaters": {
                "heater": {
                    "node": "body",
                    "power": "30 W",
                    "sensor": "body",
                    "on_below": "10 degC",
                    "off_above": "13 degC",
                    "measured_by": "heater_status",
                }
            },
            "loads": {"sun": {"node": "panel", "driver": "sun", "coefficient": "12 W/A"}},
        },
        "parameters": {
            "link": {
                "sets": "conductors.body-panel.conductance",
                "prior": {"lognormal": {"median": "0.6 W/K", "factor": 1.3}},
            },
            "panel_size": {
                "scales": ["conductors.panel-space.radiative", "loads.sun.coefficient"],
                "prior": {"uniform": [0.7, 1.4]},
            },
            "power": {
                "sets": "heaters.heater.power",
                "prior": {
                    "truncated_normal": {"mean": "30 W", "standard_deviation": "3 W", "lower": "15 W", "upper": "45 W"}
                },
            },
        },
        "observations": {
            "body_temp": {"node": "body"},
            "panel_temp": {"node": "panel", "noise": "0.1 K"},
            "heater_status": {"heater": "heater"},
        },
        "heat": "none",
        "windows": {
            "train": {"start": "2024-03-01T00:00:00", "end": "2024-03-01T03:00:00"},
            "test": {"start": "2024-03-01T03:30:00", "end": "2024-03-01T06:30:00"},
        },
        "calibration": {
            "seed": 3,
            "genetic": {"runs": 2, "population": 16, "generations": 8},
            "nuts": {"chains": 2, "draws": 100, "warmup": 100},
            "prediction": {"simulations": 40, "initial_span": "10 min"},
        },
    }


def chattering() -> dict[str, Any]:
    """The same with thresholds so near to each other that its thermostat switches all the time."""
    written = content()
    written["simulator"]["heaters"]["heater"]["off_above"] = "10.00001 degC"
    return written


def load(
    folder: Path,
    written: Mapping[str, Any] | None = None,
    *,
    hours: float = 7.0,
    columns: Mapping[str, Any] | None = None,
) -> tuple[Scenario, xr.Dataset]:
    """The scenario in `folder`, and telemetry of one sample a minute whose temperatures are placeholders.

    columns: more of these.
    """
    minutes = np.arange(int(hours * 60) + 1)
    table = pd.DataFrame(
        {
            "time": np.datetime_as_string(START + minutes * np.timedelta64(60, "s"), unit="s"),
            "body": 12.0 + 0.001 * minutes,
            "panel": -10.0 + 0.001 * minutes,
            "heater": 0,
            "sun": sunlight(60.0 * minutes),
        }
        | dict(columns or {})
    )
    table.to_csv(folder / "telemetry.csv", index=False)
    with (folder / "scenario.yaml").open("w", encoding="utf-8") as file:
        yaml = YAML(typ="safe")
        yaml.sort_base_mapping_type_on_output = False
        yaml.dump(dict(written or content()), file)
    scenario = load_scenario(folder / "scenario.yaml")
    return scenario, read_telemetry(scenario.telemetry, scenario.folder, period=period_of(scenario))


def sunlight(seconds: Any) -> Any:
    """Current of a sun sensor, A: half a sine in sunlight, nothing in eclipse."""
    return np.maximum(np.sin(2 * np.pi * np.asarray(seconds) / PERIOD), 0.0)


def period_of(scenario: Scenario) -> float:
    return orbital_period(scenario.environment, scenario.folder)


def simulator_of(scenario: Scenario, data: xr.Dataset, *, hours: float | None = None) -> NetworkSimulator:
    """The simulator over the telemetry's first `hours`, observed at its times."""
    times = data["time"].values
    if hours is not None:
        times = times[times <= times[0] + np.timedelta64(int(hours * 3600), "s")]
    return network_simulator(scenario, data, times[0], times[-1], times, period=period_of(scenario))


def theta_of(simulator: NetworkSimulator, **values: float) -> Any:
    """theta [d] with parameters by name (the others: as the scenario writes them) and initial temperatures of 285 K.

    ``initial_body=280`` is the initial temperature of the node 'body'.
    """
    theta = np.full(len(simulator.parameters), 285.0)
    for k, name in enumerate(simulator.names):
        sets = np.flatnonzero(simulator.mapping.set_by == k)
        theta[k] = simulator.network.values[simulator.mapping.set_positions[sets[0]]] if len(sets) else 1.0
        theta[k] = values.get(name, theta[k])
    for name, value in values.items():
        if name.startswith("initial_"):
            theta[simulator.parameters.index(name.replace("_", ".", 1))] = value
    return theta


def telemetry_of(scenario: Scenario, data: xr.Dataset, *, noise: float = 0.1, seed: int = 0, **values: float) -> Any:
    """The telemetry that the scenario's own model gives at `values` (default: `TRUTH`), with noise in K."""
    simulator = simulator_of(scenario, data)
    run = simulator.simulate(theta_of(simulator, **(TRUTH | values)))
    rng = np.random.default_rng(seed)
    made = data.copy(deep=True)
    for k, channel in enumerate(simulator.channels):
        made[channel].values[:] = run.temperatures[:, k] + noise * rng.standard_normal(len(run.temperatures))
    for k, heater in enumerate(simulator.heaters):
        made[scenario.simulator.heaters[heater].measured_by].values[:] = run.status[:, k]
    return made


def closed_loop(
    folder: Path,
    written: Mapping[str, Any] | None = None,
    *,
    columns: Mapping[str, Any] | None = None,
    **options: Any,
) -> tuple[Scenario, xr.Dataset]:
    """Scenario and telemetry made by its own model at `TRUTH`, thermostats acting; columns: see `load`."""
    scenario, data = load(folder, written, columns=columns)
    return scenario, telemetry_of(scenario, data, **options)


def median(window: Any) -> Any:
    """A theta of a window: the medians of the priors that it would give itself."""
    return Priors(window.names, tuple(window.reads.values())).median()


def unsuspected(patch: Any) -> None:
    """Let runs suspect nothing before they sample, where a test is of something else: it takes a second or more."""
    patch.setattr(import_module("flightcal.check.suspects"), "suspects", lambda *_, **__: Suspects())
