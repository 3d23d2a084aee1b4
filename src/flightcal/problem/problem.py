"""The calibration problem: priors and windows, one or many; the log density on unconstrained coordinates.

The log density is that of the priors, once, and the log likelihood of each `Window`. theta, in physical units, is that
of `entries`; z is theta on the unconstrained scale on which the sampler moves.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..compiled import Spare, warm
from ..probability import (
    DEVIATION,
    Bars,
    Gains,
    Likelihood,
    Priors,
    PriorTerms,
    Weighed,
    information,
    weigh,
    weights_given,
)
from ..scenario import Scenario
from ..simulator import FloatArray, IntArray, SimulationFailure, Trajectory
from .coordinates import Whitening, whitening
from .entries import Entry, Link, link, moving_parameters
from .heat_model import HeatModel
from .native import NativeDensity, native_density
from .window import Window

_DIFFERENCE = 1e-4
"""Of a coordinate."""
_AT_ONCE = 2**24
"""Temperatures that are kept of one batch of simulations."""

Runs = tuple[Trajectory, ...]
"""A simulation of each window."""


@dataclass(frozen=True)
class Problem:
    """Priors and windows: a log density."""

    scenario: Scenario
    entries: tuple[Entry, ...]
    windows: tuple[Window, ...]
    open_loop: Problem | None = None
    """The same with every heater driven by its measured status, where there is one."""
    heat: HeatModel | None = None
    """Unmodelled heat to which the windows respond; None: there is none, or it has not been looked at."""
    flown: tuple[Window, ...] = ()
    """With heat: the windows as they are predicted, with thermostats that act; empty: as they are."""

    def __repr__(self) -> str:
        parameters = sum(entry.kind == "parameter" for entry in self.entries)
        samples = sum(len(window.times) for window in self.windows)
        found = f"{len(self.entries)} unknowns, {parameters} of them parameters"
        windows = ", ".join(window.name for window in self.windows)
        seen = f"{samples} samples of {len(self.channels)} channels in {windows}"
        return f"<Problem of {self.scenario.name!r}: {found}; {seen}{'' if self.heat is None else '; with heat'}>"

    @cached_property
    def priors(self) -> Priors:
        """Of theta's entries [d]; with heat tilted as this says (`HeatModel.tilt_of`)."""
        names = tuple(entry.name for entry in self.entries)
        tilt = None if self.heat is None else self.heat.tilt_of(names)
        return Priors(names, tuple(entry.prior for entry in self.entries), tilt)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of theta's entries [d]."""
        return self.priors.names

    @cached_property
    def links(self) -> tuple[Link, ...]:
        """Where each window's theta comes from."""
        return tuple(link(self.entries, self.windows, window) for window in self.windows)

    @cached_property
    def simulated(self) -> IntArray:
        """Positions in theta of what simulations depend on."""
        found = np.concatenate(
            [
                window_link.columns[window.simulated]
                for window, window_link in zip(self.windows, self.links, strict=True)
            ]
        )
        drifts = [k for k, entry in enumerate(self.entries) if entry.kind == "drift"]
        return np.unique(np.concatenate([found, np.array(drifts, dtype=np.int64)]))

    @cached_property
    def places(self) -> tuple[IntArray, IntArray, IntArray]:
        """Of the residuals' numbers that are entries of theta: channels, columns and positions in theta, [.] each."""
        channels, columns, positions = self.windows[0].places
        return channels, columns, self.links[0].columns[positions]

    @cached_property
    def channels(self) -> tuple[str, ...]:
        """Temperature channels of all windows."""
        return tuple(self.windows[0].simulator.channels)

    @cached_property
    def heaters(self) -> tuple[str, ...]:
        """Heaters of all windows."""
        return tuple(self.windows[0].simulator.heaters)

    def to_theta(self, z: FloatArray) -> FloatArray:
        """Physical values [..., d] of unconstrained z [..., d]."""
        return self.priors.to_theta(z)

    def to_z(self, theta: FloatArray) -> FloatArray:
        """Unconstrained z [..., d] of physical values [..., d]."""
        return self.priors.to_z(theta)

    def at(self, window: Window, thetas: FloatArray, rng: np.random.Generator | None = None) -> FloatArray:
        """Thetas [..., q] of a window from those [..., d] of the calibration.

        The window need not be one of these: then its initial temperatures are the medians of their priors, and a
        parameter that drifts is drawn anew around the common value (rng; None: it is the common value).
        """
        return self._link(window).thetas(thetas, self.priors, rng)

    def _link(self, window: Window) -> Link:
        """That of `links`, where the window or one in its place (an emulator's) is among these."""
        for known, window_link in zip(self.windows, self.links, strict=True):
            if (known.name, known.names) == (window.name, window.names):
                return window_link
        return link(self.entries, self.windows, window)

    def nearest(self, start: np.datetime64) -> Window:
        """The window that is nearest to a time: that it lies in, or whose edge is; of several the nearest start."""

        def distance(window: Window) -> tuple[np.timedelta64, np.timedelta64]:
            first, last = window.times[0], window.times[-1]
            return max(first - start, start - last, np.timedelta64(0, "ns")), abs(first - start)

        return min(self.windows, key=distance)

    def independent(self) -> Problem:
        """The same problem, its theta too, with independent normal noise alone: no discrepancy, no correlation."""
        opened = None if self.open_loop is None else self.open_loop.independent()
        return replace(self, windows=tuple(window.independent() for window in self.windows), open_loop=opened)

    @cached_property
    def is_independent(self) -> bool:
        """Whether all noise is independent and normal, and there is no discrepancy."""
        return all(window.residuals.is_independent for window in self.windows)

    # --- simulations --------------------------------------------------------------------------------------------

    def simulate(self, theta: FloatArray) -> Runs:
        """The simulation of each window at theta [d]. Raises SimulationFailure."""
        return tuple(window.simulate(self.at(window, theta)) for window in self.windows)

    def simulate_many(self, thetas: FloatArray) -> list[Runs | None]:
        """The simulations of each window at thetas [S, d]; None where one of a window failed."""
        by_window = [window.simulate_many(self.at(window, thetas)) for window in self.windows]
        found: list[Runs | None] = []
        for runs in zip(*by_window, strict=True):
            done = tuple(run for run in runs if run is not None)
            found.append(done if len(done) == len(runs) else None)
        return found

    def replicates(self, thetas: FloatArray, runs: Sequence[Runs], rng: np.random.Generator) -> FloatArray:
        """Telemetry [S, T, N], K, drawn anew at thetas [S, d] with their simulations.

        Heat and the discrepancy are ones that the residuals show; the noise is new.
        """
        inside = [self.at(window, thetas) for window in self.windows]
        if self.heat is None:
            return np.stack([self._replicate(*pair, rng) for pair in zip(zip(*inside, strict=True), runs, strict=True)])
        gains = Gains([window.terms for window in self.windows], self.weighed, *self.heat_sizes(thetas))
        left = self.heat_left(runs, thetas)
        weights = gains.draw(left, rng)
        parts = []
        for window, of_window, residual in zip(self.windows, inside, left, strict=True):
            assert window.heat is not None
            noise = np.stack([window.residuals.draw_noise(window.numbers(theta), rng) for theta in of_window])
            does = np.einsum("tnm,sm->stn", window.heat.response, weights, optimize=True)
            parts.append(window.observed - residual + does + noise)
        return np.concatenate(parts, axis=1)

    def _replicate(self, thetas: Sequence[FloatArray], runs: Runs, rng: np.random.Generator) -> FloatArray:
        """Without heat, of one simulation; thetas: of each window [q]."""
        parts = [
            run.temperatures + window.residuals.draw_given(window.numbers(inside), *of_window, rng)
            for window, inside, run, of_window in zip(
                self.windows, thetas, runs, self.weights(runs, thetas), strict=True
            )
        ]
        return np.concatenate(parts)

    def residual(self, runs: Runs) -> FloatArray:
        """Telemetry minus simulation [T, N], K, the windows' samples one after another; NaN where there is none."""
        return np.concatenate([window.residual(run) for window, run in zip(self.windows, runs, strict=True)])

    def rmse(self, thetas: FloatArray, status_weight: float = 0.0) -> FloatArray:
        """RMSE over all channels and windows [S], K, of simulations at thetas [S, d].

        NaN where one fails. status_weight: kelvin that a wrongly simulated heater status sample counts as (0:
        temperatures only).
        """
        kept = sum(window.observed.size for window in self.windows)
        parts = np.array_split(thetas, max(1, math.ceil(len(thetas) * kept / _AT_ONCE)))
        return np.concatenate([self._rmse(part, status_weight) for part in parts])

    def _rmse(self, thetas: FloatArray, status_weight: float) -> FloatArray:
        """`rmse` of one batch."""
        samples = np.array([window.valid.sum() for window in self.windows])
        squares = [window.mean_squares(self.at(window, thetas), status_weight) for window in self.windows]
        return np.asarray(np.sqrt(samples / samples.sum() @ squares))

    # --- the log density ----------------------------------------------------------------------------------------

    def log_density(self, z: FloatArray, runs: Runs | None = None) -> float:
        """Log posterior density (up to a constant) at z [d]; -inf where a simulation fails.

        runs: the simulations at z, where they have been made.
        """
        prior = self.priors.at(z)
        try:
            inside = [(window, prior_terms.theta) for window, prior_terms in self._inside(z, prior)]
            if runs is None:
                runs = tuple(window.simulate(theta) for window, theta in inside)
            value = float(prior.log_density) + self._of_residuals(runs, [theta for _, theta in inside])[0]
            return value + sum(window.of_heaters(theta, run) for (window, theta), run in zip(inside, runs, strict=True))
        except SimulationFailure:
            return -np.inf

    def log_density_and_gradient(self, z: FloatArray) -> tuple[float, FloatArray]:
        """Log posterior density at z [d] and its gradient [d]; (-inf, 0) where a simulation fails."""
        with self._densities.borrowed(self._density, len(z)) as density:
            value, gradient = (density or self._in_python)(z)
        if any(window.measured_switches is not None for window in self.windows) and math.isfinite(value):
            return self._with_thresholds(z, value, gradient)
        return value, gradient

    def coordinates(self, z: FloatArray) -> Whitening:
        """Coordinates in which the posterior is nearly round if z [d] is its mode. Raises SimulationFailure."""
        return whitening(z, self.gauss_newton_hessian(z), self.priors)

    def native_density(self, coordinates: Whitening) -> NativeDensity | None:
        """The log density at w [d] of other coordinates as a C function; None where there is none."""
        if not all(window.is_network for window in self.windows):
            return None
        return native_density(self.windows, self.links, self.priors, coordinates)

    def _in_python(self, z: FloatArray) -> tuple[float, FloatArray]:
        """The compiled density's twin, for simulators that have none; thresholds apart."""
        prior = self.priors.at(z)
        if not math.isfinite(prior.theta.sum()):
            return -np.inf, np.zeros_like(z)
        gradient = prior.gradient.copy()
        try:
            inside = list(self._inside(z, prior))
            linear = [window.simulator.linearise(at.theta[window.simulated]) for window, at in inside]
        except SimulationFailure:
            return -np.inf, np.zeros_like(z)
        value, cotangents = self._of_residuals([run for run, _ in linear], [at.theta for _, at in inside])
        value += float(prior.log_density)
        for (window, at), window_link, (run, cotangent), bars in zip(
            inside, self.links, linear, cotangents, strict=True
        ):
            added, theta_bar = window.pull_back(at.theta, run, cotangent, bars)
            value += added
            gradient += window_link.pull_back(z, prior, at.slope * theta_bar)
        return value, gradient

    def _with_thresholds(self, z: FloatArray, value: float, gradient: FloatArray) -> tuple[float, FloatArray]:
        prior, gradient = self.priors.at(z), gradient.copy()
        for (window, inside), window_link in zip(self._inside(z, prior), self.links, strict=True):
            if window.measured_switches is not None:
                added, scaled, pull_back = window.at_thresholds(inside.theta)
                gradient -= window_link.pull_back(z, prior, inside.slope * pull_back(scaled))
                value += added
        return value, gradient

    def likelihood_of_numbers(self, runs: Runs, theta: FloatArray) -> tuple[float, FloatArray]:
        """Log likelihood of simulations at theta [d], and its gradient [d] by noise and discrepancy alone."""
        inside = [window_link.thetas(theta, self.priors, None) for window_link in self.links]
        value, bars = self._of_residuals(runs, inside)
        theta_bar = np.zeros(len(self.names))
        for window, window_link, of_window in zip(self.windows, self.links, bars, strict=True):
            np.add.at(theta_bar, window_link.columns, window.by_numbers(of_window.numbers, None, of_window.scales))
        return value, theta_bar

    @cached_property
    def shares_weights(self) -> bool:
        """Whether the windows have weights of a discrepancy in common."""
        return len(self.windows) > 1 and bool(self.windows[0].residuals.terms.discrepant.any())

    def _of_residuals(self, runs: Sequence[Trajectory], thetas: Sequence[FloatArray]) -> tuple[float, list[Bars]]:
        """Log likelihood of the windows' temperatures at their thetas, and its derivatives."""
        given = [
            (window.target, run.temperatures, window.numbers(theta), run.error_variance, window.scales(theta))
            for window, run, theta in zip(self.windows, runs, thetas, strict=True)
        ]
        with self._likelihoods.borrowed(self._likelihood, given[0][2].shape[1]) as likelihood:
            return likelihood(*given)

    def _inside(self, z: FloatArray, prior: PriorTerms) -> Iterator[tuple[Window, PriorTerms]]:
        for window, window_link in zip(self.windows, self.links, strict=True):
            yield window, window_link.at(z, prior)

    @cached_property
    def _densities(self) -> Spare[NativeDensity | None]:
        return Spare()

    def _density(self, dimensions: int) -> NativeDensity | None:
        return self.native_density(Whitening(np.zeros(dimensions), np.eye(dimensions)))

    @cached_property
    def _likelihoods(self) -> Spare[Likelihood]:
        return Spare()

    def _likelihood(self, numbers: int) -> Likelihood:
        return Likelihood([window.terms for window in self.windows], numbers)

    # --- its curvature ------------------------------------------------------------------------------------------

    def jacobians(self, z: FloatArray) -> list[FloatArray]:
        """d temperatures / d z of each window, [T, N, d], by central differences; zero for what is not simulated.

        Raises SimulationFailure.
        """
        return [self.jacobians_of(place, z) for place in range(len(self.windows))]

    def jacobians_of(self, place: int, z: FloatArray) -> FloatArray:
        """d temperatures / d z of one window, [T, N, d]. Raises SimulationFailure."""
        window_link = self.links[place]
        inside = self._jacobian(self.windows[place], window_link, z)
        return np.einsum("tna,ab->tnb", inside, window_link.derivative(z, self.priors.at(z)))

    def _jacobian(self, window: Window, window_link: Link, z: FloatArray) -> FloatArray:
        """d temperatures / d coordinates of one window, [T, N, q]."""
        coordinates = window_link.coordinates(z, self.priors.to_theta(z))
        return window.jacobian(
            Priors(window.names, tuple(self.entries[k].prior for k in window_link.columns)), coordinates
        )

    def gauss_newton_hessian(self, z: FloatArray, beside: Sequence[FloatArray] | None = None) -> FloatArray:
        """Gauss-Newton approximation [d, d] of minus the Hessian of the log density at z: priors and windows.

        beside: d temperatures [T, N, m] of each window by other numbers, which then stand after z [d + m, d + m]; they
        have no prior, and what they do to the heaters' status is not counted. Raises SimulationFailure.
        """
        prior, d = self.priors.at(z), len(z)
        moved = list(self._moved(z, prior, beside))
        if self.heat is not None:
            hessian = self._information_beside_heat(z, prior, moved)
            hessian[:d, :d] += self._curvature_beside_heat(z, prior)
        else:
            hessian = self._information(z, prior, moved)
        for (window, inside), window_link in zip(self._inside(z, prior), self.links, strict=True):
            derivative = window_link.derivative(z, prior)
            found = window.status_information(inside)
            if self.heat is None:
                found += window.noise_information(inside)
            hessian[:d, :d] += np.einsum("ai,ab,bj->ij", derivative, found, derivative, optimize=True)
        hessian[np.arange(d), np.arange(d)] += self.priors.precision(z)
        return hessian

    def _moved(
        self, z: FloatArray, prior: PriorTerms, beside: Sequence[FloatArray] | None
    ) -> Iterator[tuple[FloatArray, FloatArray]]:
        """d temperatures / d coordinates and what is beside these, [T, N, q + m], and of these by z and that."""
        for k, (window, window_link) in enumerate(zip(self.windows, self.links, strict=True)):
            jacobian, derivative = self._jacobian(window, window_link, z), window_link.derivative(z, prior)
            if beside is None:
                yield jacobian, derivative
            else:
                (q, d), m = derivative.shape, beside[k].shape[2]
                both = np.block([[derivative, np.zeros((q, m))], [np.zeros((m, d)), np.eye(m)]])
                yield np.concatenate([jacobian, beside[k]], axis=2), both

    def _information(
        self, z: FloatArray, prior: PriorTerms, moved: Sequence[tuple[FloatArray, FloatArray]]
    ) -> FloatArray:
        """Gauss-Newton of the temperatures, J^T C^-1 J; C: of residuals, or normal ones of their information."""
        terms, numbers, variances = [], [], []
        for window, inside in self._inside(z, prior):
            equivalent, equal = window.residuals.normal_equivalent(window.numbers(inside.theta))
            terms.append(equivalent.with_errors(window.simulator.error_basis))
            numbers.append(equal)
            variances.append(window.simulate(inside.theta).error_variance)
        jacobians, derivatives = zip(*moved, strict=True)
        return information(terms, jacobians, derivatives, numbers, variances)

    @cached_property
    def weighed(self) -> Weighed:
        """What the windows tell of the weights of heat."""
        return weigh([window.terms for window in self.windows])

    def heat_left(self, runs: Sequence[Runs], thetas: FloatArray) -> list[FloatArray]:
        """Telemetry minus S simulations at thetas [S, d] as if without any heat, [S, T, N] K of each window."""
        by_window = zip(self.windows, zip(*runs, strict=True), strict=True)
        left = [np.stack([window.target - run.temperatures for run in of_window]) for window, of_window in by_window]
        more = self.heat_growth(thetas) - 1.0
        if self.heat is not None and more.any():
            for residual, window in zip(left, self.windows, strict=True):
                assert window.heat is not None
                residual += np.einsum("tnm,sm->stn", window.heat.response, more * self.heat.centre, optimize=True)
        return left

    def heat_growth(self, thetas: FloatArray) -> FloatArray:
        """[S, m] by how much more each weight of heat does at thetas [S, d] than where the response was looked at."""
        return np.stack([self.windows[0].growth(numbers) for numbers in self.at(self.windows[0], thetas)])

    def heat_sizes(self, thetas: FloatArray) -> tuple[FloatArray, FloatArray]:
        """At thetas [S, d]: deviations [S, P] of the noise of each window's channels, and of the weights [S, m]."""
        inside = [self.at(window, thetas) for window in self.windows]
        parts = [
            np.stack([window.numbers(value)[:, DEVIATION] for value in thetas_of])
            for window, thetas_of in zip(self.windows, inside, strict=True)
        ]
        return np.concatenate(parts, axis=1), np.stack([self.windows[0].roots(value) for value in inside[0]])

    def _information_beside_heat(
        self, z: FloatArray, prior: PriorTerms, moved: Sequence[tuple[FloatArray, FloatArray]]
    ) -> FloatArray:
        """`_information`, with the weights of heat integrated out."""
        assert self.heat is not None
        inside = [at.theta for _, at in self._inside(z, prior)]
        roots = self.windows[0].roots(inside[0])
        d, m, known = moved[0][1].shape[1], len(roots), self.weighed
        total = np.zeros((d + m, d + m))
        for window, (jacobian, derivative), theta, whitens, response in zip(
            self.windows, moved, inside, known.filters, known.white, strict=True
        ):
            white = whitens.whiten(np.moveaxis(jacobian, 1, 0), window.terms.valid) @ derivative
            columns = np.concatenate([white, response], axis=2)
            precision = window.numbers(theta)[:, DEVIATION] ** -2.0
            total += np.einsum("k,kti,ktj->ij", precision, columns, columns, optimize=True)
        inner = np.eye(m) + roots[:, None] * total[d:, d:] * roots
        half = np.linalg.solve(np.linalg.cholesky(inner), roots[:, None] * total[d:, :d])
        return np.asarray(total[:d, :d] - half.T @ half)

    def _curvature_beside_heat(self, z: FloatArray, prior: PriorTerms) -> FloatArray:
        """Curvature [d, d] of the log likelihood in the sizes of noise and heat, bent to be positive: differences."""
        runs = self.simulate(prior.theta)
        of_noise = np.array(
            [k for k, entry in enumerate(self.entries) if entry.kind in ("noise", "heat")], dtype=np.int64
        )
        columns = []
        for k in of_noise:
            slopes = []
            for sign in (1.0, -1.0):
                moved = z.copy()
                moved[k] += sign * _DIFFERENCE
                at = self.priors.at(moved)
                slopes.append((at.slope * self.likelihood_of_numbers(runs, at.theta)[1])[of_noise])
            columns.append((slopes[1] - slopes[0]) / (2.0 * _DIFFERENCE))
        found = np.reshape(columns, (len(of_noise), len(of_noise)))
        eigenvalues, directions = np.linalg.eigh(0.5 * (found + found.T))
        curvature = np.zeros((len(z), len(z)))
        curvature[np.ix_(of_noise, of_noise)] = (directions * np.abs(eigenvalues)) @ directions.T
        return curvature

    def weights(self, runs: Runs, thetas: Sequence[FloatArray]) -> list[tuple[FloatArray, FloatArray]]:
        """The discrepancy's weights of each window given all residuals: see `probability.weights_given`.

        runs, thetas: of each window, the latter [q].
        """
        numbers = [window.numbers(theta) for window, theta in zip(self.windows, thetas, strict=True)]
        terms = [window.residuals.terms for window in self.windows]
        observed, simulated = [window.observed for window in self.windows], [run.temperatures for run in runs]
        return weights_given(terms, observed, simulated, numbers)

    def warm(self) -> None:
        """Have all compiled code in the cache, as far as the simulators are thermal networks."""
        density = self.native_density(Whitening(np.zeros(len(self.names)), np.eye(len(self.names))))
        if density is not None and self.windows[0].is_network:
            warm((*density.program.rows, *self.windows[0].network.rows))

    # --- what drifts --------------------------------------------------------------------------------------------

    def window_values(self, thetas: FloatArray) -> dict[str, FloatArray]:
        """What the parameters that move are in each window [..., window], at thetas [..., d]."""
        names = moving_parameters(self.scenario)
        if not names:
            return {}
        inside = [(window, self.at(window, thetas)) for window in self.windows]
        return {
            name: np.stack([values[..., window.names.index(name)] for window, values in inside], axis=-1)
            for name in names
        }
