"""One window of telemetry, a simulator and priors: residuals, and the log density on unconstrained coordinates.

theta, in physical units, is ordered: the scenario's parameters, ``noise.<channel>`` (K) where the noise is inferred,
``timing.<channel>`` (s) and ``error_rate.<channel>`` of a heater's status where these are, ``initial.<node>`` (K). z is
theta on the unconstrained scale on which the sampler moves.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import xarray

from ..environment import orbital_period
from ..errors import ScenarioError
from ..scenario import Normal, Prior, Scenario
from ..scenario.external import ExternalModel
from ..scenario.schema import HalfNormal
from ..simulator import NetworkSimulator, SimulationFailure, Simulator, Trajectory, open_loop
from ..simulator.sampling import ICE_POINT
from ..simulator.system import FloatArray, Switch
from ..surrogate.build import build_simulator
from ..telemetry import select_window, window_bounds
from .likelihood import ErrorShapes, error_shapes, iid_log_likelihood, low_rank_log_likelihood, shrinkage
from .native import NativeDensity, native_density
from .priors import Priors, PriorTerms
from .status import THRESHOLD_ERROR, HeaterStatus, heater_status, measured_switches
from .whitening import Whitening

_DEFAULT_NOISE = HalfNormal(scale=2.0)  # K
_SAMPLES_FOR_START = 3
_DIFFERENCE = 1e-4  # of z, whose prior has a standard deviation of about one


@dataclass(frozen=True)
class Problem:
    """A calibration problem on one window."""

    scenario: Scenario
    window: str
    times: Any
    """[T] datetime64, UTC."""
    observed: FloatArray
    """[T, N] K, NaN where there is no valid sample."""
    status: FloatArray
    """[T, H] measured heater status, NaN where unknown."""
    simulator: Simulator
    priors: Priors
    fixed_noise: FloatArray
    """[N] K; NaN where the noise is inferred."""
    heater_status: HeaterStatus | None = None
    """What the telemetry says of the heaters, where the scenario gives it a likelihood."""
    measured_switches: Switch | None = None
    """In open loop, when heaters with uncertain thresholds switched; null: in closed loop."""
    open_loop: Problem | None = None
    """The same problem with every heater driven by its measured status, where there is one."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of theta's entries [d]."""
        return self.priors.names

    @cached_property
    def simulated(self) -> Any:
        """Positions in theta of what the simulator takes, in its order."""
        return np.array([self.names.index(name) for name in self.simulator.parameters])

    @cached_property
    def inferred_noise(self) -> Any:
        """Channels [.] whose noise is inferred, and their positions in theta [.]."""
        channels = np.flatnonzero(np.isnan(self.fixed_noise))
        positions = np.array([self.names.index(f"noise.{self.simulator.channels[k]}") for k in channels], dtype=int)
        return channels, positions

    @cached_property
    def inferred_settings(self) -> Any:
        """Settings [.] of the status likelihood that are inferred, and their positions in theta [.]."""
        if self.heater_status is None:
            return np.empty(0, int), np.empty(0, int)
        return self.heater_status.inferred, np.array([self.names.index(n) for n in self.heater_status.priors], int)

    def status_settings(self, theta: FloatArray) -> FloatArray:
        """Settings [P] of the status likelihood at theta [d]."""
        places, positions = self.inferred_settings
        settings = np.empty(0) if self.heater_status is None else self.heater_status.settings.copy()
        settings[places] = theta[positions]
        return settings

    @cached_property
    def valid(self) -> Any:
        """[T, N] whether there is a valid sample."""
        return np.isfinite(self.observed)

    @cached_property
    def error_shapes(self) -> ErrorShapes | None:
        """Shapes in which a surrogate's temperatures may be off, at the valid samples."""
        basis = self.simulator.error_basis
        return None if basis is None else error_shapes(basis, self.valid)

    def noise(self, theta: FloatArray) -> FloatArray:
        """Noise standard deviation per channel [N], K, at theta [d]."""
        channels, positions = self.inferred_noise
        noise = self.fixed_noise.copy()
        noise[channels] = theta[positions]
        return noise

    def to_theta(self, z: FloatArray) -> FloatArray:
        """Physical values [..., d] of unconstrained z [..., d]."""
        return self.priors.to_theta(z)

    def to_z(self, theta: FloatArray) -> FloatArray:
        """Unconstrained z [..., d] of physical values [..., d]."""
        return self.priors.to_z(theta)

    def simulate(self, theta: FloatArray) -> Trajectory:
        """The simulation at theta [d]. Raises SimulationFailure."""
        return self.simulator.simulate(theta[self.simulated])

    def simulate_many(self, thetas: FloatArray) -> list[Trajectory | None]:
        """Simulations at thetas [S, d]; None where one failed."""
        return self.simulator.simulate_many(thetas[:, self.simulated])

    def log_density(self, z: FloatArray) -> float:
        """Log posterior density (up to a constant) at z [d]; -inf where the simulation fails."""
        prior = self.priors.at(z)
        try:
            run = self.simulate(prior.theta)
        except SimulationFailure:
            return -np.inf
        value = float(prior.log_density) + self._log_likelihood(run, self.noise(prior.theta))[0]
        if self.measured_switches is not None:
            return value + self._at_thresholds(prior.theta)[0]
        if self.heater_status is not None:
            value += self.heater_status.log_likelihood(run, self.status_settings(prior.theta))[0]
        return value

    def native_density(self, coordinates: Whitening) -> NativeDensity | None:
        """The log density at w [d] of other coordinates as a C function; None where there is none."""
        if not isinstance(self.simulator, NetworkSimulator):
            return None
        places = (self.simulated, *self.inferred_noise)
        status = None
        if self.heater_status is not None and self.measured_switches is None:
            status = (self.heater_status.data, self.heater_status.settings, *self.inferred_settings)
        return native_density(self.simulator, self.priors, self.observed, self.fixed_noise, places, coordinates, status)

    def log_density_and_gradient(self, z: FloatArray) -> tuple[float, FloatArray]:
        """Log posterior density at z [d] and its gradient [d]; (-inf, 0) where the simulation fails."""
        if not hasattr(self._own, "density"):
            self._own.density = self.native_density(Whitening(np.zeros(len(z)), np.eye(len(z))))
        if self._own.density is not None and self.measured_switches is None:
            return self._own.density(z)
        if self._own.density is not None:
            return self._with_thresholds(z, *self._own.density(z))
        prior = self.priors.at(z)
        if not math.isfinite(prior.theta.sum()):
            return -np.inf, np.zeros_like(z)
        try:
            trajectory, cotangent = self.simulator.linearise(prior.theta[self.simulated])
        except SimulationFailure:
            return -np.inf, np.zeros_like(z)
        value, noise_bar, *cotangents = self._log_likelihood(trajectory, self.noise(prior.theta))
        theta_bar = np.zeros(len(prior.theta))
        theta_bar[self.simulated] = cotangent(*cotangents)
        channels, positions = self.inferred_noise
        theta_bar[positions] = noise_bar[channels]
        return float(prior.log_density) + value, prior.gradient + prior.slope * theta_bar

    def _at_thresholds(self, theta: FloatArray) -> tuple[float, FloatArray, Callable[[FloatArray], FloatArray]]:
        """In open loop: log likelihood (up to a constant) of the sensors being at their thresholds when heaters switch.

        Also the scaled deviations [E], and the vector-Jacobian product of these. Raises SimulationFailure.
        """
        assert isinstance(self.simulator, NetworkSimulator)
        assert self.measured_switches is not None
        excess, pull_back = self.simulator.threshold_excess(theta[self.simulated], self.measured_switches)
        scaled = excess / THRESHOLD_ERROR
        return -0.5 * float((scaled**2).sum()), scaled, lambda bar: pull_back(bar / THRESHOLD_ERROR)

    def _with_thresholds(self, z: FloatArray, value: float, gradient: FloatArray) -> tuple[float, FloatArray]:
        if not math.isfinite(value):
            return value, gradient
        prior = self.priors.at(z)
        added, scaled, pull_back = self._at_thresholds(prior.theta)
        gradient = gradient.copy()
        gradient[self.simulated] -= prior.slope[self.simulated] * pull_back(scaled)
        return value + added, gradient

    @cached_property
    def _own(self) -> threading.local:
        """What each thread has for itself."""
        return threading.local()

    def _log_likelihood(self, run: Trajectory, noise: FloatArray) -> tuple[Any, ...]:
        """Log likelihood, its derivative by the noise [N], and those by what the simulator gives."""
        if self.error_shapes is None:
            value, temperatures_bar, noise_bar = iid_log_likelihood(self.observed, run.temperatures, noise)
            return value, noise_bar, temperatures_bar
        value, temperatures_bar, noise_bar, variance_bar = low_rank_log_likelihood(
            self.observed, run.temperatures, noise, self.error_shapes, run.error_variance
        )
        return value, noise_bar, temperatures_bar, variance_bar

    def jacobian(self, z: FloatArray) -> FloatArray:
        """d temperatures / d z, [T, N, d], by central differences in one batch; zero for the noise's entries.

        The located switching makes the simulation smooth, so differences are good to about seven digits.
        """
        columns = self.simulated
        steps = np.zeros((len(columns), len(z)))
        steps[np.arange(len(columns)), columns] = _DIFFERENCE
        runs = self.simulate_many(self.to_theta(np.concatenate([z + steps, z - steps])))
        jacobian = np.zeros((*self.observed.shape, len(z)))
        for k, column in enumerate(columns):
            above, below = runs[k], runs[k + len(columns)]
            if above is None or below is None:
                raise SimulationFailure(
                    f"a simulation next to this point fails, in the direction of '{self.names[column]}'"
                )
            jacobian[..., column] = (above.temperatures - below.temperatures) / (2.0 * _DIFFERENCE)
        return jacobian

    def gauss_newton_hessian(self, z: FloatArray) -> FloatArray:
        """Gauss-Newton approximation [d, d] of minus the Hessian of the log density at z.

        Prior, J^T C^-1 J with C the covariance of the residuals, and the Fisher information of the noise levels as if a
        surrogate were exact. Raises SimulationFailure.
        """
        prior = self.priors.at(z)
        noise = self.noise(prior.theta)
        weighted = np.where(self.valid[..., None], self.jacobian(z) / noise[:, None], 0.0).reshape(-1, len(z))
        # Not a product of BLAS, whose threads spin for a hundred times longer than this takes when the cores are busy.
        hessian: FloatArray = np.einsum("ti,tj->ij", weighted, weighted)
        if self.error_shapes is not None:
            scaled = self.error_shapes.basis / noise[:, None]
            covariance, _ = shrinkage(self.error_shapes, noise, self.simulate(prior.theta).error_variance)
            crossed = np.einsum("ti,tj->ij", scaled.reshape(len(weighted), -1), weighted)
            hessian -= crossed.T @ covariance @ crossed
        hessian[np.diag_indices(len(z))] += self.priors.precision(z)
        channels, positions = self.inferred_noise
        hessian[positions, positions] += (
            2.0 * self.valid.sum(axis=0)[channels] * (prior.slope[positions] / noise[channels]) ** 2
        )
        return hessian + self._status_information(prior)

    def _status_information(self, prior: PriorTerms) -> FloatArray:
        """What the heaters' status adds to the Gauss-Newton Hessian [d, d], with an exact Jacobian of the switches."""
        hessian = np.zeros((len(prior.theta),) * 2)
        rows = []
        if self.measured_switches is not None:
            _, scaled, pull_back = self._at_thresholds(prior.theta)
            rows = [pull_back(row) for row in np.eye(len(scaled))]
        elif self.heater_status is not None:
            run, cotangent = self.simulator.linearise(prior.theta[self.simulated])
            settings = self.status_settings(prior.theta)
            weights, precision = self.heater_status.information(run, settings)
            rows = [cotangent(np.zeros(run.temperatures.shape), row) for row in weights]
            places, positions = self.inferred_settings
            hessian[positions, positions] = precision[places] * prior.slope[positions] ** 2
        jacobian = np.reshape(rows, (-1, len(self.simulated))) * prior.slope[self.simulated]
        hessian[np.ix_(self.simulated, self.simulated)] += np.einsum("ei,ej->ij", jacobian, jacobian)
        return hessian

    def beginning(self, share: float) -> Problem:
        """The same with the temperatures alone, of the first share of the window."""
        elapsed = (self.times - self.times[0]) / (self.times[-1] - self.times[0])
        observed = np.where((elapsed <= share)[:, None], self.observed, np.nan)
        return replace(self, observed=observed, heater_status=None)

    def rmse(self, thetas: FloatArray, status_weight: float = 0.0) -> FloatArray:
        """RMSE over all channels [S], K, of simulations at thetas [S, d], run as one batch; NaN where one fails.

        status_weight: kelvin that a wrongly simulated heater status sample counts as (0: temperatures only).
        """
        return np.array(
            [np.nan if run is None else self._misfit(run, status_weight) for run in self.simulate_many(thetas)]
        )

    def _misfit(self, run: Trajectory, status_weight: float) -> float:
        residual = np.where(self.valid, self.observed - run.temperatures, 0.0)
        mean_square = np.einsum("tk,tk->", residual, residual) / self.valid.sum()
        if status_weight > 0.0 and np.isfinite(self.status).any():
            mean_square += status_weight**2 * np.nanmean(np.abs(self.status - run.status))
        return float(np.sqrt(mean_square))


def build_problem(
    scenario: Scenario, telemetry: xarray.Dataset, window: str = "train", *, span: float | None = None
) -> Problem:
    """The calibration problem of a scenario on one of its windows.

    span: only the window's first so many seconds. Raises ScenarioError and TelemetryError.
    """
    if window not in scenario.windows:
        raise ScenarioError(f"window '{window}' is not in the scenario, which has {', '.join(scenario.windows)}")
    period = orbital_period(scenario.environment, scenario.folder)
    chosen = select_window(telemetry, scenario.windows[window], period)
    start, end = window_bounds(scenario.windows[window], period)
    if span is not None:
        end = min(end, start + np.timedelta64(round(span * 1e9), "ns"))
        chosen = chosen.sel(time=slice(start, end))
    times = chosen["time"].values
    simulator = build_simulator(scenario, telemetry, start, end, times, period=period)
    observed = np.stack([chosen[channel].values for channel in simulator.channels], axis=1)
    priors: dict[str, Prior] = {name: parameter.prior for name, parameter in scenario.parameters.items()}
    fixed_noise = np.full(len(simulator.channels), np.nan)
    for k, channel in enumerate(simulator.channels):
        noise = scenario.observations[channel].noise
        if isinstance(noise, float):
            fixed_noise[k] = noise
        else:
            priors[f"noise.{channel}"] = noise or _DEFAULT_NOISE
    status = heater_status(scenario, chosen, start)
    priors |= {} if status is None else status.priors
    priors |= initial_priors(scenario, simulator.channels, observed)
    opened = None
    if _can_be_opened(scenario):
        opened = build_problem(open_loop(scenario), telemetry, window, span=span)
    return Problem(
        scenario=scenario,
        window=window,
        times=times,
        observed=observed,
        status=measured_status(scenario, chosen),
        simulator=simulator,
        priors=Priors(tuple(priors), tuple(priors.values())),
        fixed_noise=fixed_noise,
        heater_status=status,
        measured_switches=measured_switches(scenario, chosen, start),
        open_loop=opened,
    )


def _can_be_opened(scenario: Scenario) -> bool:
    """Whether the heaters act in closed loop, and all of them could be driven by their measured status instead."""
    if isinstance(scenario.simulator, ExternalModel):
        return False
    heaters = scenario.simulator.heaters.values()
    measurable = bool(heaters) and all(heater.measured_by is not None for heater in heaters)
    return measurable and scenario.simulator.heater_input == "simulated"


def initial_priors(scenario: Scenario, channels: tuple[str, ...], observed: FloatArray) -> dict[str, Prior]:
    """Normal priors of the initial temperatures (K): around the first samples, or around what the scenario writes."""
    first = {}
    for k, channel in enumerate(channels):
        valid = observed[np.isfinite(observed[:, k]), k]
        observation = scenario.observations[channel]
        place = observation.node or observation.output
        if len(valid) and place not in first:
            reading = float(np.mean(valid[:_SAMPLES_FOR_START])) - observation.bias
            first[place] = (reading - ICE_POINT) / observation.gain + ICE_POINT
    typical = float(np.mean(list(first.values()))) if first else 293.15
    priors: dict[str, Prior] = {}
    for name, written in _initial_temperatures(scenario).items():
        if name in first:
            priors[f"initial.{name}"] = Normal(mean=first[name], standard_deviation=scenario.initial_state.observed)
        else:
            centre = written if written is not None else typical
            priors[f"initial.{name}"] = Normal(mean=centre, standard_deviation=scenario.initial_state.unobserved)
    return priors


def _initial_temperatures(scenario: Scenario) -> dict[str, float | None]:
    """What has an initial temperature that is estimated, and the one that the scenario writes, K."""
    model = scenario.simulator
    if isinstance(model, ExternalModel):
        return {item.initial_of: item.si[1] for item in model.inputs.values() if item.initial_of is not None}
    return {name: node.initial for name, node in model.nodes.items() if node.capacity is not None}


def measured_status(scenario: Scenario, telemetry: xarray.Dataset) -> FloatArray:
    """Measured status [T, H] of the heaters, NaN where a heater has no status channel or no valid sample."""
    heaters = tuple(scenario.simulator.heaters)
    status = np.full((telemetry.sizes["time"], len(heaters)), np.nan)
    for k, name in enumerate(heaters):
        watching = [c for c, item in scenario.observations.items() if item.heater == name]
        channel = watching[0] if watching else getattr(scenario.simulator.heaters[name], "measured_by", None)
        if channel is not None:
            status[:, k] = telemetry[channel].values
    return status
