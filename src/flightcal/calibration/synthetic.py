"""Telemetry that a problem's own model makes: the simulation at a theta, and noise as the likelihood has it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import xarray

from ..simulator import open_loop
from ..simulator.system import FloatArray
from .problem import Problem, build_problem


def simulate_telemetry(problem: Problem, theta: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """A draw of what the likelihood says of telemetry at theta [d]: temperatures [T, N] K and heater status [T, H].

    At the problem's sample times, NaN where the problem has no valid sample. Raises SimulationFailure.
    """
    run = problem.simulate(theta)
    temperatures = run.temperatures + problem.noise(theta) * rng.standard_normal(run.temperatures.shape)
    basis = problem.simulator.error_basis
    if basis is not None:
        weights = np.sqrt(run.error_variance) * rng.standard_normal(len(run.error_variance))
        temperatures += np.einsum("tnr,r->tn", basis, weights)
    return (
        np.where(problem.valid, temperatures, np.nan),
        np.where(np.isfinite(problem.status), run.status, np.nan),
    )


def with_telemetry(problem: Problem, telemetry: xarray.Dataset, observed: FloatArray, status: FloatArray) -> Problem:
    """The problem with other temperatures [T, N] K and heater status [T, H], and the same priors.

    telemetry: what the problem was built from; its drivers stay. The priors of initial temperatures stay those around
    the telemetry that there was. In open loop the heaters are driven by the new status.
    """
    opened = problem.open_loop
    if opened is not None:
        made = telemetry.copy(deep=True)
        at = {"time": problem.times}
        for k, name in enumerate(problem.simulator.heaters):
            channel = problem.scenario.network.heaters[name].measured_by
            if channel is not None and np.isfinite(problem.status[:, k]).any():
                made[channel].loc[at] = status[:, k]
        opened = replace(
            build_problem(open_loop(problem.scenario), made, problem.window), observed=observed, priors=problem.priors
        )
    return replace(problem, observed=observed, status=status, open_loop=opened)
