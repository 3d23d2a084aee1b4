"""How probable telemetry is under a scenario before any sampling: a Gaussian around one point of the prior.

Parameters, initial temperatures, unmodelled heat and noise are all taken as normal, and the simulator as linear around
the point: so the probability of the telemetry, with all of them integrated out, is that of one normal distribution. Its
errors are correlated in time, so samples beside each other count for little more than one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, eigh, solve_triangular

from ..problem import Window
from ..simulator import FloatArray, SimulationFailure
from .compared_window import MODEL, Rows
from .network_view import Point, View

SIZES = (0.5, 1.0, 2.0, 4.0)
"""Of all unmodelled heat, over that of `HEAT`: the likeliest counts."""
USUAL = 2.0
"""Size of unmodelled heat that a model may have and be right."""
_ALIKE = 3.0
"""Samples beside each other that tell as much as one of a change of scale."""
_RIGHT = 0.5
"""Mean square of the deviations of a right model, at most about."""
_UNKNOWN = 1e3
"""K, deviation of a sample that is not there."""
_DIVERGED = 1e6
"""K, beyond which a residual is as bad as it can be; its square is still a number."""
_THERMOSTAT = 1.0
"""K, by which a thermostat's own sensor may read otherwise than the telemetry's."""
_ROUNDS = 3
_SHORTER = (1.0, 0.5, 0.25)
"""Shares of a step that are tried."""
_FARTHEST = 3.0
"""Deviations of its prior that an entry is moved by at most."""


@dataclass(frozen=True)
class Scale:
    """What telemetry is multiplied by before it is compared."""

    factor: float = 1.0
    samples: int = 0
    """That are."""

    def evidence(self, square: float, rows: int) -> float:
        """Nats that it adds where deviations of so many rows have this sum of squares, in those expected.

        The density of the telemetry as it was, which a factor above one makes no likelier; and a model that is wrong
        anyway is not to be nearer for the telemetry being smaller: what a right model does not have is counted as it
        was read.
        """
        jacobian = self.samples * min(float(np.log(self.factor)), 0.0) / _ALIKE
        return jacobian - 0.5 * max(square - _RIGHT * rows, 0.0) * max(self.factor**-2 - 1.0, 0.0)


AS_READ = Scale()


@dataclass(frozen=True)
class Fit:
    """Telemetry beside what a point and its Gaussian expect."""

    evidence: float
    """Log density of the telemetry, nats."""
    size: float
    """Of unmodelled heat, one of `SIZES`."""
    misfit: float
    """Mean square of the telemetry's deviations, in those expected; about 1 where nothing is wrong."""
    lacking: float
    """Nats by which the telemetry is less probable than that of a right model with usual heat, at least 0."""
    farthest: float
    """Deviations of its prior by which the heat is off that is farthest, or the parameter."""
    z: FloatArray
    """[d] of the point."""
    moved: FloatArray
    """[d] deviations of the priors from their centre to where the entries are likeliest, as if linear in z."""
    added: FloatArray
    """[k] weights of further columns where these are likeliest."""

    @property
    def is_usual(self) -> bool:
        """Whether a model that is right can be so far off."""
        return self.size <= USUAL and self.misfit < 1.0

    def with_parameters(self, names: Sequence[str], moved: FloatArray) -> Fit:
        """With what is farthest off of parameters by name too, moved by so many deviations of their priors.

        Where a node begins is no parameter: it is read from the telemetry, that may be wrong.
        """
        off = [abs(float(by)) for name, by in zip(names, moved, strict=True) if not name.startswith("initial.")]
        return replace(self, farthest=max([self.farthest, *off]))


@dataclass(frozen=True)
class Modes:
    """Combinations of rows that are independent, whatever the size of unmodelled heat."""

    across: FloatArray
    """[R, R] in deviations."""
    heat: FloatArray
    """[R] variance that heat of size one adds to each; without more heat it is one."""


@dataclass(frozen=True)
class _Likeliest:
    """What telemetry tells at the size of heat that is likeliest."""

    evidence: float
    size: int
    """Which of the sizes."""
    square: float
    """Sum of squares of the deviations, in those expected."""
    expected: float
    """The evidence of a right model with usual heat."""
    added: FloatArray
    left: FloatArray
    """[R] deviations, independent and over their variances."""


@dataclass(frozen=True)
class Gaussian:
    """What telemetry is expected to be around a point, for each of some sizes of heat."""

    point: Point
    sizes: tuple[float, ...]
    known: NDArray[np.bool_]
    """[R] where there is telemetry."""
    factors: tuple[FloatArray, ...]
    """[R, R] Cholesky factors, lower, of each size."""
    modes: Modes | None = None
    """Of the first size, where many fits are made."""

    def in_modes(self) -> Gaussian:
        """The same for many fits."""
        heat = solve_triangular(self.factors[0], self.point.heat, lower=True, check_finite=False)
        variances, directions = eigh(heat @ heat.T, check_finite=False)
        across = solve_triangular(self.factors[0], directions, lower=True, trans="T", check_finite=False).T
        return replace(self, modes=Modes(np.ascontiguousarray(across), variances.clip(0.0)))

    def _white(self, columns: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
        """Independent columns [R, k] of columns in deviations, and the variances [R] of their rows, at each size."""
        if self.modes is None:
            one = np.ones(len(columns))
            return [(solve_triangular(factor, columns, lower=True, check_finite=False), one) for factor in self.factors]
        white, first = self.modes.across @ columns, self.sizes[0]
        return [(white, 1.0 + (size**2 - first**2) * self.modes.heat) for size in self.sizes]

    def _across(self, k: int, left: FloatArray) -> FloatArray:
        """Deviations over their covariance [R] of independent ones over their variances, at one size."""
        if self.modes is None:
            return np.asarray(solve_triangular(self.factors[k], left, lower=True, trans="T", check_finite=False))
        return np.asarray(left @ self.modes.across)

    def _finite(self, residual: FloatArray) -> FloatArray:
        """Residuals [R] of what is known, zero elsewhere."""
        return np.where(self.known, np.nan_to_num(residual, nan=_DIVERGED), 0.0).clip(-_DIVERGED, _DIVERGED)

    def _likeliest(self, residual: FloatArray, columns: FloatArray | None, scale: Scale) -> _Likeliest:
        best: _Likeliest | None = None
        expected = -np.inf
        left = self._finite(residual)
        rows = int(self.known.sum())
        of_sizes = self._white(left[:, None] if columns is None else np.column_stack([left, columns]))
        for k, (size, factor, (white, variances)) in enumerate(zip(self.sizes, self.factors, of_sizes, strict=True)):
            first, extra = white[:, 0], white[:, 1:]
            over = extra / variances[:, None]
            inner = np.eye(extra.shape[1]) + extra.T @ over
            added = np.linalg.solve(inner, over.T @ first)
            rest = first / variances - over @ added
            square = float(first @ rest)
            # A size beside one is less likely: heat of a fifth of the flow is no longer usual.
            volume = float(np.log(np.diag(factor)).sum()) + 0.5 * float(np.linalg.slogdet(inner)[1])
            volume += 0.5 * (np.log2(size) / 0.7) ** 2
            if size <= USUAL:
                expected = max(expected, scale.evidence(_RIGHT * rows, rows) - 0.5 * _RIGHT * rows - volume)
            evidence = scale.evidence(square, rows) - 0.5 * square - volume
            if best is None or evidence > best.evidence:
                best = _Likeliest(evidence, k, square, expected, np.asarray(added, float), rest)
        assert best is not None
        return replace(best, expected=expected)

    def evidence(self, residual: FloatArray, columns: FloatArray | None = None, scale: Scale = AS_READ) -> float:
        """That of `fit`."""
        return self._likeliest(residual, columns, scale).evidence

    def gained(self, residual: FloatArray, effects: FloatArray) -> tuple[FloatArray, FloatArray]:
        """b [k] and G [k, k]: residuals [R] less effects [R, k] times u are more probable by b u - u G u / 2 nats.

        At the size that is likeliest for the residuals as they are, or at one: of usual heat, with what is looked for.
        """
        size = min(self._likeliest(residual, None, AS_READ).size, self.sizes.index(1.0))
        white, variances = self._white(np.column_stack([self._finite(residual), effects]))[size]
        over = white[:, 1:] / variances[:, None]
        return over.T @ white[:, 0], over.T @ white[:, 1:]

    def fit(self, residual: FloatArray, columns: FloatArray | None = None, scale: Scale = AS_READ) -> Fit:
        """Of residuals [R] with further columns [R, k] of normal weights of one."""
        best = self._likeliest(residual, columns, scale)
        size, over = self.sizes[best.size], self._across(best.size, best.left)
        return Fit(
            evidence=best.evidence,
            size=size,
            misfit=best.square / max(int(self.known.sum()), 1),
            lacking=max(best.expected - best.evidence, 0.0),
            farthest=size * float(np.abs(self.point.heat.T @ over).max(initial=0.0)),
            z=self.point.z,
            moved=self.point.effects.T @ over,
            added=best.added,
        )


def gaussian(
    rows: Rows, point: Point, known: NDArray[np.bool_], sizes: Sequence[float] = SIZES, of_model: float = MODEL
) -> Gaussian:
    """Around a point; known: [R]."""
    error, t = rows.error(of_model), len(rows.kept)
    base = point.effects @ point.effects.T + point.jitter @ point.jitter.T
    for k, block in enumerate(error):
        base[k * t : (k + 1) * t, k * t : (k + 1) * t] += block
    of_thermostats = np.arange(len(error) * t, len(base))
    base[of_thermostats, of_thermostats] += _THERMOSTAT**2
    base[np.diag_indices(len(base))] += np.where(known, 0.0, _UNKNOWN**2)
    of_heat = point.heat @ point.heat.T
    factors = [cholesky(base + size**2 * of_heat, lower=True, check_finite=False) for size in sizes]
    return Gaussian(point, tuple(sizes), known, tuple(factors))


def climbed(
    view: View,
    window: Window,
    observed: FloatArray,
    start: Point,
    columns: FloatArray | None = None,
    scale: Scale = AS_READ,
) -> Fit:
    """The fit of telemetry [t, N] where the entries are likeliest, by Gauss-Newton steps. Raises SimulationFailure."""
    centre, flat = view.centre(observed), view.flat(observed)
    known = np.isfinite(flat)
    if window is not view.window or view.moved:
        # What flows through the nodes, and so what heat is usual, may be another.
        view = replace(view, heat=view.heat_of(window))
        start = view.point(window, centre)
    point, wanted, found = start, start.z, None
    for number in range(_ROUNDS + 1):
        last = number == _ROUNDS
        point = _towards(view, window, point, wanted, None if last else start)
        # About the centre of the prior: what is linear in z is integrated out from there.
        back = point.effects @ ((centre - point.z) / view.spread)
        sizes = SIZES if found is None or last else (found.size,)
        around = gaussian(view.rows, point, known, sizes)
        found = around.fit(flat - point.temperatures - back, columns, scale)
        wanted = centre + view.spread * np.clip(found.moved, -_FARTHEST, _FARTHEST)
    assert found is not None
    return found.with_parameters(view.problem.names, found.moved)


def _towards(view: View, window: Window, point: Point, wanted: FloatArray, like: Point | None) -> Point:
    """The point at z `wanted` [d]; nearer to the one before where no simulation finishes. Raises SimulationFailure."""
    for share in _SHORTER:
        try:
            return view.point(window, point.z + share * (wanted - point.z), like)
        except SimulationFailure:
            continue
    return view.point(window, point.z, like)
