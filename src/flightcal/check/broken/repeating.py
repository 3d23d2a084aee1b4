"""Samples that are those of some time before."""

from __future__ import annotations

import math

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ...simulator import FloatArray
from ...telemetry import spells
from ...words import moment
from ..samples import step_of
from ..suspicion import Suspicion
from .broken import Broken, between, leave_out

_COPIED = 15
"""Changes that come again exactly, where they are no chance."""
_IN_A_ROW, _MOST_ALIKE = 8, 50
"""Changes in a row that come again where more may, and places of the same at most that are compared."""
_MOST_LAGS = 500
"""At which it is seen how often two readings are the same."""
_CHANCE, _ALIKE = 1e-9, 0.4
"""Probability of that by chance, and the least that is assumed of each change."""
_USUAL, _NO_NOISE = 0.9, 1e-3
"""Share of bends that noise makes, where others are the temperature's; steps of noise that are none."""


def repeating(channel: str, times: NDArray[np.datetime64], values: FloatArray, modelled: FloatArray) -> Broken | None:
    """Samples in a row that are exactly those of some time before."""
    moves = np.append(False, np.diff(values) != 0.0)
    best = (0, 0, 0, 0)  # changes, lag, first, last
    for lag in _lags(values, moves):
        same = values[lag:] == values[:-lag]
        for first, last in spells(same):
            count = int(moves[lag + first : lag + last].sum())
            if count > best[0]:
                best = (count, lag, lag + int(first), lag + int(last))
    count, lag, first, last = best
    if count < _COPIED or len(np.unique(values[first:last])) < 6:
        return None
    # What comes again in every orbit, and is read in coarse steps, is often the same by chance.
    same = values[lag:] == values[:-lag]
    outside = np.concatenate([same[: first - lag], same[last - lag :]])
    # Where two curves come close they stay so, and then it is the noise alone that tells readings apart.
    lags = np.unique(np.linspace(2, len(values) // 2, _MOST_LAGS).round().astype(int))
    usual = float(np.median([np.mean(values[other:] == values[:-other]) for other in lags.tolist()]))
    likely = [_ALIKE, _alike(values), usual]
    likely += [float(outside.mean())] if len(outside) >= _COPIED else []
    if max(likely) ** count > _CHANCE:
        return None
    useless = between(values, first, last)
    suspicion = Suspicion(
        "repeating", channel, f"{channel} repeats itself",
        f"{last - first} samples from {moment(times[first])} UTC on are exactly those of {lag} samples before.",
        leave_out(channel, times, useless),
    )  # fmt: skip
    return Broken(suspicion, useless)


def _lags(values: FloatArray, moves: NDArray[np.bool_]) -> list[int]:
    """Lags in samples, up to half of all, at which some changes in a row of samples [T] come again; moves: [T].

    A change is told by what is read then and how many samples later the next one comes.
    """
    changes = np.flatnonzero(moves)
    if len(changes) <= _IN_A_ROW:
        return []
    told = np.stack([values[changes[:-1]], np.diff(changes).astype(float)], axis=1)
    kinds = np.unique(told, axis=0, return_inverse=True)[1].ravel()
    rows = sliding_window_view(kinds, _IN_A_ROW)
    order = np.lexsort(rows.T)
    alike = np.all(rows[order[1:]] == rows[order[:-1]], axis=1)
    found: set[int] = set()
    for group in np.split(changes[order], np.flatnonzero(~alike) + 1):
        lags = np.abs(np.subtract.outer(group[:_MOST_ALIKE], group[:_MOST_ALIKE]))
        found.update(lags[(lags >= 2) & (lags <= len(values) // 2)].tolist())
    return sorted(found)


def _alike(values: FloatArray) -> float:
    """How often a temperature that is read twice, in the steps of readings [T] and with their noise, is the same."""
    bends, step = np.abs(np.diff(values, 2)), step_of(values)
    square = float(np.mean(bends[bends <= np.quantile(bends, _USUAL)] ** 2)) / 6.0
    # Without that of the steps; of the difference of two readings, in steps.
    width = float(np.sqrt(2.0 * max(square - step**2 / 12.0, 0.0))) / step
    if width < _NO_NOISE:
        return 1.0
    inside = math.erf(1.0 / (width * math.sqrt(2.0)))
    return inside - width * math.sqrt(2.0 / math.pi) * (1.0 - math.exp(-0.5 / width**2))
