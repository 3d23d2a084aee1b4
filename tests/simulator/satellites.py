"""Random small satellites in low orbits, as scenarios with priors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.truth.satellites import ATTITUDES, NORMALS

from flightcal.problem import Problem, build_problem
from flightcal.telemetry import read_telemetry

from .. import small


def random_satellite(seed: int) -> dict[str, Any]:
    """Four to seven nodes, panels in sunlight and eclipse, two modes, and a thermostat on two satellites of three."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(4, 8))
    names = [f"node_{k}" for k in range(count)]
    capacities = np.exp(rng.uniform(np.log(150.0), np.log(8000.0), count))
    capacities[0] = max(capacities[0], 1500.0)  # with the heater
    links = {(int(rng.integers(0, k)), k): rng.uniform(0.2, 3.0) for k in range(1, count)}
    faces = {
        f"face_{k}": {
            "node": names[int(rng.integers(0, count))],
            "area": f"{rng.uniform(0.02, 0.25)} m^2",
            "normal": NORMALS[k],
            "absorptivity": float(rng.uniform(0.2, 0.9)),
            "emissivity": float(rng.uniform(0.5, 0.9)),
        }
        for k in rng.permutation(6)[: int(rng.integers(3, 7))]
    }
    simulator: dict[str, Any] = {
        "nodes": {
            name: {"capacity": f"{c} J/K", "initial": "12 degC"} for name, c in zip(names, capacities, strict=True)
        },
        "conductors": [{"between": [names[a], names[b]], "conductance": f"{g} W/K"} for (a, b), g in links.items()],
        "faces": faces,
        "modes": {"idle": {names[0]: "8 W"}, "busy": {names[0]: "8 W", names[1]: f"{rng.uniform(5.0, 30.0)} W"}},
        "timeline": [
            {"at": "2024-03-01T00:00:00", "mode": "idle"},
            {"at": "2024-03-01T00:47:13", "mode": "busy"},
            {"at": "2024-03-01T01:21:40", "mode": "idle"},
        ],
    }
    parameters = {
        "link": {"scales": [f"conductors.{names[0]}-{names[1]}.conductance"], "prior": _around(1.0)},
        "mass": {"scales": [f"nodes.{name}.capacity" for name in names], "prior": _around(1.0)},
        "absorptivity": {"scales": [f"faces.{name}.absorptivity" for name in faces], "prior": {"uniform": [0.7, 1.1]}},
    }
    if seed % 3:
        simulator["heaters"] = {
            "heater": {
                "node": names[0], "power": f"{rng.uniform(15.0, 40.0)} W", "sensor": names[0],
                "on_below": "9 degC", "off_above": f"{rng.uniform(10.0, 14.0)} degC",
            }
        }  # fmt: skip
    return {
        "name": f"random_{seed}",
        "telemetry": {
            "file": "telemetry.csv",
            "time": {"column": "time"},
            "channels": {f"{name}_temp": {"column": "body", "unit": "degC", "kind": "temperature"} for name in names},
        },
        "environment": {
            "orbit": {
                "altitude": f"{rng.uniform(400.0, 800.0)} km", "inclination": f"{rng.uniform(45.0, 99.0)} deg",
                "ltan": f"{int(rng.integers(0, 24)):02d}:30", "epoch": "2024-03-01T00:00:00",
            },
            "attitude": ATTITUDES[seed % 3],
        },
        "simulator": simulator,
        "parameters": parameters,
        "observations": {f"{name}_temp": {"node": name} for name in names},
        "heat": "none",
        "windows": {"train": {"start": "2024-03-01T00:00:00", "end": "2024-03-01T03:10:00"}},
        "calibration": {"seed": 1},
    }  # fmt: skip


def _around(median: float) -> dict[str, Any]:
    return {"lognormal": {"median": median, "factor": 1.5}}


def problem_of(folder: Path, written: dict[str, Any], *, step: float | None = None) -> Problem:
    """The problem, with placeholders for telemetry."""
    scenario, data = small.load(folder, written)
    if step is not None:
        scenario = scenario.model_copy(update={"simulator": scenario.network.model_copy(update={"step": step})})
    data = read_telemetry(scenario.telemetry, scenario.folder, period=small.period_of(scenario))
    return build_problem(scenario, data)
