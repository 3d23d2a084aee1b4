"""How probable the telemetry is, given simulated temperatures.

Channels are independent of each other given theta. Each one's residuals are noise (`noise`) and, where the scenario has
one, known shapes (`shapes`) whose weights are integrated out. The likelihood is rows of kernels in three phases: every
window's forward rows, `close`, and every window's backward rows; only weights that windows share need more than the
first. A surrogate's error, which channels share, comes on top (`surrogate_error`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiled import Program, Row
from ..simulator import FloatArray
from .kernels.window import ProjectCall, WindowCall, finish, project, start
from .noise.kind import NoiseCall, NoiseKind, ShapesCall
from .shapes import Shapes, Weights, shrinkage

SHAPE_NUMBERS = 4
"""The last of a channel's numbers, which are those of its shapes' weights."""


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

    @property
    def discrepant(self) -> NDArray[np.bool_]:
        """[N] whether there are shapes."""
        return self.shapes.channels


class WindowMemory(NamedTuple):
    """What the likelihood of a window reads and fills."""

    observed: FloatArray
    """[T, N] K, read, as the next two; what is not valid is of no matter."""
    simulated: FloatArray
    numbers: FloatArray
    """[N, n] of each channel: its noise's, in the kind's order, and last the four of its shapes' weights."""
    simulated_bar: FloatArray
    """[T, N], filled: derivatives of the log likelihood, as the next."""
    numbers_bar: FloatArray
    """[N, n]"""
    value: FloatArray
    """[1], filled: the log likelihood; of several windows that share weights, the first has what these add."""


def window_memory(
    observed: FloatArray, simulated: FloatArray, numbers: FloatArray, simulated_bar: FloatArray | None = None
) -> WindowMemory:
    """Memory with arrays that are read, and perhaps one that is filled."""
    bar = np.empty(simulated.shape) if simulated_bar is None else simulated_bar
    return WindowMemory(observed, simulated, numbers, bar, np.empty(numbers.shape), np.empty(1))


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

    Several windows share the weights that are not a window's own, and the numbers of the weights' prior.
    """
    windows = [_Window(own, memory) for own, memory in zip(residuals, memories, strict=True)]
    together = len(windows) > 1 and residuals[0].shapes.is_shared
    forward, closing = [window.begin() for window in windows], []
    backward: list[list[Row]] = [[] for _ in windows]
    for window, rows in zip(windows, forward, strict=True):
        weights = None
        for k, discrepant in enumerate(window.terms.discrepant):
            if not discrepant:
                rows.append(window.alone(k))
            elif not together:
                weights = weights or window.weights()
                rows += [row for phase in _with_shapes([window], k, weights) for row in phase]
    if together:
        for k in np.flatnonzero(residuals[0].discrepant).tolist():
            opening, closed, returning = _with_shapes(windows, k, windows[0].weights(len(windows)), keep=True)
            closing += closed
            for rows, row in zip(forward, opening, strict=True):
                rows.append(row)
            for rows, row in zip(backward, returning, strict=True):
                rows.append(row)
    for window, rows in zip(windows, backward, strict=True):
        rows.append(finish.row(window.call))
    return LikelihoodCalls(tuple(forward), closing, tuple(backward))


class _Window:
    """Memory for the rows of a window."""

    def __init__(self, terms: Residuals, memory: WindowMemory) -> None:
        channels, samples = terms.valid.shape
        self.terms, self.memory = terms, memory
        self.residual, self.residual_bar = np.zeros((2, channels, samples))
        self.values, self.projected = np.empty(channels), np.empty((channels, terms.shapes.basis.shape[1]))
        self.transposed = np.ascontiguousarray(terms.shapes.basis.T)
        self._narrow = self._columns(1)
        self._wide: tuple[FloatArray, FloatArray] | None = None
        self.call = WindowCall(
            terms.valid, memory.observed, memory.simulated, self.residual, self.values, memory.numbers_bar,
            self.residual_bar, memory.simulated_bar, memory.value,
        )  # fmt: skip

    def _columns(self, count: int) -> tuple[FloatArray, FloatArray]:
        samples = len(self.terms.seconds)
        return np.empty((3, samples)), np.empty((4, samples, count))

    def weights(self, windows: int = 1) -> Weights:
        """Memory for a channel's weights."""
        shapes = self.terms.shapes
        return Weights(windows, shapes.own, shapes.basis.shape[1])

    def begin(self) -> list[Row]:
        """Residuals, and their products with the basis."""
        terms = self.terms
        wanted = [k for k, kind in enumerate(terms.kinds) if terms.discrepant[k] and kind.projects]
        rows = [start.row(self.call)]
        if wanted:
            rows.append(project.row(ProjectCall(np.array(wanted), terms.shapes.basis, self.residual, self.projected)))
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

    def shapes(self, k: int, gram: FloatArray, weights: Weights, place: int, *, keep: bool) -> ShapesCall:
        """A channel with shapes, in the window that has this place among the weights'; keep: memory of its own."""
        shapes = self.terms.shapes
        count = shapes.basis.shape[1]
        if self.terms.kinds[k].projects:
            wide = self._narrow
        elif keep:
            wide = self._columns(count + 1)
        else:
            wide = self._wide = self._wide or self._columns(count + 1)
        return ShapesCall(
            self.noise(k, *wide), shapes.basis, self.transposed, self.projected[k], gram, weights.scale[place],
            weights.moment[place], weights.known[place], weights.mean[place], weights.root[place],
            weights.inverse[place], weights.untold[place], np.empty(count + 1), np.empty((count, count)),
        )  # fmt: skip


def _with_shapes(
    windows: Sequence[_Window], k: int, weights: Weights, *, keep: bool = False
) -> tuple[list[Row], list[Row], list[Row]]:
    """Opening rows of channel k in every window, rows that close, and rows that return to every window."""
    kinds = [window.terms.kinds[k] for window in windows]
    gram = weights.gram
    if kinds[0].projects:
        gram = np.stack([window.terms.shapes.products[k] for window in windows])
    opening, returning, before, after = [], [], [], []
    for place, (window, kind) in enumerate(zip(windows, kinds, strict=True)):
        assert kind.opens is not None
        assert kind.returns is not None
        call = window.shapes(k, gram[place], weights, place, keep=keep)
        opening.append(kind.opens.row(call))
        returning.append(kind.returns.row(call))
        numbers, numbers_bar = (
            array[k, -SHAPE_NUMBERS:] for array in (window.memory.numbers, window.memory.numbers_bar)
        )
        fills, pulls = window.terms.shapes.prior.rows(numbers, numbers_bar, weights, place)
        before.append(fills)
        after.append(pulls)
    return opening, [*before, weights.close(gram, windows[0].values[k : k + 1]), *after], returning


# --- in Python ------------------------------------------------------------------------------------------------


class LikelihoodTogether:
    """The log likelihood of several windows that share weights, for one thread at a time."""

    def __init__(self, residuals: Sequence[Residuals], numbers: int) -> None:
        """numbers: how many each channel has."""
        self.memories = []
        for own in residuals:
            channels, samples = own.valid.shape
            observed, simulated = np.empty((2, samples, channels))
            self.memories.append(window_memory(observed, simulated, np.empty((channels, numbers))))
        self._program = Program(likelihood_calls(residuals, self.memories).rows)

    def __call__(
        self, observed: Sequence[FloatArray], simulated: Sequence[FloatArray], numbers: Sequence[FloatArray]
    ) -> tuple[float, list[tuple[FloatArray, FloatArray]]]:
        """The log likelihood, and each window's derivatives as in `log_likelihood`."""
        for memory, *arrays in zip(self.memories, observed, simulated, numbers, strict=True):
            memory.observed[:], memory.simulated[:], memory.numbers[:] = arrays
        self._program.run()
        value = float(sum(memory.value[0] for memory in self.memories))
        return value, [(memory.simulated_bar.copy(), memory.numbers_bar.copy()) for memory in self.memories]


class Likelihood:
    """The log likelihood of one window, for one thread at a time."""

    def __init__(self, residuals: Residuals, numbers: int) -> None:
        """numbers: how many each channel has."""
        self._windows = LikelihoodTogether([residuals], numbers)

    def __call__(
        self, observed: FloatArray, simulated: FloatArray, numbers: FloatArray
    ) -> tuple[float, FloatArray, FloatArray]:
        """See `log_likelihood`."""
        value, ((simulated_bar, numbers_bar),) = self._windows([observed], [simulated], [numbers])
        return value, simulated_bar, numbers_bar


def log_likelihood(
    residuals: Residuals, observed: FloatArray, simulated: FloatArray, numbers: FloatArray
) -> tuple[float, FloatArray, FloatArray]:
    """Log likelihood of temperatures observed and simulated [T, N], K, and its derivatives.

    observed: valid where `residuals.valid` says; numbers: [N, n], see `WindowMemory`. The derivatives are by
    `simulated` [T, N] and by `numbers` [N, n].
    """
    return Likelihood(residuals, numbers.shape[1])(observed, simulated, numbers)


def weights_given(
    residuals: Residuals, observed: FloatArray, simulated: FloatArray, numbers: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The shapes' weights given residuals: mean [N, m], and F [N, m, m] with their covariance F F^T.

    Arguments as in `log_likelihood`; zero for a channel without shapes.
    """
    return weights_together([residuals], [observed], [simulated], [numbers])[0]


def weights_together(
    residuals: Sequence[Residuals],
    observed: Sequence[FloatArray],
    simulated: Sequence[FloatArray],
    numbers: Sequence[FloatArray],
) -> list[tuple[FloatArray, FloatArray]]:
    """The same of each of several windows, which share the weights that are not a window's own."""
    channels, count = len(numbers[0]), residuals[0].shapes.basis.shape[1]
    found = [(np.zeros((channels, count)), np.zeros((channels, count, count))) for _ in residuals]
    windows = []
    for own, *arrays in zip(residuals, observed, simulated, numbers, strict=True):
        windows.append(_Window(own, window_memory(*(np.ascontiguousarray(array, float) for array in arrays))))
        for row in windows[-1].begin():
            row()
    weights = windows[0].weights(len(windows))
    for k in np.flatnonzero(residuals[0].discrepant).tolist():
        opening, closing, _ = _with_shapes(windows, k, weights)
        for row in (*opening, *closing):
            row()
        for place, (mean, factor) in enumerate(found):
            mean[k] = weights.mean[place]
            factor[k] = weights.root[place][:, None] * weights.inverse[place].T
    return found


def precision_times(residuals: Residuals, columns: FloatArray, numbers: FloatArray) -> FloatArray:
    """C^-1 times columns [T, N, c], with C the covariance of the residuals of normal noise and shapes.

    What the shapes are expected to explain of a column is taken off it, and the rest weighed by the noise.
    """
    shapes = replace(residuals.shapes, channels=np.zeros_like(residuals.discrepant))
    alone, none = Likelihood(replace(residuals, shapes=shapes), numbers.shape[1]), np.zeros(columns.shape[:2])

    def weighed(columns: FloatArray) -> FloatArray:
        parts = [alone(columns[..., c], none, numbers)[1] for c in range(columns.shape[-1])]
        return np.stack(parts, axis=-1) if parts else np.empty(columns.shape)

    solved = weighed(columns)
    if not residuals.discrepant.any():
        return solved
    _, factor = weights_given(residuals, none, none, numbers)
    # Not products of BLAS: as in the Hessian that this is for, its threads would spin when the cores are busy.
    projected = np.einsum("tm,tnc->nmc", residuals.shapes.basis, solved)
    weights = np.einsum("nij,njc->nic", factor, np.einsum("nji,njc->nic", factor, projected))
    return weighed(columns - np.einsum("tm,nmc->tnc", residuals.shapes.basis, weights))


def information(
    residuals: Sequence[Residuals], jacobians: Sequence[FloatArray], numbers: Sequence[FloatArray]
) -> FloatArray:
    """J^T C^-1 J [p, p] of windows that share weights, with J [T, N, p] of each, zero where there is no sample.

    With a window's own weights in C, the shared ones take away as Woodbury's identity says.
    """
    shapes = residuals[0].shapes
    columns = jacobians[0].shape[2]
    total = np.zeros((columns, columns))
    products = np.zeros((len(shapes.channels), *(columns + shapes.basis.shape[1] - shapes.own,) * 2))
    for window, jacobian, own in zip(residuals, jacobians, numbers, strict=True):
        basis = np.where(window.valid.T[..., None], window.shapes.basis[:, None, shapes.own :], 0.0)
        both = np.concatenate([jacobian, basis], axis=2)
        solved = precision_times(replace(window, shapes=window.shapes.alone()), both, own)
        products += np.einsum("tni,tnj->nij", both, solved)
    for k, of_channel in enumerate(products):
        total += of_channel[:columns, :columns]
        if shapes.channels[k]:
            deviation = shapes.prior.deviations(numbers[0][k, -SHAPE_NUMBERS:])[shapes.own :]
            covariance, _ = shrinkage(of_channel[columns:, columns:], deviation**2)
            crossed = of_channel[columns:, :columns]
            total -= crossed.T @ covariance @ crossed
    return total


def iid_log_likelihood(
    observed: FloatArray, simulated: FloatArray, noise: FloatArray
) -> tuple[float, FloatArray, FloatArray]:
    """Independent Gaussian noise, as published: y ~ N(y(theta), sigma^2) with one sigma per channel.

    observed: [T, N] K, NaN where there is no valid sample; simulated: [T, N] K; noise: [N] K.
    Returns the log likelihood and its derivatives by `simulated` [T, N] and by `noise` [N].
    """
    valid = np.isfinite(observed)
    scaled = np.where(valid, observed - simulated, 0.0) / noise
    squares, samples = np.einsum("tn,tn->n", scaled, scaled), valid.sum(axis=0)
    value = -0.5 * squares - samples * (np.log(noise) + 0.5 * np.log(2.0 * np.pi))
    return float(value.sum()), scaled / noise, (squares - samples) / noise
