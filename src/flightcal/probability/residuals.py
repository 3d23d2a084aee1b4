"""What a scenario says about the residuals of a window: noise of each channel, discrepancy, and their numbers.

The numbers [N, 9] (see `noise`) are each fixed, or an entry of theta under its name; several may be one entry.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..environment import orbit_phase
from ..errors import ScenarioError
from ..scenario import Discrepancy, Noise, Prior, Scenario, TimeDiscrepancy, Uniform, noise_of, support
from ..simulator.system import FloatArray
from .discrepancy import (
    PhaseBasis,
    TimeBasis,
    functions_for,
    longest_lengthscale,
    matern_factor,
    shortest_lengthscale,
    time_basis,
)
from .likelihood import Residuals, log_likelihood, weights_given
from .noise import (
    CORRELATED,
    CORRELATED_STUDENT,
    DEGREES,
    DEVIATION,
    INDEPENDENT,
    NUMBERS,
    PHASE_LENGTH,
    PHASE_SIZE,
    ROUNDED,
    STEP,
    STUDENT,
    TIME,
    TIME_LENGTH,
    TIME_SIZE,
    WHITE,
)

_SMOOTHNESS = {"3/2": 1.5, "5/2": 2.5}
_WIDEST = 0.8
"""Of the longest lengthscale: the shortest at most, where a scenario does not say."""
_DIFFERENCE = 1e-4
"""Of a number's logarithm."""


@dataclass(frozen=True)
class Entry:
    """A number of a channel's residuals that is an entry of theta."""

    name: str
    channel: int
    column: int


@dataclass(frozen=True)
class ResidualModel:
    """Noise and discrepancy of a window's N channels."""

    compiled: Residuals
    fixed: FloatArray
    """[N, 9] the numbers; anything where one is an entry of theta."""
    entries: tuple[Entry, ...]
    time: TimeBasis | None
    """Of the discrepancy: the first columns of the basis."""
    phase: PhaseBasis | None

    @cached_property
    def is_independent(self) -> bool:
        """Whether all noise is independent and normal, and there is no discrepancy."""
        return not self.compiled.discrepant.any() and bool((self.compiled.kinds == INDEPENDENT).all())

    @cached_property
    def is_normal(self) -> bool:
        """Whether all residuals are normal given theta."""
        return bool(np.isin(self.compiled.kinds, (INDEPENDENT, CORRELATED)).all())

    def independent(self) -> ResidualModel:
        """The same channels and entries with independent normal noise alone: the published likelihood."""
        none = np.zeros_like(self.compiled.discrepant)
        return replace(self, compiled=self.compiled._replace(kinds=np.zeros_like(self.compiled.kinds), discrepant=none))

    def at_samples(self, valid: NDArray[np.bool_]) -> ResidualModel:
        """The same where other samples [T, N] are valid."""
        compiled = self.compiled._replace(
            valid=np.ascontiguousarray(valid.T), products=_products(self.compiled.basis, valid.T)
        )
        return replace(self, compiled=compiled)

    def normal_equivalent(self, numbers: FloatArray) -> tuple[ResidualModel, FloatArray]:
        """Normal residuals of the same information on the simulated temperatures, and their numbers [N, 9].

        Student's t has (nu + 1) / (nu + 3) of a normal's (Lange et al. 1989, J. Am. Stat. Assoc. 84, 881); rounding is
        taken for uniform noise.
        """
        kinds, numbers = self.compiled.kinds.copy(), numbers.copy()
        student = np.isin(kinds, (STUDENT, CORRELATED_STUDENT))
        degrees = numbers[student, DEGREES]
        numbers[student, DEVIATION] *= np.sqrt((degrees + 3.0) / (degrees + 1.0))
        rounded = kinds == ROUNDED
        numbers[rounded, DEVIATION] = np.hypot(numbers[rounded, DEVIATION], numbers[rounded, STEP] / np.sqrt(12.0))
        kinds[(kinds == STUDENT) | rounded] = INDEPENDENT
        kinds[kinds == CORRELATED_STUDENT] = CORRELATED
        return replace(self, compiled=self.compiled._replace(kinds=kinds)), numbers

    def curvature(self, residual: FloatArray, numbers: FloatArray) -> FloatArray:
        """Minus the second derivatives [N, 9, 9] of the log likelihood by the numbers' logarithms.

        residual: [T, N] K. By differences of the first derivatives; of independent normal noise alone its expectation,
        twice the number of samples.
        """
        curvature = np.zeros((len(numbers), NUMBERS, NUMBERS))
        simple = (self.compiled.kinds == INDEPENDENT) & ~self.compiled.discrepant
        curvature[simple, DEVIATION, DEVIATION] = 2.0 * self.compiled.valid[simple].sum(axis=1)
        if simple.all():
            return curvature
        none = np.zeros(residual.shape)
        for column in sorted({entry.column for entry in self.entries if not simple[entry.channel]}):
            slopes = []
            for sign in (1.0, -1.0):
                moved = numbers.copy()
                moved[:, column] *= np.exp(sign * _DIFFERENCE)
                slopes.append(moved * log_likelihood(self.compiled, residual, none, moved)[2])
            second = (slopes[1] - slopes[0]) / (2.0 * _DIFFERENCE)
            curvature[~simple, :, column] = second[~simple]
        return 0.5 * (curvature + curvature.transpose(0, 2, 1))

    def draw_errors(self, numbers: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Residuals [T, N], K, drawn from the model with the discrepancy's weights from their prior."""
        drawn = np.stack(
            [draw_noise(self, numbers, k, self.compiled.seconds, rng) for k in range(len(numbers))], axis=1
        )
        for k in np.flatnonzero(self.compiled.discrepant):
            deviation = self.prior_deviations(numbers[k])
            standard = rng.standard_normal(len(deviation))
            drawn[:, k] += self.compiled.basis @ (deviation * standard)
        return drawn

    def draw_given(
        self, observed: FloatArray, simulated: FloatArray, numbers: FloatArray, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """A discrepancy that residuals between observed and simulated [T, N] show, and new noise, [T, N] each, K."""
        noise = np.stack(
            [draw_noise(self, numbers, k, self.compiled.seconds, rng) for k in range(len(numbers))], axis=1
        )
        discrepancy = np.zeros_like(noise)
        if self.compiled.discrepant.any():
            mean, factor = weights_given(self.compiled, observed, simulated, numbers)
            drawn = mean + np.einsum("nij,nj->ni", factor, rng.standard_normal(mean.shape))
            discrepancy = self.compiled.basis @ drawn.T
        return discrepancy, noise

    def prior_deviations(self, numbers: FloatArray) -> FloatArray:
        """Prior standard deviations [m] of the discrepancy's weights of a channel with `numbers` [9]."""
        parts = []
        if self.time is not None:
            nu, length = self.compiled.smoothness[0], numbers[TIME_LENGTH]
            density = self.compiled.factor[0] * length ** (-2 * nu)
            density = density * (2 * nu / length**2 + self.time.frequencies**2) ** (-nu - 0.5)
            parts.append(numbers[TIME_SIZE] * np.sqrt(density))
        if self.phase is not None:
            nu, frequency = self.compiled.smoothness[1], self.phase.frequencies
            density = (2 * nu / numbers[PHASE_LENGTH] ** 2 + frequency**2) ** (-nu - 0.5)
            density = np.where(frequency == 0.0, density, 2.0 * density)
            # Cosine and sine of a harmonic add up to one.
            total = density[: self.phase.harmonics + 1].sum()
            parts.append(numbers[PHASE_SIZE] * np.sqrt(density / total))
        return np.concatenate(parts)


def draw_noise(
    model: ResidualModel, numbers: FloatArray, channel: int, seconds: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """A channel's noise [T], K, at `seconds` [T]: correlated noise from its stationary distribution."""
    own, kind, count = numbers[channel], model.compiled.kinds[channel], len(seconds)
    if kind in (STUDENT, CORRELATED_STUDENT):
        innovations = own[DEVIATION] * rng.standard_t(own[DEGREES], count)
    else:
        innovations = own[DEVIATION] * rng.standard_normal(count)
    if kind == ROUNDED:
        return np.asarray(innovations + own[STEP] * (rng.random(count) - 0.5))
    if kind in (INDEPENDENT, STUDENT):
        return np.asarray(innovations)
    return correlate(innovations, seconds, own[TIME]) + white_noise(model, numbers, channel, count, rng)


def white_noise(
    model: ResidualModel, numbers: FloatArray, channel: int, count: int, rng: np.random.Generator
) -> FloatArray:
    """What is white in a channel's correlated noise, [count] K."""
    if model.compiled.kinds[channel] != CORRELATED or numbers[channel, WHITE] == 0.0:
        return np.zeros(count)
    return np.asarray(numbers[channel, WHITE] * rng.standard_normal(count))


def correlate(innovations: FloatArray, seconds: FloatArray, time: float) -> FloatArray:
    """An Ornstein-Uhlenbeck process [T] at `seconds` [T] from innovations [T] with its stationary scale."""
    decay = np.exp(-np.diff(seconds) / time)
    process = np.array(innovations)
    for t, kept in enumerate(decay, start=1):
        process[t] = kept * process[t - 1] + np.sqrt(1.0 - kept * kept) * innovations[t]
    return process


# --- from the scenario ----------------------------------------------------------------------------------------


def residual_model(
    scenario: Scenario, channels: tuple[str, ...], times: Any, observed: FloatArray, *, checked: bool
) -> tuple[ResidualModel, dict[str, Prior]]:
    """The residuals' model at times [T] (UTC) with telemetry observed [T, N], and the priors of its entries by name.

    checked: see that the discrepancy has functions enough for its lengthscales. Raises ScenarioError.
    """
    seconds = (times - times[0]) / np.timedelta64(1, "ns") * 1e-9 if len(times) else np.empty(0)
    fixed = np.zeros((len(channels), NUMBERS))
    priors: dict[str, Prior] = {}
    entries: list[Entry] = []

    def put(name: str, value: Prior | float, channel: int, column: int) -> None:
        if isinstance(value, float):
            fixed[channel, column] = value
        else:
            priors.setdefault(name, value)
            entries.append(Entry(name, channel, column))

    noises = [noise_of(scenario, channel) for channel in channels]
    for column, key in ((DEVIATION, ""), (WHITE, "white"), (TIME, "correlation_time"), (DEGREES, "degrees_of_freedom")):
        for k, (channel, noise) in enumerate(zip(channels, noises, strict=True)):
            value = _number(noise, column)
            if value is not None:
                put(".".join(part for part in ("noise", channel, key) if part), value, k, column)
    for k, noise in enumerate(noises):
        fixed[k, STEP] = noise.quantisation or 0.0

    written = scenario.discrepancy or Discrepancy.model_construct(time=None, phase=None, channels=())
    time = _time_part(written.time, seconds) if written.time is not None else None
    phase = PhaseBasis(written.phase.harmonics) if written.phase is not None else None
    discrepant = np.array([not written.channels or channel in written.channels for channel in channels])
    discrepant &= time is not None or phase is not None
    if written.time is not None and time is not None:
        length = written.time.lengthscale or _default_lengthscale(written.time, time, seconds)
        if checked:
            _check_functions(written.time, time, length)
    for what, columns in (("time", (TIME_SIZE, TIME_LENGTH)), ("phase", (PHASE_SIZE, PHASE_LENGTH))):
        block = getattr(written, what)
        if block is None:
            continue
        for column, key in zip(columns, ("amplitude", "lengthscale"), strict=True):
            value = length if (what, key) == ("time", "lengthscale") else getattr(block, key)
            for k in np.flatnonzero(discrepant).tolist():
                own = () if key in block.shared else (channels[k],)
                put(".".join(("discrepancy", what, key, *own)), value, k, column)

    basis, frequency = [], []
    if time is not None:
        basis.append(time.at(seconds))
        frequency.append(time.frequencies)
    if phase is not None:
        origin = np.datetime64(scenario.windows[scenario.train_windows[0]].start)
        basis.append(phase.at(orbit_phase(scenario.environment, times, scenario.folder, origin)))
        frequency.append(phase.frequencies)
    together = np.concatenate(basis, axis=1) if basis else np.zeros((len(seconds), 0))
    valid = np.ascontiguousarray(np.isfinite(observed).T)
    smoothness = np.array([_SMOOTHNESS[block.smoothness] if block else 1.5 for block in (written.time, written.phase)])
    compiled = Residuals(
        seconds=np.ascontiguousarray(seconds, float),
        valid=valid,
        kinds=np.array([_kind(noise) for noise in noises], np.int64),
        discrepant=discrepant,
        basis=np.ascontiguousarray(together),
        transposed=np.ascontiguousarray(together.T),
        products=_products(together, valid),
        frequency=np.concatenate([*frequency, np.empty(0)]),
        in_time=np.array([0 if time is None else time.count], np.int64),
        smoothness=smoothness,
        factor=np.array([matern_factor(nu) for nu in smoothness]),
    )
    return ResidualModel(compiled, fixed, tuple(entries), time, phase), priors


def _products(basis: FloatArray, valid: NDArray[np.bool_]) -> FloatArray:
    """Of the basis [T, m] with itself at each channel's valid samples [N, T], [N, m, m]."""
    return np.stack([np.einsum("ti,tj->ij", basis[own], basis[own]) for own in valid])


def _kind(noise: Noise) -> int:
    if noise.quantisation is not None:
        return ROUNDED
    if noise.distribution == "student_t":
        return CORRELATED_STUDENT if noise.model == "ar1" else STUDENT
    return CORRELATED if noise.model == "ar1" else INDEPENDENT


def _number(noise: Noise, column: int) -> Prior | float | None:
    """What stands in a column of the noise; None: nothing."""
    if column == DEVIATION:
        return noise.standard_deviation
    if column == WHITE:
        return noise.white if noise.model == "ar1" else None
    if column == TIME:
        return noise.correlation_time if noise.model == "ar1" else None
    return noise.degrees_of_freedom if noise.distribution == "student_t" else None


def _time_part(written: TimeDiscrepancy, seconds: FloatArray) -> TimeBasis:
    first, last = (seconds[0], seconds[-1]) if len(seconds) > 1 else (0.0, 1.0)
    longest = longest_lengthscale(first, last) if written.lengthscale is None else _bounds(written.lengthscale)[1]
    return time_basis(first, last, longest, _SMOOTHNESS[written.smoothness], written.functions)


def _default_lengthscale(written: TimeDiscrepancy, basis: TimeBasis, seconds: FloatArray) -> Prior | float:
    first, last = (seconds[0], seconds[-1]) if len(seconds) > 1 else (0.0, 1.0)
    shortest, longest = shortest_lengthscale(basis, _SMOOTHNESS[written.smoothness]), longest_lengthscale(first, last)
    return Uniform(lower=min(shortest, _WIDEST * longest), upper=longest)


def _bounds(value: Prior | float) -> tuple[float, float]:
    return (value, value) if isinstance(value, float) else support(value)


def _check_functions(written: TimeDiscrepancy, basis: TimeBasis, length: Prior | float) -> None:
    shortest = _bounds(length)[0]
    needed = functions_for(basis, _SMOOTHNESS[written.smoothness], shortest)
    if needed > written.functions:
        raise ScenarioError(
            f"discrepancy.time: found {written.functions} functions for lengthscales from {shortest / 60:.3g} min on, "
            f"expected at least {needed}: more 'functions', a longer shortest lengthscale or a shorter longest one"
        )
