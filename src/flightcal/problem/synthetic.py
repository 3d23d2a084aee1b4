"""Telemetry that a problem's own model makes: the simulation at a theta, and noise as the likelihood has it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import xarray

from ..errors import ScenarioError
from ..probability import Priors
from ..simulator import FloatArray, Trajectory
from .build import build_window, open_windows, status_channels
from .heat import heat_in_prior
from .heat_units import heat_of_weights, unit_heats
from .problem import Problem
from .window import Window

Telemetry = tuple[FloatArray, FloatArray]
"""Of one window: temperatures [T, N] K and heater status [T, H]."""


def simulate_telemetry(problem: Problem, theta: FloatArray, rng: np.random.Generator) -> list[Telemetry]:
    """A draw of what the likelihood says of each window's telemetry at theta [d].

    At the windows' sample times, NaN where a window has no valid sample. Raises SimulationFailure, and ScenarioError
    where the likelihood is one of duty cycles, which says nothing of the samples.
    """
    shared = None
    if problem.shares_weights:
        shapes = problem.windows[0].residuals.terms.shapes
        shared = rng.standard_normal((len(shapes.channels), shapes.basis.shape[1]))
    return [_simulate(window, problem.at(window, theta), rng, shared) for window in problem.windows]


def with_drawn_heat(problem: Problem, rng: np.random.Generator) -> tuple[Problem, dict[str, float]]:
    """The problem with heat in its simulators that is a draw from its prior, and the sizes of it by their names.

    Without heat in the scenario: the problem itself.
    """
    model = heat_in_prior(problem)
    if model is None:
        return problem, {}
    priors = Priors(tuple(model.priors), tuple(model.priors.values()))
    sizes = dict(zip(priors.names, priors.sample(rng, 1)[0].tolist(), strict=True))
    shared: dict[int, FloatArray] = {}
    windows = []
    for window in problem.windows:
        units = unit_heats(model, window)
        for g, (group, group_units) in enumerate(zip(model.groups, units, strict=True)):
            if g not in shared or group.window:
                # Switches happen where thermostats switch, and the simulator's error is no heat.
                scale = sizes.get(group.scale, 1.0 if group.part in ("gaps", "changes") else 0.0)
                shared[g] = scale * rng.standard_normal(len(group_units.series))
        heat = heat_of_weights(model, units, [shared[g] for g in range(len(units))])
        windows.append(replace(window, simulator=window.network.with_heat(heat)))
    return replace(problem, windows=tuple(windows)), sizes


def _simulate(window: Window, theta: FloatArray, rng: np.random.Generator, shared: FloatArray | None) -> Telemetry:
    run = window.simulate(theta)
    temperatures = run.temperatures + window.draw_errors(theta, rng, shared)
    basis = window.simulator.error_basis
    if basis is not None:
        weights = np.sqrt(run.error_variance) * rng.standard_normal(len(run.error_variance))
        temperatures += np.einsum("tnr,r->tn", basis, weights)
    return (
        np.where(window.valid, temperatures, np.nan),
        np.where(np.isfinite(window.status), _status(window, run, theta, rng), np.nan),
    )


def _status(window: Window, run: Trajectory, theta: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Status [T, H]: of a heater whose status has a likelihood, with its timing errors and false samples."""
    status = run.status.copy()
    if window.heater_status is None:
        return status
    data, settings = window.heater_status.data, window.status_settings(theta)
    if len(data.duties.heater):
        raise ScenarioError(
            f"{window.scenario.name}: observations: found a likelihood of duty cycles, expected one of switch times: "
            "telemetry cannot be made from it"
        )
    seconds = (window.times - window.start) / np.timedelta64(1, "ns") * 1e-9
    for heater, place in zip(data.samples.heater, data.samples.setting, strict=True):
        timing, error_rate = settings[place], settings[place + 1]
        of_heater = run.switches.heater == heater
        if of_heater.any():
            # None happens before the one before it.
            happened = np.maximum.accumulate(
                run.switches.time[of_heater] + timing * rng.standard_normal(of_heater.sum())
            )
            states = np.concatenate([1.0 - run.switches.on[of_heater][:1], run.switches.on[of_heater]])
            status[:, heater] = states[np.searchsorted(happened, seconds, side="right")]
        wrong = rng.random(len(seconds)) < error_rate
        status[wrong, heater] = 1.0 - status[wrong, heater]
    return status


def with_telemetry(problem: Problem, telemetry: xarray.Dataset, made: Sequence[Telemetry]) -> Problem:
    """The problem with other telemetry in its windows, and the same simulators and priors.

    telemetry: what the problem was built from; its drivers stay. The priors of initial temperatures stay those around
    the telemetry that there was. In open loop the heaters are driven by the new status.
    """
    changed = telemetry.copy(deep=True)
    for window, (observed, status) in zip(problem.windows, made, strict=True):
        _put(changed, window, observed, status)
    built = [build_window(problem.scenario, changed, window.name) for window in problem.windows]
    windows = tuple(
        replace(new, simulator=old.simulator, reads=old.reads) for new, old in zip(built, problem.windows, strict=True)
    )
    if problem.open_loop is None:
        return replace(problem, windows=windows)
    pairs = zip(open_windows(built, changed), problem.open_loop.windows, strict=True)
    opened = tuple(replace(new, reads=old.reads) for new, old in pairs)
    return replace(problem, windows=windows, open_loop=replace(problem.open_loop, windows=opened))


def _put(telemetry: xarray.Dataset, window: Window, observed: FloatArray, status: FloatArray) -> None:
    at = {"time": window.times}
    for k, channel in enumerate(window.simulator.channels):
        telemetry[channel].loc[at] = observed[:, k]
    for k, name in enumerate(window.simulator.heaters):
        for channel in status_channels(window.scenario, name):
            telemetry[channel].loc[at] = status[:, k]
