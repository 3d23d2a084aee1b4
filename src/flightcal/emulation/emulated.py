"""Problems whose simulator has no derivatives, with an emulator in the simulator's place."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..calibration import mean_and_some
from ..errors import FlightcalError
from ..external import ExternalSimulator, RunFailure
from ..problem import Problem
from ..simulator import FloatArray
from .active import simulated_priors, start_design
from .emulator import EmulatedSimulator, Emulator, fit_emulator
from .held_out import Validation, judge, validate
from .horizon import shape_tolerance
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
        return any(isinstance(own, ExternalSimulator) and not own.program.has_gradient for own in simulators)
    except RunFailure as failure:
        raise FlightcalError(f"simulator: {failure.outcome}: {failure.message}") from None


def external(problem: Problem) -> ExternalSimulator:
    """The problem's simulator, which `needs_emulator`."""
    assert isinstance(problem.simulator, ExternalSimulator)
    return problem.simulator


def empty_runs(problem: Problem) -> TrainingRuns:
    """No runs of the problem's simulator yet."""
    simulator = problem.simulator
    return no_runs(simulator.parameters, simulator.channels, simulator.heaters, problem.times)


def with_emulator(problem: Problem, emulator: Emulator) -> Problem:
    """The problem with an emulator of its simulator, which still tells the heaters' power."""
    simulator = EmulatedSimulator(emulator, simulated_priors(problem), heater_powers=problem.simulator.heater_power)
    return replace(problem, simulator=simulator, open_loop=None)


def through_the_priors(problem: Problem, runs: TrainingRuns, noise: FloatArray) -> Problem:
    """The problem with a coarse emulator of all finished runs, good for a search, not for an interval. noise: [N] K."""
    finished = runs.take(runs.finished)
    z = simulated_priors(problem).to_z(finished.theta)
    return with_emulator(problem, fit_emulator(finished, z, _GLOBAL_TOLERANCE * noise))


def around_draws(
    problem: Problem, thetas: FloatArray, seed: int, runs: TrainingRuns | None = None
) -> tuple[Problem, TrainingRuns, Validation]:
    """The problem of a window that is only predicted, with an emulator made around posterior draws thetas [S, d].

    Initial temperatures are this window's own, and are drawn from their priors. runs: what an earlier call returned.
    Returns the runs too, and how they are predicted when left out. Raises FlightcalError where too few runs finish.
    """
    scale = simulated_priors(problem)
    if runs is None:
        count = _RUNS_PER_INPUT * len(scale.names)
        design = start_design(scale, count, seed)
        chosen = np.random.default_rng(seed).choice(len(thetas), count, replace=len(thetas) < count)
        own = np.array([name.startswith("initial.") for name in scale.names])
        design[:, ~own] = thetas[chosen][:, problem.simulated][:, ~own]
        runs = empty_runs(problem).add(external(problem).run_many(design), 0)
    finished = runs.take(runs.finished)
    if len(finished) < 2 * (len(scale.names) + 1):
        raise FlightcalError(f"window '{problem.window}': {failure_summary(runs)}; too few are left for an emulator")
    noise = problem.noise(np.median(thetas, axis=0))
    emulator = fit_emulator(finished, scale.to_z(finished.theta), shape_tolerance(noise, len(problem.times)))
    return with_emulator(problem, emulator), runs, judge(*emulator.leave_one_out(), finished.channels)


@dataclass(frozen=True)
class SimulatorCheck:
    """What the simulator itself says of a posterior through its emulator."""

    validation: Validation
    density_error: float
    """Of the log density over posterior draws: see `simulator_check.density_error`."""
    steps: tuple[Steps, ...]
    """Of the heaters whose status is measured."""


def check_on_the_simulator(
    problem: Problem, emulated: Problem, thetas: FloatArray, seed: int
) -> tuple[SimulatorCheck, TrainingRuns]:
    """Run the simulator at the mean of posterior draws thetas [S, d] and at some of them, and judge the emulator by it.

    Raises FlightcalError where no run finishes.
    """
    design = mean_and_some(thetas, CHECKED - 1, seed)
    runs = empty_runs(problem).add(external(problem).run_many(design[:, problem.simulated]), 0)
    assert isinstance(emulated.simulator, EmulatedSimulator)
    finished = runs.take(runs.finished)
    z = simulated_priors(problem).to_z(finished.theta)
    validation = validate(emulated.simulator.emulator, z, finished.temperatures)
    # The mean is no draw.
    drawn = runs.finished & (np.arange(len(runs)) > 0)
    error = density_error(problem, emulated, design[drawn], runs.take(drawn))
    return SimulatorCheck(validation, error, steps(problem, finished)), runs
