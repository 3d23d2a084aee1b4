"""Calibrating a simulator that is slow and has no derivatives: an emulator, and real runs where the posterior lives.

A start design through the priors; then, round by round: fit an emulator to the runs near the posterior, sample the
posterior with it (its error is in the likelihood), and run the simulator at those posterior draws from which the
emulator's error in the posterior shrinks most. The posterior is that of as much of the window as the emulator follows.
It ends when the emulator's error no longer matters, or with the budget. With several windows each has an emulator of
its own, all at the same thetas; the posterior is that of all together.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from ..calibration import find_mode, least_effective, sample_problem
from ..errors import FlightcalError
from ..probability import DEVIATION
from ..problem import Problem, Window, whitening
from ..progress import SILENT, Progress, about
from ..scenario import EmulatorSettings, NutsSettings
from ..simulator import FloatArray, SimulationFailure
from ..telemetry import quiet_noise
from .design import Evaluate, RealRuns, Runs, check_start, on_all_windows, start_thetas, taken, thetas_of, title
from .emulator import Emulator, fit_emulator, simulated_priors, with_emulator
from .held_out import HeldOutScores, together, validate
from .horizon import farthest_emulator, shape_tolerance
from .influence import influence, most_telling
from .runs import TrainingRuns, failure_summary

_NUTS = NutsSettings(chains=4, draws=400, warmup=200)
"""Of a round that may be the last: enough for means within 0.05 standard deviations."""
_COARSE = NutsSettings(chains=4, draws=100, warmup=150)
"""Of any other round: enough to choose the next runs by."""
_LEAST_NOISE = 1e-3  # K
_REACH = 9.0
"""Runs within so many posterior standard deviations of its mean belong to its surroundings."""
_NEAREST_PER_PARAMETER = 8
"""At least so many runs for each parameter are fitted, however far: the nearest."""
_JUDGED_PER_PARAMETER = 4
"""So many of the nearest runs for each parameter tell how far into the window the emulator can be trusted."""
_MODE_STARTS = 4


@dataclass(frozen=True)
class Round:
    """What one round found; numbers of runs, samples and shapes are those of all windows together."""

    number: int
    runs: int
    """Asked for so far."""
    failed: int
    samples: int
    """Of the windows, from their beginnings, that the posterior was taken from."""
    fitted: int
    """Runs that the emulator was fitted to: the finished ones near the posterior of the round before."""
    shapes: int
    error_share: float
    """Emulator's standard deviation over the noise: root mean square over outputs and posterior draws."""
    expected_shift: float
    """Of the posterior along any direction by the emulator's error, in its standard deviations."""
    mean_shift: float
    """Largest difference of the parameters' means from the round before, in standard deviations; NaN in the first."""
    monte_carlo: float
    """Two standard errors of `mean_shift` by sampling."""
    validation: HeldOutScores | None
    """Of the emulator of the round before, on the runs that this round added."""
    verdict: str
    """What goes on."""

    def __str__(self) -> str:
        covered = (
            "" if self.validation is None else f", new runs covered {self.validation.channels[-1].coverage[-1]:.0%}"
        )
        return (
            f"round {self.number}: {self.runs} runs ({self.failed} failed, {self.fitted} fitted), "
            f"first {self.samples} samples, {self.shapes} shapes, emulator's sd / noise {self.error_share:.3f}, "
            f"expected shift {self.expected_shift:.3f} sd, mean moved {self.mean_shift:.3f} sd{covered}: {self.verdict}"
        )


@dataclass(frozen=True)
class Fit:
    """A window's emulator."""

    window: Window
    """As much of it as the emulator follows, with the emulator as its simulator."""
    emulator: Emulator
    fitted: NDArray[np.intp]
    """Positions of the runs that it was fitted to."""
    tolerance: FloatArray
    """[N] K, what it is fitted with on the whole window."""


@dataclass(frozen=True)
class Learnt:
    """The end of active learning."""

    problem: Problem
    """With emulators as its windows' simulators."""
    fits: tuple[Fit, ...]
    """Each window's."""
    runs: Runs
    """All of them, failed ones too."""
    rounds: tuple[Round, ...]
    reached: bool
    """Whether the emulator's error no longer matters, by the stated rule."""
    theta: FloatArray
    """[d] posterior mean of the last round: where to start sampling."""
    failures: str
    """How many runs failed, and where; empty where none did."""


@dataclass(frozen=True)
class Belief:
    """Posterior draws of a round."""

    runs: int
    """Asked for before it."""
    z: FloatArray
    """[S, d]."""
    effective: float
    """Least effective number of draws."""
    samples: int
    """Of the windows, of which this is the posterior."""

    @property
    def mean(self) -> FloatArray:
        """[d] of z."""
        return np.asarray(self.z.mean(axis=0))

    @property
    def deviation(self) -> FloatArray:
        """[d] of z."""
        return np.asarray(self.z.std(axis=0))


def learn(
    problem: Problem,
    evaluate: Evaluate,
    runs: Runs,
    settings: EmulatorSettings,
    seed: int,
    *,
    beginning: Callable[[Window, int], Window] | None = None,
    beliefs: Sequence[Belief] = (),
    save: Callable[[Runs], None] = lambda _: None,
    save_beliefs: Callable[[list[Belief]], None] = lambda _: None,
    progress: Progress = SILENT,
) -> Learnt:
    """Learn an emulator of each window's simulator around the posterior.

    beginning: a window's first so many samples (None: only whole windows are looked at; see `horizon`). runs, beliefs:
    what has been run and sampled before (`no_runs`: nothing). The same seed and settings ask for the same, so nothing
    is run or sampled again, and an interrupted call ends as it would have. save: is given all runs after each few of
    them; save_beliefs: those of all rounds after each. Raises FlightcalError where too few runs of the start design
    finish.
    """
    windows = problem.windows
    inputs = sum(len(window.simulator.parameters) for window in windows)
    shortest = min(len(training) for training in runs)  # of all windows but where an interrupted call saved only some
    campaign = RealRuns(problem, evaluate, save, taken(runs, slice(0, shortest)), settings.runs, progress)
    count = max(0, min(settings.runs, settings.start or 10 * inputs)) // len(windows)
    usual = max(len(windows), settings.batch or 4 * inputs)
    most_rounds = 1 + _batches(settings.runs - count * len(windows), usual)
    progress.say(f"at most {settings.runs} runs of the simulator, and rounds of sampling: at most {most_rounds}")
    runs = campaign.complete(taken(runs, slice(0, 0)), start_thetas(problem, count, seed), 0)
    check_start(problem, runs)
    whole = sum(len(window.times) for window in windows)
    validation: HeldOutScores | None = None
    belief: Belief | None = None
    rounds: list[Round] = []
    found: list[Belief] = []
    while True:
        started, rng = perf_counter(), np.random.default_rng([seed, len(rounds), 1])
        asked = sum(len(training) for training in runs)
        batch = min(usual, settings.runs - asked) // len(windows)
        fits = _fit(problem, runs, belief, beginning if batch > 0 else None)
        emulated = replace(problem, windows=tuple(fit.window for fit in fits), open_loop=None)
        samples = sum(len(fit.window.times) for fit in fits)
        before, kept = belief, _kept(beliefs, len(rounds), asked, samples)
        if kept is None:
            is_compared = before is not None and before.samples == samples == whole
            nuts, at_random = _NUTS if is_compared else _COARSE, np.random.default_rng([seed, len(rounds)])
            belief = _posterior(emulated, runs, before, nuts, at_random, progress)
        else:
            belief = kept
        found.append(belief)
        save_beliefs(found)
        share, shift = influence(emulated, belief.z, rng)
        moved, monte_carlo = _movement(before, belief)
        reached = (
            samples == whole
            and before is not None
            and before.samples == whole
            and shift <= settings.shift
            and moved <= settings.shift + monte_carlo
            and validation is not None
            and validation.passed
        )
        verdict = (
            "the emulator's error no longer matters"
            if reached
            else "the budget of runs is spent"
            if batch <= 0
            else f"{batch * len(windows)} more runs"
        )
        rounds.append(
            Round(
                number=len(rounds), runs=asked, samples=samples,
                failed=sum(int((~training.finished).sum()) for training in runs),
                fitted=sum(len(fit.fitted) for fit in fits),
                shapes=sum(fit.emulator.coefficients.shape[1] for fit in fits), error_share=share, expected_shift=shift,
                mean_shift=moved, monte_carlo=monte_carlo, validation=validation, verdict=verdict,
            )
        )  # fmt: skip
        progress.at(asked)
        left = 0 if reached or kept is not None else _batches(settings.runs - asked, usual)
        progress.say(f"{rounds[-1]}{_time_left(left, perf_counter() - started)}")
        if reached or batch <= 0:
            texts = {
                title(problem, window): failure_summary(training)
                for window, training in zip(windows, runs, strict=True)
            }
            failures = "; ".join(f"{start}{text}" for start, text in texts.items() if text)
            return Learnt(emulated, fits, runs, tuple(rounds), reached, problem.to_theta(belief.mean), failures)
        number = len(rounds)
        runs = campaign.complete(runs, problem.to_theta(most_telling(emulated, belief.z, batch, rng)), number)
        new = [training.take((training.round == number) & training.finished) for training in runs]
        validation = _validation(problem, fits, new) if all(len(training) for training in new) else None


def _kept(beliefs: Sequence[Belief], number: int, runs: int, samples: int) -> Belief | None:
    """What an earlier call sampled in a round, from the same runs and samples."""
    belief = beliefs[number] if number < len(beliefs) else None
    return belief if belief is not None and (belief.runs, belief.samples) == (runs, samples) else None


def _batches(runs: int, batch: int) -> int:
    return max(0, math.ceil(runs / batch))


def _time_left(rounds: int, seconds: float) -> str:
    """How long so many more rounds take, if each samples as long as the last one did."""
    return f"; rounds left: at most {rounds}, {about(seconds)} each beside the runs" if rounds else ""


def _fit(
    problem: Problem, runs: Runs, belief: Belief | None, beginning: Callable[[Window, int], Window] | None
) -> tuple[Fit, ...]:
    """Emulators of the runs near the posterior, of all runs where there is none yet."""
    fits = []
    for window, link, found in zip(problem.windows, problem.links, runs, strict=True):
        # One scale of z for all rounds, though a prior may be centred on a sample that the beginning has not.
        scale, theta, draws = simulated_priors(window), None, None
        if belief is not None:
            theta = problem.at(window, problem.to_theta(np.median(belief.z, axis=0)))
            draws = link.coordinates(belief.z, problem.to_theta(belief.z))[:, window.simulated]
        noise = noise_level(window, theta)
        chosen, nearest = _near(scale.to_z(found.theta), found.finished, draws)
        near, tolerance = found.take(chosen), shape_tolerance(noise, len(window.times))
        if beginning is None:
            emulator = fit_emulator(near, scale, tolerance)
        else:
            emulator = farthest_emulator(near, scale, noise, nearest)
        samples = len(emulator.runs.times)
        shown = window if beginning is None or samples == len(window.times) else beginning(window, samples)
        fits.append(Fit(with_emulator(shown, emulator), emulator, chosen, tolerance))
    return tuple(fits)


def _validation(problem: Problem, fits: Sequence[Fit], runs: Sequence[TrainingRuns]) -> HeldOutScores:
    """Of emulators, on finished runs of each window that they were not fitted to."""
    return together(
        {
            title(problem, fit.window): validate(fit.emulator, training.during(slice(0, len(fit.window.times))))
            for fit, training in zip(fits, runs, strict=True)
        }
    )


def noise_level(window: Window, theta: FloatArray | None = None) -> FloatArray:
    """[N] K: the noise at theta [q], or without one what the telemetry's second differences look like."""
    if theta is not None:
        return np.maximum(window.noise(theta), _LEAST_NOISE)
    noise = window.residuals.fixed[:, DEVIATION].copy()
    for k in window.inferred_noise[0]:
        noise[k] = quiet_noise(window.observed[:, k])
    return np.maximum(noise, _LEAST_NOISE)


def _near(
    z: FloatArray, finished: NDArray[np.bool_], draws: FloatArray | None
) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Positions of the finished runs at z [S, p] that an emulator is fitted to, and which of them are nearest.

    draws: of the posterior [P, p]; None: there is none yet.
    """
    positions = np.flatnonzero(finished)
    if draws is None:
        return positions, np.ones(len(positions), bool)
    factor = np.linalg.cholesky(np.cov(draws.T).reshape(draws.shape[1], -1) + 1e-12 * np.eye(draws.shape[1]))
    distance = np.linalg.norm(np.linalg.solve(factor, (z[positions] - draws.mean(axis=0)).T), axis=0)
    order = np.argsort(distance)
    count = max(int((distance <= _REACH).sum()), _NEAREST_PER_PARAMETER * draws.shape[1])
    chosen = np.sort(order[:count])
    return positions[chosen], np.isin(chosen, order[: _JUDGED_PER_PARAMETER * draws.shape[1]])


def _posterior(
    problem: Problem,
    runs: Runs,
    before: Belief | None,
    nuts: NutsSettings,
    rng: np.random.Generator,
    progress: Progress,
) -> Belief:
    """Posterior draws of the emulated problem, its mode sought from the best real runs and the round before.

    Not from prior draws: where runs are far the emulator's own variance explains any telemetry a little, and a climb
    that starts there ends there.
    """
    starts = [] if before is None else [("the round before", problem.to_theta(before.mean))]
    starts += [("a real run", theta) for theta in _best_runs(problem, runs)]
    mode = find_mode(problem, starts, rng=rng, random_starts=0)[0]
    if not math.isfinite(mode.log_density):
        raise FlightcalError("emulator: found no point of finite density, expected the posterior's mode")
    try:
        coordinates = problem.coordinates(mode.z)
    except SimulationFailure as failure:
        if before is None:
            raise FlightcalError(f"emulator: {failure}") from None
        # The mode is at the edge of where there are runs.
        coordinates = whitening(before.mean, np.asarray(np.linalg.inv(np.cov(before.z.T)), float))
    draws = sample_problem(problem, coordinates, nuts, int(rng.integers(2**32)), progress=progress)
    if draws.interrupted:
        raise KeyboardInterrupt
    samples = sum(len(window.times) for window in problem.windows)
    asked = sum(len(training) for training in runs)
    return Belief(asked, draws.z.reshape(-1, draws.z.shape[-1]), least_effective(draws.z), samples)


def _best_runs(problem: Problem, runs: Runs) -> FloatArray:
    """Thetas [., d] of the best of the runs that finished on all windows, each channel's inferred noise at its RMSE."""
    finished = taken(runs, on_all_windows(runs))
    thetas = thetas_of(problem, finished)
    squares, samples = np.zeros((len(thetas), len(problem.channels))), np.zeros(len(problem.channels))
    for window, training in zip(problem.windows, finished, strict=True):
        temperatures = training.temperatures[:, : len(window.times)]
        residuals = np.where(window.valid, window.observed - temperatures, 0.0)
        squares += np.einsum("stn,stn->sn", residuals, residuals)
        samples += window.valid.sum(axis=0)
    rmse = np.sqrt(squares / np.maximum(samples, 1))
    channels, columns, positions = problem.places
    told = (columns == DEVIATION) & (samples[channels] > 0)
    thetas[:, positions[told]] = np.maximum(rmse[:, channels[told]], _LEAST_NOISE)
    window = problem.windows[0]
    noise = np.stack([window.noise(theta) for theta in problem.at(window, thetas)])
    density = -samples @ (np.log(noise) + 0.5 * (rmse / noise) ** 2).T
    density += problem.priors.at(problem.to_z(thetas)).log_density
    return thetas[np.argsort(-density)[:_MODE_STARTS]]


def _movement(before: Belief | None, now: Belief) -> tuple[float, float]:
    """Largest difference of the means in standard deviations, and two standard errors of such a difference."""
    if before is None:
        return math.nan, math.nan
    moved = float(np.max(np.abs(now.mean - before.mean) / now.deviation))
    return moved, 2.0 * math.sqrt(1.0 / before.effective + 1.0 / now.effective)
