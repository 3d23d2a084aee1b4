"""What telemetry of a window differs by from the simulation: discrepancy and noise, given what calibration has seen.

On the training window the discrepancy is the one that the residuals there show, and noise is drawn anew. On any other
window the discrepancy carries over, with its weights as the training residuals leave them; correlated noise starts from
its stationary distribution. There, the window's first samples, which are not scored, tell about both as well: each draw
is corrected for the residuals that its simulation leaves in them (Matheron's rule: a draw of the prior plus the gain
times what it errs by is a draw given the data; Journel & Huijbregts 1978).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve

from ..probability import DEVIATION, ResidualModel, weights_given
from ..problem import Problem, Window
from ..simulator import FloatArray, IntArray, Trajectory
from .duty import duty_errors

_TELLING = 60
"""First samples at most that a draw is corrected for: each draw and channel has a covariance of them."""


def window_errors(
    problem: Problem,
    window: Window,
    draws: FloatArray,
    first: int,
    stand_in: Callable[[Window], Window] = lambda window: window,
) -> WindowErrors:
    """Errors of a window at posterior draws [S, d] of the problem.

    The nearest training window tells discrepancy and noise; all of them tell the errors of duty cycles. first: how many
    samples at the window's start tell about them; stand_in: gives a training window its emulator.
    """
    trained = [window if other.name == window.name else stand_in(other) for other in problem.windows]
    thetas = [problem.at(other, draws) for other in trained]
    runs = [other.simulate_many(theta) for other, theta in zip(trained, thetas, strict=True)]
    duty = [_duty_errors(other, of_window) for other, of_window in zip(trained, runs, strict=True)]
    names = [other.name for other in problem.windows]
    place = names.index(window.name if window.name in names else problem.nearest(window.times[0]).name)
    train = trained[place]
    missing = np.full(train.observed.shape, np.nan)
    temperatures = np.stack([missing if run is None else run.temperatures for run in runs[place]])
    numbers = np.stack([train.numbers(theta) for theta in thetas[place]])
    errors = WindowErrors(window, train, numbers, temperatures, first, np.concatenate(duty))
    if not problem.shares_weights:
        return errors
    found = []
    for s, of_draw in enumerate(zip(*runs, strict=True)):
        done = tuple(run for run in of_draw if run is not None)
        if len(done) == len(of_draw):
            found.append(problem.weights(done, [theta[s] for theta in thetas])[place])
        else:
            temperatures[s] = np.nan
            found.append(errors.weights(s))
    return replace(errors, together=tuple(found))


def _duty_errors(train: Window, runs: Sequence[Trajectory | None]) -> FloatArray:
    """Of the runs' mean, [K, H]."""
    simulated = [run.status for run in runs if run is not None]
    if not simulated:
        return np.empty((0, train.status.shape[1]))
    seconds = np.asarray((train.times - train.start) / np.timedelta64(1, "s"), float)
    return duty_errors(train.status, np.mean(simulated, axis=0), seconds, train.period, train.duration)


@dataclass(frozen=True)
class WindowErrors:
    """Discrepancy and noise of a window at S draws of theta."""

    window: Window
    train: Window
    numbers: FloatArray
    """[S, N, n]."""
    train_temperatures: FloatArray
    """[S, T, N] K, simulated on the training window; NaN where that failed."""
    first: int
    """How many samples at the window's start the draws are corrected for; 0 on the training window."""
    duty: FloatArray
    """[K, H] by how much telemetry's duty cycles exceed the simulation's in the orbits of the training windows."""
    together: tuple[tuple[FloatArray, FloatArray], ...] = ()
    """[S] what `weights` gives, where training windows share weights; empty: they share none."""
    at_start: FloatArray | None = None
    """[S, N] K, noise with a memory at the window's start; None: nothing is known of it."""

    @property
    def model(self) -> ResidualModel:
        """Of the training window."""
        return self.train.residuals

    @property
    def seconds(self) -> FloatArray:
        """Of the window's samples, from its first one, [T]."""
        return self.window.residuals.terms.seconds

    @property
    def basis(self) -> FloatArray:
        """What the weights do to the window's discrepancy, [T, m]."""
        return self.window.residuals.terms.shapes.basis

    def usable(self) -> NDArray[np.bool_]:
        """[S] whether the training window could be simulated."""
        return np.asarray(np.isfinite(self.train_temperatures).all(axis=(1, 2)))

    def only(self, kept: NDArray[np.bool_]) -> WindowErrors:
        """Those of some of the draws."""
        together = tuple(found for found, rows in zip(self.together, kept, strict=False) if rows)
        numbers, temperatures = self.numbers[kept], self.train_temperatures[kept]
        at_start = None if self.at_start is None else self.at_start[kept]
        return replace(self, numbers=numbers, train_temperatures=temperatures, together=together, at_start=at_start)

    def weights(self, draw: int) -> tuple[FloatArray, FloatArray]:
        """The weights' mean [N, m] and a factor [N, m, m] of their covariance, as the training residuals leave them."""
        if self.together:
            return self.together[draw]
        observed, simulated = self.train.observed, self.train_temperatures[draw]
        return weights_given([self.model.terms], [observed], [simulated], [self.numbers[draw]])[0]

    @cached_property
    def telling(self) -> IntArray:
        """[F] places of the first samples that the draws are corrected for: of dense ones a part tells as much."""
        return np.unique(np.linspace(0, self.first - 1, min(self.first, _TELLING)).round().astype(np.int64))

    # --- the first samples ------------------------------------------------------------------------------------

    def covariances(self, numbers: FloatArray, channel: int, factor: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Covariance with the first samples that tell of the discrepancy and of correlated noise, [T, F] each, K^2.

        numbers: [n] of the channel's noise; factor: [m, m] of the weights' covariance, of the channel.
        """
        told = self.telling
        discrepancy = np.zeros((len(self.seconds), len(told)))
        if self.model.terms.discrepant[channel]:
            discrepancy = self.basis @ (factor @ (self.basis[told] @ factor).T)
        apart = self.seconds[:, None] - self.seconds[told]
        return discrepancy, self.model.terms.kinds[channel].covariance(numbers, apart)

    def at_first(self) -> FirstErrors:
        """The law of the first samples' errors, in which initial temperatures are estimated."""
        draws, channels = self.numbers.shape[:2]
        mean = np.zeros((draws, self.first, channels))
        factors = np.zeros((channels, draws, len(self.telling), len(self.telling)))
        for k, alike in self.alike.items():
            factors[k] = self.numbers[:, k, DEVIATION, None, None] * alike.factor
            missing = np.flatnonzero(~self.told[:, k])
            factors[k][:, missing, missing] = 1.0
        others = [k for k in range(channels) if k not in self.alike]
        for s in range(draws) if others else ():
            weights, factor = self.weights(s)
            for k in others:
                if self.model.terms.discrepant[k]:
                    mean[s, :, k] = self.basis[: self.first] @ weights[k]
                numbers = self.numbers[s, k]
                factors[k, s] = self._factor(numbers, k, *self.covariances(numbers, k, factor[k]))
        return FirstErrors(mean, factors, self.telling)

    @cached_property
    def told(self) -> NDArray[np.bool_]:
        """[F, N] whether there is telemetry at the first samples that tell."""
        return np.asarray(np.isfinite(self.window.observed[self.telling]))

    def _factor(self, numbers: FloatArray, channel: int, discrepancy: FloatArray, noise: FloatArray) -> FloatArray:
        """Cholesky factor [F, F] of the covariance of the samples that tell; what is not valid stands apart."""
        valid = self.told[:, channel]
        total = (discrepancy + noise)[self.telling]
        total = np.where(valid[:, None] & valid, total, 0.0)
        white = self.model.terms.kinds[channel].white_variance(numbers)
        total[np.diag_indices(len(total))] += np.where(valid, white, 1.0)
        return np.asarray(np.linalg.cholesky(total))

    @cached_property
    def alike(self) -> dict[int, Alike]:
        """Of channels without discrepancy whose noise has a known shape."""
        terms, found = self.model.terms, {}
        for k, kind in enumerate(terms.kinds):
            if kind.has_known_shape and not terms.discrepant[k]:
                unit = np.ones(1)
                none, noise = self.covariances(unit, k, np.empty((0, 0)))
                factor = self._factor(unit, k, none, noise)
                found[k] = Alike(factor, np.asarray(cho_solve((factor, True), noise.T).T) * self.told[:, k])
        return found

    # --- drawing ------------------------------------------------------------------------------------------------

    def draw(self, temperatures: FloatArray, rng: np.random.Generator) -> Drawn:
        """Errors of the draws, whose simulations of the window are `temperatures` [S, T, N]."""
        discrepancy, mean = np.zeros(temperatures.shape), np.zeros(temperatures.shape)
        others = [k for k in range(temperatures.shape[2]) if k not in self.alike]
        weights = [self.weights(s) for s in range(len(temperatures))] if others else []
        for s, (expected, factor) in enumerate(weights):
            for k in np.flatnonzero(self.model.terms.discrepant).tolist():
                drawn = expected[k] + factor[k] @ rng.standard_normal(len(expected[k]))
                mean[s, :, k], discrepancy[s, :, k] = self.basis @ expected[k], self.basis @ drawn
        errors = Drawn(mean, discrepancy, *self._noise(rng))
        for k, alike in self.alike.items():
            residual = self.window.observed[self.telling, k] - temperatures[:, self.telling, k]
            drawn = errors.noise[:, self.telling, k] + errors.white[:, self.telling, k]
            errors.mean[:, :, k] += np.nan_to_num(residual) @ alike.gain.T
            errors.noise[:, :, k] += np.nan_to_num(residual - drawn) @ alike.gain.T
        for s, (_, factor) in enumerate(weights):
            self._correct(s, others, factor, temperatures[s], errors)
        return errors

    def _noise(self, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Noise with a memory and noise without, [S, T, N] each, K."""
        shape = (len(self.numbers), len(self.seconds), self.numbers.shape[1])
        noise, white = np.zeros(shape), np.zeros(shape)
        for s, numbers in enumerate(self.numbers):
            for k, kind in enumerate(self.model.terms.kinds):
                noise[s, :, k], white[s, :, k] = kind.draw(numbers[k], self.seconds, rng)
                if self.at_start is not None and kind.has_memory:
                    # It starts from what it was, and no longer from anything.
                    since = self.seconds - self.seconds[0]
                    fades = kind.covariance(numbers[k], since) / kind.covariance(numbers[k], np.zeros(1))
                    gap = np.array([self.window.first_sample])
                    kept = kind.covariance(numbers[k], gap) / kind.covariance(numbers[k], np.zeros(1))
                    noise[s, :, k] += fades * (kept * self.at_start[s, k] + (np.sqrt(1 - kept**2) - 1) * noise[s, 0, k])
        return noise, white

    def _correct(
        self, draw: int, channels: Sequence[int], factors: FloatArray, temperatures: FloatArray, errors: Drawn
    ) -> None:
        """Correct some channels of one draw, simulated temperatures [T, N], for the residuals of the first samples."""
        told = self.telling
        mean, discrepancy, noise, white = (
            part[draw] for part in (errors.mean, errors.discrepancy, errors.noise, errors.white)
        )
        for k in channels:
            numbers = self.numbers[draw, k]
            of_discrepancy, of_noise = self.covariances(numbers, k, factors[k])
            factor = self._factor(numbers, k, of_discrepancy, of_noise)
            residual = self.window.observed[told, k] - temperatures[told, k]
            valid = np.isfinite(residual)
            missing = np.stack([residual - mean[told, k], residual - (discrepancy + noise + white)[told, k]], axis=1)
            missing = np.where(valid[:, None], missing, 0.0)
            solved = np.linalg.solve(factor.T, np.linalg.solve(factor, missing))
            mean[:, k] += (of_discrepancy + of_noise) @ solved[:, 0]
            discrepancy[:, k] += of_discrepancy @ solved[:, 1]
            noise[:, k] += of_noise @ solved[:, 1]


@dataclass(frozen=True)
class Alike:
    """What the first samples tell of noise that differs between draws in its size alone."""

    factor: FloatArray
    """[F, F] Cholesky factor of the covariance of those that tell, of noise of 1 K."""
    gain: FloatArray
    """[T, F] what noise is expected for each K of them."""


@dataclass(frozen=True)
class Drawn:
    """Errors [S, T, N], K, of each draw of theta."""

    mean: FloatArray
    """Expected."""
    discrepancy: FloatArray
    """Drawn, as the next two."""
    noise: FloatArray
    """With a memory."""
    white: FloatArray
    """Without."""


@dataclass(frozen=True)
class FirstErrors:
    """Errors of the first samples of a window at S draws of theta: normal, channels apart."""

    mean: FloatArray
    """[S, T, N] K."""
    factors: FloatArray
    """[N, S, F, F] Cholesky factors of each channel's covariance, K, at those that tell."""
    telling: IntArray
    """[F] places of these."""

    def whiten(self, columns: FloatArray) -> FloatArray:
        """Columns [S, T, N, c], K, in standard deviations of these errors, [S, F, N, c]."""
        parts = [np.linalg.solve(factor, columns[:, self.telling, k]) for k, factor in enumerate(self.factors)]
        return np.stack(parts, axis=2)


@dataclass(frozen=True)
class WhiteErrors:
    """The same of independent noise of standard deviations `noise` [S, N], K."""

    noise: FloatArray
    mean: float = 0.0

    def whiten(self, columns: FloatArray) -> FloatArray:
        """Columns [S, T, N, c], K, in standard deviations of the noise."""
        return np.asarray(columns / self.noise[:, None, :, None])


def white_errors(window: Window, thetas: FloatArray) -> WhiteErrors:
    """Independent noise of thetas [S, q]: what the methods know of that have no model of the residuals."""
    return WhiteErrors(np.stack([window.noise(theta) for theta in thetas]))
