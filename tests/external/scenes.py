"""Small scenarios with simulators of our own making that behave well or badly on purpose."""

import copy
from pathlib import Path

import numpy as np
import pandas as pd
from ruamel.yaml import YAML

from flightcal.external import build_external
from flightcal.scenario import lint, load_scenario
from flightcal.telemetry import read

START = np.datetime64("2024-03-01T00:00:00", "ns")
SAMPLES = 31
TIMES = 60.0 * np.arange(SAMPLES)  # s
END = START + np.timedelta64(60 * SAMPLES, "s")
THETA = np.array([0.8, 5.0])

INPUTS = {"link": "0.5 W/K", "load": {"value": "4 W"}}
OUTPUTS = {"battery": {}, "radiator": {}}


def written(simulator, **changes):
    """A scenario, as YAML says it, around a simulator's block."""
    scenario = {
        "name": "external",
        "telemetry": {
            "file": "telemetry.csv",
            "time": {"column": "time"},
            "channels": {
                "battery_temp": {"column": "battery", "unit": "degC", "kind": "temperature"},
                "radiator_temp": {"column": "radiator", "unit": "degC", "kind": "temperature"},
                "heater_status": {"column": "heater", "kind": "status"},
                "sun": {"column": "sun", "unit": "W", "kind": "driver"},
            },
        },
        "environment": {"period": "1800 s"},
        "simulator": {"inputs": INPUTS, "outputs": OUTPUTS, "timeout": "20 s", **simulator},
        "parameters": {
            "link": {"sets": "inputs.link", "prior": {"uniform": ["0.1 W/K", "2 W/K"]}},
            "load": {"sets": "inputs.load", "prior": {"uniform": ["1 W", "9 W"]}},
        },
        "observations": {
            "battery_temp": {"output": "battery", "noise": "0.1 K"},
            "radiator_temp": {"output": "radiator", "noise": "0.1 K"},
        },
        "heat": "none",
        "windows": {"train": {"start": "2024-03-01T00:00:00", "end": "2024-03-01T00:31:00"}},
    }
    scenario = copy.deepcopy(scenario)
    for key, value in changes.items():
        scenario[key] = {**scenario.get(key, {}), **value}
    return scenario


def write(folder: Path, content) -> Path:
    """Write the scenario and placeholder telemetry."""
    seconds = 60.0 * np.arange(121)
    pd.DataFrame(
        {
            "time": np.datetime_as_string(START + (seconds * 1e9).astype("timedelta64[ns]"), unit="s"),
            "battery": 20.0 + 1e-4 * seconds,
            "radiator": 5.0 + 1e-4 * seconds,
            "heater": (seconds // 600 % 2).astype(int),
            "sun": 10.0 + 1e-3 * seconds,
        }
    ).to_csv(folder / "telemetry.csv", index=False)
    path = folder / "scenario.yaml"
    with path.open("w", encoding="utf-8") as file:
        yaml = YAML(typ="safe")
        yaml.sort_base_mapping_type_on_output = False
        yaml.dump(content, file)
    return path


def simulator_of(folder: Path, block, **changes):
    """The simulator of a written scenario on its train window, observed once a minute."""
    scenario = load_scenario(write(folder, written(block, **changes)))
    times = START + (TIMES * 1e9).astype("timedelta64[ns]")
    return build_external(scenario, read(scenario), START, END, times, period=1800.0)


def findings(folder: Path, block, **changes):
    """What lint says about a written scenario, without the file's name and line."""
    path = write(folder, written(block, **changes))
    return [f"{finding.location}: {finding.message}" for finding in lint(path)]
