"""Telemetry that a problem's own model makes: the simulation at a theta, and noise as the likelihood has it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import xarray

from ..errors import ScenarioError
from ..simulator import FloatArray, Trajectory
from ..telemetry import window_bounds
from .problem import Problem, build_problem


def simulate_telemetry(problem: Problem, theta: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """A draw of what the likelihood says of telemetry at theta [d]: temperatures [T, N] K and heater status [T, H].

    At the problem's sample times, NaN where the problem has no valid sample. Raises SimulationFailure, and
    ScenarioError where the likelihood is one of duty cycles, which says nothing of the samples.
    """
    run = problem.simulate(theta)
    temperatures = run.temperatures + problem.draw_errors(theta, rng)
    basis = problem.simulator.error_basis
    if basis is not None:
        weights = np.sqrt(run.error_variance) * rng.standard_normal(len(run.error_variance))
        temperatures += np.einsum("tnr,r->tn", basis, weights)
    return (
        np.where(problem.valid, temperatures, np.nan),
        np.where(np.isfinite(problem.status), _status(problem, run, theta, rng), np.nan),
    )


def _status(problem: Problem, run: Trajectory, theta: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Status [T, H]: of a heater whose status has a likelihood, with its timing errors and false samples."""
    status = run.status.copy()
    if problem.heater_status is None:
        return status
    data, settings = problem.heater_status.data, problem.status_settings(theta)
    if len(data.duties.heater):
        raise ScenarioError(
            f"{problem.scenario.name}: observations: found a likelihood of duty cycles, expected one of switch times: "
            "telemetry cannot be made from it"
        )
    start, _ = window_bounds(problem.scenario.windows[problem.window], problem.period)
    seconds = (problem.times - start) / np.timedelta64(1, "ns") * 1e-9
    for heater, place in zip(data.samples.heater, data.samples.setting, strict=True):
        timing, error_rate = settings[place], settings[place + 1]
        own = run.switches.heater == heater
        if own.any():
            # None happens before the one before it.
            happened = np.maximum.accumulate(run.switches.time[own] + timing * rng.standard_normal(own.sum()))
            states = np.concatenate([1.0 - run.switches.on[own][:1], run.switches.on[own]])
            status[:, heater] = states[np.searchsorted(happened, seconds, side="right")]
        wrong = rng.random(len(seconds)) < error_rate
        status[wrong, heater] = 1.0 - status[wrong, heater]
    return status


def with_telemetry(problem: Problem, telemetry: xarray.Dataset, observed: FloatArray, status: FloatArray) -> Problem:
    """The problem with other temperatures [T, N] K and heater status [T, H], and the same simulator and priors.

    telemetry: what the problem was built from; its drivers stay. The priors of initial temperatures stay those around
    the telemetry that there was. In open loop the heaters are driven by the new status.
    """
    made = telemetry.copy(deep=True)
    at = {"time": problem.times}
    for k, channel in enumerate(problem.simulator.channels):
        made[channel].loc[at] = observed[:, k]
    for k, name in enumerate(problem.simulator.heaters):
        channels = [c for c, item in problem.scenario.observations.items() if item.heater == name]
        measured_by = getattr(problem.scenario.simulator.heaters[name], "measured_by", None)
        for channel in {*channels, *([measured_by] if measured_by is not None else [])}:
            made[channel].loc[at] = status[:, k]
    built = build_problem(problem.scenario, made, problem.window)
    opened = built.open_loop
    return replace(
        built,
        simulator=problem.simulator,
        priors=problem.priors,
        open_loop=None if opened is None else replace(opened, priors=problem.priors),
    )
