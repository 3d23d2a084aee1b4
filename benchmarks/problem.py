"""The problem that all solve: two orbits of an eight-node satellite with one thermostat, telemetry of its own model.

`benchmark_problem` is flightcal's; `benchmarks.canonical` gives the same equations to the peers.
"""

from __future__ import annotations

import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray
from ruamel.yaml import YAML

from flightcal.environment import orbital_period
from flightcal.problem import Problem, build_problem
from flightcal.scenario import Scenario, load_scenario
from flightcal.simulator import Drive, NetworkSimulator, network_simulator
from flightcal.simulator.drive import window_inputs
from flightcal.telemetry import read_telemetry

START = np.datetime64("2024-03-01T00:00:00", "ns")
NOISE = 0.1  # K
SAMPLING = 60  # s
TRUTH = {
    "radiator_absorptivity": 0.22,
    "radiator_emissivity": 0.78,
    "array_absorptivity": 0.72,
    "battery_link": 1.1,
    "tank_link": 0.35,
    "payload_link": 2.2,
    "radiator_link": 4.5,
    "structure_capacity": 1.1,
    "heater_power": 23.0,
    "payload_power": 22.0,
}

_CAPACITIES = {  # J/K
    "structure": 8000,
    "battery": 2500,
    "tank": 3500,
    "payload": 2500,
    "electronics": 1800,
    "radiator": 2000,
    "panel": 900,
    "array": 4000,
}
_INITIAL = dict(zip(_CAPACITIES, (9.0, 15.0, 10.0, 14.0, 10.0, 4.0, -5.0, -20.0), strict=True))  # degC
_LINKS = {  # W/K
    ("structure", "battery"): 1.0,
    ("structure", "tank"): 0.4,
    ("structure", "payload"): 2.0,
    ("structure", "radiator"): 4.0,
    ("electronics", "radiator"): 3.0,
    ("structure", "panel"): 0.8,
    ("structure", "array"): 0.1,
    ("structure", "electronics"): 1.0,
}


def content() -> dict[str, Any]:
    """The scenario as its YAML file has it."""
    return {
        "name": "benchmark",
        "telemetry": {
            "file": "telemetry.csv",
            "time": {"column": "time"},
            "channels": {
                **{f"{node}_temp": {"column": node, "unit": "degC", "kind": "temperature"} for node in _CAPACITIES},
                "heater_status": {"column": "heater", "kind": "status"},
            },
        },
        "environment": {
            "orbit": {"altitude": "693 km", "inclination": "98.18 deg", "ltan": "22:30", "epoch": str(START)[:19]},
            "attitude": "nadir",
        },
        "simulator": {
            "nodes": {
                node: {"capacity": f"{capacity} J/K", "initial": f"{_INITIAL[node]} degC"}
                for node, capacity in _CAPACITIES.items()
            },
            "conductors": [{"between": list(pair), "conductance": f"{value} W/K"} for pair, value in _LINKS.items()],
            "faces": {
                "radiator": _face("radiator", 0.30, [0, -1, 0], 0.2, 0.8),
                "array_front": _face("array", 1.0, [0, 0, -1], 0.7, 0.8),
                "array_back": _face("array", 1.0, [0, 0, 1], 0.5, 0.75),
                "panel": _face("panel", 0.2, [1, 0, 0], 0.4, 0.6),
            },
            "heaters": {
                "heater": {
                    "node": "battery",
                    "power": "24 W",
                    "sensor": "battery",
                    "on_below": "14 degC",
                    "off_above": "16 degC",
                    "measured_by": "heater_status",
                }
            },
            "modes": {
                "nominal": {"structure": "25 W", "payload": "20 W", "electronics": "10 W", "battery": "1 W"},
            },
        },
        "parameters": {
            "radiator_absorptivity": _sets("faces.radiator.absorptivity", uniform=[0.05, 0.4]),
            "radiator_emissivity": _sets("faces.radiator.emissivity", uniform=[0.6, 0.95]),
            "array_absorptivity": _sets("faces.array_front.absorptivity", uniform=[0.5, 0.9]),
            "battery_link": _conductance("structure-battery", 1.0),
            "tank_link": _conductance("structure-tank", 0.4),
            "payload_link": _conductance("structure-payload", 2.0),
            "radiator_link": _conductance("structure-radiator", 4.0),
            "structure_capacity": {
                "scales": ["nodes.structure.capacity"],
                "prior": {"lognormal": {"median": 1, "factor": 1.3}},
            },
            "heater_power": _sets("heaters.heater.power", normal={"mean": "24 W", "standard_deviation": "3 W"}),
            "payload_power": _sets("modes.nominal.payload", uniform=["10 W", "40 W"]),
        },
        "observations": {
            **{f"{node}_temp": {"node": node, "noise": f"{NOISE} K"} for node in _CAPACITIES},
            "heater_status": {"heater": "heater"},
        },
        "heat": "none",
        "windows": {
            "train": {"start": str(START)[:19], "orbits": 2},
            "test": {"start": str(START + np.timedelta64(12000, "s"))[:19], "orbits": 2},
        },
        "calibration": {"seed": 1},
    }


def _face(node: str, area: float, normal: list[int], absorptivity: float, emissivity: float) -> dict[str, Any]:
    return {
        "node": node,
        "area": f"{area} m^2",
        "normal": normal,
        "absorptivity": absorptivity,
        "emissivity": emissivity,
    }


def _sets(path: str, **prior: Any) -> dict[str, Any]:
    if "normal" in prior:
        prior = {"truncated_normal": {**prior["normal"], "lower": "10 W", "upper": "40 W"}}
    return {"sets": path, "prior": prior}


def _conductance(label: str, median: float) -> dict[str, Any]:
    return _sets(f"conductors.{label}.conductance", lognormal={"median": f"{median} W/K", "factor": 1.5})


@cache
def benchmark_problem() -> tuple[Problem, Any]:
    """The calibration problem, and the theta [d] that its telemetry was made with."""
    with tempfile.TemporaryDirectory() as folder:
        return make_problem(content(), TRUTH, Path(folder))


def make_problem(written: dict[str, Any], truth: dict[str, float], folder: Path) -> tuple[Problem, Any]:
    """The problem of a scenario, with telemetry that its own model makes at `truth` (else: as written) with noise."""
    scenario, data = _placeholder(written, folder)
    period = orbital_period(scenario.environment, folder)
    times = data["time"].values
    simulator = network_simulator(scenario, data, times[0], times[-1], times, period=period)
    theta = _theta(simulator, scenario, truth)
    run = simulator.simulate(theta)
    rng = np.random.default_rng(1)
    for k, channel in enumerate(simulator.channels):
        data[channel].values[:] = run.temperatures[:, k] + NOISE * rng.standard_normal(len(times))
    for k, heater in enumerate(simulator.heaters):
        channel = scenario.simulator.heaters[heater].measured_by
        if channel is not None:
            data[channel].values[:] = run.status[:, k]
    problem = build_problem(scenario, data)
    ordered = problem.priors.median()
    ordered[[problem.names.index(name) for name in simulator.parameters]] = theta
    return problem, ordered


def _placeholder(written: dict[str, Any], folder: Path) -> tuple[Scenario, Any]:
    """The scenario, and telemetry on its times that holds nothing yet."""
    window = written["windows"]["train"]
    seconds = np.arange(0, int(window["orbits"] * 5950) + SAMPLING, SAMPLING)
    channels = written["telemetry"]["channels"].values()
    table = {channel["column"]: 0 * seconds for channel in channels}
    times = np.datetime_as_string(START + seconds * np.timedelta64(1, "s"), unit="s")
    pd.DataFrame({"time": times, **table}).to_csv(folder / "telemetry.csv", index=False)
    with (folder / "scenario.yaml").open("w", encoding="utf-8") as file:
        yaml = YAML(typ="safe")
        yaml.sort_base_mapping_type_on_output = False
        yaml.dump(written, file)
    scenario = load_scenario(folder / "scenario.yaml")
    period = orbital_period(scenario.environment, folder)
    return scenario, read_telemetry(scenario.telemetry, folder, period=period)


def _theta(simulator: NetworkSimulator, scenario: Scenario, truth: dict[str, float]) -> Any:
    written = simulator.network.values
    sets = dict(zip(simulator.mapping.set_by, simulator.mapping.set_positions, strict=True))
    parameters = [truth.get(name, written[sets[k]] if k in sets else 1.0) for k, name in enumerate(simulator.names)]
    nodes = [simulator.network.nodes[k] for k in simulator.network.diffusive]
    return np.array([*parameters, *(scenario.simulator.nodes[node].initial for node in nodes)])


def drives_of_peers(problem: Problem) -> tuple[Drive, Drive]:
    """The inputs of the one window as the peers take them, linear between grid points, and as they are known at most.

    The peers' grid has the telemetry's times, at which they give their states, and the kinks of the inputs.
    """
    (window,) = problem.windows
    simulator = problem.scenario.network
    heaters = {name: heater.model_copy(update={"measured_by": None}) for name, heater in simulator.heaters.items()}
    alone = problem.scenario.model_copy(update={"simulator": simulator.model_copy(update={"heaters": heaters})})
    assert isinstance(window.simulator, NetworkSimulator)
    period = orbital_period(alone.environment, alone.folder)
    inputs = window_inputs(
        alone,
        window.simulator.network,
        xarray.Dataset(),
        window.times[0],
        window.times[-1],
        window.times,
        period=period,
    )
    drive = window.simulator.drive
    grids = [np.union1d(times, window.simulator.observation.times) for times in (inputs.breaks, inputs.times)]
    values = [np.stack([np.interp(grid, inputs.times, row) for row in inputs.values], axis=1) for grid in grids]
    return tuple(  # type: ignore[return-value]
        Drive(grid, np.stack([at[:-1], at[1:]], axis=1), np.full((len(grid) - 1, 1), np.nan), drive.initially_on)
        for grid, at in zip(grids, values, strict=True)
    )
