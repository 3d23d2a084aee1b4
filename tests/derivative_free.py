"""The small satellite as a simulator that is not ours: five unknowns, runs that are records, and no derivatives."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import xarray

from flightcal.emulation.design import Runs
from flightcal.emulation.emulated import empty_runs
from flightcal.emulation.runs import TrainingRuns
from flightcal.external.record import Record
from flightcal.problem import Problem, Window, build_problem
from flightcal.scenario import Scenario
from tests import small

TRUTH = {"link": 0.65, "panel_size": 1.1, "initial_body": 284.0, "initial_panel": 262.0}


def problem(folder: Path, *, heater: bool, seed: int = 0, **values: float) -> Problem:
    """The calibration problem of `scene`."""
    return build_problem(*scene(folder, heater=heater, seed=seed, **values))


def scene(
    folder: Path, *, heater: bool, seed: int = 0, train: dict[str, Any] | None = None, **values: float
) -> tuple[Scenario, xarray.Dataset]:
    """A scenario and telemetry that its own model made: with a thermostat, or with an uncertain capacity.

    train: the windows to train on, where there are several.
    """
    written = small.content()
    truth: dict[str, float] = TRUTH | ({"power": 28.0} if heater else {"capacity": 3200.0})
    if not heater:
        written["simulator"]["heaters"] = {}
        del written["observations"]["heater_status"], written["parameters"]["power"]
        del written["telemetry"]["channels"]["heater_status"]
        written["parameters"]["capacity"] = {
            "sets": "nodes.body.capacity",
            "prior": {"lognormal": {"median": "3000 J/K", "factor": 1.2}},
        }
    if train is not None:
        written["windows"] = {"train": train}
    folder.mkdir(exist_ok=True)
    scenario, data = small.load(folder, written)
    return scenario, small.telemetry_of(scenario, data, seed=seed, **(truth | values))


def nothing(problem: Problem) -> Runs:
    """No runs yet."""
    return tuple(empty_runs(window) for window in problem.windows)


def evaluate(window: Window, thetas: Any, fails: Callable[[Any], bool] = lambda _: False) -> list[Record]:
    """Real runs of a window at thetas [S, p]; where `fails` says so of one, it crashes."""

    def run(theta: Any) -> Record:
        found = window.simulator.simulate(theta)
        if fails(theta):
            missing = np.full(found.temperatures.shape, np.nan), np.full(found.status.shape, np.nan)
            return Record(theta, "crashed", "segmentation fault", 1, 0.0, *missing)
        return Record(theta, "finished", "", 1, 0.0, found.temperatures, found.status)

    return [run(theta) for theta in thetas]


def runs_at(window: Window, thetas: Any) -> TrainingRuns:
    """The runs of a window at thetas [S, p]."""
    return empty_runs(window).add(evaluate(window, thetas), 0)
