"""The likelihood of windows with unmodelled heat, whose weights are integrated out; see `kernels.heat`."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dtrtri

from ..compiled import Row
from ..simulator import FloatArray, IntArray
from .heat import Follows, Sizes
from .kernels.heat import (
    LAPACK,
    HeatCloseCall,
    HeatWindowCall,
    KnownCloseCall,
    KnownWindowCall,
    close,
    close_known,
    opens,
    opens_known,
    returns,
    returns_known,
)
from .noise.kind import WhitenCall

if TYPE_CHECKING:
    from .likelihood import Residuals, WindowMemory

_LOG_2_PI = math.log(2.0 * math.pi)
_TOLD = 1e-4
"""Of what the prior knows of a direction: where the telemetry tells less, residuals are as good as not explained."""


@dataclass(frozen=True)
class Filter:
    """What whitens a channel's noise of deviation one, [N, T] each; see `kernels.heat`."""

    decay: FloatArray
    gain: FloatArray
    root: FloatArray
    determinant: FloatArray
    """[N] log determinants."""

    def whiten(self, columns: FloatArray, valid: NDArray[np.bool_]) -> FloatArray:
        """Columns [N, T, c] whitened; zero where there is no sample."""
        white = np.empty(columns.shape)
        # Where there is no sample the state stays.
        decay, gain, root = np.where(valid, self.decay, 1.0), self.gain * valid, self.root * valid
        state = np.zeros((len(columns), columns.shape[2]))
        for t in range(columns.shape[1]):
            state *= decay[:, t, None]
            new = columns[:, t] - state
            np.multiply(root[:, t, None], new, out=white[:, t])
            new *= gain[:, t, None]
            state += new
        return white


def filter_of(terms: Residuals) -> Filter:
    """Of a window's noise, whose kinds are normal and have one number, their deviation."""
    decay, gain, root = np.zeros((3, *terms.valid.shape))
    determinant = np.zeros(len(terms.valid))
    unit = np.ones(1)
    for k, kind in enumerate(terms.kinds):
        white, process = kind.white_variance(unit), float(kind.covariance(unit, np.zeros(1))[0])
        samples = np.flatnonzero(terms.valid[k])
        if kind.has_memory:
            decay[k, samples[1:]] = kind.covariance(unit, np.diff(terms.seconds[samples])) / process
        known, totals = 0.0, np.empty(len(samples))
        for place, (t, kept) in enumerate(zip(samples.tolist(), decay[k, samples].tolist(), strict=True)):
            variance = kept**2 * known + process * (1.0 - kept**2)
            total = variance + white
            totals[place], gain[k, t], known = total, variance / total, variance * white / total
        root[k, samples] = totals**-0.5
        determinant[k] = np.log(totals).sum()
    return Filter(decay, gain, root, determinant)


def through_noise(terms: Residuals) -> Callable[[FloatArray], FloatArray]:
    """What makes of columns [T, N, c] those through noise as in `filter_of`, of deviation one, [N, T, c]."""
    whitens = filter_of(terms)
    return lambda columns: whitens.whiten(np.moveaxis(columns, 1, 0), terms.valid)


@dataclass(frozen=True)
class Weighed:
    """What windows tell of the weights through their noise, but for its deviations."""

    filters: tuple[Filter, ...]
    white: tuple[FloatArray, ...]
    """[N, T, m] whitened responses."""
    products: FloatArray
    """[P, m, m] of each part, a channel of a window, with itself."""
    samples: FloatArray
    """[P]"""
    determinant: FloatArray
    """[P]"""


def weigh(residuals: Sequence[Residuals]) -> Weighed:
    """Of windows with heat."""
    filters = tuple(filter_of(window_residuals) for window_residuals in residuals)
    white, products = [], []
    for window_residuals, whitens in zip(residuals, filters, strict=True):
        assert window_residuals.heat is not None
        response = whitens.whiten(np.moveaxis(window_residuals.heat.response, 1, 0), window_residuals.valid)
        white.append(np.ascontiguousarray(response))
        products.append(np.ascontiguousarray(np.einsum("kti,ktj->kij", response, response, optimize=True)))
    samples = np.concatenate([window_residuals.valid.sum(axis=1) for window_residuals in residuals]).astype(float)
    determinant = np.concatenate([whitens.determinant for whitens in filters])
    return Weighed(filters, tuple(white), np.concatenate(products), samples, determinant)


def heat_rows(
    residuals: Sequence[Residuals], memories: Sequence[WindowMemory]
) -> tuple[tuple[list[Row], ...], list[Row], tuple[list[Row], ...]]:
    """Rows that open each window, that close, and that return to each window; as of `likelihood_calls`.

    All windows share the weights; the first memory has their scales, and the value.
    """
    heat, known = residuals[0].heat, weigh(residuals)
    assert heat is not None
    if heat.sizes is not None:
        return _known_rows(residuals, memories, known, heat.sizes)
    parts, m = known.products.shape[:2]
    squares, precision, trace = np.zeros((3, parts))
    projected, shown = np.zeros((parts, m)), np.zeros(m)
    follows = heat.follows or Follows((), np.zeros(0, bool), np.zeros(0), np.zeros((m, 0)), np.zeros(m))
    forward, backward, first = [], [], 0
    for window_residuals, memory, whitens, response in zip(
        residuals, memories, known.filters, known.white, strict=True
    ):
        call = HeatWindowCall(
            window_residuals.valid, memory.observed, memory.simulated, memory.numbers, whitens.decay, whitens.gain,
            whitens.root, response, first, np.zeros(window_residuals.valid.shape), squares, precision, projected,
            shown, trace, memory.simulated_bar, memory.numbers_bar, known.samples,
        )  # fmt: skip
        first += len(window_residuals.valid)
        memory.value[0], memory.scales_bar[:] = 0.0, 0.0
        forward.append([opens.row(call)])
        backward.append([returns.row(call)])
    memory = memories[0]
    closing: Row = close.row(
        HeatCloseCall(  # type: ignore[call-arg]
            squares, precision, projected, known.samples, known.determinant, known.products, heat.group,
            memory.scales, follows.logarithmic, follows.at, np.ascontiguousarray(follows.slope), follows.centre,
            *np.zeros((7, m)), shown, *np.zeros((2, m, m)), np.array(LAPACK), np.array([ord("L")], np.uint8),
            np.array([m, 0], np.int32), trace, memory.scales_bar, memory.value,
        )
    )  # fmt: skip
    return tuple(forward), [closing], tuple(backward)


def _known_rows(
    residuals: Sequence[Residuals], memories: Sequence[WindowMemory], known: Weighed, sizes: Sizes
) -> tuple[tuple[list[Row], ...], list[Row], tuple[list[Row], ...]]:
    """`heat_rows` where the sizes of noise and heat are known."""
    roots, precision = sizes.roots, np.tile(sizes.deviations, len(residuals)) ** -2.0
    told, directions = np.linalg.eigh(roots[:, None] * np.tensordot(precision, known.products, 1) * roots)
    determinant = float(np.log1p(told).sum() + known.determinant.sum())
    determinant += float(known.samples @ (_LOG_2_PI - np.log(precision)))
    kept = told > _TOLD
    root = roots[:, None] * directions[:, kept] * (1.0 + told[kept]) ** -0.5
    squares, projected = np.zeros(1), np.zeros(kept.sum())
    forward, backward = [], []
    for place, (window_residuals, memory, whitens, response) in enumerate(
        zip(residuals, memories, known.filters, known.white, strict=True)
    ):
        explaining = response / sizes.deviations[:, None, None] @ root
        call = KnownWindowCall(
            window_residuals.valid, memory.observed, memory.simulated, whitens.decay, whitens.gain,
            whitens.root / sizes.deviations[:, None], np.ascontiguousarray(explaining), int(place == 0),
            np.zeros(window_residuals.valid.shape), squares, projected, memory.simulated_bar, memory.numbers_bar,
        )  # fmt: skip
        memory.value[0] = 0.0
        forward.append([opens_known.row(call)])
        backward.append([returns_known.row(call)])
    closing: Row = close_known.row(KnownCloseCall(squares, projected, determinant, memories[0].value))
    return tuple(forward), [closing], tuple(backward)


def _factors(gram: FloatArray, roots: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Cholesky factor [m, m] of 1 + root gram root, and its inverse X: X^T X is the weights' covariance over roots."""
    lower = np.asarray(np.linalg.cholesky(np.eye(len(roots)) + roots[:, None] * gram * roots), float)
    return lower, np.asarray(dtrtri(lower, lower=1)[0], float)


class Gains:
    """What S draws make of residuals: weights of heat, each draw with its sizes of noise and heat."""

    factors: list[tuple[IntArray, FloatArray]]
    """Draws that have the same sizes, and F, whose F F^T is the covariance of their weights [m, m]."""

    def __init__(
        self, residuals: Sequence[Residuals], known: Weighed, deviations: FloatArray, roots: FloatArray
    ) -> None:
        """deviations: [S, P] of the noise of each part; roots: [S, m] prior deviations of the weights."""
        self._residuals, self._known, self._deviations = residuals, known, deviations
        sizes = np.concatenate([deviations, roots], axis=1)
        _, place, which = np.unique(sizes, axis=0, return_index=True, return_inverse=True)
        self.factors = []
        for k, one in enumerate(place):
            gram, root = np.tensordot(deviations[one] ** -2.0, known.products, 1), roots[one]
            self.factors.append((np.flatnonzero(which.ravel() == k), root[:, None] * _factors(gram, root)[1].T))

    def __call__(self, left: Sequence[FloatArray]) -> FloatArray:
        """Weights [S, m] expected with residuals [S, T, N] of each window, K."""
        moment, first = np.zeros((len(self._deviations), self._known.products.shape[1])), 0
        known = zip(self._residuals, self._known.filters, self._known.white, left, strict=True)
        for window_residuals, whitens, response, residual in known:
            white = whitens.whiten(
                np.where(window_residuals.valid[..., None], residual.transpose(2, 1, 0), 0.0), window_residuals.valid
            )
            precision = self._deviations[:, first : first + len(white)] ** -2.0
            moment += np.einsum("sk,ktm,kts->sm", precision, response, white, optimize=True)
            first += len(white)
        for which, factor in self.factors:
            moment[which] = moment[which] @ factor @ factor.T
        return moment

    def draw(self, left: Sequence[FloatArray], rng: np.random.Generator) -> FloatArray:
        """Weights [S, m] drawn, likewise."""
        drawn = self(left)
        for which, factor in self.factors:
            drawn[which] += rng.standard_normal((len(which), factor.shape[1])) @ factor.T
        return drawn


class Evidence:
    """The log likelihood of windows with what is linear integrated out, by the numbers of their noise and its scales.

    r columns stand in each window's residuals, with weights that all windows share.
    """

    def __init__(self, residuals: Sequence[Residuals], columns: Sequence[FloatArray], numbers: int) -> None:
        """columns: [T, N, r] of each window; numbers: how many each channel has."""
        r = columns[0].shape[2]
        self.numbers = np.zeros((len(residuals[0].kinds), numbers))
        self._parts: list[tuple[int, int, WhitenCall]] = []
        self._whitens, self._pulls = [], []
        for w, (window_residuals, basis) in enumerate(zip(residuals, columns, strict=True)):
            samples = len(window_residuals.seconds)
            work = np.zeros((2, samples, r + 1))
            for k, kind in enumerate(window_residuals.kinds):
                assert kind.whitens is not None
                assert kind.pulls is not None
                seen = np.zeros((samples, r + 1))
                seen[:, :r] = np.where(window_residuals.valid[k][:, None], basis[:, k], 0.0)
                call = WhitenCall(
                    window_residuals.seconds, window_residuals.valid[k], self.numbers[k], seen, np.zeros(seen.shape),
                    np.zeros(1), work[0], np.zeros(numbers), np.zeros((3, samples)), work[1], np.zeros(r + 1),
                )  # fmt: skip
                self._parts.append((w, k, call))
                self._whitens.append(kind.whitens.row(call))
                self._pulls.append(kind.pulls.row(call))

    def __call__(
        self, left: Sequence[FloatArray], numbers: FloatArray, roots: FloatArray
    ) -> tuple[float, FloatArray, FloatArray]:
        """The value, and its derivatives by the numbers [N, n] and by the prior deviations [r] of the weights.

        left: residuals [T, N] of each window, K.
        """
        self.numbers[:] = numbers
        r = len(roots)
        products, total = np.zeros((r + 1, r + 1)), 0.0
        for (w, k, call), whitens in zip(self._parts, self._whitens, strict=True):
            call.columns[:, r] = np.where(call.valid, left[w][:, k], 0.0)
            whitens()
            products += call.white.T @ call.white
            total += call.determinant[0] + call.valid.sum() * _LOG_2_PI
        gram, moment, squares = products[:r, :r], products[:r, r], products[r, r]
        lower, inverse = _factors(gram, roots)
        half = inverse @ (roots * moment)
        weights = inverse.T @ half
        shrunk = inverse.T @ inverse
        value = -0.5 * (total + squares + 2.0 * np.log(np.diag(lower)).sum() - half @ half)
        # Derivatives by the whitened columns, beside whose products stand those of the weights' second moments.
        mean = np.append(roots * weights, -1.0)
        second = np.outer(mean, mean)
        second[:r, :r] += roots[:, None] * shrunk * roots
        numbers_bar = np.zeros(numbers.shape)
        for (_, k, call), pulls in zip(self._parts, self._pulls, strict=True):
            np.matmul(call.white, -second, out=call.white_bar)
            call.numbers_bar[:] = 0.0
            pulls()
            numbers_bar[k] += call.numbers_bar
        return float(value), numbers_bar, (weights**2 - 1.0 + np.diag(shrunk)) / roots
