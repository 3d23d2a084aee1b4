"""The stochastic update of a problem with NUTS."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from ..problem import Problem
from ..progress import SILENT, Progress
from ..run import numbers_told
from ..scenario import NutsSettings, heat_of
from ..simulator import FloatArray
from .diagnostics import Diagnostics, diagnose
from .enough_draws import sample_enough
from .mode import check_simulated, find_mode
from .nuts import Draws, sample_problem
from .posterior import Posterior, prior_scores
from .with_heat import calibrate_with_heat


@numbers_told("calibration", "check units, powers and capacities, and the priors with 'flightcal simulate'")
def calibrate_nuts(
    problem: Problem,
    settings: NutsSettings | None = None,
    seed: int | None = None,
    *,
    starts: Sequence[tuple[str, FloatArray]] = (),
    random_starts: int = 6,
    progress: Progress = SILENT,
) -> Posterior:
    """Sample the posterior with NUTS: find the mode, whiten with the Gauss-Newton Hessian, run the chains.

    settings, seed: None: the scenario's. starts: named thetas [d] from which the mode is sought too, such as the
    genetic algorithm's. random_starts: prior draws from which it is sought.
    Raises FlightcalError when no start has a finite density or a simulation fails beside the mode, and
    KeyboardInterrupt where sampling is interrupted before the first draw.
    """
    settings = settings or problem.scenario.calibration.nuts
    seed = problem.scenario.calibration.seed if seed is None else seed
    rng = np.random.default_rng(seed)
    if heat_of(problem.scenario) is not None and problem.heat is None:
        return calibrate_with_heat(problem, settings, seed, starts, random_starts, progress)
    with progress.stage("mode search") as search:
        modes = find_mode(problem, starts, rng=rng, random_starts=random_starts, progress=search)
    check_simulated(modes)
    coordinates = problem.coordinates(modes[0].z)
    sampler = partial(sample_problem, problem, progress=progress)

    def judge(draws: Draws) -> tuple[FloatArray, Diagnostics]:
        theta = problem.to_theta(draws.z)
        by_name = {name: theta[..., k] for k, name in enumerate(problem.names)}
        return theta, diagnose(by_name, draws.statistics, settings, prior_scores(problem, theta))

    draws, theta, judged = sample_enough(sampler, coordinates, settings, seed, judge, progress)
    return Posterior(problem.names, theta, draws, modes, judged, problem)
