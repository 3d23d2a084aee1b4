"""An emulator: runs of a slow simulator, learnt, and a simulator with derivatives in its place.

Trajectories are principal shapes whose coefficients are Gaussian processes over the parameters, on the unconstrained
scale of the priors. What the emulator does not know is a sum of shapes with independent Gaussian weights: the shapes
themselves, with the processes' variances, and the shapes of the truncation error. This is what the likelihood takes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from ..probability import Priors
from ..problem import Window
from ..simulator import FloatArray, SimulationFailure, Trajectory, in_parallel
from .gaussian_process import GaussianProcesses, fit
from .principal import PrincipalShapes, principal_shapes
from .runs import TrainingRuns

_REACH = 1.5


@dataclass(frozen=True)
class Emulator:
    """Temperatures at the runs' T sample times as a function of z [d], with the error's shapes and their variances."""

    runs: TrainingRuns
    """The S runs that it was fitted to, all finished."""
    scale: Priors
    """Of the runs' theta: z is theta on their unconstrained scale."""
    centre: FloatArray
    """[d] mean of the runs' z."""
    spread: FloatArray
    """[d] standard deviation of the runs' z: the processes' inputs are (z - centre) / spread."""
    principal: PrincipalShapes
    coefficients: FloatArray
    """[S, r] of the runs."""
    processes: GaussianProcesses

    @cached_property
    def error_basis(self) -> FloatArray:
        """[T, N, r + t] K."""
        return np.ascontiguousarray(np.concatenate([self.principal.shapes, self.principal.tail], axis=2))

    def during(self, window: slice) -> Emulator:
        """The same at these of the sample times."""
        return replace(self, runs=self.runs.during(window), principal=self.principal.during(window))

    def inputs(self, z: FloatArray) -> FloatArray:
        """The processes' inputs [..., d] at z [..., d]."""
        return (z - self.centre) / self.spread

    def covers(self, z: FloatArray) -> bool:
        """Whether z [d] is not far beyond the runs: at most `_REACH` times as far out as the outermost of them.

        Farther out the processes extrapolate, and their variance means nothing.
        """
        return bool(np.linalg.norm(self._whitening @ self.inputs(z)) <= self._radius)

    @cached_property
    def _whitening(self) -> FloatArray:
        """[d, d]: gives the runs' inputs a covariance of one."""
        inputs = self.processes.inputs
        values, directions = np.linalg.eigh(inputs.T @ inputs / len(inputs))
        return np.asarray(directions.T / np.sqrt(np.maximum(values, 1e-12 * values[-1]))[:, None])

    @cached_property
    def _radius(self) -> float:
        return _REACH * float(np.linalg.norm(self.processes.inputs @ self._whitening.T, axis=1).max())

    def predict(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean and standard deviation of the temperatures at z [P, d], [P, T, N] K each."""
        found = [self.processes.predict(x) for x in self.inputs(z)]
        mean, variance = (np.array(part) for part in zip(*found, strict=True))
        return self._temperatures(mean), self.deviations(variance)

    def deviations(self, variance: FloatArray) -> FloatArray:
        """Standard deviation of the temperatures [P, T, N] K, where the coefficients have variances [P, r]."""
        of_all = np.concatenate([variance, np.tile(self.principal.tail_variance, (len(variance), 1))], axis=1)
        return np.sqrt(np.einsum("tnr,pr->ptn", self.error_basis**2, of_all))

    def leave_one_out(self) -> tuple[FloatArray, FloatArray]:
        """Each run's temperatures less what the others predict, and the standard deviation of that, [S, T, N] K each.

        The shapes and hyper-parameters are those of all runs.
        """
        error, variance = self.processes.leave_one_out()
        return self.runs.temperatures - self._temperatures(self.coefficients - error), self.deviations(variance)

    def _temperatures(self, coefficients: FloatArray) -> FloatArray:
        return self.principal.mean + np.einsum("tnr,pr->ptn", self.principal.shapes, coefficients)


def fit_emulator(runs: TrainingRuns, scale: Priors, tolerance: FloatArray) -> Emulator:
    """An emulator of finished runs, whose theta has the priors `scale`.

    tolerance: [N] K, what the principal shapes may leave out of each channel (root mean square); it is also the unit in
    which channels are weighed.
    Raises FlightcalError where the runs are too few.
    """
    z = scale.to_z(runs.theta)
    centre, spread = z.mean(axis=0), z.std(axis=0)
    spread = np.where(spread > 0.0, spread, 1.0)
    principal = principal_shapes(runs.temperatures, tolerance)
    coefficients = principal.coefficients(runs.temperatures)
    processes = fit((z - centre) / spread, coefficients)
    return Emulator(runs, scale, centre, spread, principal, coefficients, processes)


@dataclass(frozen=True)
class EmulatedSimulator:
    """An emulator as a simulator of one window.

    A heater's duty cycle is smooth in the parameters, and is emulated too (its mean; between 0 and 1). When it switches
    is not: status and switches are those of the real run whose temperatures are nearest to the emulated ones.
    """

    emulator: Emulator
    certain: bool = False
    """As if it had no error: for comparison, never for a calibration."""
    heater_powers: Callable[[FloatArray], FloatArray] | None = None
    """Power [H] W of each heater at theta [d], where the real simulator knows it: runs do not tell."""

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of theta's entries."""
        return self.emulator.runs.parameters

    @property
    def channels(self) -> tuple[str, ...]:
        """Temperature channels."""
        return self.emulator.runs.channels

    @property
    def heaters(self) -> tuple[str, ...]:
        """Names of the heaters."""
        return self.emulator.runs.heaters

    @property
    def error_basis(self) -> FloatArray | None:
        """[T, N, r] K."""
        return None if self.certain else self.emulator.error_basis

    def on(self, window: slice) -> EmulatedSimulator:
        """The same at these of the sample times."""
        return replace(self, emulator=self.emulator.during(window))

    def heater_power(self, theta: FloatArray) -> FloatArray:
        """Power [H] W of each heater while it is on, at theta [d]; NaN where it is not known."""
        if self.heater_powers is None:
            return np.full(len(self.heaters), np.nan)
        return self.heater_powers(theta)

    def simulate(self, theta: FloatArray) -> Trajectory:
        """The emulated simulation at theta [d]. Raises SimulationFailure where theta is far from all runs."""
        x = self._inputs(theta)
        return self._trajectory(x, *self.emulator.processes.predict(x))

    def simulate_many(self, thetas: FloatArray) -> list[Trajectory | None]:
        """Emulated simulations at thetas [S, d]."""

        _ = self._duty_processes  # fitted before the threads want it

        def one(k: int) -> Trajectory | None:
            try:
                return self.simulate(thetas[k])
            except SimulationFailure:
                return None

        return in_parallel(one, len(thetas))

    def linearise(self, theta: FloatArray) -> tuple[Trajectory, Callable[..., FloatArray]]:
        """As `simulate`, and the product: cotangents of temperatures [T, N] and error variance [r] -> theta [d]."""
        z = self._z(theta)
        x = self.emulator.inputs(z)
        mean, variance, cotangent = self.emulator.processes.linearise(x)
        return self._trajectory(x, mean, variance), partial(self._cotangent, z, cotangent)

    def _z(self, theta: FloatArray) -> FloatArray:
        z = self.emulator.scale.to_z(theta)
        if not np.isfinite(z).all():
            raise SimulationFailure("a parameter is not finite, or outside of its prior")
        if not self.emulator.covers(z):
            raise SimulationFailure("the parameters are far from all runs that the emulator was made from")
        return z

    def _inputs(self, theta: FloatArray) -> FloatArray:
        return self.emulator.inputs(self._z(theta))

    def _cotangent(
        self,
        z: FloatArray,
        cotangent: Callable[[FloatArray, FloatArray], FloatArray],
        temperatures_bar: FloatArray,
        error_variance_bar: FloatArray | None = None,
    ) -> FloatArray:
        mean_bar = np.einsum("tnr,tn->r", self.emulator.principal.shapes, temperatures_bar)
        variance_bar = np.zeros_like(mean_bar) if error_variance_bar is None else error_variance_bar[: len(mean_bar)]
        z_bar = cotangent(mean_bar, variance_bar) / self.emulator.spread
        slope = self.emulator.scale.at(z).slope
        # Far outside of a bounded prior theta no longer moves.
        return np.divide(z_bar, slope, out=np.zeros_like(z_bar), where=slope > 0.0)

    def _trajectory(self, x: FloatArray, mean: FloatArray, variance: FloatArray) -> Trajectory:
        principal = self.emulator.principal
        temperatures = principal.mean + np.einsum("tnr,r->tn", principal.shapes, mean)
        difference = (self.emulator.coefficients - mean) * principal.size
        nearest = int(np.argmin(np.einsum("sr,sr->s", difference, difference)))
        return Trajectory(
            temperatures,
            self.emulator.runs.status[nearest],
            self._duty_cycle(x),
            self.emulator.runs.switches[nearest],
            np.empty(0) if self.certain else np.concatenate([variance, principal.tail_variance]),
        )

    def _duty_cycle(self, x: FloatArray) -> FloatArray:
        """[H] at the processes' inputs x [d]; NaN where the runs do not tell."""
        known, processes = self._duty_processes
        duty_cycle = np.full(len(self.heaters), np.nan)
        if processes is not None:
            duty_cycle[known] = np.clip(processes.predict(x)[0], 0.0, 1.0)
        return duty_cycle

    @cached_property
    def _duty_processes(self) -> tuple[NDArray[np.bool_], GaussianProcesses | None]:
        """Which heaters' duty the runs tell [H], and the processes of these."""
        status = self.emulator.runs.status
        of_samples = np.isfinite(status)
        on, count = np.where(of_samples, status, 0.0).sum(axis=1), of_samples.sum(axis=1)
        # [S, H] share of the known samples in which a run's heaters are on.
        duty_cycles = np.divide(on, count, out=np.full(on.shape, np.nan), where=count > 0)
        known = np.asarray(np.isfinite(duty_cycles).all(axis=0))
        inputs = self.emulator.processes.inputs
        return known, fit(inputs, duty_cycles[:, known]) if known.any() else None


def simulated_priors(window: Window) -> Priors:
    """Priors of what a window's simulator takes, in its order."""
    names = tuple(window.names[k] for k in window.simulated)
    return Priors(names, tuple(window.reads[name] for name in names))


def with_emulator(window: Window, emulator: Emulator) -> Window:
    """The window with an emulator of its simulator, which still tells the heaters' power."""
    return replace(window, simulator=EmulatedSimulator(emulator, heater_powers=window.simulator.heater_power))
