"""Propagating draws of theta to temperatures with intervals, and to heater status.

Where thermostats may fall out of step, temperatures are far from normal: they have two humps, of a heater that is on
and of one that is off. So what telemetry is held to is the distribution of the draws themselves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import RunError
from ..problem import Window
from ..scenario import is_trained
from ..simulator import SCATTERED, FloatArray, Trajectory
from .duty import draw_duty_errors, sampled_duty_cycle
from .errors import WindowErrors
from .metrics import crps_of_draws, probability_below
from .thresholds import Thresholds, scattered

_FEWEST = 0.5  # share of simulations that must succeed


@dataclass(frozen=True)
class Ensemble:
    """Posterior simulations of one window, summarised; S simulations that did not fail."""

    mean: FloatArray
    """[T, N] K, of the simulation and of the discrepancy and noise expected with it."""
    standard_deviation: FloatArray
    """[T, N] K, of simulation, discrepancy and noise together."""
    lower: FloatArray
    """[T, N] K, of the interval for telemetry: simulation, discrepancy and noise together."""
    upper: FloatArray
    model_lower: FloatArray
    """[T, N] K, of the interval for the temperature itself: simulation and discrepancy, without noise."""
    model_upper: FloatArray
    crps: FloatArray
    """[T, N] K, of telemetry in the distribution of the draws, noise included; NaN where there is none."""
    probability_below: FloatArray
    """[T, N] of a temperature below telemetry's, in the same distribution; NaN where there is none."""
    status: FloatArray
    """[T, H] probability that the heater is on."""
    duty_cycle: FloatArray
    """[S, H], of the whole window."""
    sampled_duty_cycle: FloatArray
    """[S, H], of the samples whose status is known; NaN without any."""
    switch_count: FloatArray
    """[S, H]."""
    energy: FloatArray
    """[S, H] J over the window."""
    failed: int
    draws: FloatArray
    """[S, T, N] K, of telemetry: simulation, discrepancy and noise together."""
    lowest: FloatArray
    """[S, N] K, of the temperature itself, at the times that count; infinite without any."""
    highest: FloatArray
    discrepancy: FloatArray | None = None
    """[3, T, N] K: its mean, and lower and upper bound of its interval; None: there is none."""


def simulated(
    window: Window,
    thetas: FloatArray,
    rng: np.random.Generator,
    heat: FloatArray | None = None,
    thresholds: Thresholds | None = None,
    on: FloatArray | None = None,
) -> list[Trajectory | None]:
    """Simulations at thetas [S, q] of a window, as `propagate` makes them; None where one fails."""
    trained = is_trained(window.name)
    # Where the telemetry is known, so is when its heaters switched.
    added = None if thresholds is None else scattered(thresholds, SCATTERED, None if trained else rng)
    runs: list[Trajectory | None] = [None] * len(thetas)
    states, group = (None, np.zeros(len(thetas), int)) if on is None else np.unique(on, axis=0, return_inverse=True)
    for k in range(int(group.max()) + 1):
        here = np.flatnonzero(group.ravel() == k)
        begun = window if states is None else window.begun(states[k])
        of_heat = None if heat is None else heat[here]
        if added is not None and begun.is_network:
            made = begun.network.simulate_switching(thetas[here][:, window.simulated], added[here], of_heat)
        elif trained:
            made = begun.simulate_many(thetas[here], of_heat)
        else:
            made = begun.simulate_as_flown(thetas[here], rng, of_heat)
        for place, run in zip(here.tolist(), made, strict=True):
            runs[place] = run
    return runs


def propagate(
    window: Window,
    thetas: FloatArray,
    interval: float,
    rng: np.random.Generator,
    errors: WindowErrors | None = None,
    heat: FloatArray | None = None,
    thresholds: Thresholds | None = None,
    known: FloatArray | None = None,
    on: FloatArray | None = None,
    counting: NDArray[np.bool_] | None = None,
) -> Ensemble:
    """Simulate at thetas [S, q] in one batch, add a surrogate's error, discrepancy and noise of each, and summarise.

    On a window that was not trained on, thermostats scatter around their thresholds as far as the scenario says.
    interval: probability inside, such as 0.95; errors: of each theta (None: independent noise); heat: [S, h, 2 K] W
    that no block describes, of each theta; thresholds: of each theta (None: as written); known:
    [S, T, N] K, a surrogate's error of each theta (None: drawn); on: [S, H] heaters that are on at first (None: as
    the status or the scenario says); counting: [T] times at which extremes are looked for (None: all). Raises RunError
    when more than half of the simulations fail.
    """
    trained, runs = is_trained(window.name), simulated(window, thetas, rng, heat, thresholds, on)
    usable = np.ones(len(thetas), bool) if errors is None else errors.usable()
    usable &= np.array([run is not None for run in runs], bool)
    kept = [(theta, run) for theta, run, good in zip(thetas, runs, usable, strict=True) if run is not None and good]
    if len(kept) < _FEWEST * len(thetas):
        raise RunError(f"window '{window.name}': {len(thetas) - len(kept)} of {len(thetas)} simulations failed")
    kelvins = np.stack([run.temperatures for _, run in kept])  # [S, T, N]
    discrepancy = None
    tails = [0.5 * (1 - interval), 0.5 * (1 + interval)]
    basis = window.simulator.error_basis
    if known is not None:
        kelvins += known[usable]
    elif basis is not None:
        weights = np.stack([np.sqrt(run.error_variance) for _, run in kept])  # [S, r]
        kelvins += np.einsum("tnr,sr->stn", basis, weights * rng.standard_normal(weights.shape))
    if errors is None:
        noise = np.stack([window.noise(theta) for theta, _ in kept])  # [S, N]
        mean, noisy = kelvins.mean(axis=0), kelvins + noise[:, None, :] * rng.standard_normal(kelvins.shape)
        deviation = np.sqrt(kelvins.var(axis=0) + (noise**2).mean(axis=0))
    else:
        drawn = errors.only(usable).draw(kelvins, rng)
        mean = (kelvins + drawn.mean).mean(axis=0)
        kelvins = kelvins + drawn.discrepancy
        noisy = kelvins + drawn.noise + drawn.white
        deviation = noisy.std(axis=0)
        if window.residuals.terms.discrepant.any():
            bounds = np.quantile(drawn.discrepancy, tails, axis=0)
            discrepancy = np.concatenate([drawn.discrepancy.mean(axis=0)[None], bounds])
    lower, upper = np.quantile(noisy, tails, axis=0)
    within = kelvins if counting is None else kelvins[:, counting]
    model_lower, model_upper = np.quantile(kelvins, tails, axis=0)
    heaters = len(window.simulator.heaters)
    duty_cycle = np.stack([run.duty_cycle for _, run in kept])
    status = np.stack([run.status for _, run in kept])
    sampled = sampled_duty_cycle(status, window.status)
    if errors is not None and not trained:
        drawn_duty = draw_duty_errors(errors.duty, window.duration / window.period, len(kept), rng)
        duty_cycle, sampled = (np.clip(duties + drawn_duty, 0.0, 1.0) for duties in (duty_cycle, sampled))
    power = np.stack([window.simulator.heater_power(theta[window.simulated]) for theta, _ in kept])
    return Ensemble(
        mean=mean,
        standard_deviation=deviation,
        lower=lower,
        upper=upper,
        model_lower=model_lower,
        model_upper=model_upper,
        crps=crps_of_draws(window.observed, noisy),
        probability_below=probability_below(window.observed, noisy),
        status=status.mean(axis=0),
        duty_cycle=duty_cycle,
        sampled_duty_cycle=sampled,
        switch_count=np.stack([np.bincount(run.switches.heater, minlength=heaters) for _, run in kept]).astype(float),
        energy=duty_cycle * power * window.duration,
        failed=len(thetas) - len(kept),
        draws=noisy,
        lowest=within.min(axis=1, initial=np.inf),
        highest=within.max(axis=1, initial=-np.inf),
        discrepancy=discrepancy,
    )
