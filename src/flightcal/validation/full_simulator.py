"""The last stage of a calibration through a reduced model: posterior draws on the full operational simulator."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Final

import numpy as np

from ..calibration import Sampled, mean_and_some, posterior_draws, with_kept_heat
from ..errors import ScenarioError
from ..problem import Problem, Window
from ..reduction import Flown, compare, fly_at, load_task, spacecraft_of
from ..run import Run, Stage, hash_of, hash_of_file, read_json
from ..scenario import Scenario
from ..simulator import TIME_ERROR, FloatArray, Trajectory, in_parallel

FULL_CHECK_FILE = "full_simulator_check.json"
CHECKED = 8
"""Posterior draws that are flown, besides the mean; in how far the reduced model is off they differ little."""


def flown_from(scenario: Scenario) -> str:
    """Hash of the reduction file that the check follows, and of the spacecraft file in it, which no scenario names.

    Raises ScenarioError where the reduction file does not read.
    """
    assert scenario.network.checked_on is not None
    file = scenario.folder / scenario.network.checked_on
    return hash_of(list(map(hash_of_file, (file, spacecraft_of(file)))))


def _fly(run: Run, problem: Problem, sampled: Sampled, *, flown_from: str, simulations: int, seed: int) -> None:
    problem = with_kept_heat(problem, sampled.posterior)
    draws = posterior_draws(sampled.posterior, problem.names, simulations, seed)
    scenario = problem.scenario
    assert scenario.network.checked_on is not None
    task = load_task(scenario.folder / scenario.network.checked_on)
    known = task.scenario.parameters
    unknown = [name for name in scenario.parameters if name not in known]
    if unknown:
        raise ScenarioError(
            f"simulator.checked_on: found no parameter '{unknown[0]}' in {scenario.network.checked_on}, "
            f"expected all of the scenario's; it has {', '.join(known)}"
        )
    parameters = {name: known[name] for name in scenario.parameters}
    thetas = mean_and_some(draws, CHECKED, seed)
    positions = [problem.names.index(name) for name in parameters]
    channels = problem.channels
    # With thermostats that act, as on board, and without heat, of which the operational simulator knows nothing.
    windows = problem.flown or problem.windows
    inside = [(window, problem.at(window, thetas)) for window in windows]
    flights = list(product(range(len(thetas)), inside))

    def both(number: int) -> tuple[Flown, Trajectory | None]:
        k, (window, flight) = flights[number]
        run.progress.at(k, f"flight {k + 1} of {len(thetas)}")
        there = fly_at(task.mission, parameters, thetas[k, positions], channels, window.times, window.span)
        return there, _from_there(window, flight[k], there)

    made = in_parallel(both, len(flights))
    flown = [there for there, trajectory in made if trajectory is not None]
    reduced = [trajectory for _, trajectory in made if trajectory is not None]
    run.folder.write_json(
        FULL_CHECK_FILE,
        {
            "flights": len(flown),
            "failed": len(thetas) * len(windows) - len(flown),
            "records": compare(flown, reduced, channels, problem.heaters) if flown else [],
        },
    )


def _from_there(window: Window, theta: FloatArray, there: Flown) -> Trajectory | None:
    """The reduced model from where a flight is at the window's start, theta [q] aside; None: it failed."""
    network = window.network
    theta = theta.copy()
    for k, name in enumerate(window.names):
        kind, _, node = name.partition(".")
        if kind == "initial":
            theta[k] = there.start[node]
        elif name == TIME_ERROR:
            theta[k] = 0.0
    on = np.array([there.on[name] for name in network.heaters])
    started = replace(network, drive=replace(network.drive, initially_on=on))
    return replace(window, simulator=started).simulate_many(theta[None])[0]


FULL_SIMULATOR: Final = Stage(
    "full simulator",
    "checking on the full simulator",
    (FULL_CHECK_FILE,),
    _fly,
    lambda run, *_: read_json(run.folder.file(FULL_CHECK_FILE)),
)
"""Of a problem and its posterior: its mean and some draws are flown, and how far the reduced model is off is written.

Made anew where `flown_from`, a setting, has changed.
The flight begins with the spacecraft file's initial temperatures, the reduced model in each window where the flight is
then. Biases and failures of what flies are not in it.
Raises ScenarioError where the reduction file does not read or has other parameters.
"""
