"""Where a slow simulator is run for an emulator: the start design, and what ran there and later, on all windows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import FlightcalError
from ..external import Record
from ..probability import Priors, sobol
from ..problem import Problem, Window
from ..progress import Progress, about
from ..simulator import FloatArray, Trajectory
from .runs import TrainingRuns, failure_summary

Evaluate = Callable[[Window, FloatArray], Sequence[Record]]
"""Real runs of a window at thetas [S, p], in its simulator's order of parameters; failed ones are records too."""

Runs = tuple[TrainingRuns, ...]
"""Of each window; the k-th of all are at the same theta of the calibration."""

_PRIOR_SHARE = 0.998
"""Of each prior, through which the start design goes."""
_SAVED_TOGETHER = 8
"""Runs of a window that are asked for, and saved, together: an interruption costs no more than these."""


def title(problem: Problem, window: Window) -> str:
    """What begins a message about a window where there are several."""
    return "" if len(problem.windows) == 1 else f"{window.label}: "


def taken(runs: Runs, chosen: Any) -> Runs:
    """Each window's runs at these positions."""
    return tuple(training.take(chosen) for training in runs)


def start_thetas(problem: Problem, count: int, seed: int) -> FloatArray:
    """Thetas [count, d] of the start design; what simulations do not depend on is at its prior's median."""
    kept = problem.simulated
    scale = Priors(tuple(problem.names[k] for k in kept), tuple(problem.priors.priors[k] for k in kept))
    thetas = np.tile(problem.priors.median(), (count, 1))
    thetas[:, kept] = start_design(scale, count, seed)
    return thetas


def start_design(scale: Priors, count: int, seed: int) -> FloatArray:
    """Thetas [count, d] through the priors but for their farthest tails."""
    return sobol(scale, count, seed, share=_PRIOR_SHARE)


@dataclass(frozen=True)
class RealRuns:
    """Real runs, a few at a time, each few saved."""

    problem: Problem
    evaluate: Evaluate
    save: Callable[[Runs], None]
    stored: Runs
    """What an earlier call ran."""
    most: int
    """Runs of all windows together."""
    progress: Progress

    def complete(self, runs: Runs, thetas: FloatArray, number: int) -> Runs:
        """`runs` and those of round `number` at thetas [S, d], of which only what is missing is run."""
        there = tuple(training.take(training.round == number) for training in self.stored)
        later = tuple(training.take(training.round > number) for training in self.stored)
        windows = self.problem.windows
        designs = [self.problem.at(window, thetas)[:, window.simulated] for window in windows]
        known, design = np.concatenate([training.theta for training in there], axis=1), np.concatenate(designs, axis=1)
        is_there = [bool(np.isclose(known, theta, rtol=1e-9, atol=0.0).all(axis=1).any()) for theta in design]
        missing = np.flatnonzero(~np.array(is_there, bool))[: max(0, len(design) - len(known))]
        with self.progress.stage("runs", self.most) as running:
            for first in range(0, len(missing), _SAVED_TOGETHER):
                few, started = missing[first : first + _SAVED_TOGETHER], perf_counter()
                there = tuple(
                    training.add(self.evaluate(window, design[few]), number)
                    for training, window, design in zip(there, windows, designs, strict=True)
                )
                if first == number == 0:
                    self._foretell(perf_counter() - started, len(few) * len(windows))
                whole = _joined(runs, there)
                self.save(_joined(whole, later))
                done = sum(map(len, whole))
                running.at(done, f"{done} of at most {self.most}")
        return _joined(runs, there)

    def _foretell(self, seconds: float, runs: int) -> None:
        """Say how long the most runs will take, as the first ones tell it."""
        self.progress.say(
            f"the first {runs} runs took {seconds:.1f} s, so all runs take {about(seconds / runs * self.most)} at "
            "most; the sampling of the first round will tell how long the rounds take"
        )


def _joined(runs: Runs, others: Runs) -> Runs:
    return tuple(training.join(other) for training, other in zip(runs, others, strict=True))


def on_all_windows(runs: Runs) -> NDArray[np.bool_]:
    """[S] where the runs of all windows finished."""
    return np.all([training.finished for training in runs], axis=0)


def check_start(problem: Problem, runs: Runs) -> None:
    """Raises FlightcalError where too few runs of the start design finish."""
    for window, training in zip(problem.windows, runs, strict=True):
        least = 2 * (len(training.parameters) + 1)
        if training.finished.sum() < least:
            last = "" if training.finished.all() else f"; the last message: {training.message[~training.finished][-1]}"
            raise FlightcalError(
                f"emulator: {title(problem, window)}found {int(training.finished.sum())} finished runs in the start "
                f"design, expected at least {least}: "
                f"{failure_summary(training) or 'allow more runs (calibration.emulator.runs)'}{last}"
            )
    if not on_all_windows(runs).any():
        raise FlightcalError("emulator: found no run of the start design that finished on all windows, expected one")


def start_runs(problem: Problem, runs: Runs) -> tuple[FloatArray, list[tuple[Trajectory, ...] | None]]:
    """Thetas [S, d] of the start design, and what ran there: of each window; None where one failed."""
    started = taken(runs, np.flatnonzero(runs[0].round == 0))
    of_windows = [training.trajectories() for training in started]
    finished = on_all_windows(started)
    every = zip(finished, zip(*of_windows, strict=True), strict=True)
    return thetas_of(problem, started), [run if whole else None for whole, run in every]


def thetas_of(problem: Problem, runs: Runs) -> FloatArray:
    """Thetas [S, d] of runs; what simulations do not depend on is at its prior's median, and so are drifts' sizes."""
    thetas = np.tile(problem.priors.median(), (len(runs[0]), 1))
    for window, link, found in zip(problem.windows, problem.links, runs, strict=True):
        thetas[:, link.columns[window.simulated]] = found.theta
    drifting = problem.links[0].columns[problem.links[0].moving]
    if len(drifting):
        priors, names = problem.links[0].priors, runs[0].parameters
        places = [names.index(name) for name in priors.names]
        values = [priors.to_z(found.theta[:, places]) for found in runs]
        common = np.mean(values, axis=0)
        thetas[:, drifting] = priors.to_theta(common)
        for link, inside in zip(problem.links, values, strict=True):
            # A simulator that is emulated has no trends, so each parameter has one term.
            thetas[:, link.moves.score] = (inside - common) / thetas[:, link.moves.factor]
    return thetas
