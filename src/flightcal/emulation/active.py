"""Calibrating a simulator that is slow and has no derivatives: an emulator, and real runs where the posterior lives.

A start design through the priors; then, round by round: fit an emulator to the runs near the posterior, sample the
posterior with it (its error is in the likelihood), and run the simulator at those posterior draws from which the
emulator's error in the posterior shrinks most. The posterior is that of as much of the window as the emulator follows.
It ends when the emulator's error no longer matters, or with the budget.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..calibration import find_mode, least_effective, sample
from ..errors import FlightcalError
from ..external import Record
from ..probability import Priors, sobol
from ..problem import Problem, whitening
from ..scenario import EmulatorSettings, NutsSettings
from ..simulator import FloatArray, SimulationFailure
from .emulator import EmulatedSimulator, Emulator, fit_emulator
from .held_out import Validation, validate
from .horizon import farthest_emulator, shape_tolerance
from .influence import influence, most_telling
from .runs import TrainingRuns, failure_summary

Evaluate = Callable[[FloatArray], Sequence[Record]]
"""Real runs at thetas [S, d], in the simulator's order of parameters; failed ones are records too."""

_NUTS = NutsSettings(chains=4, draws=400, warmup=200)
"""Of a round: enough for means within 0.05 standard deviations."""
_PRIOR_SHARE = 0.998
"""Of each prior, through which the start design goes."""
_LEAST_NOISE = 1e-3  # K
_REACH = 9.0
"""Runs within so many posterior standard deviations of its mean belong to its surroundings."""
_NEAREST_PER_PARAMETER = 8
"""At least so many runs for each parameter are fitted, however far: the nearest."""
_JUDGED_PER_PARAMETER = 4
"""So many of the nearest runs for each parameter tell how far into the window the emulator can be trusted."""
_MODE_STARTS = 4
_SAVED_TOGETHER = 8
"""Runs that are asked for, and saved, together: an interruption costs no more than these."""


@dataclass(frozen=True)
class Round:
    """What one round found."""

    number: int
    runs: int
    """Asked for so far."""
    failed: int
    samples: int
    """Of the window, from its beginning, that the posterior was taken from."""
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
    validation: Validation | None
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
class Learnt:
    """The end of active learning."""

    problem: Problem
    """With the emulator as its simulator."""
    emulator: Emulator
    runs: TrainingRuns
    """All of them, failed ones too."""
    fitted: NDArray[np.intp]
    """Positions of the runs that the emulator was fitted to."""
    tolerance: FloatArray
    """[N] K, what it was fitted with."""
    rounds: tuple[Round, ...]
    reached: bool
    """Whether the emulator's error no longer matters, by the stated rule."""
    theta: FloatArray
    """[d] posterior mean of the last round: where to start sampling."""
    failures: str
    """How many runs failed, and where; empty where none did."""


@dataclass(frozen=True)
class _Belief:
    """Posterior draws of a round."""

    z: FloatArray
    """[S, d]."""
    effective: float
    """Least effective number of draws."""
    samples: int
    """Of the window, of which this is the posterior."""

    @property
    def mean(self) -> FloatArray:
        return np.asarray(self.z.mean(axis=0))

    @property
    def deviation(self) -> FloatArray:
        return np.asarray(self.z.std(axis=0))


def learn(
    problem: Problem,
    evaluate: Evaluate,
    runs: TrainingRuns,
    settings: EmulatorSettings,
    seed: int,
    *,
    window: slice | None = None,
    beginning: Callable[[int], Problem] | None = None,
    save: Callable[[TrainingRuns], None] = lambda _: None,
    on_round: Callable[[Round], None] = lambda _: None,
) -> Learnt:
    """Learn an emulator of `problem.simulator` around the posterior.

    evaluate: real runs at the sample times of `runs`; window: the problem's among these (None: all). beginning: the
    problem on its first so many samples (None: only the whole window is looked at; see `horizon`). runs: what has been
    run before (`no_runs`: nothing). The same seed and settings ask for the same runs, so what has been run is not
    run again, and an interrupted call ends as it would have. save: is given all runs after each few of them.
    Raises FlightcalError where too few runs of the start design finish.
    """
    scale = simulated_priors(problem)
    rng = np.random.default_rng(seed)
    campaign = _Campaign(evaluate, save, stored=runs)
    design = start_design(scale, min(settings.runs, settings.start or 10 * len(scale.names)), seed)
    runs = campaign.complete(runs.take(slice(0, 0)), design, 0)
    _check_start(runs)
    part = window or slice(None)
    whole = len(problem.times)
    validation: Validation | None = None
    belief: _Belief | None = None
    rounds: list[Round] = []
    while True:
        noise = noise_level(problem, belief)
        chosen, nearest = _near(scale.to_z(runs.theta), runs.finished, belief, problem)
        near = runs.take(chosen)
        batch = min(settings.batch or 4 * len(scale.names), settings.runs - len(runs))
        if beginning is None or batch <= 0:
            emulator, samples = fit_emulator(near, scale.to_z(near.theta), shape_tolerance(noise, whole)), whole
        else:
            emulator, samples = farthest_emulator(near, scale.to_z(near.theta), noise, part, nearest)
        shown = problem if beginning is None or samples == whole else beginning(samples)
        seen = part if samples == whole else slice(0, samples)
        simulator = EmulatedSimulator(emulator, scale, seen, heater_powers=problem.simulator.heater_power)
        # One scale of z for all rounds, though a prior may be centred on a sample that the beginning has not.
        emulated = replace(shown, simulator=simulator, priors=problem.priors, open_loop=None)
        finished = runs.take(runs.finished).during(part).during(slice(0, samples))
        before, belief = belief, _posterior(emulated, finished, belief, rng)
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
            else f"{batch} more runs"
        )
        rounds.append(
            Round(
                number=len(rounds), runs=len(runs), failed=int((~runs.finished).sum()), samples=samples,
                fitted=len(near), shapes=emulator.coefficients.shape[1], error_share=share, expected_shift=shift,
                mean_shift=moved, monte_carlo=monte_carlo, validation=validation, verdict=verdict,
            )
        )  # fmt: skip
        on_round(rounds[-1])
        if reached or batch <= 0:
            theta = problem.to_theta(belief.mean)
            tolerance, failures = shape_tolerance(noise, whole), failure_summary(runs)
            return Learnt(emulated, emulator, runs, chosen, tolerance, tuple(rounds), reached, theta, failures)
        z = most_telling(emulated, belief.z, batch, rng)
        number = len(rounds)
        runs = campaign.complete(runs, scale.to_theta(z), number)
        new = runs.take((runs.round == number) & runs.finished)
        new = new if samples == whole else new.during(part).during(slice(0, samples))
        validation = validate(emulator, scale.to_z(new.theta), new.temperatures) if len(new) else None


def simulated_priors(problem: Problem) -> Priors:
    """Priors of what the simulator takes, in its order."""
    kept = problem.simulated
    return Priors(tuple(problem.names[k] for k in kept), tuple(problem.priors.priors[k] for k in kept))


def start_design(scale: Priors, count: int, seed: int) -> FloatArray:
    """Thetas [count, d] through the priors but for their farthest tails."""
    return sobol(scale, count, seed, share=_PRIOR_SHARE)


@dataclass(frozen=True)
class _Campaign:
    """Real runs, a few at a time, each few saved."""

    evaluate: Evaluate
    save: Callable[[TrainingRuns], None]
    stored: TrainingRuns
    """What an earlier call ran."""

    def complete(self, runs: TrainingRuns, design: FloatArray, number: int) -> TrainingRuns:
        """`runs` and those of round `number` at thetas `design` [S, d], of which only what is missing is run."""
        there = self.stored.take(self.stored.round == number)
        later = self.stored.take(self.stored.round > number)
        is_there = [bool(np.isclose(there.theta, theta, rtol=1e-9, atol=0.0).all(axis=1).any()) for theta in design]
        missing = design[~np.array(is_there)][: max(0, len(design) - len(there))]
        for first in range(0, len(missing), _SAVED_TOGETHER):
            there = there.add(self.evaluate(missing[first : first + _SAVED_TOGETHER]), number)
            self.save(runs.join(there).join(later))
        return runs.join(there)


def _check_start(runs: TrainingRuns) -> None:
    """Raises FlightcalError where too few runs of the start design finish."""
    least = 2 * (len(runs.parameters) + 1)
    if runs.finished.sum() < least:
        last = "" if runs.finished.all() else f"; the last message: {runs.message[~runs.finished][-1]}"
        raise FlightcalError(
            f"emulator: found {int(runs.finished.sum())} finished runs in the start design, expected at least {least}: "
            f"{failure_summary(runs)}{last}"
        )


def noise_level(problem: Problem, belief: _Belief | None = None) -> FloatArray:
    """[N] K: the posterior's median noise, or before there is one what the telemetry's second differences look like."""
    if belief is not None:
        return np.maximum(problem.noise(problem.to_theta(np.median(belief.z, axis=0))), _LEAST_NOISE)
    noise = problem.fixed_noise.copy()
    for k in np.flatnonzero(np.isnan(noise)):
        values = problem.observed[np.isfinite(problem.observed[:, k]), k]
        # Second differences of white noise have a variance of six times its own.
        noise[k] = 1.4826 * np.median(np.abs(np.diff(values, 2))) / math.sqrt(6.0) if len(values) > 2 else 0.0
    return np.maximum(noise, _LEAST_NOISE)


def _near(
    z: FloatArray, finished: NDArray[np.bool_], belief: _Belief | None, problem: Problem
) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Positions of the finished runs at z [S, d] that the emulator is fitted to, and which of them are nearest."""
    positions = np.flatnonzero(finished)
    if belief is None:
        return positions, np.ones(len(positions), bool)
    draws = belief.z[:, problem.simulated]
    factor = np.linalg.cholesky(np.cov(draws.T).reshape(draws.shape[1], -1) + 1e-12 * np.eye(draws.shape[1]))
    distance = np.linalg.norm(np.linalg.solve(factor, (z[positions] - draws.mean(axis=0)).T), axis=0)
    order = np.argsort(distance)
    count = max(int((distance <= _REACH).sum()), _NEAREST_PER_PARAMETER * draws.shape[1])
    chosen = np.sort(order[:count])
    return positions[chosen], np.isin(chosen, order[: _JUDGED_PER_PARAMETER * draws.shape[1]])


def _posterior(problem: Problem, runs: TrainingRuns, before: _Belief | None, rng: np.random.Generator) -> _Belief:
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
        coordinates = whitening(mode.z, problem.gauss_newton_hessian(mode.z))
    except SimulationFailure as failure:
        if before is None:
            raise FlightcalError(f"emulator: {failure}") from None
        # The mode is at the edge of where there are runs.
        coordinates = whitening(before.mean, np.asarray(np.linalg.inv(np.cov(before.z.T)), float))
    draws = sample(problem.log_density_and_gradient, coordinates, _NUTS, int(rng.integers(2**32)))
    return _Belief(draws.z.reshape(-1, draws.z.shape[-1]), least_effective(draws.z), len(problem.times))


def _best_runs(problem: Problem, runs: TrainingRuns) -> FloatArray:
    """Thetas [., d] of the finished runs of the highest density, with each channel's inferred noise at its RMSE."""
    residuals = np.where(problem.valid, problem.observed - runs.temperatures, 0.0)
    samples = problem.valid.sum(axis=0)
    rmse = np.sqrt(np.einsum("stn,stn->sn", residuals, residuals) / np.maximum(samples, 1))
    thetas = np.tile(problem.priors.median(), (len(runs), 1))
    thetas[:, problem.simulated] = runs.theta
    channels, positions = problem.inferred_noise
    told = samples[channels] > 0
    thetas[:, positions[told]] = np.maximum(rmse[:, channels[told]], _LEAST_NOISE)
    noise = np.stack([problem.noise(theta) for theta in thetas])
    density = -samples @ (np.log(noise) + 0.5 * (rmse / noise) ** 2).T
    density += problem.priors.at(problem.to_z(thetas)).log_density
    return thetas[np.argsort(-density)[:_MODE_STARTS]]


def _movement(before: _Belief | None, now: _Belief) -> tuple[float, float]:
    """Largest difference of the means in standard deviations, and two standard errors of such a difference."""
    if before is None:
        return math.nan, math.nan
    moved = float(np.max(np.abs(now.mean - before.mean) / now.deviation))
    return moved, 2.0 * math.sqrt(1.0 / before.effective + 1.0 / now.effective)
