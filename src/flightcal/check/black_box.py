"""Which simple wrong explains the telemetry best, where a simulator is run and not looked into.

Nothing in it can be changed but its inputs. So it is simulated at draws of the prior, and these are what parameters can
do: the telemetry is beside them as one more draw, of a normal distribution (`evidence`), and beside what any simulator
lacks: a little of everything that comes again with the orbit. Wrongs of channels and clocks need no more.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import xarray

from ..problem import Problem, Runs, Window, initial_priors
from ..scenario import ICE_POINT
from ..simulator import FloatArray
from ..words import number
from .compared_window import ComparedWindow, Rows, rows_of
from .evidence import Fit, Gaussian, gaussian
from .network_view import WIDENED, Point
from .suspicion import CLEAR, Suspicion
from .wrongs import COLDEST, HOTTEST, SHIFT, SHIFTS, Words, Wrong, clocks_as_read, wrongs_of_channels

_LEAST = 8
"""Draws that tell what parameters do."""
_LEVEL, _PATTERN, _OF_SWING = 1.0, 0.5, 0.05
"""Deviations of what a simulator may lack in a channel and be right: K at all times, K over the orbit, and share of the
range in which the channel moves."""
_HARMONICS = 4
_ROUNDS = 6
"""Closer looks at one wrong."""
_FEW = 30.0
"""Nats below the best, from which a wrong is not looked at closely."""
_FEWEST = 10
"""Samples of a status that tell something."""
_CLOCKS = frozenset({"clock", "channel clock"})
_NULLS, _SEED = 25, 1
"""Draws that are taken for telemetry with nothing wrong."""
_DUTY, _MOVES = 0.05, 0.15
"""Deviations of a duty cycle and of a correlation that a right simulator may have."""


@dataclass(frozen=True)
class PriorEnsemble(ComparedWindow):
    """One window of a scenario, its telemetry as rows, and simulations at draws of the prior."""

    problem: Problem
    telemetry: xarray.Dataset
    rows: Rows
    z: FloatArray
    """[S, d] draws of the prior."""
    simulated: FloatArray
    """[S, T, N] K at the window's samples, and"""
    status: FloatArray
    """[S, T, H] of its heaters; NaN where it is not known."""

    @property
    def window(self) -> Window:
        """The first to train on."""
        return self.problem.windows[0]

    @cached_property
    def draws(self) -> FloatArray:
        """[S, R] K."""
        read = np.moveaxis(self.simulated[:, self.rows.kept], 2, 1)
        return read.reshape(len(read), -1)

    @cached_property
    def modelled(self) -> FloatArray:
        """[R] K, the mean of the draws."""
        return np.asarray(self.draws.mean(axis=0))

    @cached_property
    def away(self) -> FloatArray:
        """[S, d] of each draw from their mean, in deviations of the priors."""
        return np.asarray((self.z - self.z.mean(axis=0)) / self.problem.priors.spread())

    @cached_property
    def slopes(self) -> FloatArray:
        """[R, d] K for a deviation of each prior: a ridge regression on the draws."""
        inner = self.away.T @ self.away + np.eye(self.away.shape[1])
        return np.asarray(np.linalg.solve(inner, self.away.T @ (self.draws - self.modelled)).T)

    def begun_of(self, channel: int) -> FloatArray:
        """[R] K for each kelvin that what a channel reads is warmer at the beginning."""
        observation = self.window.scenario.observations[self.channels[channel]]
        name, names = f"initial.{observation.node or observation.output}", self.problem.names
        if name not in names:
            return np.zeros(len(self.modelled))
        entry, middle = names.index(name), self.z.mean(axis=0)
        warmer = self.problem.to_theta(middle)
        warmer[entry] += 1.0
        by = (self.problem.to_z(warmer) - middle)[entry] / self.problem.priors.spread()[entry]
        return np.asarray(by * self.slopes[:, entry])

    def expected(self, observed: FloatArray) -> FloatArray:
        """[R] K beside other telemetry [t, N]: what a channel reads first says where its node begins."""
        if observed is self.observed:
            return self.modelled
        return self.modelled + self.begun @ np.nan_to_num(self._beginnings(observed) - self._begins)

    @cached_property
    def _begins(self) -> FloatArray:
        """[N] K, where nodes begin as the telemetry has it."""
        return self._beginnings(self.observed)

    def _beginnings(self, observed: FloatArray) -> FloatArray:
        """[N] K, where the nodes of channels begin by other telemetry [t, N]; NaN where that does not tell it."""
        since = self.window.first_sample + self.rows.seconds
        priors = initial_priors(self.problem.scenario, self.channels, since, observed)
        observations = [self.window.scenario.observations[channel] for channel in self.channels]
        names = [f"initial.{observation.node or observation.output}" for observation in observations]
        return np.array([getattr(priors.get(name), "mean", np.nan) for name in names])

    @cached_property
    def follows(self) -> FloatArray:
        """[H, N] how much each channel warms while a heater is on, on average over the draws; see `_warms`."""
        found = [
            [[_warms(run[:, c], on[:, h]) for c in range(run.shape[1])] for h in range(on.shape[1])]
            for run, on in zip(self.simulated, self.status, strict=True)
        ]
        shape = len(self.simulated), self.status.shape[2], len(self.channels)
        return np.asarray(np.nan_to_num(np.array(found).reshape(shape)).mean(axis=0))

    @cached_property
    def lacked(self) -> FloatArray:
        """[R, k] K of a deviation of what the simulator may lack in each channel."""
        phase = 2.0 * np.pi * self.rows.seconds / self.window.period
        waves = [np.full(len(phase), 1.0)]
        for k in range(1, _HARMONICS + 1):
            waves += [wave(k * phase) / np.sqrt(1.0 + (k / 3.0) ** 2) for wave in (np.cos, np.sin)]
        found = []
        for channel in range(len(self.channels)):
            size = _PATTERN + _OF_SWING * float(np.ptp(self.modelled_of(channel)))
            series = size * np.stack(waves, axis=1)
            series[:, 0] *= _LEVEL / _PATTERN
            found.append(self.of_channel(channel, series))
        return np.concatenate(found, axis=1)

    @cached_property
    def point(self) -> Point:
        """The draws' mean, and the draws as what moves it."""
        effects = (self.draws - self.modelled).T / np.sqrt(len(self.draws) - 1.0)
        none = np.empty((len(self.modelled), 0))
        return Point(self.z.mean(axis=0), self.simulated.mean(axis=0), self.modelled, effects, self.lacked, none)


def ensemble_of(
    problem: Problem, telemetry: xarray.Dataset, thetas: FloatArray, runs: Sequence[Runs | None]
) -> PriorEnsemble | None:
    """Of simulations at draws of the prior thetas [S, d]; None: too few of them finish."""
    done = [(theta, run[0]) for theta, run in zip(thetas, runs, strict=True) if run is not None]
    if len(done) < _LEAST:
        return None
    simulated = np.stack([run.temperatures for _, run in done])
    status = np.stack([run.status for _, run in done])
    z = problem.to_z(np.stack([theta for theta, _ in done]))
    return PriorEnsemble(problem, telemetry, rows_of(problem.windows[0]), z, simulated, status)


@dataclass(frozen=True)
class _Look:
    """What telemetry is expected to be, and how it is with nothing wrong."""

    around: Gaussian
    nothing: Fit


def compared_by_runs(ensemble: PriorEnsemble) -> tuple[Fit, list[tuple[Fit, Wrong, float]]]:
    """The telemetry with nothing wrong, and what is better by over `CLEAR` nats, each with its nats, the best first."""
    look = _look(ensemble)
    tried = sorted(((*_gained(ensemble, look, wrong), wrong) for wrong in _wrongs(ensemble)), key=lambda item: -item[0])
    found: dict[tuple[str, str], tuple[Fit, Wrong, float]] = {}
    for nats, fit, wrong in tried:
        if nats < max(0.0, tried[0][0] - _FEW):
            break
        nats, fit, wrong = _closely(ensemble, look, nats, fit, wrong)
        if nats > CLEAR and wrong.matters(fit) and _is_nearer(ensemble, wrong, fit, look.nothing):
            place = wrong.kind, wrong.about
            if place not in found or nats > found[place][2]:
                found[place] = fit, wrong, nats
    better = [kept for kept in found.values() if kept[1].kind not in _CLOCKS or kept[2] > _by_chance(ensemble, kept[1])]
    return look.nothing, sorted(better, key=lambda item: -item[2])


def _look(ensemble: PriorEnsemble) -> _Look:
    around = gaussian(ensemble.rows, ensemble.point, np.isfinite(ensemble.as_read)).in_modes()
    return _Look(around, _fit(ensemble, around, ensemble.observed))


def _gained(ensemble: PriorEnsemble, look: _Look, wrong: Wrong) -> tuple[float, Fit]:
    """Nats by which a wrong is better than nothing, odds counted, and its fit."""
    fit = _fit(ensemble, look.around, wrong.read(ensemble.observed), wrong)
    return fit.evidence - look.nothing.evidence - wrong.odds, fit


def _by_chance(ensemble: PriorEnsemble, wrong: Wrong) -> float:
    """Nats that another clock of the same channels gains at most where nothing is wrong.

    Each draw of one half in turn is the telemetry, and the other half what is expected. Cycles of a thermostat that are
    out of step look like a clock: they are no normal distribution.
    """
    half = len(ensemble.z) // 2
    expected = replace(
        ensemble, z=ensemble.z[:half], simulated=ensemble.simulated[:half], status=ensemble.status[:half]
    )
    around, rng = _look(expected).around, np.random.default_rng(_SEED)
    every = wrong.kind == "clock"
    late_ones = [k for k, name in enumerate(ensemble.channels) if every or name in wrong.about.split()]
    seconds, shape = ensemble.rows.seconds, ensemble.observed.shape
    shifts = [shift for shift in SHIFTS if abs(shift) <= 0.5 * ensemble.window.period + SHIFT]
    most = 0.0
    for drawn in ensemble.simulated[half : half + _NULLS]:
        read = drawn[ensemble.rows.kept] + ensemble.rows.noise * rng.standard_normal(shape)
        nothing = _evidence(expected, around, read)
        for late in shifts:
            moved = read.copy()
            for k in late_ones:
                noise = ensemble.rows.noise[k] * rng.standard_normal(len(seconds))
                moved[:, k] = np.interp(seconds + late, ensemble.seconds, drawn[:, k]) + noise
            most = max(most, _evidence(expected, around, moved) - nothing)
    return most


def _wrongs(ensemble: PriorEnsemble) -> Iterator[Wrong]:
    yield from wrongs_of_channels(ensemble)
    yield from clocks_as_read(ensemble)
    yield from _priors(ensemble)


def _priors(ensemble: PriorEnsemble) -> Iterator[Wrong]:
    """A prior is not where it should be."""
    names = ensemble.window.scenario.parameters
    for entry, name in enumerate(ensemble.problem.names):
        if name not in names:
            continue

        def words(fit: Fit, name: str = name) -> Words:
            off = WIDENED * float(fit.added[0])
            return Words(
                f"The prior of {name} is off",
                f"With {name} {abs(off):.0f} deviations {'above' if off > 0 else 'below'} the middle of its prior, the "
                "simulator explains the telemetry.",
                f"Check the value and the unit of {name} in 'parameters' and in 'simulator: inputs'",
            )

        column = WIDENED * ensemble.slopes[:, [entry]]
        yield Wrong("prior", name, words, columns=column, least=3.0 / WIDENED, tries=len(names))


def _closely(ensemble: PriorEnsemble, look: _Look, nats: float, fit: Fit, wrong: Wrong) -> tuple[float, Fit, Wrong]:
    """A wrong with the best of numbers near by."""
    for _ in range(_ROUNDS):
        near = [] if wrong.closer is None else list(wrong.closer())
        tried = [(*_gained(ensemble, look, closer), closer) for closer in near]
        best = max(tried, key=lambda item: item[0], default=(nats, fit, wrong))
        if best[0] <= nats:
            break
        nats, fit, wrong = best
    return nats, fit, wrong


def _fit(ensemble: PriorEnsemble, around: Gaussian, observed: FloatArray, wrong: Wrong | None = None) -> Fit:
    """Of telemetry [t, N] as it should be read."""
    left = _left(ensemble, observed)
    fit = around.fit(left) if wrong is None else around.fit(left, wrong.columns, wrong.scale)
    moved = ensemble.away.T @ fit.moved / np.sqrt(len(ensemble.away) - 1.0)
    return fit.with_parameters(ensemble.problem.names, moved)


def _evidence(ensemble: PriorEnsemble, around: Gaussian, observed: FloatArray) -> float:
    """That of `_fit` with nothing wrong."""
    return around.evidence(_left(ensemble, observed))


def _left(ensemble: PriorEnsemble, observed: FloatArray) -> FloatArray:
    """[R] K of telemetry [t, N] beside what is expected."""
    return ensemble.flat(observed) - ensemble.expected(observed)


def _is_nearer(ensemble: PriorEnsemble, wrong: Wrong, fit: Fit, nothing: Fit) -> bool:
    """Whether another unit is worth a word, if it is one."""
    if not wrong.is_smaller:
        return True
    read = wrong.read(ensemble.observed)
    left, before = (
        (ensemble.flat(values) - ensemble.expected(values) - ensemble.point.effects @ of.moved)
        .reshape(-1, len(values))
        .T
        for values, of in ((read, fit), (ensemble.observed, nothing))
    )
    return wrong.leaves_less(left, before, ensemble.observed)


def told_by_status(ensemble: PriorEnsemble) -> Iterator[Suspicion]:
    """A status that says on where the simulator says off, and heaters that never switch there.

    By how often a heater is on, and by what warms meanwhile.
    """
    window, observations = ensemble.window, ensemble.window.scenario.observations
    for k, heater in enumerate(window.simulator.heaters):
        channel = next((name for name, observation in observations.items() if observation.heater == heater), None)
        known = np.isfinite(window.status[:, k]) & np.isfinite(ensemble.status[:, :, k]).all(axis=0)
        if channel is None or known.sum() < _FEWEST:
            continue
        status, of_draws = window.status[known, k], ensemble.status[:, known, k]
        measured, simulated = float(status.mean()), of_draws.mean(axis=1)
        if not 0.0 < measured < 1.0:
            continue
        often = f"{channel} says that {heater} is on for {100.0 * measured:.0f}% of the time"
        if np.ptp(of_draws) == 0.0:
            never = "never" if of_draws[0, 0] == 0.0 else "always"
            yield Suspicion(
                "heater",
                heater,
                f"{heater} is {never} on in the simulator",
                f"{often}; in none of {len(of_draws)} simulations at draws of the prior it switches.",
                f"Check {heater} in the simulator's own files: whether it is there, its thresholds, its sensor; "
                f"and what else {'keeps its node warm' if never == 'never' else 'cools its node'} there: priors, "
                "powers, sunlight",
            )
            continue
        nats = _less_likely(measured, 1.0 - measured, simulated, _DUTY)
        shows = int(np.argmax(ensemble.follows[k]))
        warms = _warms(window.observed[:, shows], window.status[:, k])
        if np.isfinite(warms):
            nats += _less_likely(warms, -warms, ensemble.follows[[k], shows], _MOVES)
        if nats > CLEAR:
            yield Suspicion(
                "status inverted",
                channel,
                f"{channel} is inverted",
                f"{often}, the simulator for {100.0 * float(simulated.mean()):.0f}%; {ensemble.channels[shows]} "
                "warms while it says off.",
                f"Correct {window.scenario.telemetry.channels[channel].says_on} of {channel} in 'telemetry: channels'",
            )


def no_temperatures(ensemble: PriorEnsemble) -> Iterator[Suspicion]:
    """Channels that read, or for which the simulator says, what no satellite has: another unit, by their middle."""
    observations = ensemble.window.scenario.observations
    for k, channel in enumerate(ensemble.channels):
        output = observations[channel].output or channel
        for name, values, where in (
            (channel, ensemble.window.observed[:, k], "in 'telemetry: channels'"),
            (f"The simulator's {output}", ensemble.simulated[:, :, k], "in 'simulator: outputs'"),
        ):
            valid = values[np.isfinite(values)]
            if not len(valid) or COLDEST < float(np.median(valid)) < HOTTEST:
                continue
            middle = float(np.median(valid)) - ICE_POINT
            unit = "kelvin, and is read as degC" if COLDEST < middle < HOTTEST else "another unit"
            yield Suspicion(
                "unit",
                channel,
                f"{name} is in {unit}",
                f"It is {number(middle, 3)} degC in the middle.",
                f"Correct 'unit' of {output if values.ndim > 1 else channel} {where}",
            )


def _less_likely(value: float, otherwise: float, of_draws: FloatArray, deviation: float) -> float:
    """Nats by which a value is less likely than another among those of draws."""
    if not len(of_draws):
        return 0.0
    middle, variance = float(np.mean(of_draws)), float(np.var(of_draws)) + deviation**2
    return ((value - middle) ** 2 - (otherwise - middle) ** 2) / (2.0 * variance)


def _warms(temperatures: FloatArray, status: FloatArray) -> float:
    """Correlation of a channel's change from sample to sample with a status [T]; NaN where nothing changes."""
    rises, on = np.diff(temperatures), 0.5 * (status[1:] + status[:-1])
    valid = np.isfinite(rises) & np.isfinite(on)
    if valid.sum() < 3 or np.ptp(rises[valid]) == 0.0 or np.ptp(on[valid]) == 0.0:
        return np.nan
    return float(np.corrcoef(rises[valid], on[valid])[0, 1])
