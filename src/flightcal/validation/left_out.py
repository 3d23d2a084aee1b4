"""How well each of several training windows is predicted by the others.

What predicts a test window best must not be chosen by that window. With several windows to train on there is something
else to choose by: each is left out in turn, the others are calibrated on, and it is predicted as a test window is.
"""

from __future__ import annotations

from typing import Any

import xarray

from ..calibration import calibrate_nuts, some_of
from ..errors import RunError
from ..prediction import predict, score
from ..problem import build_problem
from ..progress import SILENT, Progress
from ..scenario import ExternalModel, Scenario

LEFT_OUT = "left_out"


def leave_windows_out(
    scenario: Scenario, telemetry: xarray.Dataset, *, progress: Progress = SILENT
) -> dict[str, dict[str, Any]]:
    """Scores of each training window's telemetry as the posterior of all others predicts it, by the window's label.

    A window's record holds the metrics over its channels together, and `passed`: whether the sampling on the others
    passed its gates. Raises RunError where there are not several to train on, and
    KeyboardInterrupt where a sampling is interrupted.
    """
    check_windows(scenario)
    found = {}
    for window in scenario.train_windows:
        label = window.removeprefix("train.")
        progress.say(f"without {label}")
        found[label] = _predicted_by_others(scenario, telemetry, window)
    return found


def check_windows(scenario: Scenario) -> None:
    """Raises RunError where windows cannot be left out."""
    if len(scenario.train_windows) < 2:
        raise RunError("--leave-windows-out: found one window to train on, expected several")
    if isinstance(scenario.simulator, ExternalModel):
        raise RunError("--leave-windows-out: found a simulator that is not flightcal's, expected a network")


def _predicted_by_others(scenario: Scenario, telemetry: xarray.Dataset, window: str) -> dict[str, Any]:
    others = {name: scenario.windows[name] for name in scenario.train_windows if name != window}
    alone = scenario.model_copy(update={"windows": others | {LEFT_OUT: scenario.windows[window]}})
    problem = build_problem(alone, telemetry)
    posterior = calibrate_nuts(problem)
    if posterior.draws.interrupted:
        raise KeyboardInterrupt
    settings = scenario.calibration
    draws = some_of(posterior.flat, settings.prediction.simulations, settings.seed)
    predicted, _ = predict(posterior.problem, telemetry, LEFT_OUT, {}, draws, seed=settings.seed)
    scores = {metric.metric: metric.value for metric in score(predicted, LEFT_OUT) if metric.channel == "all"}
    return scores | {"passed": posterior.diagnostics.passed}
