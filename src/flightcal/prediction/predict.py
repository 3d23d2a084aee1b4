"""Everything that is predicted about one window, by every method, as one labelled dataset."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import xarray

from ..emulation import EmulatedSimulator
from ..environment import orbit_phase, sunlit_share, timespan
from ..probability import Shaped
from ..problem import Problem, Window, build_window, dressed
from ..run import labelled
from ..scenario import Scenario, SimulatorModel, is_trained
from ..simulator import FloatArray, Trajectory
from .duty import FEWEST_ORBITS, sampled_duty_cycle, unknown_share
from .ensemble import Ensemble, propagate
from .errors import WindowErrors, white_errors, window_errors
from .heat import DrawnHeat, Heated, draw_heat, heated_window
from .holding import replicate
from .initial import around_usual, begun, condition_initial, initial_places
from .innovations import innovations, noise_in_words
from .labels import LABELS
from .lead import UNKNOWN, lead_up_to
from .limits import to_come
from .metrics import STOCHASTIC
from .unseen import unseen_attribute


def predict(
    problem: Problem,
    telemetry: xarray.Dataset,
    name: str,
    points: Mapping[str, FloatArray],
    draws: FloatArray,
    *,
    seed: int,
    heat: DrawnHeat | None = None,
    stand_in: Callable[[Window], Window] = lambda window: window,
) -> tuple[xarray.Dataset, Ensemble]:
    """Predict a window of the problem's scenario, by name, with point estimates and with posterior draws.

    points: method -> theta [d], with ``noise.*`` the method's own residual level; draws: posterior thetas [S, d]; both
    ordered as `Problem.names`. On windows that were trained on thetas hold the initial temperatures; on any other,
    these are conditioned on the first samples of the window (`initial.condition_initial`), which are marked as not
    scored. What telemetry differs by is learnt from the training window that is nearest.
    heat: that of the draws (`draw_heat`), where it has been drawn.
    stand_in: gives a window an emulator, through which the draws are propagated; points always run on the simulator
    itself.
    Raises TelemetryError and RunError.
    """
    settings = problem.scenario.calibration.prediction
    rng = np.random.default_rng([seed, *name.encode()])
    trained = {window.name: window for window in problem.flown or problem.windows}
    window = trained.get(name) or _like_trained(problem, build_window(problem.scenario, telemetry, name))
    for_draws = stand_in(window)
    thetas = problem.at(window, np.stack(list(points.values())) if points else np.empty((0, draws.shape[1])))
    inside = problem.at(window, draws, rng)
    first = None if name in trained else around_usual(_first_of(problem, window, telemetry), problem, draws)
    scored = np.ones(len(window.times), bool) if first is None else window.times > first.times[-1]
    heated, errors, led = None, None, None
    drawn = heat if problem.heat is None or heat is not None else draw_heat(problem, draws, rng)
    if drawn is not None:
        heated = heated_window(problem, window, inside, drawn, int((~scored).sum()), rng)
        errors = heated.errors
    elif not window.residuals.is_independent:
        errors = window_errors(problem, for_draws, draws, int((~scored).sum()), stand_in)
    ended, on = (None, None) if heated is None else (heated.ended, heated.on)
    if first is not None:
        if len(thetas):
            thetas = condition_initial(first, thetas, white_errors(window, thetas))
        if ended is not None:
            scored[:] = True
            inside[:, initial_places(window)] = ended.temperatures
        elif (led := lead_up_to(problem, telemetry, window, draws, inside, drawn, rng)) is not None:
            scored[:] = True
            inside, on = led.thetas, led.on
        else:
            if isinstance(for_draws.simulator, EmulatedSimulator):
                first = replace(first, simulator=for_draws.simulator.on(slice(len(first.times))))
            at_first = white_errors(first, inside) if errors is None else errors.at_first()
            of_first = None if heated is None else heated.injected.on(first)
            inside, on = begun(problem, first, inside, at_first, rng, of_first)
    of_heat: dict[str, Any] = {}
    if heated is not None:
        of_heat = {"heat": heated.injected.on(window), "thresholds": heated.thresholds, "known": heated.known}
    coming = np.zeros(len(window.times), bool)
    if name not in trained and problem.scenario.windows[name].planned:
        coming = to_come(window.times, window.observed)
    if coming.any():
        # Of a plan that goes on from telemetry, the first minutes belong to that.
        scored &= coming | (window.times >= window.start + timespan(settings.initial_span))
    counting = coming if coming.any() else scored
    ensemble = propagate(for_draws, inside, settings.interval, rng, errors, on=on, counting=counting, **of_heat)
    runs = window.simulate_many(thetas) if len(thetas) else []
    prediction = _dataset(window, dict(zip(points, runs, strict=True)), thetas, ensemble, scored)
    seconds = (window.times - window.times[0]) / np.timedelta64(1, "s")
    replicated = replicate(seconds, window.observed, scored, ensemble.draws, settings.interval)
    prediction = prediction.merge(replicated.dataset())
    if heated is not None and heated.thresholds is not None:
        offset, least = heated.thresholds.told
        prediction = prediction.assign_coords(direction=["on", "off"])
        prediction = prediction.assign(
            threshold_offset=(("direction", "heater"), offset), least_threshold_offset=(("direction", "heater"), least)
        )
    if errors is not None:
        fitted = ensemble.mean if heated is None or heated.fitted is None else heated.fitted
        prediction = prediction.assign(_residual_model(window, errors, ensemble, fitted, rng))
    prediction.attrs |= {"interval": settings.interval, "failed_simulations": ensemble.failed}
    prediction.attrs |= {"planned": 1} if coming.any() else {}
    prediction.attrs |= _in_words(for_draws, errors, heated, trained, settings.initial_span)
    if led is not None:
        prediction.attrs["initial_state"] = led.words
    elif first is not None and not np.isfinite(first.observed).any():
        prediction.attrs["initial_state"] = UNKNOWN
    prediction.attrs |= unseen_attribute(trained, window, ensemble.mean)
    return labelled(prediction, LABELS), ensemble


def _first_of(problem: Problem, window: Window, telemetry: xarray.Dataset) -> Window:
    """A window that was not trained on, cut to the first samples, which tell its initial temperatures."""
    span = problem.scenario.calibration.prediction.initial_span
    first = _like_trained(problem, build_window(problem.scenario, telemetry, window.name, span=span))
    # Heat in a gap that goes on beyond the first samples is one, and changes of mode are counted from the start.
    return replace(first, bridged=window.bridged, changes=window.changes)


def _like_trained(problem: Problem, window: Window) -> Window:
    """A window that reads what the calibration knows."""
    return window if problem.heat is None else dressed(window, problem.heat)


def _residual_model(
    window: Window, errors: WindowErrors, ensemble: Ensemble, fitted: FloatArray, rng: np.random.Generator
) -> dict[str, tuple[str | tuple[str, ...], object]]:
    """Variables of a window whose residuals are more than iid noise: what is assumed, and what should be white.

    fitted: [T, N] K, what telemetry is held to.
    """
    model = window.residuals
    numbers = np.median(errors.numbers, axis=0)
    by_sample = ("time", "channel")
    found: dict[str, tuple[str | tuple[str, ...], object]] = {
        "noise": ("channel", noise_in_words(model)),
        "discrepant": ("channel", model.terms.discrepant),
        "innovation": (
            by_sample,
            innovations(model, window.observed - fitted, errors.seconds, numbers, rng),
        ),
    }
    if ensemble.discrepancy is not None:
        names = ("discrepancy_mean", "discrepancy_lower", "discrepancy_upper")
        found |= {name: (by_sample, values) for name, values in zip(names, ensemble.discrepancy, strict=True)}
    return found


def _in_words(
    window: Window,
    errors: WindowErrors | None,
    heated: Heated | None,
    trained: Mapping[str, Window],
    initial_span: float,
) -> dict[str, str]:
    """What intervals contain, and where the window's initial state is from. window: as draws are propagated through."""
    is_unseen = window.name not in trained
    error = "" if window.simulator.error_basis is None else ", the surrogate's error"
    if heated is not None:
        error += ", unmodelled heat"
    scatter = ", scatter of the thermostats" if is_unseen and _scatters(window.scenario) else ""
    discrepancy = ", model discrepancy" if window.residuals.terms.discrepant.any() else ""
    if not is_unseen:
        state = "calibrated with the parameters"
    elif heated is not None and heated.ended is not None:
        state = "that of the end of the training window"
    else:
        state = f"estimated from the first {initial_span / 60:g} min of the window, which are not scored"
    of_duty = _of_duty(errors, window.name, len(trained), heated=heated is not None)
    return {
        "interval_contains": f"parameters, initial temperatures{error}{scatter}, {_contained(window)}",
        "model_interval_contains": f"parameters, initial temperatures{error}{scatter}{discrepancy}",
        "duty_cycle_contains": f"parameters, initial temperatures{scatter}{of_duty}",
        "initial_state": state,
    }


def _contained(window: Window) -> str:
    """What of the residuals is in the interval, and whether the discrepancy carries over to the window."""
    model = window.residuals
    correlated = any(kind.has_memory for kind in model.terms.kinds)
    noise = "correlated measurement noise (drawn anew)" if correlated else "measurement noise"
    if any(isinstance(kind, Shaped) for kind in model.terms.kinds):
        return noise
    if not model.terms.discrepant.any():
        return f"{noise}; not model discrepancy"
    if is_trained(window.name):
        return f"{noise}, and model discrepancy as the residuals of this window show it"
    return f"{noise}, and model discrepancy as it carries over from the training window"


def _of_duty(errors: WindowErrors | None, name: str, windows: int, *, heated: bool) -> str:
    """What else the interval of a duty cycle has."""
    if errors is None or is_trained(name):
        return ""
    if heated:
        return ", unmodelled heat, thresholds as the measured switches show them"
    orbits = int(np.isfinite(errors.duty).sum(axis=0).max(initial=0))
    if orbits < FEWEST_ORBITS:
        return (
            f"; not its error, which takes {FEWEST_ORBITS} whole orbits of training with a known status to tell; there "
            f"{'is' if orbits == 1 else 'are'} {orbits}"
        )
    return f", its error as in {orbits} orbits of the training window{'s' if windows > 1 else ''}"


def _scatters(scenario: Scenario) -> bool:
    model = scenario.simulator
    return isinstance(model, SimulatorModel) and any(heater.scatter for heater in model.switches.values())


def _dataset(
    window: Window,
    runs: Mapping[str, Trajectory | None],
    thetas: FloatArray,
    ensemble: Ensemble,
    scored: FloatArray,
) -> xarray.Dataset:
    samples, channels = window.observed.shape
    heaters = len(window.simulator.heaters)
    methods = [*runs, STOCHASTIC]
    mean = np.full((len(methods), samples, channels), np.nan)
    lower, upper, deviation = mean.copy(), mean.copy(), mean.copy()
    status = np.full((len(methods), samples, heaters), np.nan)
    duty = np.full((len(methods), heaters), np.nan)
    count, energy = duty.copy(), duty.copy()
    elapsed = np.asarray((window.times - window.start) / np.timedelta64(1, "s"), float)
    for k, run in enumerate(runs.values()):
        if run is None:
            continue
        mean[k], status[k], duty[k] = run.temperatures, run.status, run.duty_cycle
        count[k] = np.bincount(run.switches.heater, minlength=heaters)
        energy[k] = run.duty_cycle * window.simulator.heater_power(thetas[k][window.simulated]) * window.duration
    mean[-1], lower[-1], upper[-1] = ensemble.mean, ensemble.lower, ensemble.upper
    deviation[-1], status[-1] = ensemble.standard_deviation, ensemble.status
    duty[-1] = ensemble.duty_cycle.mean(axis=0)
    sampled = sampled_duty_cycle(status, window.status)
    sampled[-1] = ensemble.sampled_duty_cycle.mean(axis=0)
    count[-1] = ensemble.switch_count.mean(axis=0)
    energy[-1] = ensemble.energy.mean(axis=0)
    environment, folder = window.scenario.environment, window.scenario.folder
    scenario = window.scenario
    origin = np.datetime64(scenario.windows[scenario.train_windows[0]].start)  # phases of all windows are comparable
    by_method, by_simulation = ("by", "time", "channel"), ("simulation", "heater")
    return xarray.Dataset(
        {
            "observed": (("time", "channel"), window.observed),
            "scored": ("time", scored),
            "mean": (by_method, mean),
            "lower": (by_method, lower),
            "upper": (by_method, upper),
            "standard_deviation": (by_method, deviation),
            "model_lower": (("time", "channel"), ensemble.model_lower),
            "model_upper": (("time", "channel"), ensemble.model_upper),
            "lowest": (("simulation", "channel"), ensemble.lowest),
            "highest": (("simulation", "channel"), ensemble.highest),
            "crps": (("time", "channel"), ensemble.crps),
            "probability_below": (("time", "channel"), ensemble.probability_below),
            "observed_status": (("time", "heater"), window.status),
            "status": (("by", "time", "heater"), status),
            "duty_cycle": (by_simulation, ensemble.duty_cycle),
            "sampled_duty_cycle": (by_simulation, ensemble.sampled_duty_cycle),
            "switch_count": (by_simulation, ensemble.switch_count),
            "energy": (by_simulation, ensemble.energy),
            "point_duty_cycle": (("by", "heater"), duty),
            "point_sampled_duty_cycle": (("by", "heater"), sampled),
            "point_switch_count": (("by", "heater"), count),
            "point_energy": (("by", "heater"), energy),
            "observed_duty_cycle": ("heater", sampled_duty_cycle(window.status, window.status)),
            "unknown_status": ("heater", unknown_share(window.status, elapsed, window.duration)),
            "observed_switch_count": ("heater", _observed_switch_count(window.status)),
            "eclipse": ("time", sunlit_share(environment, window.times, folder)),
            "orbit_phase": ("time", orbit_phase(environment, window.times, folder, origin)),
        },
        coords={
            "time": window.times,
            "channel": list(window.simulator.channels),
            "heater": list(window.simulator.heaters),
            "by": methods,
        },
    )


def _observed_switch_count(status: FloatArray) -> FloatArray:
    """Changes between neighbouring valid status samples [T, H], [H]; NaN without any."""
    counts = np.full(status.shape[1], np.nan)
    for k in range(status.shape[1]):
        valid = status[np.isfinite(status[:, k]), k]
        if len(valid):
            counts[k] = np.count_nonzero(np.diff(valid > 0.5))
    return counts
