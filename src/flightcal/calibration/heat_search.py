"""Finding unmodelled heat: parameters, weights of heat, and sizes of noise and heat, around which all is linear.

Parameters and weights take Gauss-Newton steps; between these the sizes of heat and noise, and the noise's shape, are
those under which the telemetry is most probable with all that is linear integrated out. What the telemetry tells
nothing of is left to the prior.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from ..probability import DEVIATION, Evidence, Priors, Residuals, Shaped, filter_of, shape_of, through_noise
from ..problem import (
    HeatModel,
    Problem,
    Units,
    Window,
    errors_of_weights,
    heat_of_weights,
    kept_responses,
    responses,
    responses_in,
    split,
    unit_heats,
)
from ..progress import Progress
from ..simulator import FloatArray, IntArray, in_parallel
from .heat_point import HeatPoint
from .sizes import Around

_ROUNDS = 10
_SHAPED = 3
"""In the first rounds the noise's shape is looked for too."""
_MOVED = 0.1
"""Of its deviation: by how much no parameter may move in the last round."""
_TOLD = 0.05
"""Of what the prior knows of a direction: where the telemetry tells less, it is left to the prior."""
_TOLD_HARDLY = 1e-3
"""The same for a step: what the telemetry moves by less than a thousandth of its deviation's square stays."""
_TOLD_MUCH = 0.5
"""The same while the noise's shape is looked for, and what heaters without a status did."""
_AT_ONCE = 8
"""Groups whose responses are looked at together: of all at once there may be gigabytes."""
_WORK = 1e9
"""Samples times functions squared, in one look at the noise's shape: of a longer telemetry the beginning tells it."""
_ITERATIONS = 25
_FARTHEST = 8.0
"""Most by which the logarithm of a size changes in one fit: beyond, matrices lose all their digits."""
_SHORTEST = 1 / 16
_TURNED = 0.05
"""Of z, by which responses to heat are looked at again."""
_BENT = 0.5
"""Of the log of how much heat does: by how much it may be off before the slope in the density no longer counts."""
_LARGER = 4.0
"""Times what it was found to be, that a size hardly ever is: of a half-normal the upper 0.7% over the median."""
_SMALL, _MUCH = 0.3, 10.0
"""Of a prior's size, that of heat to begin with, and of what wanders in a second start."""


@dataclass(frozen=True)
class Linear:
    """A window around a point."""

    window: Window
    units: tuple[Units, ...]
    terms: Residuals
    """Without heat."""
    left: FloatArray
    """[T, N] K, telemetry minus simulation; zero where there is none."""
    jacobian: FloatArray
    """[T, N, d] by z of the whole problem."""
    response: list[FloatArray]
    """Of each group [T, N, f]."""

    def beginning(self, samples: int) -> Linear:
        """The same of the first samples alone."""
        terms = replace(self.terms, seconds=self.terms.seconds[:samples], valid=self.terms.valid[:, :samples])
        response = [of_group[:samples] for of_group in self.response]
        return replace(self, terms=terms, left=self.left[:samples], jacobian=self.jacobian[:samples], response=response)

    def through(self, shapes: tuple[Shaped, ...]) -> Callable[[FloatArray], FloatArray]:
        """What makes of columns [T, N, c] those through noise of these shapes and of deviation one, [N, T, c]."""
        return through_noise(replace(self.terms, kinds=shapes))


@dataclass(frozen=True)
class Point:
    """A point, and the windows around it."""

    z: FloatArray
    """[d] of the problem,"""
    weights: FloatArray
    """[f] and the weights of all functions of all groups."""
    each: Sequence[Linear]
    """Of the windows."""


class Search:
    """The rounds of `find_heat`, while heaters do what is held."""

    def __init__(self, problem: Problem, windows: Sequence[Window], model: HeatModel) -> None:
        self.problem, self.model = problem, model
        self.windows = windows
        self.sampling = replace(problem, windows=tuple(windows), open_loop=None)
        self.moving: IntArray = self.sampling.simulated
        residuals = windows[0].residuals
        self.entries, self.kinds = residuals.entries, residuals.terms.kinds
        names = list(dict.fromkeys(entry.name for entry in self.entries))
        priors = [windows[0].reads[name] for name in names]
        scales = model.priors
        self.sizes = Priors((*names, *scales), (*priors, *scales.values()))
        self.noise, self.names = names, [*names, *scales]
        self.floor = _floors(windows)
        self.units = {window.name: unit_heats(model, window) for window in windows}
        most = [max(len(series.series) for series in of_group) for of_group in zip(*self.units.values(), strict=True)]
        self.functions = most
        self.group = np.repeat(np.arange(len(most)), most)
        # Of each channel, the column of its white noise.
        self.white = [kind.names.index(kind.white) if kind.white else 0 for kind in self.kinds]

    # --- numbers ------------------------------------------------------------------------------------------------

    def numbers(self, sizes: FloatArray) -> FloatArray:
        """[N, n] of the noise at sizes, no smaller than the telemetry's steps allow."""
        numbers = self.windows[0].residuals.fixed.copy()
        for entry in self.entries:
            numbers[entry.channel, entry.column] = sizes[self.noise.index(entry.name)]
        for k, column in enumerate(self.white):
            numbers[k, column] = np.hypot(numbers[k, column], self.floor[k])
        return numbers

    def roots(self, sizes: FloatArray) -> FloatArray:
        """[g] scale of each group."""
        known = dict(zip(self.names, sizes, strict=True))
        return np.array([known[group.scale] if group.scale else 1.0 for group in self.model.groups])

    def shapes(self, sizes: FloatArray) -> tuple[Shaped, ...]:
        """Of each channel's noise."""
        return tuple(shape_of(kind, numbers) for kind, numbers in zip(self.kinds, self.numbers(sizes), strict=True))

    # --- rounds -------------------------------------------------------------------------------------------------

    def run(self, theta: FloatArray, progress: Progress, look: str = "") -> HeatPoint:
        """Parameters, heat and sizes, from theta [d] of the problem without heat; see also `tilted`.

        look: what is looked at, in words. Raises SimulationFailure.
        """
        z, weights = self.problem.to_z(theta), np.zeros(len(self.group))
        sizes = self._start(z)
        moved, rounds = np.inf, 0
        while rounds < _ROUNDS and (moved > _MOVED or rounds < _SHAPED):
            rounds += 1
            progress.at(min(1.0, rounds / (_SHAPED + 2)), f"{look}round {rounds}")
            linear = self.linear(z, weights).each
            if rounds <= _SHAPED:
                starts = self._starts(sizes) if rounds == 1 else [sizes]
                sizes = self._best_fit(linear, z, weights, starts)
            else:
                sizes = self._around(linear, z, weights, sizes).most_probable(sizes)
            z, weights, moved = self.step(linear, z, weights, sizes)
        linear = self.linear(z, weights).each
        around = self._around(linear, z, weights, sizes)
        sizes = around.most_probable(sizes)
        # Windows are linearised around heat; an error of the simulator is linear everywhere.
        errors = [g for g, group in enumerate(self.model.groups) if group.part == "error"]
        at = np.where(np.isin(self.group, errors), 0.0, weights)
        centre = self.of_bases(at, around.bases)
        model = replace(self.model, kept=around.bases, centre=centre, shapes=self.shapes(sizes))
        found = dict(zip(self.names, sizes.tolist(), strict=True))
        return HeatPoint(model, self.problem.names, self.problem.to_theta(z), found, around)

    def linear(self, z: FloatArray, weights: FloatArray) -> Point:
        """All windows around z [d] and weights [f]."""
        return Point(z, weights, [self._linearise(window, z, weights) for window in self.windows])

    def at(self, point: HeatPoint) -> Point:
        """All windows around a point that was found."""
        weights = np.concatenate(split(point.model, point.model.centre))
        return self.linear(self.problem.to_z(point.theta), weights)

    def _start(self, z: FloatArray) -> FloatArray:
        """Sizes to begin with: noise as the residuals have it, heat of a part of its prior's size."""
        theta = self.problem.to_theta(z)
        sizes = self.sizes.median()
        runs = self.sampling.simulate(theta)
        rmse = np.sqrt(np.nanmean(self.sampling.residual(runs) ** 2, axis=0))
        for entry in self.entries:
            if entry.size == "noise":
                sizes[self.noise.index(entry.name)] = max(0.5 * rmse[entry.channel], 1e-3)
            elif entry.size == "white":
                sizes[self.noise.index(entry.name)] = max(0.2 * rmse[entry.channel], 1e-3)
        for k in range(len(self.noise), len(sizes)):
            sizes[k] = _SMALL * next(g.size for g in self.model.groups if g.scale == self.names[k])
        return sizes

    def _starts(self, sizes: FloatArray) -> list[FloatArray]:
        """These sizes, and the same with much heat that wanders: what is small stays so, for noise takes its place."""
        wandering = [self.names.index(group.scale) for group in self.model.groups if group.part == "slow"]
        much = sizes.copy()
        much[wandering] *= _MUCH / _SMALL
        return [sizes, much] if wandering else [sizes]

    def _linearise(self, window: Window, z: FloatArray, weights: FloatArray) -> Linear:
        problem = self.sampling
        units, heat = self.units[window.name], self._heat(window, weights)
        around = replace(window, simulator=window.network.with_heat(heat))
        here = replace(
            problem, windows=tuple(around if each_window is window else each_window for each_window in problem.windows)
        )
        theta = here.at(around, problem.to_theta(z))
        expected = around.simulate(theta).temperatures + self._errors(window, weights)
        place = [each_window is window for each_window in problem.windows].index(True)
        left = np.where(window.valid, window.observed - expected, 0.0)
        jacobian = here.jacobians_of(place, z)
        terms = replace(window.residuals.terms, heat=None)
        return Linear(around, units, terms, left, jacobian, responses(around, theta, self.model, units))

    def _heat(self, window: Window, weights: FloatArray) -> FloatArray:
        """[h, 2 K] W of weights of all groups."""
        return heat_of_weights(self.model, self.units[window.name], self._by_group(window, weights))

    def _errors(self, window: Window, weights: FloatArray) -> FloatArray | float:
        """[T, N] K of the simulator, of weights of all groups."""
        return errors_of_weights(self.units[window.name], self._by_group(window, weights))

    def _by_group(self, window: Window, weights: FloatArray) -> list[FloatArray]:
        """Weights of the functions that a window has."""
        return [
            weights[self.group == g][: len(group_units.series)] for g, group_units in enumerate(self.units[window.name])
        ]

    def columns(self, linear: Sequence[Linear], bases: Sequence[FloatArray]) -> list[FloatArray]:
        """[T, N, m + d] of each window: responses in the kept directions, and by z."""
        return [
            np.concatenate([kept_responses(bases, linearised.response), linearised.jacobian[..., self.moving]], axis=2)
            for linearised in linear
        ]

    def of_bases(self, weights: FloatArray, bases: Sequence[FloatArray]) -> FloatArray:
        """Weights of all groups in the kept directions."""
        return np.concatenate([basis.T @ weights[self.group == g] for g, basis in enumerate(bases)])

    def from_bases(self, kept: FloatArray, bases: Sequence[FloatArray]) -> FloatArray:
        """Weights of all groups from those in the kept directions."""
        return np.concatenate(split(replace(self.model, kept=tuple(bases)), kept))

    def _told(
        self, linear: Sequence[Linear], sizes: FloatArray, roots: FloatArray, least: float
    ) -> tuple[FloatArray, ...]:
        """Of each group an orthonormal basis [f, k] of the directions of which the telemetry tells something."""
        deviations = self.numbers(sizes)[:, :1, None]
        whitens = [linearised.through(self.shapes(sizes)) for linearised in linear]
        grams = [np.zeros((functions, functions)) for functions in self.functions]
        for first in range(0, len(grams), _AT_ONCE):
            for linearised, whiten in zip(linear, whitens, strict=True):
                responses_here = linearised.response[first : first + _AT_ONCE]
                wide = np.concatenate(responses_here, axis=2)
                if wide.shape[2] == 0:
                    continue
                white = (whiten(wide) / deviations).reshape(-1, wide.shape[2])
                # A window may lack the last functions of a group.
                counts = [response.shape[2] for response in responses_here]
                parts = np.split(white, np.cumsum(counts)[:-1], axis=1)
                for gram, count, part in zip(grams[first : first + _AT_ONCE], counts, parts, strict=True):
                    gram[:count, :count] += part.T @ part
        return tuple(_directions(root**2 * gram, least) for root, gram in zip(roots, grams, strict=True))

    def much_told(self, linear: Sequence[Linear], sizes: FloatArray) -> tuple[FloatArray, ...]:
        """The same of those of which it tells much, where heat is as large as found, or as its prior has it."""
        return self._told(linear, sizes, self._generous(sizes), _TOLD_MUCH)

    def _generous(self, sizes: FloatArray) -> FloatArray:
        """Scales of the groups, or their priors' where these are larger."""
        prior = np.array([group.size for group in self.model.groups])
        return np.maximum(self.roots(sizes), prior)

    def _largest(self, sizes: FloatArray) -> FloatArray:
        """Scales of the groups that they hardly exceed where they were found to be `sizes`."""
        return np.minimum(self._generous(sizes), _LARGER * self.roots(sizes))

    def prior_of_z(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean and deviations of the normal distribution that the prior of what is simulated is like at z."""
        precision = np.maximum(self.problem.priors.precision(z)[self.moving], 1e-6)
        gradient = self.problem.priors.at(z).gradient[self.moving]
        return z[self.moving] + gradient / precision, precision**-0.5

    def _best_fit(
        self, linear: Sequence[Linear], z: FloatArray, weights: FloatArray, starts: Sequence[FloatArray]
    ) -> FloatArray:
        """Of several starts, the sizes under which the telemetry is most probable."""
        found = in_parallel(lambda k: self._fit(linear, z, weights, starts[k]), len(starts))
        return min(found, key=lambda fitted: fitted[1])[0]

    def _fit(
        self, linear: Sequence[Linear], z: FloatArray, weights: FloatArray, sizes: FloatArray
    ) -> tuple[FloatArray, float]:
        """The sizes near these under which the telemetry is most probable, and minus the log density there."""
        bases = self.much_told(linear, sizes)
        kept = sum(basis.shape[1] for basis in bases)
        share = (_WORK / max(1, kept**2 * sum(linearised.left.size for linearised in linear))) ** (1 / 3)
        if share < 1.0:
            linear = [linearised.beginning(int(np.ceil(share * len(linearised.left)))) for linearised in linear]
            bases = self.much_told(linear, sizes)
        columns = self.columns(linear, bases)
        mean, deviation = self.prior_of_z(z)
        from_prior = np.concatenate([self.of_bases(weights, bases), z[self.moving] - mean])
        left = [linearised.left + basis @ from_prior for linearised, basis in zip(linear, columns, strict=True)]
        counts = [basis.shape[1] for basis in bases]
        evidence = Evidence(
            [linearised.terms for linearised in linear], columns, self.windows[0].residuals.fixed.shape[1]
        )
        ends = np.cumsum(counts)

        def cost(u: FloatArray) -> tuple[float, FloatArray]:
            at = self.sizes.at(u)
            numbers, scales = self.numbers(at.theta), self.roots(at.theta)
            roots = np.concatenate([np.repeat(scales, counts), deviation])
            value, numbers_bar, roots_bar = evidence(left, numbers, roots)
            bar = np.zeros(len(u))
            for entry in self.entries:
                slope = numbers_bar[entry.channel, entry.column]
                if entry.column == self.white[entry.channel]:
                    slope *= at.theta[self.noise.index(entry.name)] / numbers[entry.channel, entry.column]
                bar[self.noise.index(entry.name)] += slope
            for group, part in zip(self.model.groups, np.split(roots_bar, ends)[:-1], strict=True):
                if group.scale:
                    bar[self.names.index(group.scale)] += part.sum()
            return -(value + float(at.log_density)), -(bar * at.slope + at.gradient)

        start = self.sizes.to_z(sizes)
        bounds = [(size - _FARTHEST, size + _FARTHEST) for size in start]
        options = {"maxiter": _ITERATIONS, "ftol": 1e-7}
        found = minimize(cost, start, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
        return self.sizes.to_theta(found.x), float(found.fun)

    def step(
        self, linear: Sequence[Linear], z: FloatArray, weights: FloatArray, sizes: FloatArray
    ) -> tuple[FloatArray, FloatArray, float]:
        """The next point, and by how much parameters moved in their deviations."""
        shapes, numbers, scales = self.shapes(sizes), self.numbers(sizes), self.roots(sizes)
        moving, (mean, deviation) = self.moving, self.prior_of_z(z)
        # In thousands of functions there are some hundred directions that the telemetry tells of.
        bases = self._told(linear, sizes, scales, _TOLD_HARDLY)
        kept = self.of_bases(weights, bases)
        roots = np.concatenate([np.repeat(scales, [basis.shape[1] for basis in bases]), deviation])
        gram, moment = np.zeros((len(roots), len(roots))), np.zeros(len(roots))
        whitens = [linearised.through(shapes) for linearised in linear]
        for linearised, wide, whiten in zip(linear, self.columns(linear, bases), whitens, strict=True):
            both = np.concatenate([wide, linearised.left[..., None]], axis=2)
            flat = (whiten(both) / numbers[:, :1, None]).reshape(-1, both.shape[2])
            gram += flat[:, :-1].T @ flat[:, :-1]
            moment += flat[:, :-1].T @ flat[:, -1]
        # In units of the prior's deviations, from the prior's mean.
        now = np.concatenate([kept / roots[: len(kept)], (z[moving] - mean) / deviation])
        inner = np.eye(len(roots)) + roots[:, None] * gram * roots
        covariance = np.linalg.inv(inner)
        step = covariance @ (roots * moment - now)
        spread = np.sqrt(np.diag(covariance))[len(kept) :]

        def moved(share: float) -> tuple[FloatArray, FloatArray]:
            moved_z, there = z.copy(), roots * (now + share * step)
            moved_z[moving] = mean + there[len(kept) :]
            return moved_z, self.from_bases(there[: len(kept)], bases)

        def cost(share: float) -> float:
            there, total = moved(share), float(((now + share * step) ** 2).sum())
            for window, whiten in zip(self.windows, whitens, strict=True):
                left = self._left(window, *there)
                if left is None:
                    return np.inf
                white = whiten(left[..., None]) / numbers[:, :1, None]
                total += float((white**2).sum())
            return total

        share, before = 1.0, cost(0.0)
        while share >= _SHORTEST and not cost(share) < before + 1e-6:
            share *= 0.5
        if share < _SHORTEST:
            return z, weights, 0.0
        return *moved(share), share * float(np.abs(step[len(kept) :] / spread).max(initial=0.0))

    def _left(self, window: Window, z: FloatArray, weights: FloatArray) -> FloatArray | None:
        """Telemetry minus simulation and its error [T, N]; None where it fails."""
        heat = self._heat(window, weights)
        theta = self.sampling.at(window, self.problem.to_theta(z))
        run = window.network.simulate_many(theta[None, window.simulated], heat[None])[0]
        if run is None:
            return None
        return np.where(window.valid, window.observed - run.temperatures - self._errors(window, weights), 0.0)

    def _around(self, linear: Sequence[Linear], z: FloatArray, weights: FloatArray, sizes: FloatArray) -> Around:
        bases = self._told(linear, sizes, self._largest(sizes), _TOLD)
        mean, deviation = self.prior_of_z(z)
        from_prior = np.concatenate([self.of_bases(weights, bases), z[self.moving] - mean])
        columns, shapes = self.columns(linear, bases), self.shapes(sizes)
        gram, moment, squares, samples, determinant = [], [], [], [], []
        for linearised, wide in zip(linear, columns, strict=True):
            left = np.where(linearised.window.valid, linearised.left + wide @ from_prior, 0.0)
            whitens = filter_of(replace(linearised.terms, kinds=shapes))
            both = np.concatenate([wide, left[..., None]], axis=2)
            white = whitens.whiten(np.moveaxis(both, 1, 0), linearised.terms.valid)
            products = np.einsum("kti,ktj->kij", white, white, optimize=True)
            gram.append(np.ascontiguousarray(products[:, :-1, :-1]))
            moment.append(products[:, :-1, -1])
            squares.append(products[:, -1, -1])
            samples.append(linearised.terms.valid.sum(axis=1))
            determinant.append(whitens.determinant)
        parts = (np.concatenate(part) for part in (gram, moment, squares, samples, determinant))
        groups = np.repeat(np.arange(len(bases)), [basis.shape[1] for basis in bases])
        noise = {entry.channel: self.noise.index(entry.name) for entry in self.entries if entry.column == DEVIATION}
        held = self.numbers(sizes)[:, DEVIATION]
        free = [k for k in range(len(self.names)) if k in noise.values() or k >= len(self.noise)]
        scale = [self.names.index(group.scale) if group.scale else -1 for group in self.model.groups]
        return Around(
            bases, self.sizes, np.array(free), np.array([noise.get(k, -1) for k in range(len(held))]),
            held, np.array(scale)[groups], mean, deviation, self.moving, *parts,
        )  # fmt: skip

    def tilted(self, point: HeatPoint) -> HeatPoint:
        """The point with the slope by z of minus half the log determinant of the telemetry's covariance.

        Looked at by the parameters; initial temperatures and the time tags' error change next to nothing of how
        temperatures respond to heat. Raises SimulationFailure.
        """
        around, sizes, z = point.around, point.most_probable, self.problem.to_z(point.theta)
        linear = self.at(point).each
        covariance, told = around.known_of_weights(sizes)
        precision = np.split(around.precision(sizes), len(linear))
        slopes: dict[str, float] = {}
        for linearised, of_window in zip(linear, precision, strict=True):
            whiten = linearised.through(self.shapes(sizes))
            here = whiten(self._kept(linearised, z, around))
            known = of_window[:, None, None] * (here @ covariance)
            for k in around.moving.tolist():
                if self.problem.entries[k].is_of_network:
                    there = z.copy()
                    there[k] += _TURNED
                    turned = (whiten(self._kept(linearised, there, around)) - here) / _TURNED
                    change = np.vdot(known, turned)
                    slopes[self.problem.names[k]] = slopes.get(self.problem.names[k], 0.0) - float(change)
        place = {name: self.problem.names.index(name) for name in slopes}
        tilted = {name: (slope, float(z[place[name]])) for name, slope in slopes.items()}
        return replace(point, model=replace(point.model, tilted=tilted, most=max(_BENT * told, 1e-3)))

    def _kept(self, linearised: Linear, z: FloatArray, around: Around) -> FloatArray:
        """Responses in the kept directions at z, [T, N, m]."""
        theta = self.sampling.at(linearised.window, self.problem.to_theta(z))
        return responses_in(linearised.window, theta, self.model, linearised.units, around.bases)


def _floors(windows: Sequence[Window]) -> FloatArray:
    """[N] K, the least white noise: that of rounding to the telemetry's step, step / sqrt(12)."""
    found = []
    for k in range(windows[0].observed.shape[1]):
        values = np.unique(np.concatenate([window.observed[window.valid[:, k], k] for window in windows]))
        steps = np.diff(values)
        found.append(float(np.min(steps[steps > 1e-6], initial=np.inf)) / np.sqrt(12.0) if len(steps) else 0.0)
    kinds = windows[0].residuals.terms.kinds
    return np.where(np.isfinite(found) & [kind.has_memory for kind in kinds], found, 0.0)


def _directions(information: FloatArray, least: float) -> FloatArray:
    """Orthonormal directions [f, k] of which a matrix [f, f] tells more than the least."""
    values, directions = np.linalg.eigh(information)
    return np.asarray(directions[:, values > least])
