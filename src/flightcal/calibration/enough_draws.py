"""Sampling until there are enough effective draws, and with smaller steps where trajectories broke off."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..problem import Whitening, whitening
from ..progress import Progress
from ..scenario import NutsSettings
from ..simulator import FloatArray
from .diagnostics import BROKEN_OFF, Diagnostics, Gate, draws_wanted, fewest_effective
from .nuts import Draws

_MOST = 8.0
"""Times the draws that were asked for, at most."""
_ROUNDS = 3
"""In which more are made, at most."""
_NEAR = 0.03
"""So little above its limit R-hat may be with few draws: it is looked at again with twice as many."""
_FEW = {"effective draws", "effective draws, tails", "R-hat"}
"""Gates that more draws can mend."""
_REFUSED = 1.0 / 3.0
"""Share of the refusals that the second time may remain, where trajectories broke off,"""
_FEWEST_REFUSED = 0.01
"""and least share of the draws that may be refused: steps that are smaller still take hours."""
_SEEDS = 1_000_003
"""Between the seeds of the first draws and of those that are added."""

Sampler = Callable[[Whitening, NutsSettings, int], Draws]
"""By coordinates, settings and seed."""
Judge = Callable[[Draws], tuple[FloatArray, Diagnostics]]
"""Thetas [chain, draw, d] of draws, and what they come to."""


def sample_enough(
    sampler: Sampler, coordinates: Whitening, settings: NutsSettings, seed: int, judge: Judge, progress: Progress
) -> tuple[Draws, FloatArray, Diagnostics]:
    """Draws with their thetas and diagnostics: as many as the settings say, and more where too few are effective.

    So are they where R-hat is just above its limit. The others are of chains of their own, in coordinates in which the
    draws so far are nearly standard normal. Where too many trajectories break off, or at one place, all is drawn once
    more with smaller steps, and the first draws do not count: they leave that place out. Where chains fail for another
    reason, or it would take too many, all is left as it is.

    Raises KeyboardInterrupt where sampling is interrupted before the first draw.
    """
    draws = sampler(coordinates, settings, seed)
    if not draws.z.shape[1]:
        raise KeyboardInterrupt
    theta, judged = judge(draws)
    careful = _careful(judged, settings)
    if careful is not None and not draws.interrupted:
        progress.say(
            f"{_wanting(judged)}: all is drawn once more with smaller steps (acceptance "
            f"{careful.target_acceptance:.3g}, not {settings.target_acceptance:g})"
        )
        settings = careful
        again = sampler(_whitened(draws.z, coordinates), settings, seed + (_ROUNDS + 1) * _SEEDS)
        draws = replace(draws, interrupted=True) if again.interrupted else _instead(draws, again)
        theta, judged = judge(draws)
    for k in range(1, _ROUNDS + 1):
        more = 0 if draws.interrupted else _more(judged, draws.z.shape[1], settings)
        if not more:
            break
        progress.say(f"{more} more draws of each chain: {_wanting(judged)}")
        # In these coordinates there is little left to adapt to.
        added = settings.model_copy(update={"draws": more, "warmup": settings.warmup // 2})
        again = sampler(_whitened(draws.z, coordinates), added, seed + k * _SEEDS)
        draws = _joined(draws, again)
        theta, judged = judge(draws)
    return draws, theta, judged


def _failed(judged: Diagnostics) -> dict[str, Gate]:
    """The gates that are not passed, by name."""
    return {gate.name: gate for gate in judged.gates if not gate.passed}


def _wanting(judged: Diagnostics) -> str:
    """What the gates that failed found."""
    return " and ".join(f"{gate.name} {gate.found}, not {gate.required}" for gate in _failed(judged).values())


def _careful(judged: Diagnostics, settings: NutsSettings) -> NutsSettings | None:
    """Settings of smaller steps, where trajectories broke off; None: they did not, or steps are small already."""
    failed, refused = _failed(judged), _REFUSED * (1.0 - settings.target_acceptance)
    if BROKEN_OFF not in failed or not failed.keys() <= {BROKEN_OFF, *_FEW} or refused < _FEWEST_REFUSED:
        return None
    return settings.model_copy(update={"target_acceptance": 1.0 - refused})


def _more(judged: Diagnostics, drawn: int, settings: NutsSettings) -> int:
    """How many more draws of each chain than those drawn are wanted, where that is all that is wanting."""
    failed = _failed(judged)
    least, wanted = fewest_effective(judged.parameters), drawn
    if not failed.keys() <= _FEW or not least > 0.0:
        return 0
    if "R-hat" in failed:
        if not max(summary.r_hat for summary in judged.parameters) < settings.max_r_hat + _NEAR:
            return 0
        wanted = 2 * drawn
    if least <= settings.min_ess:
        wanted = max(wanted, math.ceil(draws_wanted(drawn, least, settings)))
    # At most as many again: in the new coordinates fewer may do than the draws so far let expect.
    return min(wanted - drawn, drawn) if wanted <= _MOST * settings.draws else 0


def _whitened(z: FloatArray, coordinates: Whitening) -> Whitening:
    """Coordinates as straight as those, in which draws z [chain, draw, d] have mean zero and covariance one."""
    flat = coordinates.to_y(z.reshape(-1, z.shape[-1]))
    precision = np.linalg.pinv(np.atleast_2d(np.cov(flat, rowvar=False)), hermitian=True)
    return replace(whitening(flat.mean(axis=0), precision), straight=coordinates.straight)


def _instead(first: Draws, second: Draws) -> Draws:
    """The second alone; what the first took is told as warm-up."""
    return replace(
        second,
        gradients=first.gradients + second.gradients,
        warmup_gradients=first.gradients + second.warmup_gradients,
        failures=first.failures + second.failures,
        last_failure=second.last_failure or first.last_failure,
    )


def _joined(first: Draws, second: Draws) -> Draws:
    """Both, chain by chain."""
    return replace(
        first,
        z=np.concatenate([first.z, second.z], axis=1),
        statistics={
            name: np.concatenate([statistic, second.statistics[name]], axis=1)
            for name, statistic in first.statistics.items()
        },
        gradients=first.gradients + second.gradients,
        warmup_gradients=first.warmup_gradients + second.warmup_gradients,
        warmup_divergences=first.warmup_divergences + second.warmup_divergences,
        failures=first.failures + second.failures,
        last_failure=second.last_failure or first.last_failure,
        interrupted=second.interrupted,
    )
