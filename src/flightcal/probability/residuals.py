"""What a scenario says about the residuals of a window: noise of each channel, discrepancy, and their numbers.

Each channel has a row of n numbers: its noise's, in the kind's order, and last amplitude and lengthscale of its
discrepancy. Each is fixed, or an entry of theta under its name; several may be one entry.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from ..environment import orbit_phase
from ..scenario import Discrepancy, Prior, Scenario, discrepancy_of, noise_of
from ..simulator import FloatArray
from .discrepancy import MaternPrior, frequencies, in_phase
from .likelihood import SHAPE_NUMBERS, Likelihood, Residuals
from .noise import INDEPENDENT, KINDS, MOST_NUMBERS, kind_of_noise
from .noise.kind import DEVIATION, NoiseKind
from .shapes import Shapes, no_shapes

NUMBERS = MOST_NUMBERS + SHAPE_NUMBERS
AMPLITUDE, LENGTH = range(MOST_NUMBERS, NUMBERS)
"""Columns of the numbers [N, n]."""

_SMOOTHNESS = {"3/2": 1.5, "5/2": 2.5}
_DIFFERENCE = 1e-4
"""Of a number's logarithm."""


@dataclass(frozen=True)
class NoiseEntry:
    """A number of a channel's residuals that is an entry of theta."""

    name: str
    channel: int
    column: int
    size: Literal["noise", "white", "discrepancy", ""] = ""
    """Of what it is the size, K: all of the noise, the white part of correlated noise, or the discrepancy."""


@dataclass(frozen=True)
class ResidualModel:
    """Noise and discrepancy of a window's N channels."""

    terms: Residuals
    fixed: FloatArray
    """[N, n] the numbers; anything where one is an entry of theta."""
    entries: tuple[NoiseEntry, ...]

    @cached_property
    def is_independent(self) -> bool:
        """Whether all noise is independent and normal, and there is no discrepancy."""
        return not self.terms.discrepant.any() and all(kind == INDEPENDENT for kind in self.terms.kinds)

    @cached_property
    def is_normal(self) -> bool:
        """Whether all residuals are normal given theta."""
        return all(kind.is_normal for kind in self.terms.kinds)

    def independent(self) -> ResidualModel:
        """The same channels and entries with independent normal noise alone: the published likelihood."""
        kinds = (INDEPENDENT,) * len(self.terms.kinds)
        return replace(self, terms=replace(self.terms.without_shapes(), kinds=kinds))

    def with_known_shape(self, kinds: Sequence[NoiseKind], deviations: FloatArray | None = None) -> ResidualModel:
        """The same with noise of other kinds [N], each of which has one number, its deviation.

        deviations: [N] K, known ones (None: they are what they were).
        """
        terms = replace(self.terms, kinds=tuple(kinds))
        if deviations is None:
            entries = tuple(entry for entry in self.entries if entry.column == DEVIATION)
            return replace(self, terms=terms, entries=entries)
        fixed = np.zeros(self.fixed.shape)
        fixed[:, DEVIATION] = deviations
        return replace(self, terms=terms, fixed=fixed, entries=())

    def deviations(self, numbers: FloatArray) -> FloatArray:
        """Standard deviation of the noise of one sample of each channel [N], K; numbers: [N, n]."""
        return np.array(
            [kind.deviation(kind_numbers) for kind, kind_numbers in zip(self.terms.kinds, numbers, strict=True)]
        )

    def normal_equivalent(self, numbers: FloatArray) -> tuple[Residuals, FloatArray]:
        """Normal residuals of the same information on the simulated temperatures, and their numbers [N, n]."""
        if self.is_normal:
            return self.terms, numbers
        found = [
            kind.normal_equivalent(kind_numbers) for kind, kind_numbers in zip(self.terms.kinds, numbers, strict=True)
        ]
        numbers = numbers.copy()
        for kind_numbers, (_, equal) in zip(numbers, found, strict=True):
            kind_numbers[: len(equal)] = equal
        return replace(self.terms, kinds=tuple(kind for kind, _ in found)), numbers

    def curvature(self, residual: FloatArray, numbers: FloatArray) -> FloatArray:
        """Minus the second derivatives [N, n, n] of the log likelihood by the numbers' logarithms.

        residual: [T, N] K. By differences of the first derivatives; of independent normal noise alone its expectation,
        twice the number of samples.
        """
        curvature = np.zeros((*numbers.shape, numbers.shape[1]))
        simple = np.array([kind == INDEPENDENT for kind in self.terms.kinds]) & ~self.terms.discrepant
        curvature[simple, DEVIATION, DEVIATION] = 2.0 * self.terms.valid[simple].sum(axis=1)
        if simple.all():
            return curvature
        none, likelihood = np.zeros(residual.shape), Likelihood([self.terms], numbers.shape[1])
        for column in sorted({entry.column for entry in self.entries if not simple[entry.channel]}):
            slopes = []
            for sign in (1.0, -1.0):
                moved = numbers.copy()
                moved[:, column] *= np.exp(sign * _DIFFERENCE)
                slopes.append(moved * likelihood((residual, none, moved))[1][0].numbers)
            second = (slopes[1] - slopes[0]) / (2.0 * _DIFFERENCE)
            curvature[~simple, :, column] = second[~simple]
        return 0.5 * (curvature + curvature.transpose(0, 2, 1))

    def draw_noise(self, numbers: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Noise [T, N], K, of all channels."""
        kinds, seconds = self.terms.kinds, self.terms.seconds
        drawn = [sum(kind.draw(kind_numbers, seconds, rng)) for kind, kind_numbers in zip(kinds, numbers, strict=True)]
        return np.stack(drawn, axis=1)

    def draw_errors(
        self, numbers: FloatArray, rng: np.random.Generator, shared: FloatArray | None = None
    ) -> FloatArray:
        """Residuals [T, N], K, drawn from the model with the discrepancy's weights from their prior.

        shared: [N, m] the weights in deviations, where windows share them (None: drawn too).
        """
        drawn = self.draw_noise(numbers, rng)
        for k in np.flatnonzero(self.terms.discrepant):
            deviation = self.prior_deviations(numbers[k])
            standard = rng.standard_normal(len(deviation)) if shared is None else shared[k]
            drawn[:, k] += self.terms.shapes.basis @ (deviation * standard)
        return drawn

    def draw_given(
        self, numbers: FloatArray, mean: FloatArray, factor: FloatArray, rng: np.random.Generator
    ) -> FloatArray:
        """Residuals [T, N], K: a discrepancy whose weights have mean [N, m] and covariance F F^T, and new noise."""
        drawn = self.draw_noise(numbers, rng)
        if self.terms.discrepant.any():
            weights = mean + np.einsum("nij,nj->ni", factor, rng.standard_normal(mean.shape))
            drawn += self.terms.shapes.basis @ weights.T
        return drawn

    def prior_deviations(self, numbers: FloatArray) -> FloatArray:
        """Prior standard deviations [m] of the discrepancy's weights of a channel with `numbers` [n]."""
        return self.terms.shapes.prior.deviations(numbers[-SHAPE_NUMBERS:])


# --- from the scenario ----------------------------------------------------------------------------------------


def residual_model(
    scenario: Scenario, channels: tuple[str, ...], times: Any, observed: FloatArray
) -> tuple[ResidualModel, dict[str, Prior]]:
    """The residuals' model at times [T] (UTC) with telemetry observed [T, N], and the priors of its entries by name."""
    seconds = (times - times[0]) / np.timedelta64(1, "ns") * 1e-9 if len(times) else np.empty(0)
    fixed = np.zeros((len(channels), NUMBERS))
    priors: dict[str, Prior] = {}
    entries: list[NoiseEntry] = []

    def put(name: str, value: Prior | float, channel: int, column: int, size: Any = "") -> None:
        if isinstance(value, float):
            fixed[channel, column] = value
        else:
            priors.setdefault(name, value)
            entries.append(NoiseEntry(name, channel, column, size))

    noises = [noise_of(scenario, channel) for channel in channels]
    kinds = [kind_of_noise(noise) for noise in noises]
    for number in dict.fromkeys(name for kind in KINDS for name in kind.names):
        for k, (channel, noise, kind) in enumerate(zip(channels, noises, kinds, strict=True)):
            value = getattr(noise, number) if number in kind.names else None
            if value is not None:
                column = kind.names.index(number)
                more = () if column == DEVIATION else (number,)
                size = "noise" if column == DEVIATION else "white" if number == kind.white else ""
                put(".".join(("noise", channel, *more)), value, k, column, size)

    shapes = no_shapes(len(seconds), len(channels))
    if (discrepancy := discrepancy_of(scenario)) is not None:
        shapes, phase = _discrepancy(scenario, discrepancy, channels, times), discrepancy.phase
        for column, key, size in ((AMPLITUDE, "amplitude", "discrepancy"), (LENGTH, "lengthscale", "")):
            for k in np.flatnonzero(shapes.channels).tolist():
                more = () if key in phase.shared else (channels[k],)
                put(".".join(("discrepancy", "phase", key, *more)), getattr(phase, key), k, column, size)
    valid = np.ascontiguousarray(np.isfinite(observed).T)
    terms = Residuals(np.ascontiguousarray(seconds, float), valid, tuple(kinds), shapes)
    return ResidualModel(terms, fixed, tuple(entries)), priors


def _discrepancy(scenario: Scenario, written: Discrepancy, channels: tuple[str, ...], times: Any) -> Shapes:
    """Its shapes at times [T] (UTC)."""
    which = np.array([not written.channels or channel in written.channels for channel in channels])
    origin = np.datetime64(scenario.windows[scenario.train_windows[0]].start)
    phase, harmonics = orbit_phase(scenario.environment, times, scenario.folder, origin), written.phase.harmonics
    prior = MaternPrior(frequencies(harmonics), _SMOOTHNESS[written.phase.smoothness])
    return Shapes(which, np.ascontiguousarray(in_phase(phase, harmonics)), prior)
