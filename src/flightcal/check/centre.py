"""The point at which a problem is examined: the posterior's mode, or what comes nearest to it within the budget."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from ..calibration import climb, find_mode, with_residual_noise
from ..emulation import needs_emulator
from ..errors import FlightcalError
from ..probability import Priors
from ..problem import Problem, Window
from ..progress import SILENT, Progress
from ..simulator import FloatArray, SimulationFailure, Simulator, Trajectory
from .evaluate import ManyRuns, densities

_STEP = 0.1
"""Of z, for derivatives of a simulator without any: so long that the digits it prints do not matter."""
_SHARES = np.array([1.0, 0.5, 0.2, 0.05])
"""Of a Gauss-Newton step that are tried."""


@dataclass(frozen=True)
class Centre:
    """Where the problem is examined, and its Gauss-Newton Hessian there."""

    z: FloatArray
    """[d]."""
    log_density: float
    hessian: FloatArray
    """[d, d] Gauss-Newton approximation of minus the Hessian of the log density, prior included."""
    is_mode: bool
    words: str

    @property
    def covariance(self) -> FloatArray:
        """[d, d] of z in the Gaussian approximation of the posterior."""
        return np.asarray(np.linalg.inv(self.hessian), float)


def find_centre(
    problem: Problem,
    prior_runs: tuple[FloatArray, ManyRuns],
    searches: int,
    seed: int,
    progress: Progress = SILENT,
) -> Centre:
    """The mode, sought from the prior's median and from prior draws; without derivatives, from the best of the draws.

    prior_runs: prior thetas [S, d] and their simulations. searches: see `Effort`.
    Raises FlightcalError where nothing can be simulated.
    """
    if needs_emulator(problem):
        return _without_derivatives(problem, *prior_runs, searches)
    modes = find_mode(
        problem,
        [("the prior's median", problem.priors.median())],
        rng=np.random.default_rng(seed),
        random_starts=searches,
        progress=progress,
    )
    best = modes[0]
    if not np.isfinite(best.log_density):
        raise FlightcalError(
            "no simulation at the prior's median or at prior draws finishes; "
            "see 'flightcal simulate', and check the priors' units and ranges"
        )
    try:
        hessian = problem.gauss_newton_hessian(best.z)
    except SimulationFailure as failure:
        raise FlightcalError(f"simulations next to the mode fail: {failure}") from None
    words = f"the posterior's mode, reached from {best.origin}"
    if not best.converged:
        words = f"a point near the posterior's mode (the search from {best.origin} did not converge)"
    return Centre(best.z, best.log_density, hessian, best.converged, words)


@dataclass(frozen=True)
class _Linear:
    """A simulator replaced by its first-order expansion: what Gauss-Newton steps and Hessians need, whatever the noise.

    Its derivative is exact where the simulator has none at all.
    """

    simulator: Simulator
    priors: Priors
    z: FloatArray
    """[s] of what the simulator takes."""
    run: Trajectory
    jacobian: FloatArray
    """[T, N, s] d temperatures / d z."""

    def __getattr__(self, name: str) -> Any:
        return getattr(self.simulator, name)

    def simulate(self, theta: FloatArray) -> Trajectory:
        """The expansion at theta [s]."""
        move = self.priors.to_z(theta) - self.z
        return replace(self.run, temperatures=self.run.temperatures + self.jacobian @ move)

    def simulate_many(self, thetas: FloatArray) -> list[Trajectory | None]:
        """At thetas [S, s]."""
        return [self.simulate(theta) for theta in thetas]

    def linearise(self, theta: FloatArray) -> tuple[Trajectory, Callable[..., FloatArray]]:
        """The expansion and its vector-Jacobian product."""
        slope = self.priors.at(self.priors.to_z(theta)).slope

        def product(temperatures_bar: FloatArray, *_: Any) -> FloatArray:
            return np.einsum("tn,tnd->d", temperatures_bar, self.jacobian) / slope

        return self.simulate(theta), product


def expanded(problem: Problem, z: FloatArray) -> Problem:
    """The problem with its simulators expanded about z [d] by central differences."""
    theta = problem.to_theta(z)
    windows = tuple(_expanded(window, problem.at(window, theta)) for window in problem.windows)
    return replace(problem, windows=windows, open_loop=None)


def _expanded(window: Window, theta: FloatArray) -> Window:
    """A window expanded about its theta [q]; 2 s + 1 runs in one batch."""
    simulator = window.simulator
    priors = Priors(simulator.parameters, tuple(window.reads[name] for name in simulator.parameters))
    z = priors.to_z(theta[window.simulated])
    steps = _STEP * np.eye(len(z))
    runs = simulator.simulate_many(priors.to_theta(np.concatenate([z[None], z + steps, z - steps])))
    if any(run is None for run in runs):
        raise FlightcalError("simulations next to the best of the prior's draws fail, so nothing can be said of it")
    temperatures = np.stack([cast(Trajectory, run).temperatures for run in runs])
    above, below = temperatures[1 : len(z) + 1], temperatures[len(z) + 1 :]
    jacobian = np.moveaxis((above - below) / (2.0 * _STEP), 0, -1)
    linear = _Linear(simulator, priors, z, cast(Trajectory, runs[0]), jacobian)
    return replace(window, simulator=cast(Simulator, linear))


def _without_derivatives(problem: Problem, draws: FloatArray, runs: ManyRuns, rounds: int) -> Centre:
    """Gauss-Newton steps with differences, from the prior draw that is nearest to the telemetry."""
    misfits = [np.inf if run is None else float(np.nanmean(problem.residual(run) ** 2)) for run in runs]
    if not np.isfinite(misfits).any():
        raise FlightcalError("no simulation at the prior's draws finishes; see 'flightcal simulate'")
    z = problem.to_z(with_residual_noise(problem, draws[int(np.argmin(misfits))]))
    value = float(densities(problem, z[None])[0][0])
    converged = False
    for _ in range(rounds):
        linear = expanded(problem, z)
        step = climb(linear, z).z - z
        tried = z + _SHARES[:, None] * step
        values, _runs = densities(problem, tried)
        best = int(np.argmax(values))
        converged = bool(values[best] - value < 0.1)
        if values[best] <= value:
            break
        z, value = tried[best], float(values[best])
        if converged:
            break
    words = "the best point found" if not converged else "the posterior's mode, as far as differences tell"
    words += f" (at most {rounds} Gauss-Newton steps from the best of {len(draws)} prior draws: no derivatives)"
    return Centre(z, value, expanded(problem, z).gauss_newton_hessian(z), converged, words)
