"""The last stage of a calibration through a reduced model: posterior draws on the full operational simulator."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from .calibration import Problem
from .errors import ScenarioError
from .run_directory import RunDirectory
from .simulator.system import FloatArray
from .surrogate.check import compare, fly_at
from .surrogate.file import load_task

FULL_CHECK_FILE = "full_simulator_check.json"
CHECKED = 20
"""Posterior draws that are flown, besides the mean."""


class _Listener(Protocol):
    def stage(self, name: str, done_before: bool) -> None: ...

    def search(self, what: str) -> None: ...


def full_check_stage(run: RunDirectory, key: str, problem: Problem, draws: FloatArray, listener: _Listener) -> None:
    """Fly the mean of posterior thetas [S, d] and some of them, and write how far the reduced model is off.

    The flight is that of the spacecraft file, its failures and initial temperatures included.
    Raises ScenarioError where the reduction file does not read or has other parameters.
    """
    scenario = problem.scenario
    if scenario.network.checked_on is None:
        return
    done = run.is_done("check", key, (FULL_CHECK_FILE,))
    listener.stage("check", done)
    if done:
        return
    with run.stage("check", key):
        task = load_task(scenario.folder / scenario.network.checked_on)
        parameters = {
            name: task.scenario.parameters[name] for name in _shared(problem, tuple(task.scenario.parameters))
        }
        rng = np.random.default_rng(scenario.calibration.seed)
        chosen = rng.choice(len(draws), min(CHECKED, len(draws)), replace=False)
        thetas = np.concatenate([draws.mean(axis=0)[None], draws[chosen]])
        positions = [problem.names.index(name) for name in parameters]
        flown, reduced = [], []
        for k, theta in enumerate(thetas):
            listener.search(f"flight {k + 1} of {len(thetas)}")
            run_of_theta = problem.simulate_many(theta[None])[0]
            if run_of_theta is not None:
                channels = problem.simulator.channels
                flown.append(fly_at(task.mission, parameters, theta[positions], channels, problem.times))
                reduced.append(run_of_theta)
        run.write_json(
            FULL_CHECK_FILE,
            {
                "flights": len(flown),
                "failed": len(thetas) - len(flown),
                "records": compare(flown, reduced, problem.simulator.channels, problem.simulator.heaters),
            },
        )


def _shared(problem: Problem, names: tuple[str, ...]) -> tuple[str, ...]:
    """The scenario's parameters, all of which the reduction must know."""
    unknown = [name for name in problem.scenario.parameters if name not in names]
    if unknown:
        raise ScenarioError(
            f"simulator.checked_on: found no parameter '{unknown[0]}' in {problem.scenario.network.checked_on}, "
            f"expected all of the scenario's; it has {', '.join(names)}"
        )
    return tuple(problem.scenario.parameters)
