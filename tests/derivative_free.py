"""The small satellite as a simulator that is not ours: five unknowns, runs that are records, and no derivatives."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import xarray

from flightcal.emulation.runs import TrainingRuns, no_runs
from flightcal.external.record import Record
from flightcal.problem import Problem, build_problem
from flightcal.scenario import Scenario
from flightcal.simulator import Simulator, network_simulator
from flightcal.telemetry import read_telemetry
from tests import small

TRUTH = {"link": 0.65, "panel_size": 1.1, "initial_body": 284.0, "initial_panel": 262.0}


def problem(folder: Path, *, heater: bool, seed: int = 0, **values: float) -> Problem:
    """The calibration problem of `scene`."""
    return build_problem(*scene(folder, heater=heater, seed=seed, **values))


def scene(folder: Path, *, heater: bool, seed: int = 0, **values: float) -> tuple[Scenario, xarray.Dataset]:
    """A scenario and telemetry that its own model made: with a thermostat, or with an uncertain capacity."""
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
    folder.mkdir(exist_ok=True)
    scenario, data = small.load(folder, written)
    return scenario, small.telemetry_of(scenario, data, seed=seed, **(truth | values))


def times(problem: Problem, minutes: int) -> Any:
    """The problem's sample times, and so many minutes after the last."""
    later = problem.times[-1] + np.arange(1, minutes + 1) * np.timedelta64(60, "s")
    return np.concatenate([problem.times, later])


def simulator(problem: Problem, minutes: int = 0) -> Simulator:
    """The problem's simulator on `times`."""
    scenario, period = problem.scenario, small.period_of(problem.scenario)
    samples = times(problem, minutes)
    data = read_telemetry(scenario.telemetry, scenario.folder, period=period)
    return network_simulator(scenario, data, samples[0], samples[-1], samples, period=period)


def empty(problem: Problem, minutes: int = 0) -> TrainingRuns:
    """No runs yet, on `times`."""
    simulator = problem.simulator
    return no_runs(simulator.parameters, simulator.channels, simulator.heaters, times(problem, minutes))


def evaluator(simulator: Simulator, fails: Callable[[Any], bool] = lambda _: False) -> Callable[[Any], list[Record]]:
    """Real runs of a simulator; where `fails` says so of theta [d], it crashes."""

    def run(theta: Any) -> Record:
        found = simulator.simulate(theta)
        if fails(theta):
            nothing = np.full(found.temperatures.shape, np.nan), np.full(found.status.shape, np.nan)
            return Record(theta, "crashed", "segmentation fault", 1, 0.0, *nothing)
        return Record(theta, "finished", "", 1, 0.0, found.temperatures, found.status)

    return lambda thetas: [run(theta) for theta in thetas]
