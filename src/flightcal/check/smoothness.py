"""Is the log density as smooth as a gradient-based sampler needs it, and is its gradient right?

Scans run along every parameter while the others follow as they are correlated with it in the posterior, so a scan of
three standard deviations stays where a sampler goes. Between two points the heaters may switch another number of times:
there a trajectory grazes a threshold, and the log density can jump. Each such place is found by bisection.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..problem import Problem, Runs
from ..progress import SILENT, Progress
from ..simulator import FloatArray
from .centre import Centre
from .evaluate import Effort, densities, in_batches, signature

REACH = 3.0
"""Standard deviations of the posterior to each side that a scan covers."""
SMALLEST_JUMP = 0.1
"""Nats; smaller jumps are not told of."""
_MOST_CANDIDATES = 300
_HALVINGS = 22
_ROUGH = 8.0
"""An increment that differs from its neighbours' mean by so many medians may hide a jump."""
_DRIFT = 1.0
"""Seconds by which the same switch may differ on the two sides of a jump."""
TOLERANCE = 2e-3
"""Largest error of the gradient, in nats per conditional standard deviation, relative where it is above one."""
_STEPS = (1e-2, 1e-3, 1e-4)
"""Of the conditional standard deviations, for differences."""
_POINTS = 4


@dataclass(frozen=True)
class DensityJump:
    """A place at which the log density jumps."""

    name: str
    place: float
    """Standard deviations of the posterior from the centre."""
    theta: float
    """Of the parameter there, SI."""
    nats: float
    """Upwards with the parameter."""
    heater: str = ""
    """The one that switches another number of times on the two sides; empty where none does."""
    seconds: float = np.nan
    """From the window's start to the first switch that differs; NaN where none does."""
    switches: tuple[int, int] = (0, 0)
    """Of that heater, below and above the place."""
    window: str = ""
    """Label of the window in which it does; empty where none does."""


@dataclass(frozen=True)
class Scan:
    """The log density along one parameter, others following."""

    name: str
    place: FloatArray
    """[P] standard deviations of the posterior from the centre."""
    theta: FloatArray
    """[P] of the parameter, SI."""
    log_density: FloatArray
    """[P] relative to the centre's; -inf where the simulation fails."""
    sequence: tuple[int, ...]
    """[P] number of the switch sequence: the same where all heaters switch equally often."""
    jumps: tuple[DensityJump, ...]


@dataclass(frozen=True)
class GradientError:
    """The largest error of the gradient by one parameter."""

    name: str
    error: float
    """Nats per conditional standard deviation, relative where the derivative is above one."""
    gradient: float
    difference: float
    """The derivative by z as it is given, and by differences."""


@dataclass(frozen=True)
class Smoothness:
    """The scans and the check of the gradient."""

    scans: tuple[Scan, ...]
    gradient: tuple[GradientError, ...]
    """The largest error of each parameter; empty where there is no gradient."""
    points: int
    """At which the gradient was checked."""
    left_out: int
    """Differences across another switch sequence, which say nothing."""
    located: bool

    @property
    def jumps(self) -> tuple[DensityJump, ...]:
        """Of all scans, the largest first."""
        return tuple(sorted((jump for scan in self.scans for jump in scan.jumps), key=lambda jump: -abs(jump.nats)))


def scan_all(problem: Problem, centre: Centre, effort: Effort, progress: Progress = SILENT) -> tuple[Scan, ...]:
    """A scan along each parameter through the centre, with its jumps located where the effort allows it."""
    covariance = centre.covariance
    directions = covariance / np.sqrt(np.diag(covariance))
    place = np.linspace(-REACH, REACH, effort.scan)
    names = problem.names if effort.base else tuple(problem.names[k] for k in problem.simulated)
    scanned = [problem.names.index(name) for name in names]
    points = np.concatenate([centre.z + place[:, None] * directions[:, k] for k in scanned])
    flat: FloatArray = np.empty(len(points))
    marks: list[tuple[int, ...]] = []
    for part in in_batches(len(points)):
        flat[part], runs = densities(problem, points[part])
        marks += [signature(run, len(problem.heaters)) for run in runs]
        progress.at(part.stop / len(points))
    values = flat.reshape(len(names), -1)
    signatures = [marks[k * effort.scan : (k + 1) * effort.scan] for k in range(len(names))]
    jumps = _located(problem, centre, names, directions[:, scanned], place, values, signatures) if effort.base else []
    thetas = problem.to_theta(points).reshape(len(names), effort.scan, -1)
    return tuple(
        Scan(
            name=name,
            place=place,
            theta=thetas[k, :, scanned[k]],
            log_density=values[k] - centre.log_density,
            sequence=_numbered(signatures[k]),
            jumps=tuple(jump for jump in jumps if jump.name == name),
        )
        for k, name in enumerate(names)
    )


def _numbered(signatures: list[tuple[int, ...]]) -> tuple[int, ...]:
    order = list(dict.fromkeys(signatures))
    return tuple(order.index(mark) for mark in signatures)


def _candidates(values: FloatArray, signatures: list[list[tuple[int, ...]]]) -> list[tuple[int, int, float]]:
    """Intervals that may hold a jump: scan, its lower point, and the slope [per interval] expected without one."""
    found = []
    for k, row in enumerate(values):
        with np.errstate(invalid="ignore"):  # next to failed simulations
            rise = np.diff(row)
            padded = np.concatenate([rise[1:2], rise, rise[-2:-1]])
            expected = 0.5 * (padded[:-2] + padded[2:])
            oddity = np.abs(rise - expected)
        finite = np.isfinite(oddity)
        usual = np.median(oddity[finite]) if finite.any() else 0.0
        for i in np.flatnonzero(np.isfinite(rise)):
            changed = signatures[k][i] != signatures[k][i + 1]
            odd = finite[i] and oddity[i] > max(SMALLEST_JUMP, _ROUGH * usual)
            if changed or odd:
                found.append((k, int(i), float(expected[i]) if finite[i] else 0.0, float(oddity[i])))
    found.sort(key=lambda item: -item[3])
    return [item[:3] for item in found[:_MOST_CANDIDATES]]


def _located(
    problem: Problem,
    centre: Centre,
    names: tuple[str, ...],
    directions: FloatArray,
    place: FloatArray,
    values: FloatArray,
    signatures: list[list[tuple[int, ...]]],
) -> list[DensityJump]:
    """Halve all candidates side by side, and keep what is a jump."""
    candidates = _candidates(values, signatures)
    if not candidates:
        return []
    heaters = len(problem.heaters)
    scan, lower, slope = (np.array(column) for column in zip(*candidates, strict=True))
    ends = np.stack([place[lower], place[lower + 1]])
    heights = np.stack([values[scan, lower], values[scan, lower + 1]])
    marks = [[signatures[k][i] for k, i, _ in candidates], [signatures[k][i + 1] for k, i, _ in candidates]]
    spacing = place[1] - place[0]
    for _ in range(_HALVINGS):
        middle = ends.mean(axis=0)
        height, runs = densities(problem, centre.z + middle[:, None] * directions[:, scan].T)
        smooth = slope * (middle - ends[0]) / spacing
        for c, run in enumerate(runs):
            mark = signature(run, heaters)
            lower_mark, upper_mark = marks[0][c], marks[1][c]
            if lower_mark != upper_mark and mark in (lower_mark, upper_mark):
                side = int(mark == upper_mark)
            else:
                odd = np.abs([height[c] - heights[0, c] - smooth[c], heights[1, c] - height[c] - smooth[c]])
                side = int(odd[0] > odd[1])
            # The jump is in the half that begins at the end that stays.
            ends[side, c], heights[side, c] = middle[c], height[c]
            marks[side][c] = mark
    rise = heights[1] - heights[0]
    kept = np.flatnonzero(np.isfinite(rise) & (np.abs(rise) >= SMALLEST_JUMP))
    points = [centre.z + ends[side, kept, None] * directions[:, scan[kept]].T for side in (0, 1)]
    below, above = (densities(problem, point)[1] for point in points)
    thetas = problem.to_theta(points[0])
    jumps = []
    for c, theta, *sides in zip(kept.tolist(), thetas, below, above, strict=True):
        name = names[scan[c]]
        jump = DensityJump(name, float(ends[0, c]), float(theta[problem.names.index(name)]), float(rise[c]))
        jumps.append(replace(jump, **_what_differs(problem, *sides)))
    return jumps


def _what_differs(problem: Problem, below: Runs | None, above: Runs | None) -> dict[str, Any]:
    """Of a jump: the heater that switches another number of times, when first, how often, and in which window.

    Of several the one whose switches differ first: what the others do follows from it.
    """
    if below is None or above is None:
        return {}
    found = []
    for window, *sides in zip(problem.windows, below, above, strict=True):
        for number, heater in enumerate(problem.heaters):
            times = [np.asarray(run.switches.time)[run.switches.heater == number] for run in sides]
            if len(times[0]) == len(times[1]):
                continue
            common = min(map(len, times))
            apart = np.flatnonzero(np.abs(times[0][:common] - times[1][:common]) > _DRIFT)
            first = int(apart[0]) if len(apart) else common
            seconds = min(float(row[first]) for row in times if len(row) > first)
            counts = len(times[0]), len(times[1])
            differs = {"heater": heater, "seconds": seconds, "switches": counts, "window": window.label}
            found.append((window.times[0], seconds, differs))
    return min(found, key=lambda item: item[:2])[-1] if found else {}


def check_gradient(
    problem: Problem, centre: Centre, seed: int, progress: Progress = SILENT
) -> tuple[tuple[GradientError, ...], int, int]:
    """The gradient against differences of the log density, at the centre and at draws around it.

    Central and one-sided differences of three lengths, of which the one that agrees best counts: a right gradient
    agrees with one of them, also at a kink, where modes like to lie. Returns the largest error of each parameter, the
    number of points, and how many derivatives were left out because the heaters switch otherwise next to the point.
    """
    dimension = len(centre.z)
    moves = np.random.default_rng(seed).standard_normal((_POINTS - 1, dimension))
    around = centre.z + moves @ np.linalg.cholesky(centre.covariance).T
    deviation = 1.0 / np.sqrt(np.diag(centre.hessian))
    steps = np.array(_STEPS)
    offsets = np.concatenate([np.diag(step * deviation) for step in steps])
    worst: dict[int, GradientError] = {}
    points, left_out = 0, 0
    for number, z in enumerate([centre.z, *around]):
        value, gradient = problem.log_density_and_gradient(z)
        if not np.isfinite(value):
            continue
        points += 1
        values, runs = densities(problem, np.concatenate([z[None], z + offsets, z - offsets]))
        marks = [signature(run, len(problem.heaters)) for run in runs]
        usable = np.array([mark == marks[0] for mark in marks[1:]]).reshape(2, len(steps), dimension)
        sides = values[1:].reshape(2, len(steps), dimension) - values[0]
        slopes = np.where(usable, sides / steps[:, None], np.nan) * np.array([1.0, -1.0])[:, None, None]
        # [difference, d] in nats per conditional standard deviation: forward, backward, central.
        slopes = np.concatenate([slopes[0], slopes[1], 0.5 * (slopes[0] + slopes[1])])
        expected = gradient * deviation
        error = np.abs(slopes - expected) / np.maximum(1.0, np.abs(expected))
        for k in range(dimension):
            if not np.isfinite(error[:, k]).any():
                left_out += 1
                continue
            best = int(np.nanargmin(error[:, k]))
            if k not in worst or error[best, k] > worst[k].error:
                difference = float(slopes[best, k] / deviation[k])
                worst[k] = GradientError(problem.names[k], float(error[best, k]), float(gradient[k]), difference)
        progress.at((number + 1) / (1 + len(around)))
    return tuple(worst[k] for k in sorted(worst)), points, left_out


def smoothness(
    problem: Problem, centre: Centre, effort: Effort, seed: int, *, gradient: bool, progress: Progress = SILENT
) -> Smoothness:
    """Scans along every parameter, and where there is a gradient its check."""
    with progress.stage("scans", 1.0) as scanning:
        scans = scan_all(problem, centre, effort, scanning)
    with progress.stage("gradient", 1.0) as checking:
        errors, points, left_out = check_gradient(problem, centre, seed, checking) if gradient else ((), 0, 0)
    return Smoothness(scans, errors, points, left_out, bool(effort.base))
