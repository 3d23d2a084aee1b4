"""Whether an emulator errs by as much as it says, on runs that it has not seen."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri

from ..errors import FlightcalError
from ..simulator import FloatArray
from .emulator import Emulator
from .runs import TrainingRuns

PROBABILITIES = (0.5, 0.8, 0.95)
_DEVIATIONS = 3.0


@dataclass(frozen=True)
class ChannelValidation:
    """How one channel (or all) of held-out runs was predicted."""

    channel: str
    rmse: float
    """K."""
    worst: float
    """K, largest absolute error."""
    deviation: float
    """K, root mean square of the standard deviation that was predicted."""
    standardised: float
    """Root mean square of the error in predicted standard deviations; one if these are right."""
    coverage: tuple[float, ...]
    """Share of samples inside the intervals of `PROBABILITIES`."""


@dataclass(frozen=True)
class HeldOutScores:
    """The verdict on an emulator."""

    runs: int
    channels: tuple[ChannelValidation, ...]
    """Each channel, then "all"."""
    failures: tuple[str, ...]
    """What speaks against the emulator; empty: it passed."""

    @property
    def passed(self) -> bool:
        """Whether errors were as large as predicted, or smaller."""
        return not self.failures


def validate(emulator: Emulator, runs: TrainingRuns) -> HeldOutScores:
    """Judge an emulator by K finished runs that it was not fitted to.

    Raises FlightcalError where there are none.
    """
    if not len(runs):
        raise FlightcalError("emulator: found no held-out run that finished, expected at least one to judge it by")
    mean, deviation = emulator.predict(emulator.scale.to_z(runs.theta))
    return judge(runs.temperatures - mean, deviation, runs.channels)


def judge(errors: FloatArray, deviations: FloatArray, channels: tuple[str, ...]) -> HeldOutScores:
    """Judge errors [K, T, N] by the standard deviations [K, T, N] that were predicted, K both.

    The samples of a run are so alike that it counts as one trial: the emulator fails where the 95% intervals cover
    less, or the standardised errors' mean square is more, than K such trials explain (three standard deviations).
    """
    runs = len(errors)
    ratios = np.abs(errors) / np.maximum(deviations, 1e-300)
    found = []
    for k, name in enumerate((*channels, "all")):
        chosen = slice(k, k + 1) if k < len(channels) else slice(None)
        error, ratio = errors[..., chosen], ratios[..., chosen]
        found.append(
            ChannelValidation(
                channel=name,
                rmse=float(np.sqrt(np.mean(error**2))),
                worst=float(np.abs(error).max()),
                deviation=float(np.sqrt(np.mean(deviations[..., chosen] ** 2))),
                standardised=float(np.sqrt(np.mean(ratio**2))),
                coverage=tuple(float(np.mean(ratio <= ndtri(0.5 + 0.5 * p))) for p in PROBABILITIES),
            )
        )
    least = 0.95 - _DEVIATIONS * math.sqrt(0.95 * 0.05 / runs)
    most = math.sqrt(1.0 + _DEVIATIONS * math.sqrt(2.0 / runs))
    failures = []
    for channel in found:
        if channel.coverage[-1] < least:
            failures.append(
                f"{channel.channel}: the 95% intervals cover {channel.coverage[-1]:.0%} of {runs} held-out runs, "
                f"expected at least {least:.0%}: the emulator errs by more than it says"
            )
        if not channel.standardised <= most:
            failures.append(
                f"{channel.channel}: errors on {runs} held-out runs are {channel.standardised:.2f} of the predicted "
                f"standard deviations (root mean square), expected at most {most:.2f}"
            )
    return HeldOutScores(runs, tuple(found), tuple(failures))


def together(found: Mapping[str, HeldOutScores]) -> HeldOutScores:
    """One verdict on several windows' emulators, by what their channels' names begin with; "all" weighs runs alike."""
    if len(found) == 1:
        return next(iter(found.values()))
    runs = np.array([validation.runs for validation in found.values()])
    last = [validation.channels[-1] for validation in found.values()]

    def mean(values: list[float]) -> float:
        return float(runs @ np.array(values) / runs.sum())

    everything = ChannelValidation(
        channel="all",
        rmse=math.sqrt(mean([channel.rmse**2 for channel in last])),
        worst=max(channel.worst for channel in last),
        deviation=math.sqrt(mean([channel.deviation**2 for channel in last])),
        standardised=math.sqrt(mean([channel.standardised**2 for channel in last])),
        coverage=tuple(mean(list(shares)) for shares in zip(*(channel.coverage for channel in last), strict=True)),
    )
    channels = [replace(c, channel=f"{start}{c.channel}") for start, one in found.items() for c in one.channels]
    failures = tuple(f"{start}{failure}" for start, one in found.items() for failure in one.failures)
    return HeldOutScores(int(runs.sum()), (*channels, everything), failures)
