"""Problems whose simulators have no derivatives, with emulators in the simulators' place."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..calibration import mean_and_some
from ..errors import FlightcalError
from ..external import ExternalSimulator, Record, RunFailure
from ..problem import Problem, Window
from ..simulator import FloatArray
from .active import noise_level
from .design import Runs, on_all_windows, start_design, title
from .emulator import fit_emulator, simulated_priors, with_emulator
from .held_out import HeldOutScores, judge, together, validate
from .horizon import shape_tolerance
from .influence import emulated
from .runs import TrainingRuns, failure_summary, no_runs
from .simulator_check import Steps, density_error, steps

CHECKED = 20
"""Posterior draws at which the simulator itself is run at the end."""
_RUNS_PER_INPUT = 10
"""Of the emulator of a window that is only predicted."""
_GLOBAL_TOLERANCE = 0.5
"""Share of the noise that principal shapes may leave out where the emulator only leads a search."""


def needs_emulator(problem: Problem) -> bool:
    """Whether a window's simulator is an external one without derivatives. Raises FlightcalError where it fails."""
    simulators = [window.simulator for window in problem.windows]
    try:
        return any(
            isinstance(simulator, ExternalSimulator) and not simulator.program.has_gradient for simulator in simulators
        )
    except RunFailure as failure:
        raise FlightcalError(f"simulator: {failure.outcome}: {failure.message}") from None


def run_many(window: Window, thetas: FloatArray) -> list[Record]:
    """Real runs of a window, of a problem that `needs_emulator`, at thetas [S, p]."""
    assert isinstance(window.simulator, ExternalSimulator)
    return window.simulator.run_many(thetas)


def empty_runs(window: Window) -> TrainingRuns:
    """No runs of the window's simulator yet."""
    simulator = window.simulator
    return no_runs(simulator.parameters, simulator.channels, simulator.heaters, window.times)


def in_place(problem: Problem, windows: list[Window]) -> Problem:
    """The problem with other simulators in its windows, which have no open loop."""
    return replace(problem, windows=tuple(windows), open_loop=None)


def through_the_priors(problem: Problem, runs: Runs) -> Problem:
    """The problem with coarse emulators of all finished runs, good for a search, not for an interval."""
    windows = []
    for window, training in zip(problem.windows, runs, strict=True):
        tolerance = _GLOBAL_TOLERANCE * noise_level(window)
        emulator = fit_emulator(training.take(training.finished), simulated_priors(window), tolerance)
        windows.append(with_emulator(window, emulator))
    return in_place(problem, windows)


def around_draws(
    window: Window, thetas: FloatArray, seed: int, runs: TrainingRuns | None = None
) -> tuple[Window, TrainingRuns, HeldOutScores]:
    """A window that is only predicted, with an emulator made around posterior draws thetas [S, q].

    Initial temperatures are this window's own, and are drawn from their priors. runs: what an earlier call returned.
    Returns the runs too, and how they are predicted when left out. Raises FlightcalError where too few runs finish.
    """
    scale = simulated_priors(window)
    if runs is None:
        count = _RUNS_PER_INPUT * len(scale.names)
        design = start_design(scale, count, seed)
        chosen = np.random.default_rng(seed).choice(len(thetas), count, replace=len(thetas) < count)
        is_initial = np.array([name.startswith("initial.") for name in scale.names])
        design[:, ~is_initial] = thetas[chosen][:, window.simulated][:, ~is_initial]
        runs = empty_runs(window).add(run_many(window, design), 0)
    finished = runs.take(runs.finished)
    if len(finished) < 2 * (len(scale.names) + 1):
        raise FlightcalError(f"window '{window.name}': {failure_summary(runs)}; too few are left for an emulator")
    tolerance = shape_tolerance(window.noise(np.median(thetas, axis=0)), len(window.times))
    emulator = fit_emulator(finished, scale, tolerance)
    return with_emulator(window, emulator), runs, judge(*emulator.leave_one_out(), finished.channels)


@dataclass(frozen=True)
class SimulatorCheck:
    """What the simulator itself says of a posterior through its emulator."""

    validation: HeldOutScores
    density_error: float
    """Of the log density over posterior draws: see `simulator_check.density_error`."""
    steps: tuple[Steps, ...]
    """Of the heaters whose status is measured."""


def check_on_the_simulator(
    problem: Problem, with_emulators: Problem, thetas: FloatArray, seed: int
) -> tuple[SimulatorCheck, Runs]:
    """Run the simulators at the mean of posterior draws thetas [S, d] and at some of them, and judge the emulators.

    Raises FlightcalError where no run of a window finishes.
    """
    design = mean_and_some(thetas, CHECKED - 1, seed)
    runs, validations, found = [], {}, []
    for window, stand_in in zip(problem.windows, with_emulators.windows, strict=True):
        training = empty_runs(window).add(run_many(window, problem.at(window, design)[:, window.simulated]), 0)
        finished, start = training.take(training.finished), title(problem, window)
        validations[start] = validate(emulated(stand_in).emulator, finished)
        found += [replace(item, heater=f"{start}{item.heater}") for item in steps(window, finished)]
        runs.append(training)
    # The mean is no draw.
    drawn = on_all_windows(tuple(runs)) & (np.arange(len(design)) > 0)
    error = density_error(problem, with_emulators, design[drawn], [training.take(drawn) for training in runs])
    return SimulatorCheck(together(validations), error, tuple(found)), tuple(runs)
