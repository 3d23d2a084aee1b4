"""A grey-box peer: flightcal's network with process noise at every node, in an extended Kalman filter.

    dx = (A x + N x^4 + B w(t)) dt + sigma dW,    y = x + e,

theta, sigma and the deviations of e by the maximum of the innovations' likelihood and priors, as CTSM does it:
Kristensen, Madsen & Jorgensen (2004), Automatica 40, 225-237. Between grid points the drift is linear in x and t about
the last mean, so mean and covariance follow from one matrix exponential (Van Loan (1978), IEEE Trans. Autom. Control
23, 395-404); the mean is then corrected for the curvature of x^4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import xarray
from numba import njit
from scipy.optimize import minimize

from flightcal.probability import Priors
from flightcal.problem import Window
from flightcal.scenario import HalfNormal
from flightcal.simulator import Drive, NetworkSimulator
from flightcal.simulator.drive import drive_on, window_inputs

WIDE_PROCESS, WIDE_NOISE = 0.1, 3.0
"""Scales of the half-normal priors: K/s^0.5 (a random walk to 8 K in an orbit of 97 min) and K."""
_FURTHEST = 7.0
"""Of z, whose prior is about standard normal."""


class Equations(NamedTuple):
    """The network at one theta, dense."""

    linear: Any
    """A [n, n], 1/s."""
    radiative: Any
    """N [n, n], K^-3/s."""
    heat: Any
    """B w [K, 2, n] K/s at the start and the end of each step, linear in between."""
    process: Any
    """sigma [n], K/s^0.5."""
    mean: Any
    """Of the initial state [n], K."""
    covariance: Any
    """[n, n] K^2."""


class Filtered(NamedTuple):
    """What a filter says; means and variances are of a sample [G, N] given all that came before it."""

    log_likelihood: float
    mean: Any
    """K."""
    variance: Any
    """K^2, the measurement's noise included."""


@dataclass(frozen=True)
class Record:
    """Telemetry of a window on the grid of the filter, which has all the telemetry's times."""

    simulator: NetworkSimulator
    parameters: int
    """How many of theta's entries come before the initial temperatures."""
    drive: Drive
    sampled: Any
    """[T] grid points of the telemetry."""
    observed: Any
    """[G, N] K on the grid, NaN where there is no sample."""
    initial: Any
    """[2, n] mean and standard deviation of the initial state's prior, K."""

    def equations(self, theta: Any, process: Any) -> Equations:
        """The network at theta [p] (initial temperatures left out) with process noise [n]."""
        structure = self.simulator.network.structure
        system = self.simulator.system(np.concatenate([theta, self.initial[0]]))
        n = len(structure.mass)
        A, N, B = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, self.drive.inputs.shape[2]))
        rows = np.arange(n)
        A[np.repeat(rows, np.diff(structure.linear_start)), structure.linear_column] = system.linear
        N[np.repeat(rows, np.diff(structure.radiative_start)), structure.radiative_column] = system.radiative
        B[structure.forcing_row, structure.forcing_column] = system.forcing
        return Equations(A, N, self.drive.inputs @ B.T, process, system.initial, np.diag(self.initial[1] ** 2))

    def filtered(self, equations: Equations, noise: Any, observed: Any = None) -> Filtered:
        """The filter with measurement noise [N] K on `observed` [G, N], by default all of the telemetry."""
        y = self.observed if observed is None else observed
        return Filtered(*_filter(self.drive.times, *equations, self.simulator.observation.sensors.state, noise, y))


def record_of(window: Window, telemetry: xarray.Dataset) -> Record:
    """The telemetry of a window whose network has no heater, no massless node and sensors without errors."""
    simulator = window.network
    assert simulator is not None
    assert not simulator.heaters
    assert simulator.network.structure.mass.all()
    assert not simulator.observation.sensors.moved.any()
    inputs = window_inputs(
        window.scenario,
        simulator.network,
        telemetry,
        window.times[0],
        window.times[-1],
        window.times,
        period=window.period,
    )
    times = simulator.observation.times
    extra = inputs.breaks[np.abs(inputs.breaks[:, None] - times).min(axis=1) > 1e-3]
    grid = np.sort(np.concatenate([times, extra]))
    sampled = np.searchsorted(grid, times)
    observed = np.full((len(grid), window.observed.shape[1]), np.nan)
    observed[sampled] = window.observed
    priors: list[Any] = [window.reads[name] for name in simulator.parameters[len(simulator.names) :]]
    initial = np.array([[prior.mean, prior.standard_deviation] for prior in priors]).T
    return Record(simulator, len(simulator.names), drive_on(inputs, grid), sampled, observed, initial)


@njit(cache=True)
def _exponential(matrix: Any, norm: float) -> Any:
    """Taylor's series with scaling and squaring; norm: of the blocks on the diagonal."""
    halvings = max(0, int(np.ceil(np.log2(max(norm, 1e-12) / 0.25))))
    scaled = matrix / 2.0**halvings
    term = np.eye(len(matrix))
    total = term.copy()
    for order in range(1, 13):
        term = term @ scaled / order
        total += term
    for _ in range(halvings):
        total = total @ total
    return total


@njit(cache=True)
def _propagate(x: Any, P: Any, A: Any, N: Any, heat: Any, process: Any, step: float) -> Any:
    """Mean and covariance one step later; heat [2, n] at its start and end. The covariance is of the linear drift."""
    n = len(x)
    jacobian = A + N * (4.0 * x**3)
    M = np.zeros((2 * n + 2, 2 * n + 2))
    M[:n, :n], M[n : 2 * n, n : 2 * n] = jacobian, -jacobian.T
    M[:n, n : 2 * n] = np.diag(process**2)
    M[:n, 2 * n] = A @ x + N @ x**4 + heat[0]
    M[:n, 2 * n + 1] = (heat[1] - heat[0]) / step
    M[2 * n + 1, 2 * n] = 1.0  # time, for the slope of the heat
    grown = _exponential(M * step, np.abs(jacobian).sum(axis=1).max() * step)
    transition = np.ascontiguousarray(grown[:n, :n])
    added = np.ascontiguousarray(grown[:n, n : 2 * n]) @ transition.T
    P = transition @ P @ transition.T + 0.5 * (added + added.T)
    moved = x + grown[:n, 2 * n]
    # What the line through x^4 leaves out, at its leading order: exprb32 of Hochbruck, Ostermann & Schweitzer (2009),
    # SIAM J. Numer. Anal. 47, eq. 5.1, with phi_3 = 1/6.
    return moved + step / 3.0 * (N @ (moved**4 - x**4 - 4.0 * x**3 * (moved - x))), P


@njit(cache=True)
def _filter(
    times: Any, A: Any, N: Any, heat: Any, process: Any, x: Any, P: Any, sensor: Any, noise: Any, observed: Any
) -> Any:
    """The log likelihood, and mean and variance [G, N] of each sample given the grid points before."""
    means, variances = np.empty(observed.shape), np.empty(observed.shape)
    log_likelihood = 0.0
    for k in range(len(times)):
        if k > 0 and times[k] > times[k - 1]:
            x, P = _propagate(x, P, A, N, heat[k - 1], process, times[k] - times[k - 1])
        for c in range(len(sensor)):
            means[k, c], variances[k, c] = x[sensor[c]], P[sensor[c], sensor[c]] + noise[c] ** 2
        for c in range(len(sensor)):
            if np.isnan(observed[k, c]):
                continue
            # The channels' noises are independent, so one sample after the other.
            s = sensor[c]
            variance = P[s, s] + noise[c] ** 2
            innovation = observed[k, c] - x[s]
            gain = P[:, s] / variance
            x = x + gain * innovation
            P = P - np.outer(gain, gain) * variance
            log_likelihood -= 0.5 * (innovation**2 / variance + np.log(2.0 * np.pi * variance))
    return log_likelihood, means, variances


@dataclass(frozen=True)
class Fit:
    """The best of several climbs."""

    names: tuple[str, ...]
    values: Any
    """[p + n + N] theta, process noise (K/s^0.5) and measurement noise (K)."""
    log_densities: tuple[float, ...]
    """Where each climb ended: from the given starts, then from draws."""

    def split(self, record: Record) -> tuple[Any, Any, Any]:
        """theta [p], process noise [n], measurement noise [N]."""
        p = record.parameters
        return tuple(np.split(self.values, [p, p + record.initial.shape[1]]))  # type: ignore[return-value]


def fit(record: Record, window: Window, starts: Sequence[Any] = (), draws: int = 4, seed: int = 1) -> Fit:
    """Parameters of highest posterior density in z, flightcal's unconstrained coordinates: mostly logarithms.

    starts: thetas [p], beside the prior's median and so many draws of it.
    """
    network = record.simulator
    prior: dict[str, Any] = {name: window.reads[name] for name in network.names}
    prior |= {f"process.{node}": HalfNormal(scale=WIDE_PROCESS) for node in network.network.nodes}
    prior |= {f"noise.{channel}": HalfNormal(scale=WIDE_NOISE) for channel in network.channels}
    priors = Priors(tuple(prior), tuple(prior.values()))
    p, n = record.parameters, record.initial.shape[1]

    def cost(z: Any) -> float:
        at = priors.at(z)
        theta, process, noise = np.split(at.theta, [p, p + n])
        value = record.filtered(record.equations(theta, process), noise).log_likelihood + float(at.log_density)
        return -value if np.isfinite(value) else 1e10

    median = priors.to_z(priors.median())
    median[p : p + n] = np.log(0.1)
    begins = [median, *priors.to_z(priors.sample(np.random.default_rng(seed), draws))]
    for theta in starts:
        begins.append(median.copy())
        begins[-1][:p] = priors.to_z(np.concatenate([theta, priors.median()[p:]]))[:p]
    bounds = [(-_FURTHEST, _FURTHEST)] * len(median)
    climbs = [
        minimize(cost, begin, jac="3-point", method="L-BFGS-B", bounds=bounds, options={"maxiter": 500, "maxls": 40})
        for begin in begins
    ]
    best = min(climbs, key=lambda climb: float(climb.fun))
    return Fit(priors.names, priors.to_theta(best.x), tuple(-float(climb.fun) for climb in climbs))


def forecast(record: Record, fitted: Fit, origin: int) -> Filtered:
    """The filter on the telemetry up to its sample `origin`, and what it predicts from there on."""
    theta, process, noise = fitted.split(record)
    known = record.observed.copy()
    known[record.sampled[origin] + 1 :] = np.nan
    return record.filtered(record.equations(theta, process), noise, known)
