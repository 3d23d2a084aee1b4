"""Everything that is predicted about one window, by every method, as one labelled dataset."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import xarray

from ..emulation import EmulatedSimulator
from ..environment import orbit_phase, sunlit_share
from ..problem import Problem, build_problem
from ..scenario import Scenario, SimulatorModel, is_trained
from ..simulator import FloatArray, Trajectory
from .duty import FEWEST_ORBITS
from .ensemble import Ensemble, duration, propagate
from .errors import WhiteErrors, WindowErrors, window_errors
from .initial import condition_initial
from .innovations import discrepancy_in_words, innovations, noise_in_words

STOCHASTIC = "stochastic"


def predict(
    scenario: Scenario,
    telemetry: xarray.Dataset,
    window: str,
    points: Mapping[str, FloatArray],
    draws: FloatArray,
    *,
    seed: int,
    stand_in: Callable[[Problem], Problem] | None = None,
    trained: tuple[str, FloatArray] | None = None,
) -> tuple[xarray.Dataset, Ensemble]:
    """Predict a window with point estimates and with posterior draws.

    points: method -> theta [d], with ``noise.*`` the method's own residual level; draws: posterior thetas [S, d]; both
    ordered as `Problem.names`. On the train window thetas hold its initial temperatures; on any other, these are
    conditioned on the first samples of the window (`initial.condition_initial`), which are marked as not scored.
    trained: window whose residuals tell the discrepancy, and the draws there [S, d'] (None: `train`, and `draws`).
    stand_in: gives a window's problem an emulator, through which the draws are propagated; points always run on the
    simulator itself.
    Raises TelemetryError and RunError.
    """
    settings = scenario.calibration.prediction
    rng = np.random.default_rng([seed, *window.encode()])
    problem = build_problem(scenario, telemetry, window)
    for_draws = problem if stand_in is None else stand_in(problem)
    scored = np.ones(len(problem.times), bool)
    thetas = np.stack(list(points.values())) if points else np.empty((0, draws.shape[1]))
    if not is_trained(window):
        first = build_problem(scenario, telemetry, window, span=settings.initial_span)
        scored = problem.times > first.times[-1]
    errors = None
    if not problem.residuals.is_independent:
        name, thetas_there = trained or ("train", draws)
        train = for_draws
        if window != name:
            train = build_problem(scenario, telemetry, name)
            train = train if stand_in is None else stand_in(train)
        errors = window_errors(for_draws, train, thetas_there, int((~scored).sum()))
    if not is_trained(window):
        if len(thetas):
            thetas = condition_initial(first, thetas, _white(problem, thetas))
        if isinstance(for_draws.simulator, EmulatedSimulator):
            first = replace(first, simulator=for_draws.simulator.on(slice(len(first.times))))
        draws = condition_initial(first, draws, _white(problem, draws) if errors is None else errors.at_first(), rng)
    ensemble = propagate(for_draws, draws, settings.interval, rng, errors)
    runs = problem.simulate_many(thetas) if len(thetas) else []
    prediction = _dataset(problem, dict(zip(points, runs, strict=True)), thetas, ensemble, scored)
    error = "" if for_draws.simulator.error_basis is None else ", the surrogate's error"
    scatter = ", scatter of the thermostats" if not is_trained(window) and _scatters(scenario) else ""
    if errors is not None:
        prediction = prediction.assign(_residual_model(problem, errors, ensemble, rng))
    prediction.attrs |= {
        "interval": settings.interval,
        "interval_contains": f"parameters, initial temperatures{error}{scatter}, {_contained(problem, window)}",
        "model_interval_contains": f"parameters, initial temperatures{error}{scatter}"
        + (", model discrepancy" if problem.residuals.terms.discrepant.any() else ""),
        "duty_cycle_contains": f"parameters, initial temperatures{scatter}{_of_duty(errors, window)}",
        "initial_state": "calibrated with the parameters"
        if is_trained(window)
        else f"estimated from the first {settings.initial_span / 60:g} min of the window, which are not scored",
        "failed_simulations": ensemble.failed,
    }
    return prediction, ensemble


def _white(problem: Problem, thetas: FloatArray) -> WhiteErrors:
    """Independent noise of thetas [S, d]: what the methods know of that have no model of the residuals."""
    return WhiteErrors(np.stack([problem.noise(theta) for theta in thetas]))


def _residual_model(
    problem: Problem, errors: WindowErrors, ensemble: Ensemble, rng: np.random.Generator
) -> dict[str, tuple[str | tuple[str, ...], object]]:
    """Variables of a window whose residuals are more than iid noise: what is assumed, and what should be white."""
    model = problem.residuals
    numbers = np.median(errors.numbers, axis=0)
    by_sample = ("time", "channel")
    found: dict[str, tuple[str | tuple[str, ...], object]] = {
        "noise": ("channel", noise_in_words(model)),
        "discrepant": ("channel", discrepancy_in_words(model)),
        "innovation": (
            by_sample,
            innovations(model, problem.observed - ensemble.mean, errors.seconds, numbers, rng),
        ),
    }
    if ensemble.discrepancy is not None:
        names = ("discrepancy_mean", "discrepancy_lower", "discrepancy_upper")
        found |= {name: (by_sample, values) for name, values in zip(names, ensemble.discrepancy, strict=True)}
    return found


def _contained(problem: Problem, window: str) -> str:
    """What of the residuals is in the interval, and which part of the discrepancy carries over to the window."""
    model = problem.residuals
    correlated = any(kind.has_memory for kind in model.terms.kinds)
    noise = "correlated measurement noise (drawn anew)" if correlated else "measurement noise"
    if not model.terms.discrepant.any():
        return f"{noise}; not model discrepancy"
    if is_trained(window):
        return f"{noise}, and model discrepancy as the residuals of this window show it"
    parts = []
    if model.phase is not None:
        parts.append("its part in orbit phase carries over from the training window")
    if model.time is not None:
        parts.append("its part in time is continued from the edge of the training window and fades to its prior")
    return f"{noise}, and model discrepancy: {'; '.join(parts)}"


def _of_duty(errors: WindowErrors | None, window: str) -> str:
    """What else the interval of a duty cycle has."""
    if errors is None or is_trained(window):
        return ""
    orbits = int(np.isfinite(errors.duty).sum(axis=0).max(initial=0))
    if orbits < FEWEST_ORBITS:
        return f"; not its error, which takes {FEWEST_ORBITS} whole orbits of training to tell (here {orbits})"
    return f", its error as in {orbits} orbits of the training window"


def _scatters(scenario: Scenario) -> bool:
    model = scenario.simulator
    return isinstance(model, SimulatorModel) and any(heater.scatter for heater in model.heaters.values())


def _dataset(
    problem: Problem,
    runs: Mapping[str, Trajectory | None],
    thetas: FloatArray,
    ensemble: Ensemble,
    scored: FloatArray,
) -> xarray.Dataset:
    samples, channels = problem.observed.shape
    heaters = len(problem.simulator.heaters)
    methods = [*runs, STOCHASTIC]
    seconds = duration(problem)
    mean = np.full((len(methods), samples, channels), np.nan)
    lower, upper, deviation = mean.copy(), mean.copy(), mean.copy()
    status = np.full((len(methods), samples, heaters), np.nan)
    duty = np.full((len(methods), heaters), np.nan)
    count, energy = duty.copy(), duty.copy()
    for k, run in enumerate(runs.values()):
        if run is None:
            continue
        mean[k], status[k], duty[k] = run.temperatures, run.status, run.duty_cycle
        count[k] = np.bincount(run.switches.heater, minlength=heaters)
        energy[k] = run.duty_cycle * problem.simulator.heater_power(thetas[k][problem.simulated]) * seconds
    mean[-1], lower[-1], upper[-1] = ensemble.mean, ensemble.lower, ensemble.upper
    deviation[-1], status[-1] = ensemble.standard_deviation, ensemble.status
    duty[-1] = ensemble.duty_cycle.mean(axis=0)
    count[-1] = ensemble.switch_count.mean(axis=0)
    energy[-1] = ensemble.energy.mean(axis=0)
    environment, folder = problem.scenario.environment, problem.scenario.folder
    scenario = problem.scenario
    origin = np.datetime64(scenario.windows[scenario.train_windows[0]].start)  # phases of all windows are comparable
    by_method, by_simulation = ("method", "time", "channel"), ("simulation", "heater")
    return xarray.Dataset(
        {
            "observed": (("time", "channel"), problem.observed),
            "scored": ("time", scored),
            "mean": (by_method, mean),
            "lower": (by_method, lower),
            "upper": (by_method, upper),
            "standard_deviation": (by_method, deviation),
            "model_lower": (("time", "channel"), ensemble.model_lower),
            "model_upper": (("time", "channel"), ensemble.model_upper),
            "crps": (("time", "channel"), ensemble.crps),
            "probability_below": (("time", "channel"), ensemble.probability_below),
            "observed_status": (("time", "heater"), problem.status),
            "status": (("method", "time", "heater"), status),
            "duty_cycle": (by_simulation, ensemble.duty_cycle),
            "switch_count": (by_simulation, ensemble.switch_count),
            "energy": (by_simulation, ensemble.energy),
            "point_duty_cycle": (("method", "heater"), duty),
            "point_switch_count": (("method", "heater"), count),
            "point_energy": (("method", "heater"), energy),
            "observed_duty_cycle": ("heater", _observed_duty_cycle(problem.status)),
            "observed_switch_count": ("heater", _observed_switch_count(problem.status)),
            "eclipse": ("time", sunlit_share(environment, problem.times, folder)),
            "orbit_phase": ("time", orbit_phase(environment, problem.times, folder, origin)),
        },
        coords={
            "time": problem.times,
            "channel": list(problem.simulator.channels),
            "heater": list(problem.simulator.heaters),
            "method": methods,
        },
    )


def _observed_duty_cycle(status: FloatArray) -> FloatArray:
    """Share of the valid status samples [T, H] that are on, [H]; NaN without any."""
    valid = np.isfinite(status)
    return np.divide(
        np.where(valid, status, 0.0).sum(axis=0),
        valid.sum(axis=0),
        out=np.full(status.shape[1], np.nan),
        where=valid.any(axis=0),
    )


def _observed_switch_count(status: FloatArray) -> FloatArray:
    """Changes between neighbouring valid status samples [T, H], [H]; NaN without any."""
    counts = np.full(status.shape[1], np.nan)
    for k in range(status.shape[1]):
        valid = status[np.isfinite(status[:, k]), k]
        if len(valid):
            counts[k] = np.count_nonzero(np.diff(valid > 0.5))
    return counts
