"""What a kind of noise is: everybody asks the kind, and nobody asks which kind it is.

A kind is one file beside this one, with its kernels. Its kernels are cached by that file, so a change there compiles
that kind alone; they inline nothing from other files. To add a kind: its file, its line in `__init__`, and what a user
writes for it in `scenario/residuals.py`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...compiled import Kernel
from ...simulator import FloatArray
from .process import filtered

DEVIATION = 0
"""Place of every kind's first number: its standard deviation (of Student's t: its scale), K."""


class NoiseCall(NamedTuple):
    """What a kind's kernel reads and fills for one channel."""

    seconds: Any
    """[T] times."""
    valid: Any
    """[T] whether there is a sample; where not, it is skipped, and the next gap is the longer for it."""
    residual: Any
    """[T] K, zero where not valid."""
    numbers: Any
    """[n or more] in the kind's order."""
    residual_bar: Any
    """[T], filled: the derivative of the value; zero where not valid."""
    numbers_bar: Any
    """[n or more], added to."""
    value: Any
    """[1], filled: the log likelihood."""
    rows: Any
    """[3, T] to work in, and the next [4, T, c]: as many columns as a filter has to go over."""
    columns: Any


class ShapesCall(NamedTuple):
    """What a normal kind's kernels read and fill where known shapes with normal weights w stand beside the noise.

    `opens` tells about the weights: the log likelihood given them is
    -1/2 (determinant + squares + samples log 2 pi) + scale (moment^T w - 1/2 w^T gram w).
    `returns` is given their posterior, and fills the derivatives of the log likelihood without them.
    """

    noise: NoiseCall
    basis: Any
    """[T, m]"""
    transposed: Any
    """[m, T]"""
    projected: Any
    """[m] of the basis with the residuals, where the kind wants it."""
    gram: Any
    """[m, m] before `opens`: of the basis with itself at the valid samples."""
    scale: Any
    """[1]"""
    moment: Any
    """[m]"""
    known: Any
    """[3] log determinant, squares, samples."""
    mean: Any
    """[m] expected weights."""
    root: Any
    """[m] prior deviations of the weights,"""
    inverse: Any
    """[m, m] and X, whose X^T X is their covariance over these."""
    untold: Any
    """[1] samples that tell nothing about the weights: the trace of the posterior's residual-maker matrix."""
    state: Any
    """[m + 1] to work in, and the next [m, m]."""
    covariance: Any


class WhitenCall(NamedTuple):
    """What a normal kind's kernels read and fill where c columns, such as residuals, are whitened."""

    seconds: Any
    """[T] times."""
    valid: Any
    """[T] whether there is a sample."""
    numbers: Any
    """[n or more] in the kind's order."""
    columns: Any
    """[T, c] K."""
    white: Any
    """[T, c], filled by `whitens`: what each sample adds to those before it, in deviations; zero where not valid."""
    determinant: Any
    """[1], filled: log determinant of the covariance of the samples."""
    white_bar: Any
    """[T, c], read by `pulls`: the derivative of a function by `white`."""
    numbers_bar: Any
    """[n or more], added to: that by the numbers, of the function less half the log determinant."""
    rows: Any
    """[3, T] that stay as they are from `whitens` to `pulls`; and to work in the next, [T, c],"""
    columns_bar: Any
    state: Any
    """[c]"""


class NoiseKind:
    """A kind of noise of one channel: all that anyone asks of it. `numbers` are [n], or more, in the kind's order."""

    written: tuple[str, str, bool]
    """Model and distribution of the scenario's `noise`, and whether it says a step of rounding."""
    words: str
    """What it is called,"""
    names: tuple[str, ...]
    """and its numbers: keys of the scenario's `noise`; the first is `DEVIATION`."""
    white: str = ""
    """Of these the size of what is white beside noise with a memory, where there is such a one."""
    has_memory: bool = False
    """Whether a sample's noise tells about the next one's."""
    has_known_shape: bool = False
    """Whether it is normal, and its one number its size."""
    kernel: Kernel
    """The likelihood of the noise alone, of a `NoiseCall`."""
    opens: Kernel | None = None
    """With shapes, as the next, of a `ShapesCall`; None: the noise is not normal, so there can be none."""
    returns: Kernel | None = None
    whitens: Kernel | None = None
    """Of a `WhitenCall`, as the next; None: the noise is not normal."""
    pulls: Kernel | None = None
    projects: bool = False
    """Whether `opens` wants the basis's products with the residuals made for it."""

    @property
    def in_full(self) -> str:
        """What it is called where there is room."""
        return self.words

    @property
    def is_normal(self) -> bool:
        """Whether it is normal, so that weights of shapes can be integrated out beside it."""
        return self.opens is not None

    def deviation(self, numbers: FloatArray) -> float:
        """Standard deviation of the noise of one sample, K."""
        return float(np.sqrt(self.covariance(numbers, np.zeros(1))[0] + self.white_variance(numbers)))

    def time_of(self, numbers: FloatArray) -> float:
        """Correlation time, s, of noise with a memory."""
        return float(numbers[self.names.index("correlation_time")])

    def draw(self, numbers: FloatArray, seconds: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Noise with a memory, from its stationary distribution, and noise without, [T] each, K."""
        raise NotImplementedError

    def innovations(
        self, residual: FloatArray, seconds: FloatArray, numbers: FloatArray, rng: np.random.Generator
    ) -> FloatArray:
        """Of residuals [T], K, NaN where missing, what the noise does not know from those before.

        How far each is off what the ones before make expected, as if its gap were endless.
        """
        if not self.has_memory:
            return residual
        white = float(np.sqrt(self.white_variance(numbers)))
        return filtered(residual, seconds, numbers[DEVIATION], self.time_of(numbers), white)

    def normal_equivalent(self, numbers: FloatArray) -> tuple[NoiseKind, FloatArray]:
        """A normal kind of the same information on the simulated temperatures, and its numbers."""
        return self, numbers

    def covariance(self, numbers: FloatArray, apart: FloatArray) -> FloatArray:
        """Of the noise with a memory, an Ornstein-Uhlenbeck process, at samples that are so far `apart` (s), K^2."""
        if not self.has_memory:
            return np.zeros(apart.shape)
        return np.asarray(numbers[DEVIATION] ** 2 * np.exp(-np.abs(apart) / self.time_of(numbers)))

    def white_variance(self, numbers: FloatArray) -> float:
        """Of the noise without, K^2."""
        size = self.white if self.has_memory else self.names[DEVIATION]
        return float(numbers[self.names.index(size)] ** 2) if size else 0.0

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other)

    def __hash__(self) -> int:
        return hash(type(self))
