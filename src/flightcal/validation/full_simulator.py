"""The last stage of a calibration through a reduced model: posterior draws on the full operational simulator."""

from __future__ import annotations

from collections.abc import Collection

from ..calibration import mean_and_some
from ..errors import ScenarioError
from ..problem import Problem
from ..progress import Listener
from ..reduction import compare, fly_at, load_task
from ..run import Run
from ..simulator import FloatArray

FULL_CHECK_FILE = "full_simulator_check.json"
CHECKED = 20
"""Posterior draws that are flown, besides the mean."""


def full_check_stage(run: Run, key: str, problem: Problem, draws: FloatArray, listener: Listener) -> None:
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
        parameters = {name: task.scenario.parameters[name] for name in _shared(problem, task.scenario.parameters)}
        thetas = mean_and_some(draws, CHECKED, scenario.calibration.seed)
        positions = [problem.names.index(name) for name in parameters]
        channels = problem.channels
        flown, reduced, failed = [], [], 0
        for k, (theta, runs) in enumerate(zip(thetas, problem.simulate_many(thetas), strict=True)):
            listener.search(f"flight {k + 1} of {len(thetas)}")
            failed += runs is None
            for window, trajectory in zip(problem.windows, runs or (), strict=False):
                flown.append(fly_at(task.mission, parameters, theta[positions], channels, window.times))
                reduced.append(trajectory)
        run.write_json(
            FULL_CHECK_FILE,
            {
                "flights": len(flown),
                "failed": failed,
                "records": compare(flown, reduced, channels, problem.heaters) if flown else [],
            },
        )


def _shared(problem: Problem, names: Collection[str]) -> tuple[str, ...]:
    """The scenario's parameters, all of which the reduction must know."""
    unknown = [name for name in problem.scenario.parameters if name not in names]
    if unknown:
        raise ScenarioError(
            f"simulator.checked_on: found no parameter '{unknown[0]}' in {problem.scenario.network.checked_on}, "
            f"expected all of the scenario's; it has {', '.join(names)}"
        )
    return tuple(problem.scenario.parameters)
