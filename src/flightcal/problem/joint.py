"""One calibration on several windows: shared parameters, and initial temperatures of each window's own.

The log density is that of the priors, once, and the log likelihood of each window's `Problem`. theta is ordered: the
scenario's parameters, noise and what else its problems infer, ``drift.<parameter>`` and
``drift.<parameter>.<window>`` where a parameter drifts, ``initial.<window>.<node>`` (K).

A parameter that drifts has, in window w, the unconstrained value z + tau xi_w: z is the common one, tau
(``drift.<parameter>``) the standard deviation between windows and xi_w (``drift.<parameter>.<window>``, standard
normal) how far this window is off. That is z_w ~ N(z, tau^2), non-centred (Papaspiliopoulos et al. 2007, Statistical
Science 22, 59-73), so that a small tau makes no funnel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import xarray

from ..compiled import warm
from ..errors import ScenarioError
from ..probability import Priors, ResidualModel
from ..scenario import HalfNormal, Normal, Prior, Scenario, Uniform, is_trained, support
from ..simulator import FloatArray, IntArray, NetworkSimulator, Simulator, Switch, Trajectory
from .coordinates import Whitening
from .native import NativeDensity, native_density
from .problem import Problem, build_problem


@dataclass(frozen=True)
class JointProblem:
    """Several windows' problems as one; it answers what a `Problem` does, the windows' samples one after another."""

    problems: tuple[Problem, ...]
    priors: Priors
    open_loop: JointProblem | None = None
    """The same with every heater driven by its measured status, where there is one."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of theta's entries [d]."""
        return self.priors.names

    @property
    def scenario(self) -> Scenario:
        """The scenario of all windows."""
        return self.problems[0].scenario

    @property
    def window(self) -> str:
        """Names of the windows."""
        return ", ".join(problem.window for problem in self.problems)

    @property
    def simulator(self) -> Simulator:
        """The first window's, for what does not depend on the window: channels and heaters."""
        return self.problems[0].simulator

    @cached_property
    def times(self) -> Any:
        """[T] datetime64, UTC, of all windows."""
        return np.concatenate([problem.times for problem in self.problems])

    @cached_property
    def observed(self) -> FloatArray:
        """[T, N] K, NaN where there is no valid sample."""
        return np.concatenate([problem.observed for problem in self.problems])

    @cached_property
    def status(self) -> FloatArray:
        """[T, H] measured heater status, NaN where unknown."""
        return np.concatenate([problem.status for problem in self.problems])

    @cached_property
    def valid(self) -> Any:
        """[T, N] whether there is a valid sample."""
        return np.isfinite(self.observed)

    @cached_property
    def simulated(self) -> IntArray:
        """Positions in theta of what simulations depend on."""
        taken = {name for problem in self.problems for name in problem.simulator.parameters}
        return np.array(
            [k for k, name in enumerate(self.names) if name in taken or name.startswith(("initial.", "drift."))]
        )

    @property
    def residuals(self) -> ResidualModel:
        """The first window's noise and discrepancy, for what does not depend on the window."""
        return self.problems[0].residuals

    @cached_property
    def places(self) -> Any:
        """Of the residuals' numbers that are entries of theta: channels, columns and positions in theta, [q] each."""
        channels, columns, positions = self.problems[0].places
        names = self.problems[0].names
        return channels, columns, np.array([self.names.index(names[k]) for k in positions], dtype=int)

    def replicate(self, theta: FloatArray, run: Trajectory, rng: np.random.Generator) -> FloatArray:
        """Telemetry [T, N], K, drawn anew at theta [d] with its simulations `run`; see `Problem.replicate`."""
        ends = np.cumsum([len(problem.times) for problem in self.problems])
        parts = np.split(run.temperatures, ends[:-1])
        return np.concatenate(
            [
                problem.replicate(self.window_thetas(problem, theta[None])[0], replace(run, temperatures=part), rng)
                for problem, part in zip(self.problems, parts, strict=True)
            ]
        )

    def independent(self) -> JointProblem:
        """The same problem, its theta too, with independent normal noise alone."""
        opened = None if self.open_loop is None else self.open_loop.independent()
        return replace(self, problems=tuple(problem.independent() for problem in self.problems), open_loop=opened)

    def likelihood_of_numbers(self, run: Trajectory, theta: FloatArray) -> tuple[float, FloatArray]:
        """Log likelihood of simulations at theta [d], and its gradient [d] by noise and discrepancy alone."""
        value, theta_bar, end = 0.0, np.zeros(len(theta)), 0
        for problem, link in zip(self.problems, self._links, strict=True):
            start, end = end, end + len(problem.times)
            inside = self.window_thetas(problem, theta[None])[0]
            own = replace(run, temperatures=run.temperatures[start:end])
            likelihood, inside_bar = problem.likelihood_of_numbers(own, inside)
            value += likelihood
            np.add.at(theta_bar, link.columns[link.columns >= 0], inside_bar[link.columns >= 0])
        return value, theta_bar

    @cached_property
    def inferred_noise(self) -> Any:
        """Channels [.] whose noise is inferred, and its positions in theta [.]."""
        channels, positions = self.problems[0].inferred_noise
        names = self.problems[0].names
        return channels, np.array([self.names.index(names[k]) for k in positions], dtype=int)

    @cached_property
    def _links(self) -> tuple[_Link, ...]:
        return tuple(_link(self.names, problem) for problem in self.problems)

    def to_theta(self, z: FloatArray) -> FloatArray:
        """Physical values [..., d] of unconstrained z [..., d]."""
        return self.priors.to_theta(z)

    def to_z(self, theta: FloatArray) -> FloatArray:
        """Unconstrained z [..., d] of physical values [..., d]."""
        return self.priors.to_z(theta)

    def noise(self, theta: FloatArray) -> FloatArray:
        """Noise standard deviation per channel [N], K, at theta [d]."""
        return self.problems[0].noise(self.window_thetas(self.problems[0], theta[None])[0])

    def window_thetas(self, problem: Problem, thetas: FloatArray, rng: np.random.Generator | None = None) -> FloatArray:
        """Thetas [S, d'] of a window's problem from joint ones [S, d].

        The window need not be one of these: then its initial temperatures are the medians of their priors, and a
        parameter that drifts is drawn anew around the common value (rng; None: it is the common value).
        """
        link = _link(self.names, problem)
        z = self.to_z(thetas)
        inside = problem.priors.to_theta(link.coordinates(z, self.to_theta(z), rng))
        inside[:, link.unlinked] = problem.priors.median()[link.unlinked]
        kept = np.setdiff1d(np.flatnonzero(link.columns >= 0), link.drifting)
        inside[:, kept] = thetas[:, link.columns[kept]]
        return inside

    def simulate(self, theta: FloatArray) -> Trajectory:
        """The simulations at theta [d], one after another. Raises SimulationFailure."""
        return _joined([problem.simulate(self.window_thetas(problem, theta[None])[0]) for problem in self.problems])

    def simulate_many(self, thetas: FloatArray) -> list[Trajectory | None]:
        """Simulations at thetas [S, d]; None where one of a window failed."""
        runs = [problem.simulate_many(self.window_thetas(problem, thetas)) for problem in self.problems]
        found: list[Trajectory | None] = []
        for of_theta in zip(*runs, strict=True):
            done = [run for run in of_theta if run is not None]
            found.append(_joined(done) if len(done) == len(of_theta) else None)
        return found

    def native_density(self, coordinates: Whitening) -> NativeDensity | None:
        """The log density at w [d] of other coordinates as a C function; None where a window has none."""
        parts = [
            problem.window_parts(link.columns, link.drifts)
            for problem, link in zip(self.problems, self._links, strict=True)
        ]
        windows = [own for own in parts if own is not None]
        return native_density(windows, self.priors, coordinates) if len(windows) == len(parts) else None

    def log_density(self, z: FloatArray) -> float:
        """Log posterior density (up to a constant) at z [d]; -inf where a simulation fails."""
        prior = self.priors.at(z)
        value = float(prior.log_density)
        for problem, link in zip(self.problems, self._links, strict=True):
            inside = link.coordinates(z, prior.theta)
            value += problem.log_density(inside) - float(problem.priors.at(inside).log_density)
        return value

    def log_density_and_gradient(self, z: FloatArray) -> tuple[float, FloatArray]:
        """Log posterior density at z [d] and its gradient [d]; (-inf, 0) where a simulation fails."""
        prior = self.priors.at(z)
        value, gradient = float(prior.log_density), prior.gradient.copy()
        for problem, link in zip(self.problems, self._links, strict=True):
            inside = link.coordinates(z, prior.theta)
            density, by_inside = problem.log_density_and_gradient(inside)
            if not np.isfinite(density):
                return -np.inf, np.zeros_like(z)
            # The window's problem counts its own priors, which are not these.
            own = problem.priors.at(inside)
            value += density - float(own.log_density)
            gradient += (by_inside - own.gradient) @ link.derivative(z, prior.theta, prior.slope)
        return value, gradient

    def gauss_newton_hessian(self, z: FloatArray) -> FloatArray:
        """Gauss-Newton approximation [d, d] of minus the Hessian of the log density at z. Raises SimulationFailure."""
        prior = self.priors.at(z)
        hessian: FloatArray = np.diag(self.priors.precision(z))
        for problem, link in zip(self.problems, self._links, strict=True):
            inside = link.coordinates(z, prior.theta)
            own = problem.gauss_newton_hessian(inside) - np.diag(problem.priors.precision(inside))
            derivative = link.derivative(z, prior.theta, prior.slope)
            hessian += np.einsum("ai,ab,bj->ij", derivative, own, derivative, optimize=True)
        return hessian

    def rmse(self, thetas: FloatArray, status_weight: float = 0.0) -> FloatArray:
        """RMSE over all channels and windows [S], K, of simulations at thetas [S, d]; NaN where one fails."""
        samples = np.array([problem.valid.sum() for problem in self.problems])
        of_windows = [problem.rmse(self.window_thetas(problem, thetas), status_weight) for problem in self.problems]
        mean_square: FloatArray = samples @ np.square(of_windows) / samples.sum()
        return np.sqrt(mean_square)

    def window_values(self, thetas: FloatArray) -> dict[str, FloatArray]:
        """What the drifting parameters are in each window [..., window], at thetas [..., d]."""
        flat = thetas.reshape(-1, thetas.shape[-1])
        inside = [self.window_thetas(problem, flat) for problem in self.problems]
        return {
            name: np.stack(
                [values[:, problem.names.index(name)] for values, problem in zip(inside, self.problems, strict=True)],
                axis=-1,
            ).reshape(*thetas.shape[:-1], len(self.problems))
            for name in drifting_parameters(self.scenario)
        }


AnyProblem = Problem | JointProblem


@dataclass(frozen=True)
class _Link:
    """Where the coordinates [d'] of a window's problem come from among the joint ones [d]."""

    columns: IntArray
    """[d'] position of each; -1: none, as of the initial temperatures of a window that is not calibrated on."""
    drifting: IntArray
    """[p] positions in d' of the parameters that drift,"""
    deviation: IntArray
    """[p] and in d of tau,"""
    score: IntArray
    """[p] and of xi; -1: the window has none of its own."""

    @property
    def unlinked(self) -> IntArray:
        """Positions in d' that come from nowhere."""
        return np.flatnonzero(self.columns < 0)

    @property
    def drifts(self) -> tuple[IntArray, IntArray]:
        """Positions in d of each coordinate's tau and xi [d']; -1: it does not drift."""
        found = np.full((2, len(self.columns)), -1)
        found[:, self.drifting] = self.deviation, self.score
        return found[0], found[1]

    def coordinates(self, z: FloatArray, theta: FloatArray, rng: np.random.Generator | None = None) -> FloatArray:
        """z [..., d'] of the window at joint z [..., d], whose theta is [..., d]; rng: for xi where there is none."""
        inside: FloatArray = z[..., self.columns]
        for position, deviation, score in zip(self.drifting, self.deviation, self.score, strict=True):
            if score >= 0:
                inside[..., position] += theta[..., deviation] * z[..., score]
            elif rng is not None:
                inside[..., position] += theta[..., deviation] * rng.standard_normal(z.shape[:-1])
        return inside

    def derivative(self, z: FloatArray, theta: FloatArray, slope: FloatArray) -> FloatArray:
        """Of the window's coordinates by the joint ones at z [d], [d', d]."""
        derivative = np.zeros((len(self.columns), len(z)))
        derivative[np.arange(len(self.columns)), self.columns] = 1.0
        derivative[self.drifting, self.score] = theta[self.deviation]
        derivative[self.drifting, self.deviation] = z[self.score] * slope[self.deviation]
        return derivative


def _link(names: Sequence[str], problem: Problem) -> _Link:
    place = {name: k for k, name in enumerate(names)}
    label = label_of(problem.window)
    inside = [
        f"initial.{label}.{name.removeprefix('initial.')}" if name.startswith("initial.") else name
        for name in problem.names
    ]
    drifting = [name for name in drifting_parameters(problem.scenario) if f"drift.{name}" in place]
    return _Link(
        np.array([place.get(name, -1) for name in inside]),
        np.array([problem.names.index(name) for name in drifting], dtype=int),
        np.array([place[f"drift.{name}"] for name in drifting], dtype=int),
        np.array([place.get(f"drift.{name}.{label}", -1) for name in drifting], dtype=int),
    )


def label_of(window: str) -> str:
    """What a window is called among several to train on: the part after ``train.``."""
    return window.removeprefix("train.")


def drifting_parameters(scenario: Scenario) -> tuple[str, ...]:
    """Names of the parameters that drift from window to window."""
    return tuple(name for name, parameter in scenario.parameters.items() if parameter.drift is not None)


def calibration_problem(scenario: Scenario, telemetry: xarray.Dataset) -> Problem | JointProblem:
    """What a scenario is calibrated on: its window `train`, or several as one. Raises ScenarioError, TelemetryError."""
    windows = [name for name in scenario.windows if is_trained(name)]
    if not windows:
        raise ScenarioError("windows: found none to train on, expected 'train'")
    written = scenario.discrepancy
    if len(windows) > 1 and written is not None and written.phase is not None:
        raise ScenarioError(
            f"discrepancy.phase: found {len(windows)} windows to train on, expected one: "
            "what comes again in every orbit is learnt from one window"
        )
    problems = tuple(build_problem(scenario, telemetry, window) for window in windows)
    return problems[0] if len(windows) == 1 else join(_with_common_lengthscales(problems))


def warm_problem(problem: AnyProblem) -> None:
    """Have all compiled code of a problem in the cache, as far as its simulator is a thermal network."""
    d = len(problem.names)
    density = problem.native_density(Whitening(np.zeros(d), np.eye(d)))
    if density is not None and isinstance(problem.simulator, NetworkSimulator):
        warm((*density.program.rows, *problem.simulator.rows))


def _with_common_lengthscales(problems: tuple[Problem, ...]) -> tuple[Problem, ...]:
    """The same where lengthscales in time have those default bounds that suit every window. Raises ScenarioError."""
    written = problems[0].scenario.discrepancy
    if written is None or written.time is None or written.time.lengthscale is not None:
        return problems
    priors = [dict(zip(problem.names, problem.priors.priors, strict=True)) for problem in problems]
    common: dict[str, Prior] = {}
    for name in priors[0]:
        if name.startswith("discrepancy.time.lengthscale"):
            bounds = [support(own[name]) for own in priors]
            lower, upper = max(low for low, _ in bounds), min(high for _, high in bounds)
            if lower >= upper:
                raise ScenarioError(
                    "discrepancy.time: found no 'lengthscale' with windows to train on of very different length, "
                    "expected one: no default suits them all"
                )
            common[name] = Uniform(lower=lower, upper=upper)
    return tuple(_with_priors(problem, common) for problem in problems)


def _with_priors(problem: Problem, changed: dict[str, Prior]) -> Problem:
    names, priors = problem.names, problem.priors.priors
    own = Priors(names, tuple(changed.get(name, prior) for name, prior in zip(names, priors, strict=True)))
    opened = None if problem.open_loop is None else _with_priors(problem.open_loop, changed)
    return replace(problem, priors=own, open_loop=opened)


def join(problems: tuple[Problem, ...]) -> JointProblem:
    """Problems of one scenario on different windows as one."""
    scenario = problems[0].scenario
    labels = [label_of(problem.window) for problem in problems]
    priors: dict[str, Prior] = {}
    for problem in problems:
        # What the noise's priors say may depend on the window; the first one's stands for all.
        own = zip(problem.names, problem.priors.priors, strict=True)
        priors = {name: prior for name, prior in own if not name.startswith("initial.")} | priors
    for name in drifting_parameters(scenario):
        priors[f"drift.{name}"] = HalfNormal(scale=scenario.parameters[name].drift or 1.0)
        priors |= {f"drift.{name}.{label}": Normal(mean=0.0, standard_deviation=1.0) for label in labels}
    for label, problem in zip(labels, problems, strict=True):
        for name, prior in zip(problem.names, problem.priors.priors, strict=True):
            if name.startswith("initial."):
                priors[f"initial.{label}.{name.removeprefix('initial.')}"] = prior
    opened = [problem.open_loop for problem in problems if problem.open_loop is not None]
    joint = JointProblem(problems, Priors(tuple(priors), tuple(priors.values())))
    return replace(joint, open_loop=join(tuple(opened))) if len(opened) == len(problems) else joint


def _joined(runs: Sequence[Trajectory]) -> Trajectory:
    """Simulations of several windows one after another; duty cycles are means over the samples."""
    lengths = np.array([len(run.temperatures) for run in runs])
    switches = [run.switches for run in runs]
    return Trajectory(
        temperatures=np.concatenate([run.temperatures for run in runs]),
        status=np.concatenate([run.status for run in runs]),
        duty_cycle=lengths @ np.stack([run.duty_cycle for run in runs]) / lengths.sum(),
        switches=Switch(*(np.concatenate(part) for part in zip(*switches, strict=True))),
    )
