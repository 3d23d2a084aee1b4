"""Problems of others as scenarios: a function in JAX, whose outputs stand for temperatures, from 300 K on."""

import textwrap

import numpy as np
import pandas as pd
from arviz_stats.base import array_stats
from ruamel.yaml import YAML

from flightcal.problem import build_problem
from flightcal.scenario import load_scenario
from flightcal.telemetry import read

START = np.datetime64("2024-03-01T00:00:00", "ns")
MINUTE = 60.0
BASE = 300.0  # K


def problem(folder, model, priors, observed, noise, **blocks):
    """The problem of outputs `observed` [T, N], NaN where there is none, of which one is sampled a minute.

    model: source of a function simulate(inputs, times, start) in JAX, which returns outputs [T, N]. priors: input ->
    prior. noise: standard deviation, or a prior of one; nothing else is lacking. blocks: what else the scenario has.
    """
    folder.mkdir(exist_ok=True)
    samples, outputs = observed.shape
    names = [f"y{k}" for k in range(outputs)]
    header = "import jax.numpy as jnp\n" + textwrap.dedent(model)
    shifted = "\n\ndef shifted(inputs, times, start):\n    return 300.0 + simulate(inputs, times, start)\n"
    (folder / "model.py").write_text(header + shifted, encoding="utf-8")
    times = START + (MINUTE * 1e9 * np.arange(samples + 1)).astype("timedelta64[ns]")
    table = pd.DataFrame(BASE + observed, columns=names)
    table.loc[samples] = np.nan
    table.insert(0, "time", np.datetime_as_string(times, unit="s"))
    table.to_csv(folder / "telemetry.csv", index=False, float_format="%.17g")
    written = {
        "name": "reference",
        "telemetry": {
            "file": "telemetry.csv",
            "time": {"column": "time"},
            "channels": {name: {"column": name, "unit": "K", "kind": "temperature"} for name in names},
        },
        "environment": {"period": "1 h"},
        "simulator": {
            "callable": {"file": "model.py", "function": "shifted", "gradient": "jax"},
            "inputs": dict.fromkeys(priors, 0.5),
            "outputs": {name: {} for name in names},
        },
        "parameters": {name: {"sets": f"inputs.{name}", "prior": prior} for name, prior in priors.items()},
        "observations": {name: {"output": name, "noise": noise} for name in names},
        "windows": {"train": {"start": "2024-03-01T00:00:00", "end": str(times[-1])[:19]}},
        "discrepancy": "none",
        **blocks,
    }
    with (folder / "scenario.yaml").open("w", encoding="utf-8") as file:
        yaml = YAML(typ="safe")
        yaml.sort_base_mapping_type_on_output = False
        yaml.dump(written, file)
    scenario = load_scenario(folder / "scenario.yaml")
    return build_problem(scenario, read(scenario))


def standard_error(draws):
    """Monte Carlo standard error of the mean of draws [chain, draw]."""
    return float(array_stats.mcse(draws, method="mean"))
