"""How probable the telemetry is, given simulated temperatures.

Each channel's residuals are noise (`noise`) and known shapes (`shapes`) whose weights are integrated out, where the
scenario has a discrepancy or the simulator has an error of its own. The likelihood is rows of kernels in three phases:
every window's forward rows, `close`, and every window's backward rows; only weights that windows share need more than
the first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiled import Program, Row
from ..simulator import FloatArray
from .heat import WindowHeat
from .kernels.window import ProjectCall, WindowCall, finish, project, start
from .noise.kind import NoiseCall, NoiseKind, ShapesCall
from .shapes import Shapes, Weights, no_shapes
from .weighing import heat_rows

SHAPE_NUMBERS = 2
"""The last of a channel's numbers, which are those of its discrepancy's weights."""


@dataclass(frozen=True)
class Residuals:
    """What the residuals of a window's N channels are made of."""

    seconds: FloatArray
    """[T] times."""
    valid: NDArray[np.bool_]
    """[N, T] whether there is a sample."""
    kinds: tuple[NoiseKind, ...]
    """[N] of noise."""
    shapes: Shapes
    heat: WindowHeat | None = None
    """That no block describes; None: there is none."""

    @property
    def discrepant(self) -> NDArray[np.bool_]:
        """[N] whether there is a discrepancy."""
        return self.shapes.channels

    @cached_property
    def shaped(self) -> list[int]:
        """Channels that have shapes."""
        return [k for k, discrepant in enumerate(self.discrepant) if discrepant or len(self.shapes.error_of(k))]

    @cached_property
    def products(self) -> list[FloatArray]:
        """[M, M] of each channel's shapes with one another, at its valid samples."""
        bases = [self.shapes.of_channel(k)[valid] for k, valid in enumerate(self.valid)]
        return [np.einsum("ti,tj->ij", basis, basis) for basis in bases]

    def with_errors(self, errors: FloatArray | None) -> Residuals:
        """The same with the error of a simulator in shapes [T, N, r]; None: it has none."""
        return self if errors is None else replace(self, shapes=replace(self.shapes, errors=errors))

    def without_shapes(self) -> Residuals:
        """The same with noise alone."""
        return replace(self, shapes=no_shapes(len(self.seconds), len(self.kinds)))


class WindowMemory(NamedTuple):
    """What the likelihood of a window reads and fills."""

    observed: FloatArray
    """[T, N] K, read, as the next three; what is not valid is of no matter."""
    simulated: FloatArray
    numbers: FloatArray
    """[N, n] of each channel: its noise's, in the kind's order, and last the two of its discrepancy's weights."""
    variance: FloatArray
    """[r] of the weights of the simulator's error."""
    simulated_bar: FloatArray
    """[T, N], filled: derivatives of the log likelihood, as the next two."""
    numbers_bar: FloatArray
    """[N, n]"""
    variance_bar: FloatArray
    """[r]"""
    scales: FloatArray
    """[g + c] prior deviations of the weights of heat, and what the response follows, read,"""
    scales_bar: FloatArray
    """[g + c] and filled; of several windows the first alone."""
    value: FloatArray
    """[1], filled: the log likelihood; of several windows that share weights, the first has what these add."""


def window_memory(
    observed: FloatArray,
    simulated: FloatArray,
    numbers: FloatArray,
    variance: FloatArray | None = None,
    scales: FloatArray | None = None,
    *,
    simulated_bar: FloatArray | None = None,
) -> WindowMemory:
    """Memory with arrays that are read, and perhaps one that is filled."""
    bar = np.empty(simulated.shape) if simulated_bar is None else simulated_bar
    variance, scales = (np.empty(0) if part is None else part for part in (variance, scales))
    return WindowMemory(
        observed, simulated, numbers, variance, bar, np.zeros(numbers.shape), np.zeros(variance.shape), scales,
        np.zeros(scales.shape), np.zeros(1),
    )  # fmt: skip


class LikelihoodCalls(NamedTuple):
    """Rows of a Program: forward of every window, close, backward of every window."""

    forward: tuple[list[Row], ...]
    close: list[Row]
    backward: tuple[list[Row], ...]

    @property
    def rows(self) -> list[Row]:
        """All, in order."""
        return [row for rows in (*self.forward, self.close, *self.backward) for row in rows]


def likelihood_calls(residuals: Sequence[Residuals], memories: Sequence[WindowMemory]) -> LikelihoodCalls:
    """The log likelihood of one window or several, and its derivatives: each reads and fills its memory.

    Several windows share the weights of a discrepancy, and the numbers of the weights' prior.
    """
    if residuals[0].heat is not None:
        return LikelihoodCalls(*heat_rows(residuals, memories))
    windows = [_Window(*pair) for pair in zip(residuals, memories, strict=True)]
    closing: list[Row] = []
    forward, backward = ([window.begin() for window in windows], [[finish.row(w.call)] for w in windows])
    for window, rows in zip(windows, forward, strict=True):
        rows += [window.alone(k) for k in range(len(window.values)) if k not in window.terms.shaped]
    for parts in _joined(residuals):
        opened, closed, returned, _ = _with_shapes(windows, parts)
        if len({place for place, _ in parts}) == 1:
            forward[parts[0][0]] += [*(row for rows in opened for row in rows), *closed, *returned]
            continue
        closing += closed
        for (place, _), opens, returns in zip(parts, opened, returned, strict=True):
            forward[place] += opens
            backward[place].insert(-1, returns)
    return LikelihoodCalls(tuple(forward), closing, tuple(backward))


def _joined(residuals: Sequence[Residuals]) -> list[list[tuple[int, int]]]:
    """Windows and channels that have shapes, put together where they share weights."""
    over_windows = len(residuals) > 1 and residuals[0].discrepant.any()
    over_channels = any(len(window_residuals.shapes.between) for window_residuals in residuals)
    found: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for place, window_residuals in enumerate(residuals):
        for k in window_residuals.shaped:
            key = (0 if over_windows else place, 0 if over_channels else k)
            found.setdefault(key, []).append((place, k))
    return list(found.values())


class _Window:
    """Memory for the rows of a window."""

    def __init__(self, terms: Residuals, memory: WindowMemory) -> None:
        channels, samples = terms.valid.shape
        shapes = terms.shapes
        self.terms, self.memory = terms, memory
        self.residual, self.residual_bar = np.zeros((2, channels, samples))
        self.values, self.projected = np.empty(channels), np.empty((channels, shapes.basis.shape[1]))
        self._transposed = np.ascontiguousarray(shapes.basis.T)
        self._narrow = self._columns(1)
        self._wide: tuple[FloatArray, FloatArray] | None = None
        self._weights: Weights | None = None
        self.call = WindowCall(
            terms.valid, memory.observed, memory.simulated, self.residual, self.values, memory.numbers_bar,
            self.residual_bar, memory.simulated_bar, memory.value,
        )  # fmt: skip

    def _columns(self, count: int) -> tuple[FloatArray, FloatArray]:
        samples = len(self.terms.seconds)
        return np.empty((3, samples)), np.empty((4, samples, count))

    def weights(self) -> Weights:
        """Memory for the weights of a discrepancy, of one channel after the other."""
        count = self.terms.shapes.basis.shape[1]
        self._weights = self._weights or Weights(count, np.empty((1, 0), np.int64), count)
        return self._weights

    def begin(self) -> list[Row]:
        """Residuals, and their products with the shapes of a discrepancy, of all channels that have no others."""
        rows, shapes = [start.row(self.call)], self.terms.shapes
        wanted = [k for k in self.terms.shaped if self.terms.kinds[k].projects and not len(shapes.error_of(k))]
        if wanted:
            rows.append(project.row(ProjectCall(np.array(wanted), shapes.basis, self.residual, self.projected)))
        return rows

    def noise(self, k: int, rows: FloatArray, columns: FloatArray) -> NoiseCall:
        """A channel's noise."""
        terms, memory = self.terms, self.memory
        return NoiseCall(
            terms.seconds, terms.valid[k], self.residual[k], memory.numbers[k], self.residual_bar[k],
            memory.numbers_bar[k], self.values[k : k + 1], rows, columns,
        )  # fmt: skip

    def alone(self, k: int) -> Row:
        """A channel's noise alone."""
        return self.terms.kinds[k].kernel.row(self.noise(k, *self._narrow))

    def shapes(self, k: int, gram: FloatArray, weights: Weights, part: int, *, keep: bool) -> ShapesCall:
        """A channel with shapes, which is this part of those with these weights; keep: memory of its own."""
        count, projects = weights.count, self.terms.kinds[k].projects
        if projects:
            wide = self._narrow
        elif keep:
            wide = self._columns(count + 1)
        else:
            wide = self._wide = self._wide or self._columns(count + 1)
        basis, transposed, projected = self.terms.shapes.basis, self._transposed, self.projected[k]
        if count > basis.shape[1]:
            columns = self.terms.shapes.of_channel(k)
            basis, projected = np.zeros((len(columns), count)), np.empty(count)
            basis[:, : columns.shape[1]] = columns
            transposed = np.ascontiguousarray(basis.T)
        return ShapesCall(
            self.noise(k, *wide), basis, transposed, projected, gram, weights.scale[part],
            weights.moment[part], weights.known[part], weights.mean[part], weights.root[part],
            weights.inverse[part], weights.untold[part], np.empty(count + 1), np.empty((count, count)),
        )  # fmt: skip

    def opens(self, k: int, call: ShapesCall) -> list[Row]:
        """What opens a channel with shapes, with their products where these are not those of `begin`."""
        kind = self.terms.kinds[k]
        assert kind.opens is not None
        rows = [kind.opens.row(call)]
        if kind.projects and call.basis is not self.terms.shapes.basis:
            here = np.zeros(1, np.int64), call.basis, self.residual[k : k + 1], call.projected[None]
            rows.insert(0, project.row(ProjectCall(*here)))
        return rows


def _with_shapes(
    windows: Sequence[_Window], parts: Sequence[tuple[int, int]]
) -> tuple[list[list[Row]], list[Row], list[Row], Weights]:
    """Rows that open each part, a window's channel, rows that close, rows that return to each, and their weights."""
    first, channel = parts[0]
    alone = len(parts) == 1 and not windows[first].terms.shapes.errors.shape[2]
    weights = windows[first].weights() if alone else _own_weights(windows, parts)
    kinds = [windows[place].terms.kinds[k] for place, k in parts]
    gram = np.zeros(weights.gram.shape) if any(kind.projects for kind in kinds) else weights.gram
    opening, returning, before, after = [], [], [], []
    told: set[int] = set()
    for p, ((place, k), kind) in enumerate(zip(parts, kinds, strict=True)):
        window = windows[place]
        shapes, memory = window.terms.shapes, window.memory
        assert kind.returns is not None
        if kind.projects:
            products = window.terms.products[k]
            gram[p, : len(products), : len(products)] = products
        call = window.shapes(k, gram[p], weights, p, keep=not alone)
        opening.append(window.opens(k, call))
        returning.append(kind.returns.row(call))
        if shapes.channels[k]:
            numbers, numbers_bar = (array[k, -SHAPE_NUMBERS:] for array in (memory.numbers, memory.numbers_bar))
            # What windows share is counted in the first alone.
            counted = shapes.basis.shape[1] if place == first else 0
            fills, pulls = weights.of_discrepancy(p, shapes.prior, numbers, numbers_bar, counted=counted)
            before.append(fills)
            after.append(pulls)
        which = shapes.error_of(k)
        if len(which):
            # So is what channels share.
            counted = len(which) - (len(shapes.between) if place in told else 0)
            told.add(place)
            fills, pulls = weights.of_errors(
                p, shapes.basis.shape[1], which, memory.variance, memory.variance_bar, counted=counted
            )
            before.append(fills)
            after.append(pulls)
    closing = weights.close(gram, windows[first].values[channel : channel + 1])
    return opening, [*before, closing, *after], returning, weights


def _own_weights(windows: Sequence[_Window], parts: Sequence[tuple[int, int]]) -> Weights:
    """Memory for weights that parts share: of a discrepancy between windows, of an error between channels."""
    shapes = [windows[place].terms.shapes for place, _ in parts]
    errors = [of_window.error_of(k).tolist() for of_window, (_, k) in zip(shapes, parts, strict=True)]
    in_discrepancy, most = shapes[0].basis.shape[1], max(map(len, errors))
    if len(parts) == 1:
        return Weights(in_discrepancy + most, np.empty((1, 0), np.int64), in_discrepancy + most)
    over_windows = len({place for place, _ in parts}) > 1
    between = in_discrepancy if over_windows else 0
    places: dict[tuple[str, int, int], int] = {}
    shared = []
    for p, ((place, k), which) in enumerate(zip(parts, errors, strict=True)):
        # A part that has fewer has shapes that are nothing anywhere.
        keys = [("channel", k, j) for j in range(between)] + [("window", place, j) for j in which]
        keys += [("none", p, j) for j in range(most - len(which))]
        shared.append([places.setdefault(key, len(places)) for key in keys])
    return Weights(in_discrepancy - between, np.array(shared, np.int64), in_discrepancy + most)


# --- in Python ------------------------------------------------------------------------------------------------


class Bars(NamedTuple):
    """Derivatives of the log likelihood by what one window simulates."""

    simulated: FloatArray
    """[T, N]"""
    numbers: FloatArray
    """[N, n]"""
    variance: FloatArray
    """[r]"""
    scales: FloatArray
    """[g]"""


class Likelihood:
    """The log likelihood of a window, or of several that may share weights, for one thread at a time."""

    def __init__(self, residuals: Sequence[Residuals], numbers: int) -> None:
        """numbers: how many each channel has."""
        self.memories = []
        for window_residuals in residuals:
            channels, samples = window_residuals.valid.shape
            observed, simulated = np.empty((2, samples, channels))
            variance = np.empty(window_residuals.shapes.errors.shape[2])
            scales = np.empty(0 if window_residuals.heat is None else len(window_residuals.heat.entries))
            self.memories.append(window_memory(observed, simulated, np.empty((channels, numbers)), variance, scales))
        self._program = Program(likelihood_calls(residuals, self.memories).rows)

    def __call__(self, *windows: tuple[FloatArray, ...]) -> tuple[float, list[Bars]]:
        """The log likelihood, and its derivatives by what is simulated of each window.

        windows: of each temperatures observed and simulated [T, N], K, numbers [N, n], see `WindowMemory`, and, where
        the simulator has an error, the variances [r] of its weights, and, where there is heat, the scales [g] of its.
        """
        for memory, window_terms in zip(self.memories, windows, strict=True):
            arrays = (memory.observed, memory.simulated, memory.numbers, memory.variance, memory.scales)
            for array, given in zip(arrays, window_terms, strict=False):
                array[:] = given
        self._program.run()
        value = float(sum(memory.value[0] for memory in self.memories))
        bars = [
            (
                window_memory.simulated_bar,
                window_memory.numbers_bar,
                window_memory.variance_bar,
                window_memory.scales_bar,
            )
            for window_memory in self.memories
        ]
        return value, [Bars(*(array.copy() for array in of_window)) for of_window in bars]


def weights_given(
    residuals: Sequence[Residuals],
    observed: Sequence[FloatArray],
    simulated: Sequence[FloatArray],
    numbers: Sequence[FloatArray],
) -> list[tuple[FloatArray, FloatArray]]:
    """The discrepancy's weights given residuals of windows, which share them; a simulator's error is left out.

    Arguments of each window as in `Likelihood`. Of each mean [N, m], and F [N, m, m] with their covariance F F^T; zero
    for a channel without a discrepancy.
    """
    residuals = [
        window_residuals.with_errors(np.empty((0, 0, 0))) if window_residuals.shapes.errors.size else window_residuals
        for window_residuals in residuals
    ]
    windows, found = [], []
    for window_residuals, *arrays in zip(residuals, observed, simulated, numbers, strict=True):
        windows.append(
            _Window(window_residuals, window_memory(*(np.ascontiguousarray(array, float) for array in arrays)))
        )
        channels, count = len(window_residuals.kinds), window_residuals.shapes.basis.shape[1]
        found.append((np.zeros((channels, count)), np.zeros((channels, count, count))))
        for row in windows[-1].begin():
            row()
    for parts in _joined(residuals):
        opening, closing, _, weights = _with_shapes(windows, parts)
        for row in (*(row for rows in opening for row in rows), *closing):
            row()
        for p, (place, k) in enumerate(parts):
            mean, factor = found[place]
            mean[k] = weights.mean[p]
            factor[k] = weights.root[p][:, None] * weights.inverse[p].T
    return found


def information(
    residuals: Sequence[Residuals],
    jacobians: Sequence[FloatArray],
    derivatives: Sequence[FloatArray],
    numbers: Sequence[FloatArray],
    variances: Sequence[FloatArray],
) -> FloatArray:
    """J^T C^-1 J [d, d] of windows, with C the covariance of all their residuals, which are normal.

    jacobians: of each window's temperatures by its own coordinates, [T, N, q]; derivatives: of these by the common
    ones, [q, d]; numbers and variances as in `Likelihood`. The shapes stand beside the coordinates at first.
    """
    shapes, (channels, _), d = residuals[0].shapes, numbers[0].shape, derivatives[0].shape[1]
    of_each, shared = (0, shapes.basis.shape[1]) if len(residuals) > 1 else (shapes.basis.shape[1], 0)
    in_all = np.concatenate([_prior_variances(residuals[0], numbers[0])[:, of_each:].ravel(), *variances])
    total, of_window = np.zeros((d + len(in_all),) * 2), d + channels * shared
    for window, jacobian, derivative, of_noise, of_error in zip(
        residuals, jacobians, derivatives, numbers, variances, strict=True
    ):
        q, errors = jacobian.shape[2], len(of_error)
        alone = _prior_variances(window, of_noise)[:, :of_each]
        basis = np.broadcast_to(window.shapes.basis[:, None], (*jacobian.shape[:2], of_each + shared))
        parts = [jacobian, basis[..., of_each:], *([window.shapes.errors] if errors else []), basis[..., :of_each]]
        columns = np.where(window.valid.T[..., None], np.concatenate(parts, axis=2), 0.0)
        products = columns.transpose(1, 2, 0) @ _weighed(window, columns, of_noise).transpose(1, 0, 2)
        for k in range(channels):
            places = np.zeros((q + shared + errors, len(total)))
            places[:q, :d] = derivative
            places[q : q + shared, d + k * shared : d + (k + 1) * shared] = np.eye(shared)
            places[q + shared :, of_window : of_window + errors] = np.eye(errors)
            total += places.T @ _integrated_out(products[k], alone[k]) @ places
        of_window += errors
    return _integrated_out(total, in_all)


def _prior_variances(residuals: Residuals, numbers: FloatArray) -> FloatArray:
    """[N, m] of the discrepancy's weights; zero where a channel has none."""
    variances = np.zeros((len(numbers), residuals.shapes.basis.shape[1]))
    for k in np.flatnonzero(residuals.discrepant):
        variances[k] = residuals.shapes.prior.deviations(numbers[k, -SHAPE_NUMBERS:]) ** 2
    return variances


def _weighed(residuals: Residuals, columns: FloatArray, numbers: FloatArray) -> FloatArray:
    """Columns [T, N, c], times the inverse of the covariance of the noise alone."""
    likelihood, none = Likelihood([residuals.without_shapes()], numbers.shape[1]), np.zeros(columns.shape[:2])
    weighed = np.zeros(columns.shape)
    for c in np.flatnonzero(columns.any(axis=(0, 1))):
        weighed[..., c] = likelihood((columns[..., c], none, numbers))[1][0].simulated
    return weighed


def _integrated_out(products: FloatArray, variance: FloatArray) -> FloatArray:
    """What is known of others than the last weights, which are normal of these variances: Woodbury's identity."""
    first, root = len(products) - len(variance), np.sqrt(variance)
    factor = np.linalg.cholesky(np.eye(len(root)) + root[:, None] * products[first:, first:] * root)
    half = np.linalg.solve(factor, root[:, None] * products[first:, :first])
    return np.asarray(products[:first, :first] - half.T @ half)
