"""One window of telemetry, a simulator and priors: residuals, and the log density on unconstrained coordinates.

theta, in physical units, is ordered: the scenario's parameters; what is inferred of noise and discrepancy
(``noise.<channel>``, ``noise.<channel>.<what>``, ``discrepancy.<part>.<what>[.<channel>]``); ``timing.<channel>`` (s)
and ``error_rate.<channel>`` of a heater's status where these are; ``initial.<node>`` (K). z is theta on the
unconstrained scale on which the sampler moves.
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
from numpy.typing import NDArray

from ..environment import orbital_period
from ..errors import ScenarioError
from ..probability import (
    DEVIATION,
    THRESHOLD_ERROR,
    ErrorShapes,
    HeaterStatus,
    Likelihood,
    Priors,
    PriorTerms,
    ResidualModel,
    error_shapes,
    heater_status,
    low_rank_log_likelihood,
    measured_switches,
    precision_times,
    residual_model,
    shrinkage,
    with_error_shapes,
)
from ..scenario import ExternalModel, Normal, Prior, Scenario, is_trained
from ..simulator import (
    ICE_POINT,
    FloatArray,
    IntArray,
    NetworkSimulator,
    SimulationFailure,
    Simulator,
    Switch,
    Trajectory,
    open_loop,
)
from ..telemetry import select_window, window_bounds
from .coordinates import Whitening
from .native import NativeDensity, WindowParts, native_density
from .simulators import InexactSimulator, build_simulator

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
    residuals: ResidualModel
    """Noise and discrepancy."""
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
    def period(self) -> float:
        """Of the orbit, s."""
        return orbital_period(self.scenario.environment, self.scenario.folder)

    @cached_property
    def simulated(self) -> Any:
        """Positions in theta of what the simulator takes, in its order."""
        return np.array([self.names.index(name) for name in self.simulator.parameters])

    @cached_property
    def places(self) -> Any:
        """Of the residuals' numbers that are entries of theta: channels, columns and positions in theta, [q] each."""
        entries = self.residuals.entries
        found = [(entry.channel, entry.column, self.names.index(entry.name)) for entry in entries]
        return tuple(np.array(found, np.int64).reshape(-1, 3).T)

    @cached_property
    def inferred_noise(self) -> Any:
        """Channels [.] whose noise is inferred, and the positions in theta [.] of its standard deviation."""
        channels, columns, positions = self.places
        return channels[columns == DEVIATION], positions[columns == DEVIATION]

    @property
    def fixed_noise(self) -> FloatArray:
        """Standard deviation of each channel's noise [N], K; NaN where it is inferred."""
        fixed = self.residuals.fixed[:, DEVIATION].copy()
        fixed[self.inferred_noise[0]] = np.nan
        return fixed

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

    def numbers(self, theta: FloatArray) -> FloatArray:
        """The numbers of noise and discrepancy [N, n] at theta [d]; see `noise`."""
        channels, columns, positions = self.places
        numbers = self.residuals.fixed.copy()
        numbers[channels, columns] = theta[positions]
        return numbers

    def noise(self, theta: FloatArray) -> FloatArray:
        """Standard deviation of the noise of one sample of each channel [N], K, at theta [d]; discrepancy apart."""
        return self.residuals.deviations(self.numbers(theta))

    def draw_errors(self, theta: FloatArray, rng: np.random.Generator) -> FloatArray:
        """What telemetry at theta [d] differs by from the simulation, [T, N] K: noise and discrepancy, drawn anew."""
        return self.residuals.draw_errors(self.numbers(theta), rng)

    def replicate(self, theta: FloatArray, run: Trajectory, rng: np.random.Generator) -> FloatArray:
        """Telemetry [T, N], K, drawn anew at theta [d] with its simulation `run`.

        The discrepancy is one that the residuals show; the noise is new.
        """
        numbers = self.numbers(theta)
        discrepancy, drawn = self.residuals.draw_given(self.observed, run.temperatures, numbers, rng)
        return np.asarray(run.temperatures + discrepancy + drawn)

    def independent(self) -> Problem:
        """The same problem, its theta too, with independent normal noise alone: no discrepancy, no correlation."""
        opened = None if self.open_loop is None else self.open_loop.independent()
        return replace(self, residuals=self.residuals.independent(), open_loop=opened)

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

    def simulate_as_flown(self, thetas: FloatArray, rng: np.random.Generator) -> list[Trajectory | None]:
        """The same, with thermostats that switch around their thresholds as far as the scenario says (`scatter`)."""
        if isinstance(self.simulator, NetworkSimulator | InexactSimulator):
            return self.simulator.simulate_scattered(thetas[:, self.simulated], rng)
        return self.simulate_many(thetas)

    def log_density(self, z: FloatArray) -> float:
        """Log posterior density (up to a constant) at z [d]; -inf where the simulation fails."""
        prior = self.priors.at(z)
        try:
            run = self.simulate(prior.theta)
        except SimulationFailure:
            return -np.inf
        value = float(prior.log_density) + self._log_likelihood(run, self.numbers(prior.theta))[0]
        if self.measured_switches is not None:
            return value + self._at_thresholds(prior.theta)[0]
        if self.heater_status is not None:
            value += self.heater_status.log_likelihood(run, self.status_settings(prior.theta))[0]
        return value

    def native_density(self, coordinates: Whitening) -> NativeDensity | None:
        """The log density at w [d] of other coordinates as a C function; None where there is none."""
        parts = self.window_parts(np.arange(len(self.names)), (np.full(len(self.names), -1),) * 2)
        return None if parts is None else native_density([parts], self.priors, coordinates)

    def window_parts(self, columns: IntArray, drifts: tuple[IntArray, IntArray]) -> WindowParts | None:
        """What a compiled density of this window, or of several, needs; None where there can be none.

        columns, drifts: see `WindowParts`.
        """
        if not isinstance(self.simulator, NetworkSimulator):
            return None
        status = None if self.measured_switches is not None else self.heater_status
        settings = self.inferred_settings if status else (np.empty(0, int), np.empty(0, int))
        return WindowParts(
            self.simulator, self.observed, self.residuals, status, self.priors,
            self.simulated, self.places, settings, columns, drifts,
        )  # fmt: skip

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
        value, numbers_bar, *cotangents = self._log_likelihood(trajectory, self.numbers(prior.theta))
        theta_bar, switches_bar = self._pull_back(numbers_bar), {}
        if self.heater_status is not None and self.measured_switches is None:
            settings = self.status_settings(prior.theta)
            added, switches_bar["switches_bar"], settings_bar = self.heater_status.log_likelihood(trajectory, settings)
            value += added
            places, positions = self.inferred_settings
            theta_bar[positions] += settings_bar[places]
        theta_bar[self.simulated] += cotangent(*cotangents, **switches_bar)
        value, gradient = float(prior.log_density) + value, prior.gradient + prior.slope * theta_bar
        return (value, gradient) if self.measured_switches is None else self._with_thresholds(z, value, gradient)

    def _at_thresholds(self, theta: FloatArray) -> tuple[float, FloatArray, Callable[[FloatArray], FloatArray]]:
        """In open loop: log likelihood (up to a constant) of the sensors being at their thresholds when heaters switch.

        Also the scaled deviations [E], and the vector-Jacobian product of these. Raises SimulationFailure.
        """
        assert isinstance(self.simulator, NetworkSimulator | InexactSimulator)
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

    def likelihood_of_numbers(self, run: Trajectory, theta: FloatArray) -> tuple[float, FloatArray]:
        """Log likelihood of a simulation at theta [d], and its gradient [d] by noise and discrepancy alone."""
        value, numbers_bar, *_ = self._log_likelihood(run, self.numbers(theta))
        return float(value), self._pull_back(numbers_bar)

    def _pull_back(self, numbers_bar: FloatArray) -> FloatArray:
        """Derivative by theta [d] from that by the residuals' numbers [N, n]."""
        channels, columns, positions = self.places
        theta_bar = np.zeros(len(self.names))
        np.add.at(theta_bar, positions, numbers_bar[channels, columns])
        return theta_bar

    @cached_property
    def _own(self) -> threading.local:
        """What each thread has for itself."""
        return threading.local()

    def _log_likelihood(self, run: Trajectory, numbers: FloatArray) -> tuple[Any, ...]:
        """Log likelihood, its derivative by the numbers [N, n], and those by what the simulator gives."""
        model, shapes = self.residuals, self.error_shapes
        if shapes is None:
            if not hasattr(self._own, "likelihood"):
                self._own.likelihood = Likelihood(model.terms, numbers.shape[1])
            value, temperatures_bar, numbers_bar = self._own.likelihood(self.observed, run.temperatures, numbers)
            return value, numbers_bar, temperatures_bar
        if model.is_independent:
            value, temperatures_bar, noise_bar, variance_bar = low_rank_log_likelihood(
                self.observed, run.temperatures, numbers[:, DEVIATION], shapes, run.error_variance
            )
            numbers_bar = np.zeros_like(numbers)
            numbers_bar[:, DEVIATION] = noise_bar
        else:
            value, temperatures_bar, numbers_bar, variance_bar = with_error_shapes(
                model.terms, self.observed, run.temperatures, numbers, shapes, run.error_variance
            )
        return value, numbers_bar, temperatures_bar, variance_bar

    def jacobian(self, z: FloatArray) -> FloatArray:
        """d temperatures / d z, [T, N, d], by central differences in one batch; zero for what is not the simulator's.

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

        Prior, J^T C^-1 J with C the covariance of the residuals (or of normal ones of the same information), and the
        curvature in what is inferred of noise and discrepancy as if a surrogate were exact, bent to be positive.
        Raises SimulationFailure.
        """
        prior = self.priors.at(z)
        numbers, run = self.numbers(prior.theta), self.simulate(prior.theta)
        jacobian = np.where(self.valid[..., None], self.jacobian(z), 0.0)
        equivalent, equal = self.residuals.normal_equivalent(numbers)

        def weighted(columns: FloatArray) -> FloatArray:
            return precision_times(equivalent.terms, columns, equal)

        # Not a product of BLAS, whose threads spin for a hundred times longer than this takes when the cores are busy.
        solved = np.zeros_like(jacobian)
        solved[..., self.simulated] = weighted(jacobian[..., self.simulated])
        hessian: FloatArray = np.einsum("tni,tnj->ij", jacobian, solved)
        if self.error_shapes is not None:
            basis = self.error_shapes.basis
            covariance, _ = shrinkage(np.einsum("tni,tnj->ij", basis, weighted(basis)), run.error_variance)
            crossed = np.einsum("tni,tnj->ij", basis, solved)
            hessian -= crossed.T @ covariance @ crossed
        hessian = 0.5 * (hessian + hessian.T)
        hessian[np.diag_indices(len(z))] += self.priors.precision(z)
        residual = np.where(self.valid, self.observed - run.temperatures, 0.0)
        return hessian + self._curvature(residual, numbers, prior) + self._status_information(prior)

    def _curvature(self, residual: FloatArray, numbers: FloatArray, prior: PriorTerms) -> FloatArray:
        """Curvature [d, d] in the entries of theta that are the residuals' numbers; never negative."""
        channels, columns, positions = self.places
        by_logarithm = self.residuals.curvature(residual, numbers)
        rate = prior.slope[positions] / prior.theta[positions]
        curvature = np.zeros((len(prior.theta), len(prior.theta)))
        same = channels[:, None] == channels
        blocks = by_logarithm[channels[:, None], columns[:, None], columns] * rate[:, None] * rate
        np.add.at(curvature, (positions[:, None], positions[None, :]), np.where(same, blocks, 0.0))
        own = np.unique(positions)
        eigenvalues, directions = np.linalg.eigh(curvature[np.ix_(own, own)])
        curvature[np.ix_(own, own)] = (directions * np.abs(eigenvalues)) @ directions.T
        return curvature

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
            none = [np.zeros(run.temperatures.shape)]
            if self.error_shapes is not None:
                none.append(np.zeros(run.error_variance.shape))
            rows = [cotangent(*none, switches_bar=row) for row in weights]
            places, positions = self.inferred_settings
            hessian[positions, positions] = precision[places] * prior.slope[positions] ** 2
        jacobian = np.reshape(rows, (-1, len(self.simulated))) * prior.slope[self.simulated]
        hessian[np.ix_(self.simulated, self.simulated)] += np.einsum("ei,ej->ij", jacobian, jacobian)
        return hessian

    def of_temperatures(self, kept: NDArray[np.bool_]) -> Problem:
        """The same with the temperatures alone, and of these only the samples that are kept, [T, N] or [T, 1]."""
        observed = np.where(kept, self.observed, np.nan)
        residuals = self.residuals.at_samples(np.isfinite(observed))
        return replace(self, observed=observed, residuals=residuals, heater_status=None)

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
    residuals, of_residuals = residual_model(
        scenario, simulator.channels, times, observed, checked=is_trained(window) and span is None
    )
    priors |= of_residuals
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
        residuals=residuals,
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
