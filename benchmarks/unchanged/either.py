"""The problem of a scenario, by a checkout from before the problem was made of windows or after it."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np


def problem_of(file: str, telemetry: str | None = None) -> Any:
    """The calibration problem of a scenario file."""
    from flightcal.scenario import load_scenario
    from flightcal.telemetry import read_telemetry

    orbital_period = import_module("flightcal.environment").orbital_period
    scenario = load_scenario(file, telemetry=telemetry)
    data = read_telemetry(
        scenario.telemetry, scenario.folder, period=orbital_period(scenario.environment, scenario.folder)
    )
    if find_spec("flightcal.problem") is not None:
        return import_module("flightcal.problem").build_problem(scenario, data)
    return import_module("flightcal.calibration").calibration_problem(scenario, data)


def temperatures(problem: Any, thetas: Any) -> Any:
    """Simulated at thetas [S, d], the windows' samples one after another [S, T, N]; NaN where one fails."""
    found = []
    for run in problem.simulate_many(thetas):
        parts = run if isinstance(run, tuple) and not hasattr(run, "temperatures") else (run,)
        found.append(None if run is None else np.concatenate([part.temperatures for part in parts]))
    shape = next(one.shape for one in found if one is not None)
    return np.stack([np.full(shape, np.nan) if one is None else one for one in found])
