"""How long the steps of a window's integration may be: as long as a tolerance on the temperatures allows.

A grid is tried at some thetas against the same grid with every step halved. Where the two part, steps become shorter,
elsewhere longer, until the tolerance is met with few steps. So the grid is the same for every theta afterwards, and
the derivative of a simulation is exact.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from .drive import Inputs, make_grid
from .system import FloatArray, IntArray, Structure

ROOM = 293.15
"""K, where nothing says what a node's temperature is."""
_TRIED, _FASTEST, _SPARED = 64, 8, 2
"""Thetas that are tried, of all that are drawn: the first, but for those with the fastest node. The prior of a small
capacity has draws whose node needs much shorter steps than those of most. The last number is that of the worst ones
that do not count: a thermostat that switches a hundred times would rule the steps of all others."""
_FIRST, _BEGINNING, _WIDENING = 60.0, 0.5, 0.3
"""The steps that are tried first: so long, s, at most; so long, s, after a break, and from there by so much longer for
each second that passes. What they resolve too well is seen by that, what a long step jumps over is not."""
FALLBACK = 30.0
"""s, where nothing can be simulated at the thetas that are tried."""
_SHORTEST = 0.5
"""s, no shorter for the tolerance's sake: where that would not do, a thermostat grazes its threshold at some theta."""
_FEWEST = 64
"""Fewer steps gain little, and half steps tell less of the error of very long ones."""
_MOST = 8
"""Times as many points as with `FALLBACK`: where that would not do, something diverges."""
_TRIALS, _IDLE = 14, 2
"""How often at most, and how often without a gain."""
_MARGIN = 0.7
"""Of the tolerance, at the thetas that are tried, as others will be simulated."""
_LARGEST = 2.5
"""Times the tolerance, for the largest error."""
_OWN = 0.5
"""Of the largest error, what one step may add."""
_UNDIVIDED = 1e-3  # s; settling steps are left as they are
_SHORTER = 0.7
"""Times the length of a step that was too long."""
_WHOLE = 1.5
"""Most by which the length that was wanted of a step differs from the one that it has, when the next is reckoned."""
_GROWTH = 3.0
"""Most by which a step grows or shrinks from one trial to the next."""
_ALMOST, _FEWER, _TIGHTER = 2.0, 0.6, (0.8, 0.65, 0.5)
"""Times the tolerance: a grid so near to it, with so many of the steps of the best one, is tried with shorter steps."""


@dataclass(frozen=True)
class Accuracy:
    """The steps of a window's integration, and what they cost in accuracy."""

    steps: int
    error: float
    """K, root mean square over time and the thetas that were tried, of the worst channel; NaN: unknown."""
    largest: float
    """K."""


Lengths = Callable[[FloatArray], FloatArray]
"""Of steps, s, over time [.]."""


@dataclass(frozen=True)
class StepErrors:
    """Simulations at S thetas on two grids."""

    off: FloatArray
    """[S, J, N] K, difference of the readings at the points [J] of the second grid."""
    switched: Sequence[FloatArray]
    """[S] of [.] s, when thermostats acted on either."""


Compare = Callable[[FloatArray, FloatArray], StepErrors | None]
"""None: all simulations failed."""


def to_try(structure: Structure, packed: FloatArray) -> IntArray:
    """Which of the systems [S, P] that are drawn a grid is tried at."""
    count, linear = len(structure.mass), len(structure.linear_column)
    speeds = np.zeros((len(packed), count))  # 1/s, by how much a node's own temperature slows its rate
    for start, column, first, slope in (
        (structure.linear_start, structure.linear_column, 0, 1.0),
        (structure.radiative_start, structure.radiative_column, linear, 4.0 * ROOM**3),
    ):
        candidates = np.flatnonzero(np.repeat(np.arange(count), np.diff(start)) == column)
        speeds[:, column[candidates]] -= slope * packed[:, first + candidates]
    fastest = np.argsort(-speeds[:, structure.mass > 0.0].max(axis=1), kind="stable")[:_FASTEST]
    others = np.setdiff1d(np.arange(len(packed)), fastest)
    return np.concatenate([others[: _TRIED - len(fastest)], fastest])


def choose_grid(inputs: Inputs, compare: Compare, tolerance: float) -> tuple[FloatArray, Accuracy]:
    """A grid [K+1] with few steps whose error at the thetas that `compare` tries is within the tolerance, K."""

    def first(times: FloatArray) -> FloatArray:
        since = times - inputs.breaks[np.searchsorted(inputs.breaks, times, side="right") - 1]
        return np.clip(_WIDENING * since, _BEGINNING, _FIRST)

    wanted: Lengths = first
    # On the steps' length, from each of these times to the next.
    caps = np.full(len(inputs.times), inputs.breaks[-1] / _FEWEST)
    grid = make_grid(inputs, wanted)
    best: tuple[FloatArray, Accuracy] | None = None
    left, most = _IDLE, _MOST * len(make_grid(inputs, FALLBACK))
    closest = np.inf, grid, Accuracy(len(grid) - 1, np.nan, np.nan)
    almost: tuple[int, Lengths] | None = None
    for _ in range(_TRIALS):
        found = measure(grid, compare)
        if found is None:
            grid = make_grid(inputs, FALLBACK)
            return grid, Accuracy(len(grid) - 1, np.nan, np.nan)
        accuracy, typical, worst = found
        error, largest, excess = _over(accuracy, tolerance)
        if excess < closest[0]:
            closest = excess, grid, accuracy
        if 1.0 < excess < _ALMOST and (almost is None or accuracy.steps < almost[0]):
            almost = accuracy.steps, wanted
        if excess <= 1.0:
            if best is None or accuracy.steps < 0.97 * best[1].steps:
                best = grid, accuracy
            else:
                left -= 1
                if left == 0:
                    break
        # A step of third order adds as the fourth power of its length, and the whole error follows as the third.
        too_long = np.flatnonzero(worst > _OWN * _LARGEST * tolerance)
        # A largest error that no step shows has come from all of them, by way of the heaters' switches.
        whole = max(error, 1e-3 if len(too_long) else largest)
        even = (typical / np.sqrt(np.mean(typical**2) + 1e-300) + 1e-3) ** -0.25 * whole ** (-1.0 / 3.0)
        bounded = (worst / (_OWN * _LARGEST * tolerance) + 1e-3) ** -0.25
        # Where a step was too long once, none is as long again: near a switch errors follow no power of the length.
        for k in too_long:
            here = slice(*np.searchsorted(inputs.times, grid[[k, k + 1]]))
            caps[here] = np.minimum(caps[here], _SHORTER * (grid[k + 1] - grid[k]))
        wanted = _changed(wanted, grid, np.minimum(even, bounded), inputs.times, caps)
        grid = make_grid(inputs, wanted)
        if len(grid) > most:
            break
    if almost is not None and (best is None or almost[0] < _FEWER * best[1].steps):
        # The steps that follow from errors need not lead there, where thermostats make these of some of the steps.
        best = _tightened(inputs, compare, tolerance, almost[1]) or best
    return best or closest[1:]


def _tightened(
    inputs: Inputs, compare: Compare, tolerance: float, wanted: Lengths
) -> tuple[FloatArray, Accuracy] | None:
    """The first grid within the tolerance whose steps are a little shorter than wanted; None: none is."""
    for share in _TIGHTER:
        grid = make_grid(inputs, _times(share, wanted))
        found = measure(grid, compare)
        if found is not None and _over(found[0], tolerance)[2] <= 1.0:
            return grid, found[0]
    return None


def _times(share: float, wanted: Lengths) -> Lengths:
    return lambda at: share * wanted(at)


def _over(accuracy: Accuracy, tolerance: float) -> tuple[float, float, float]:
    """The error and the largest error of a grid, over those that are allowed, and the worse of both."""
    error, largest = accuracy.error / (_MARGIN * tolerance), accuracy.largest / (_LARGEST * tolerance)
    return error, largest, max(error, largest)


def measure(grid: FloatArray, compare: Compare) -> tuple[Accuracy, FloatArray, FloatArray] | None:
    """The error of a grid against its halves, at all thetas but the worst ones (`_SPARED`); None: unknown.

    Also what each of its steps [K] adds to it, in the root mean square over the thetas and at most, K.
    """
    lengths = np.diff(grid)
    divided = np.flatnonzero(lengths > _UNDIVIDED)
    middles = grid[divided] + 0.5 * lengths[divided]
    halves = np.sort(np.concatenate([grid, middles]))
    found = compare(grid, halves)
    if found is None:
        return None
    off = found.off
    counted = np.argsort(np.abs(off).max(axis=(1, 2)), kind="stable")[: len(off) - _SPARED * len(off) // _TRIED]
    off = off[counted]
    weights = np.zeros(len(halves))
    weights[:-1] += 0.5 * np.diff(halves)
    weights[1:] += 0.5 * np.diff(halves)
    mean_square = np.einsum("sjn,j->n", off**2, weights / weights.sum()) / len(off)
    ends, middle = np.searchsorted(halves, grid), np.searchsorted(halves, middles)
    added = np.abs(np.diff(off[:, ends], axis=1))
    bent = np.abs(off[:, middle] - 0.5 * (off[:, ends[divided]] + off[:, ends[divided + 1]]))
    added[:, divided] = np.hypot(added[:, divided], 2.0 * bent)
    added = added.max(axis=2)
    for k, times in enumerate(found.switched[one] for one in counted):
        # There the error of all steps before shows, since it moves the switch.
        added[k, np.clip(np.searchsorted(grid, times) - 1, 0, len(lengths) - 1)] = 0.0
    accuracy = Accuracy(len(lengths), float(np.sqrt(mean_square.max())), float(np.abs(off).max()))
    return accuracy, np.sqrt((added**2).mean(axis=0)), added.max(axis=0)


def _changed(wanted: Lengths, grid: FloatArray, change: FloatArray, times: FloatArray, caps: FloatArray) -> Lengths:
    """Lengths of the next trial's steps, from those wanted of this one's and the factors [K] for its steps.

    At most caps [M] from `times` [M] on.
    """
    lengths, middles = np.diff(grid), 0.5 * (grid[1:] + grid[:-1])
    # What was wanted counts, for steps between two breaks come in whole numbers; but not where they rule alone.
    before = np.clip(wanted(middles), lengths / _WHOLE, lengths * _WHOLE)
    kept = lengths > _UNDIVIDED
    logarithms = np.log(np.maximum(before * np.clip(change, 1.0 / _GROWTH, _GROWTH), _SHORTEST)[kept])
    capped = np.append(np.maximum(caps, _SHORTEST), np.inf)

    def lengths_at(at: FloatArray) -> FloatArray:
        step = np.searchsorted(times, at, side="right") - 1
        return np.minimum(np.exp(np.interp(at, middles[kept], logarithms)), capped[step])

    return lengths_at
