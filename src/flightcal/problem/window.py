"""One stretch of telemetry and the simulator for it: a likelihood, without priors.

A window reads theta of its own [q], in physical units, ordered: the scenario's parameters; what is inferred of noise
and discrepancy (``noise.<channel>``, ``noise.<channel>.<what>``, ``discrepancy.<part>.<what>[.<channel>]``);
``timing.<channel>`` (s) and ``error_rate.<channel>`` of a heater's status where these are; ``initial.<node>`` (K).
`problem.Problem` says where these come from among what is calibrated.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..environment import orbital_period
from ..probability import (
    DEVIATION,
    THRESHOLD_ERROR,
    ErrorShapes,
    HeaterStatus,
    Likelihood,
    PriorTerms,
    ResidualModel,
    error_shapes,
    low_rank_log_likelihood,
    precision_times,
    shrinkage,
    with_error_shapes,
)
from ..scenario import Prior, Scenario
from ..simulator import FloatArray, NetworkSimulator, SimulationFailure, Simulator, Switch, Trajectory
from .simulators import InexactSimulator


class Information(NamedTuple):
    """Minus the Hessian of a window's log likelihood by its own coordinates [q, q], in three parts."""

    temperatures: FloatArray
    """Gauss-Newton: J^T C^-1 J."""
    numbers: FloatArray
    """Of noise and discrepancy."""
    status: FloatArray


@dataclass(frozen=True)
class Window:
    """Telemetry of one window, what simulates it, and how the two may differ."""

    scenario: Scenario
    name: str
    times: Any
    """[T] datetime64, UTC."""
    observed: FloatArray
    """[T, N] K, NaN where there is no valid sample."""
    status: FloatArray
    """[T, H] measured heater status, NaN where unknown."""
    simulator: Simulator
    residuals: ResidualModel
    """Noise and discrepancy."""
    reads: dict[str, Prior]
    """Names of what it reads of theta [q], and the prior that this window alone would give to each."""
    heater_status: HeaterStatus | None = None
    """What the telemetry says of the heaters, where the scenario gives it a likelihood."""
    measured_switches: Switch | None = None
    """In open loop, when heaters with uncertain thresholds switched; None: in closed loop."""

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of its theta's entries [q]."""
        return tuple(self.reads)

    @property
    def label(self) -> str:
        """What it is called among several to train on: the part after ``train.``."""
        return self.name.removeprefix("train.")

    @cached_property
    def period(self) -> float:
        """Of the orbit, s."""
        return orbital_period(self.scenario.environment, self.scenario.folder)

    @cached_property
    def valid(self) -> Any:
        """[T, N] whether there is a valid sample."""
        return np.isfinite(self.observed)

    @cached_property
    def simulated(self) -> Any:
        """Positions in theta of what the simulator takes, in its order."""
        return np.array([self.names.index(name) for name in self.simulator.parameters], dtype=np.int64)

    @cached_property
    def places(self) -> Any:
        """Of the residuals' numbers that are entries of theta: channels, columns and positions in theta, [.] each."""
        entries = self.residuals.entries
        found = [(entry.channel, entry.column, self.names.index(entry.name)) for entry in entries]
        return tuple(np.array(found, np.int64).reshape(-1, 3).T)

    @cached_property
    def inferred_noise(self) -> Any:
        """Channels [.] whose noise is inferred, and the positions in theta [.] of its standard deviation."""
        channels, columns, positions = self.places
        return channels[columns == DEVIATION], positions[columns == DEVIATION]

    @cached_property
    def inferred_settings(self) -> Any:
        """Settings [.] of the status likelihood that are inferred, and their positions in theta [.]."""
        if self.heater_status is None:
            return np.empty(0, int), np.empty(0, int)
        return self.heater_status.inferred, np.array([self.names.index(n) for n in self.heater_status.priors], int)

    def status_settings(self, theta: FloatArray) -> FloatArray:
        """Settings [P] of the status likelihood at theta [q]."""
        places, positions = self.inferred_settings
        settings = np.empty(0) if self.heater_status is None else self.heater_status.settings.copy()
        settings[places] = theta[positions]
        return settings

    @cached_property
    def error_shapes(self) -> ErrorShapes | None:
        """Shapes in which a surrogate's temperatures may be off, at the valid samples."""
        basis = self.simulator.error_basis
        return None if basis is None else error_shapes(basis, self.valid)

    def numbers(self, theta: FloatArray) -> FloatArray:
        """The numbers of noise and discrepancy [N, n] at theta [q]; see `noise`."""
        channels, columns, positions = self.places
        numbers = self.residuals.fixed.copy()
        numbers[channels, columns] = theta[positions]
        return numbers

    def noise(self, theta: FloatArray) -> FloatArray:
        """Standard deviation of the noise of one sample of each channel [N], K, at theta [q]; discrepancy apart."""
        return self.residuals.deviations(self.numbers(theta))

    def draw_errors(self, theta: FloatArray, rng: np.random.Generator) -> FloatArray:
        """What telemetry at theta [q] differs by from the simulation, [T, N] K: noise and discrepancy, drawn anew."""
        return self.residuals.draw_errors(self.numbers(theta), rng)

    def replicate(self, theta: FloatArray, run: Trajectory, rng: np.random.Generator) -> FloatArray:
        """Telemetry [T, N], K, drawn anew at theta [q] with its simulation `run`.

        The discrepancy is one that the residuals show; the noise is new.
        """
        discrepancy, drawn = self.residuals.draw_given(self.observed, run.temperatures, self.numbers(theta), rng)
        return np.asarray(run.temperatures + discrepancy + drawn)

    # --- simulations --------------------------------------------------------------------------------------------

    def simulate(self, theta: FloatArray) -> Trajectory:
        """The simulation at theta [q]. Raises SimulationFailure."""
        return self.simulator.simulate(theta[self.simulated])

    def simulate_many(self, thetas: FloatArray) -> list[Trajectory | None]:
        """Simulations at thetas [S, q]; None where one failed."""
        return self.simulator.simulate_many(thetas[:, self.simulated])

    def simulate_as_flown(self, thetas: FloatArray, rng: np.random.Generator) -> list[Trajectory | None]:
        """The same, with thermostats that switch around their thresholds as far as the scenario says (`scatter`)."""
        if isinstance(self.simulator, NetworkSimulator | InexactSimulator):
            return self.simulator.simulate_scattered(thetas[:, self.simulated], rng)
        return self.simulate_many(thetas)

    # --- variants -----------------------------------------------------------------------------------------------

    def independent(self) -> Window:
        """The same window, its theta too, with independent normal noise alone: no discrepancy, no correlation."""
        return replace(self, residuals=self.residuals.independent())

    def of_temperatures(self, kept: NDArray[np.bool_]) -> Window:
        """The same with the temperatures alone, and of these only the samples that are kept, [T, N] or [T, 1]."""
        observed = np.where(kept, self.observed, np.nan)
        residuals = self.residuals.at_samples(np.isfinite(observed))
        return replace(self, observed=observed, residuals=residuals, heater_status=None)

    # --- the likelihood -----------------------------------------------------------------------------------------

    def log_likelihood(self, theta: FloatArray, run: Trajectory | None = None) -> float:
        """Log likelihood at theta [q], up to a constant; run: the simulation, if made. Raises SimulationFailure."""
        run = self.simulate(theta) if run is None else run
        value = float(self.of_residuals(run, self.numbers(theta))[0])
        if self.measured_switches is not None:
            return value + self.at_thresholds(theta)[0]
        if self.heater_status is not None:
            value += self.heater_status.log_likelihood(run, self.status_settings(theta))[0]
        return value

    def log_likelihood_and_gradient(self, theta: FloatArray) -> tuple[float, FloatArray]:
        """Log likelihood at theta [q] and its gradient [q], thresholds apart. Raises SimulationFailure."""
        trajectory, cotangent = self.simulator.linearise(theta[self.simulated])
        value, numbers_bar, *cotangents = self.of_residuals(trajectory, self.numbers(theta))
        theta_bar, switches_bar = self._pull_back(numbers_bar), {}
        if self.heater_status is not None and self.measured_switches is None:
            settings = self.status_settings(theta)
            added, switches_bar["switches_bar"], settings_bar = self.heater_status.log_likelihood(trajectory, settings)
            value += added
            places, positions = self.inferred_settings
            theta_bar[positions] += settings_bar[places]
        theta_bar[self.simulated] += cotangent(*cotangents, **switches_bar)
        return value, theta_bar

    def likelihood_of_numbers(self, run: Trajectory, theta: FloatArray) -> tuple[float, FloatArray]:
        """Log likelihood of a simulation at theta [q], and its gradient [q] by noise and discrepancy alone."""
        value, numbers_bar, *_ = self.of_residuals(run, self.numbers(theta))
        return float(value), self._pull_back(numbers_bar)

    def at_thresholds(self, theta: FloatArray) -> tuple[float, FloatArray, Callable[[FloatArray], FloatArray]]:
        """In open loop: log likelihood (up to a constant) of the sensors being at their thresholds when heaters switch.

        Also the scaled deviations [E], and the vector-Jacobian product of these, to theta [q]. Raises
        SimulationFailure.
        """
        assert isinstance(self.simulator, NetworkSimulator | InexactSimulator)
        assert self.measured_switches is not None
        excess, pull_back = self.simulator.threshold_excess(theta[self.simulated], self.measured_switches)
        scaled = excess / THRESHOLD_ERROR

        def to_theta(bar: FloatArray) -> FloatArray:
            theta_bar = np.zeros(len(self.names))
            theta_bar[self.simulated] = pull_back(bar / THRESHOLD_ERROR)
            return theta_bar

        return -0.5 * float((scaled**2).sum()), scaled, to_theta

    def of_residuals(self, run: Trajectory, numbers: FloatArray) -> tuple[Any, ...]:
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

    @cached_property
    def _own(self) -> threading.local:
        """What each thread has for itself."""
        return threading.local()

    def _pull_back(self, numbers_bar: FloatArray) -> FloatArray:
        """Derivative by theta [q] from that by the residuals' numbers [N, n]."""
        channels, columns, positions = self.places
        theta_bar = np.zeros(len(self.names))
        np.add.at(theta_bar, positions, numbers_bar[channels, columns])
        return theta_bar

    # --- its curvature ------------------------------------------------------------------------------------------

    def differences(self, above: FloatArray, below: FloatArray, step: float) -> FloatArray:
        """Derivative of the temperatures [T, N, p] along p directions: central differences of one batch.

        above, below: thetas [p, q] that lie a step before and behind; the located switching makes the simulation
        smooth, so differences are good to about seven digits. Raises SimulationFailure.
        """
        runs = self.simulate_many(np.concatenate([above, below]))
        found = np.zeros((*self.observed.shape, len(above)))
        for k, (right, left) in enumerate(zip(runs, runs[len(above) :], strict=False)):
            if right is None or left is None:
                moved = self.names[int(np.argmax(np.abs(above[k] - below[k])))]
                raise SimulationFailure(f"a simulation next to this point fails, in the direction of '{moved}'")
            found[..., k] = (right.temperatures - left.temperatures) / (2.0 * step)
        return found

    def information(self, prior: PriorTerms, jacobian: FloatArray) -> Information:
        """Minus the Hessian of the log likelihood by coordinates whose theta [q] and slopes are `prior`'s.

        jacobian: [T, N, q] of the temperatures. J^T C^-1 J with C the covariance of the residuals (or of normal ones of
        the same information), and the curvature in what is inferred of noise and discrepancy as if a surrogate were
        exact, bent to be positive. Raises SimulationFailure.
        """
        numbers, run = self.numbers(prior.theta), self.simulate(prior.theta)
        jacobian = np.where(self.valid[..., None], jacobian, 0.0)
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
        residual = np.where(self.valid, self.observed - run.temperatures, 0.0)
        curvature = self._curvature(residual, numbers, prior)
        return Information(0.5 * (hessian + hessian.T), curvature, self._status_information(prior))

    def _curvature(self, residual: FloatArray, numbers: FloatArray, prior: PriorTerms) -> FloatArray:
        """Curvature [q, q] in the entries of theta that are the residuals' numbers; never negative."""
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
        """What the heaters' status adds [q, q], with an exact Jacobian of the switches."""
        hessian = np.zeros((len(prior.theta),) * 2)
        rows: list[FloatArray] = []
        if self.measured_switches is not None:
            _, scaled, pull_back = self.at_thresholds(prior.theta)
            rows = [pull_back(row)[self.simulated] for row in np.eye(len(scaled))]
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

    # --- how far off --------------------------------------------------------------------------------------------

    def residual(self, run: Trajectory) -> FloatArray:
        """Telemetry minus simulation [T, N], K; NaN where there is no valid sample."""
        return np.where(self.valid, self.observed - run.temperatures, np.nan)

    def mean_square(self, run: Trajectory, status_weight: float) -> float:
        """Mean square error over all channels, K^2.

        status_weight: kelvin that a wrongly simulated heater status sample counts as.
        """
        residual = np.where(self.valid, self.observed - run.temperatures, 0.0)
        mean_square = float(np.einsum("tk,tk->", residual, residual) / self.valid.sum())
        if status_weight > 0.0 and np.isfinite(self.status).any():
            mean_square += status_weight**2 * float(np.nanmean(np.abs(self.status - run.status)))
        return mean_square
