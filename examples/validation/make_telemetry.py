"""Writes telemetry.csv: sample times with gaps, the sun sensor, and what the scenario's own model gives at its medians.

Only the times, the sun sensor and the first temperatures matter: `flightcal validate` makes the rest anew.
"""

from pathlib import Path

import numpy as np
import pandas as pd

from flightcal.environment import orbital_period
from flightcal.problem import build_problem
from flightcal.problem.synthetic import simulate_telemetry
from flightcal.scenario import load_scenario
from flightcal.telemetry import read_telemetry

FILE = Path(__file__).parent / "telemetry.csv"
START = np.datetime64("2024-03-01T00:00:00")
PERIOD = 5400.0


def main() -> None:
    rng = np.random.default_rng(1)
    seconds = 60.0 * np.arange(181)
    # Single rows were lost, and for twenty minutes all but the sun sensor.
    kept = rng.random(seconds.size) > 0.05
    kept[[0, -1]] = True
    seconds = seconds[kept]
    lost = (seconds > 6000) & (seconds < 7200)
    table = pd.DataFrame(
        {
            "time": np.datetime_as_string(START + seconds.astype("timedelta64[s]"), unit="s"),
            "body": np.where(lost, np.nan, 11.5 + 0.001 * seconds / 60.0),
            "panel": np.where(lost, np.nan, -10.0 + 0.001 * seconds / 60.0),
            "heater": np.where(lost, np.nan, 0.0),
            "sun": np.maximum(np.sin(2 * np.pi * seconds / PERIOD), 0.0).round(4),
        }
    )
    table.to_csv(FILE, index=False)
    scenario = load_scenario(FILE.parent / "scenario.yaml")
    period = orbital_period(scenario.environment, scenario.folder)
    problem = build_problem(scenario, read_telemetry(scenario.telemetry, scenario.folder, period=period))
    ((temperatures, status),) = simulate_telemetry(problem, problem.priors.median(), rng)
    seen = np.isin(START + seconds.astype("timedelta64[s]"), problem.windows[0].times)
    table.loc[seen, ["body", "panel"]] = (temperatures - 273.15).round(3)
    table.loc[seen, "heater"] = status[:, 0]
    table.to_csv(FILE, index=False)


if __name__ == "__main__":
    main()
