"""Unmodelled heat in a prediction: drawn given the telemetry, and injected, so that thermostats answer to it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..probability import Slow
from ..problem import (
    SLOW,
    HeatModel,
    Problem,
    Window,
    errors_of_weights,
    exact_heat,
    heat_of_weights,
    knots_of,
    own_groups,
    shifts_of_weights,
    split,
    unit_heats,
    whole_weights,
)
from ..simulator import FloatArray, Trajectory
from .errors import WindowErrors
from .initial import final_temperatures
from .thresholds import Thresholds, draw_thresholds

_SAME_TIME = np.timedelta64(1, "s")
_MISSED = 1e-3
"""K, by which a draw's simulation may be off what its weights of heat stand for: as little as no interval shows."""


@dataclass(frozen=True)
class End:
    """The end of a training window, in S draws."""

    time: np.datetime64
    temperatures: FloatArray
    """[S, n] K of what has an initial temperature, in the order of theta; NaN where a simulation failed."""
    noise: FloatArray
    """[S, N] K, of the noise with a memory, as the last residuals show it."""
    on: FloatArray
    """[H] heaters that are on, NaN where that is not known."""


@dataclass(frozen=True)
class DrawnHeat:
    """Weights of heat of S posterior draws: as the telemetry leaves them, and as their prior has what it tells not."""

    model: HeatModel
    weights: tuple[FloatArray, ...]
    """Of each group [S, f]."""
    scales: tuple[FloatArray, ...]
    """Of each group [S], their prior deviations."""
    usable: NDArray[np.bool_]
    """[S] whether the training windows could be simulated."""
    thresholds: Thresholds | None
    """Of the thermostats; None: as the scenario writes them."""
    ends: tuple[End, ...]
    """Of the training windows."""
    fitted: Mapping[str, FloatArray]
    """Of each training window [T, N] K, mean over the draws, simulated as it was learnt from: with heaters driven by
    their measured status, where there is one."""

    def continued(self, start: np.datetime64) -> End | None:
        """The end of a training window at a time; None: none ends there."""
        for end in self.ends:
            if abs(start - end.time) <= _SAME_TIME and bool(np.isfinite(end.temperatures).all(axis=1).any()):
                return end
        return None

    def in_window(self, window: Window, rng: np.random.Generator) -> HeatIn:
        """What it is in a window: what comes again does, what is slow goes on from the training windows and fades."""
        knots = knots_of(self.model, window)
        weights = list(self.weights)
        if self.model.slow is not None:
            expected, factor = self.model.slow.beyond(knots)
            for g, group in enumerate(self.model.groups):
                if group.part in SLOW:
                    known = self.weights[g].reshape(len(self.usable), -1, len(self.model.slow.knots))
                    new = rng.standard_normal((*known.shape[:2], len(knots))) @ factor.T
                    values = known @ expected.T + self.scales[g][:, None, None] * new
                    weights[g] = values.reshape(len(values), -1)
        slow = None if self.model.slow is None else Slow(knots, self.model.slow.time, plain=True)
        model = replace(self.model, slow=slow)
        for own_group in own_groups(window, model.gains):
            if own_group not in model.groups:
                model = replace(model, groups=(*model.groups, own_group))
                weights.append(rng.standard_normal((len(self.usable), len(unit_heats(model, window)[-1].series))))
        return HeatIn(model, tuple(weights))


@dataclass(frozen=True)
class HeatIn:
    """Weights of heat of S draws in one window, or in a part of it."""

    model: HeatModel
    weights: tuple[FloatArray, ...]
    """Of each group [S, f]."""

    def errors(self, window: Window) -> FloatArray | None:
        """The simulator's errors [S, T, N] K in a training window; None of any other: they tell nothing of it."""
        if not any(group.part == "error" and group.window == window.name for group in self.model.groups):
            return None
        return np.asarray(errors_of_weights(unit_heats(self.model, window), self.weights))

    def on(self, window: Window) -> FloatArray:
        """Heat [S, h, 2 K] W in the steps of the window's integration."""
        return heat_of_weights(self.model, unit_heats(self.model, window), self.weights)


def draw_heat(problem: Problem, draws: FloatArray, rng: np.random.Generator) -> DrawnHeat:
    """Weights of heat at posterior draws [S, d] of a problem with heat."""
    model = problem.heat
    assert model is not None
    runs = problem.simulate_many(draws)
    usable = np.array([of_draw is not None for of_draw in runs], bool)
    kept = np.zeros((len(draws), len(model.group)))
    done = [of_draw for of_draw in runs if of_draw is not None]
    if done:
        kept[usable] = exact_heat(problem, done, draws[usable], rng, within=_MISSED).weights
    weights, scales = whole_weights(problem, draws, kept, rng)
    thetas, heats, ends, fitted = [], [], [], {}
    for window in problem.windows:
        of_window, units = problem.at(window, draws), unit_heats(model, window)
        functions = split(model, kept - model.centre)
        heat = heat_of_weights(model, units, functions)
        found = window.simulate_many(of_window, heat)
        usable &= np.array([run is not None for run in found], bool)
        errors = np.zeros((len(draws), *window.observed.shape)) + errors_of_weights(units, functions)
        ends.append(_end(window, of_window, found, errors, rng))
        done_runs = [run.temperatures + error for run, error in zip(found, errors, strict=True) if run is not None]
        fitted[window.name] = np.mean(done_runs, axis=0) if done_runs else np.full(window.observed.shape, np.nan)
        thetas.append(of_window)
        heats.append(heat)
    shifts = [shifts_of_weights(model, window, weights) for window in problem.windows]
    thresholds = draw_thresholds(problem.windows, thetas, heats, shifts, rng)
    return DrawnHeat(model, weights, scales, usable, thresholds, tuple(ends), fitted)


def _end(
    window: Window,
    thetas: FloatArray,
    runs: Sequence[Trajectory | None],
    errors: FloatArray,
    rng: np.random.Generator,
) -> End:
    """Where a training window ends, at thetas [S, q], their simulations with heat, and these errors [S, T, N] K."""
    time = window.span[1]
    noise = np.zeros((len(runs), window.observed.shape[1]))
    for k, kind in enumerate(window.residuals.terms.kinds):
        last = np.flatnonzero(window.valid[:, k])[-1:]
        if not len(last) or not kind.has_memory:
            continue
        gap = np.array([(time - window.times[last[0]]) / np.timedelta64(1, "ns") * 1e-9])
        for s, (theta, run) in enumerate(zip(thetas, runs, strict=True)):
            numbers = window.numbers(theta)[k]
            process, white = float(kind.covariance(numbers, np.zeros(1))[0]), kind.white_variance(numbers)
            fading = float(kind.covariance(numbers, gap)[0]) / process
            left = 0.0 if run is None else float((window.observed - run.temperatures - errors[s])[last[0], k])
            known = process * white / (process + white)
            variance = fading**2 * known + process * (1.0 - fading**2)
            noise[s, k] = fading * left * process / (process + white) + np.sqrt(variance) * rng.standard_normal()
    return End(time, final_temperatures(window, runs), noise, window.status[-1])


@dataclass(frozen=True)
class Heated:
    """What unmodelled heat makes of one window's prediction, in S draws."""

    errors: WindowErrors
    """Noise: beside heat there is no discrepancy."""
    injected: HeatIn
    thresholds: Thresholds | None
    """Of the thermostats; None: as the scenario writes them."""
    ended: End | None
    """Of the training window that it goes on from; None: of none."""
    known: FloatArray | None
    """[S, T, N] K, the simulator's errors as they are in training; None: they are not known."""
    on: FloatArray | None
    """[S, H] heaters that are on at first; None: not found in training."""
    fitted: FloatArray | None
    """[T, N] K, what telemetry of a training window is held to; None of any other."""


def heated_window(
    problem: Problem, window: Window, thetas: FloatArray, drawn: DrawnHeat, first: int, rng: np.random.Generator
) -> Heated:
    """Heat of posterior draws in a window, at its thetas [S, q].

    first: how many samples at its start tell about its errors; none do where training ends at the start.
    """
    injected = drawn.in_window(window, rng)
    trained = next((trained_window for trained_window in problem.windows if trained_window.name == window.name), None)
    ended = drawn.continued(window.start) if trained is None else None
    on = None
    if window.unmeasured and ended is not None:
        on = _with_held(window, ended.on, len(thetas))
    elif window.unmeasured and trained is not None:
        on = _with_held(window, trained.status[0], len(thetas))
    errors = _noise_errors(problem, window, thetas, drawn.usable, first if ended is None else 0, ended)
    known = injected.errors(window)
    return Heated(errors, injected, drawn.thresholds, ended, known, on, drawn.fitted.get(window.name))


def _with_held(window: Window, status: FloatArray, count: int) -> FloatArray:
    """[count, H] heaters that are on at first: those without a status as in training [H], where it has been found."""
    found = np.isfinite(status) & np.isin(np.arange(len(status)), window.unmeasured)
    return np.tile(np.where(found, status, window.network.drive.initially_on), (count, 1))


def _noise_errors(
    problem: Problem,
    window: Window,
    thetas: FloatArray,
    usable: NDArray[np.bool_],
    first: int,
    ended: End | None,
) -> WindowErrors:
    """Errors of a window beside heat: noise alone, at its thetas [S, q].

    first: as in `WindowErrors`; ended: the training window that it goes on from, if any.
    """
    train = problem.nearest(window.times[0])
    channels = len(window.residuals.terms.kinds)
    numbers = np.stack([window.numbers(theta) for theta in thetas])
    simulated = np.where(usable[:, None, None], 0.0, np.full((len(thetas), 1, 1), np.nan))
    none = np.zeros((channels, 0)), np.zeros((channels, 0, 0))
    duty = np.empty((0, window.status.shape[1]))
    before = None if ended is None else ended.noise
    return WindowErrors(window, train, numbers, simulated, first, duty, (none,) * len(thetas), before)
