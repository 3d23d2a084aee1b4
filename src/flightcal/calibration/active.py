"""Calibrating a simulator that is slow and has no derivatives: an emulator, and real runs where the posterior lives.

A start design through the priors; then, round by round: fit an emulator to the runs near the posterior, sample the
posterior with it (its error is in the likelihood), and run the simulator at those posterior draws from which the
emulator's error in the posterior shrinks most. It ends when the emulator's error no longer matters, or with the budget.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.stats import qmc

from ..errors import FlightcalError
from ..external.record import Record
from ..scenario.schema import EmulatorSettings, NutsSettings
from ..simulator import SimulationFailure
from ..simulator.system import FloatArray
from ..surrogate.emulator import EmulatedSimulator, Emulator, fit_emulator
from ..surrogate.held_out import Validation, validate
from ..surrogate.runs import TrainingRuns, failure_summary
from .diagnostics import least_effective
from .mode import find_mode
from .nuts import sample
from .priors import Priors
from .problem import Problem
from .whitening import whitening

Evaluate = Callable[[FloatArray], Sequence[Record]]
"""Real runs at thetas [S, d], in the simulator's order of parameters; failed ones are records too."""

_NUTS = NutsSettings(chains=4, draws=400, warmup=200)
"""Of a round: enough for means within 0.05 standard deviations."""
_PRIOR_SHARE = 0.998
"""Of each prior, through which the start design goes."""
TRUNCATION = 0.1
"""What principal shapes may leave out of a channel, added up over all its samples, in standard deviations of its noise.
Left out is a smooth function of the parameters, so it adds up where noise averages out: a posterior sees it all."""
_LEAST_NOISE = 1e-3  # K
_REACH = 9.0
"""Runs within so many posterior standard deviations of its mean belong to its surroundings."""
_NEAREST_PER_PARAMETER = 8
"""At least so many runs for each parameter are fitted, however far: the nearest."""
_MODE_STARTS = 4
_SAVED_TOGETHER = 8
"""Runs that are asked for, and saved, together: an interruption costs no more than these."""
_CANDIDATES = 300
_JUDGED = 12
"""Posterior draws at which the emulator's share in the posterior is judged."""


@dataclass(frozen=True)
class Round:
    """What one round found."""

    number: int
    runs: int
    """Asked for so far."""
    failed: int
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
            f"{self.shapes} shapes, emulator's sd / noise {self.error_share:.3f}, expected shift "
            f"{self.expected_shift:.3f} sd, mean moved {self.mean_shift:.3f} sd{covered}: {self.verdict}"
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
    save: Callable[[TrainingRuns], None] = lambda _: None,
    on_round: Callable[[Round], None] = lambda _: None,
) -> Learnt:
    """Learn an emulator of `problem.simulator` around the posterior.

    evaluate: real runs at the sample times of `runs`; window: the problem's among these (None: all). runs: what has
    been run before (`no_runs`: nothing). The same seed and settings ask for the same runs, so what has been run is not
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
    validation: Validation | None = None
    belief: _Belief | None = None
    rounds: list[Round] = []
    while True:
        noise = noise_level(problem, belief)
        chosen = _near(scale.to_z(runs.theta), runs.finished, belief, problem)
        near = runs.take(chosen)
        tolerance = TRUNCATION * noise / math.sqrt(len(problem.times))
        emulator = fit_emulator(near, scale.to_z(near.theta), tolerance)
        simulator = EmulatedSimulator(emulator, scale, part, heater_powers=problem.simulator.heater_power)
        emulated = replace(problem, simulator=simulator, open_loop=None)
        before, belief = belief, _posterior(emulated, runs.take(runs.finished), belief, rng)
        share, shift = _influence(emulated, belief, rng)
        moved, monte_carlo = _movement(before, belief)
        batch = min(settings.batch or 4 * len(scale.names), settings.runs - len(runs))
        reached = (
            before is not None
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
                number=len(rounds), runs=len(runs), failed=int((~runs.finished).sum()), fitted=len(near),
                shapes=emulator.coefficients.shape[1], error_share=share, expected_shift=shift, mean_shift=moved,
                monte_carlo=monte_carlo, validation=validation, verdict=verdict,
            )
        )  # fmt: skip
        on_round(rounds[-1])
        if reached or batch <= 0:
            theta = problem.to_theta(belief.mean)
            return Learnt(
                emulated, emulator, runs, chosen, tolerance, tuple(rounds), reached, theta, failure_summary(runs)
            )
        z = _most_telling(emulated, belief, batch, rng)
        number = len(rounds)
        runs = campaign.complete(runs, scale.to_theta(z), number)
        new = runs.take((runs.round == number) & runs.finished)
        validation = validate(emulator, scale.to_z(new.theta), new.temperatures) if len(new) else None


def simulated_priors(problem: Problem) -> Priors:
    """Priors of what the simulator takes, in its order."""
    kept = problem.simulated
    return Priors(tuple(problem.names[k] for k in kept), tuple(problem.priors.priors[k] for k in kept))


def start_design(scale: Priors, count: int, seed: int) -> FloatArray:
    """Thetas [count, d] of a Sobol sequence through the priors (scrambled, Owen 1998)."""
    points = qmc.Sobol(len(scale.names), seed=seed).random_base2(max(0, math.ceil(math.log2(count))))[:count]
    return scale.quantile(0.5 + (points - 0.5) * _PRIOR_SHARE)


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


def _near(z: FloatArray, finished: NDArray[np.bool_], belief: _Belief | None, problem: Problem) -> NDArray[np.intp]:
    """Positions of the finished runs at z [S, d] that the emulator is fitted to."""
    positions = np.flatnonzero(finished)
    if belief is None:
        return positions
    draws = belief.z[:, problem.simulated]
    factor = np.linalg.cholesky(np.cov(draws.T).reshape(draws.shape[1], -1) + 1e-12 * np.eye(draws.shape[1]))
    distance = np.linalg.norm(np.linalg.solve(factor, (z[positions] - draws.mean(axis=0)).T), axis=0)
    order = np.argsort(distance)
    count = max(int((distance <= _REACH).sum()), _NEAREST_PER_PARAMETER * draws.shape[1])
    return np.sort(positions[order[:count]])


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
    return _Belief(draws.z.reshape(-1, draws.z.shape[-1]), least_effective(draws.z))


def _best_runs(problem: Problem, runs: TrainingRuns) -> FloatArray:
    """Thetas [., d] of the finished runs of the highest density, with each channel's inferred noise at its RMSE."""
    residuals = np.where(problem.valid, problem.observed - runs.temperatures[:, _emulated(problem).window], 0.0)
    rmse = np.sqrt(np.einsum("stn,stn->sn", residuals, residuals) / problem.valid.sum(axis=0))
    thetas = np.tile(problem.priors.median(), (len(runs), 1))
    thetas[:, problem.simulated] = runs.theta
    channels, positions = problem.inferred_noise
    thetas[:, positions] = np.maximum(rmse[:, channels], _LEAST_NOISE)
    noise = np.stack([problem.noise(theta) for theta in thetas])
    density = -problem.valid.sum(axis=0) @ (np.log(noise) + 0.5 * (rmse / noise) ** 2).T
    density += problem.priors.at(problem.to_z(thetas)).log_density
    return thetas[np.argsort(-density)[:_MODE_STARTS]]


def _emulated(problem: Problem) -> EmulatedSimulator:
    assert isinstance(problem.simulator, EmulatedSimulator)
    return problem.simulator


def _movement(before: _Belief | None, now: _Belief) -> tuple[float, float]:
    """Largest difference of the means in standard deviations, and two standard errors of such a difference."""
    if before is None:
        return math.nan, math.nan
    moved = float(np.max(np.abs(now.mean - before.mean) / now.deviation))
    return moved, 2.0 * math.sqrt(1.0 / before.effective + 1.0 / now.effective)


def _influence(problem: Problem, belief: _Belief, rng: np.random.Generator) -> tuple[float, float]:
    """The emulator's standard deviation over the noise, and by how much it is expected to shift the posterior.

    Where the emulator's error adds E to the covariance V of a posterior that is otherwise the same, it has moved its
    mean by about sqrt(E / V) standard deviations; the direction with the largest, averaged over draws.
    """
    simulator = _emulated(problem)
    basis = simulator.emulator.error_basis[simulator.window]
    certain = replace(problem, simulator=replace(simulator, certain=True))
    shares, shifts = [], []
    for z in rng.choice(belief.z, min(_JUDGED, len(belief.z)), replace=False):
        with_error, without = problem.gauss_newton_hessian(z), certain.gauss_newton_hessian(z)
        shifts.append(max(0.0, float(eigh(without, with_error, eigvals_only=True)[-1]) - 1.0))
        theta = problem.to_theta(z)
        variance = problem.simulate(theta).error_variance
        deviation = np.einsum("tnr,r->tn", basis**2, variance) / problem.noise(theta) ** 2
        shares.append(float(deviation[problem.valid].mean()))
    return math.sqrt(float(np.mean(shares))), math.sqrt(float(np.mean(shifts)))


def _most_telling(problem: Problem, belief: _Belief, count: int, rng: np.random.Generator) -> FloatArray:
    """z [count, d] of the posterior draws from whose runs the emulator's part in the posterior shrinks most.

    One after the other, each the draw that most reduces the processes' variance averaged over all draws (Cohn 1996,
    Neural Networks 9, 1071-1083), with the ones before it as if they were run: so they keep apart. A process counts by
    how far its error shifts the posterior, and by its share in the noise.
    """
    simulator = _emulated(problem)
    drawn = belief.z[rng.choice(len(belief.z), min(_CANDIDATES, len(belief.z)), replace=False)]
    processes = simulator.emulator.processes
    z = drawn[:, problem.simulated]
    covariance = processes.covariance(simulator.emulator.inputs(z))
    nugget = processes.nugget * processes.scale
    importance = _importance(problem, belief.mean)[: len(nugget)]
    chosen: list[int] = []
    for _ in range(count):
        variance = np.einsum("rpp->rp", covariance) + nugget[:, None]
        gain = np.einsum("r,rpq,rpq,rq->q", importance, covariance, covariance, 1.0 / variance)
        gain[chosen] = -np.inf
        best = int(np.argmax(gain))
        chosen.append(best)
        column = covariance[:, :, best]
        covariance = covariance - column[:, :, None] * column[:, None, :] / variance[:, best, None, None]
    return z[chosen]


def _importance(problem: Problem, z: FloatArray) -> FloatArray:
    """[r] what a variance of one of each error shape does at z [d] to the posterior's mean and to temperatures."""
    noise = problem.noise(problem.to_theta(z))
    simulator = _emulated(problem)
    basis = simulator.emulator.error_basis[simulator.window] / noise[:, None]
    basis = np.where(problem.valid[..., None], basis, 0.0)
    jacobian = np.where(problem.valid[..., None], problem.jacobian(z) / noise[:, None], 0.0)
    pulled = np.einsum("tnd,tnr->dr", jacobian, basis)
    hessian = np.einsum("tnd,tne->de", jacobian, jacobian) + np.diag(problem.priors.precision(z))
    shift = np.einsum("dr,dr->r", pulled, np.linalg.solve(hessian, pulled))
    return shift + np.einsum("tnr,tnr->r", basis, basis) / problem.valid.sum()
