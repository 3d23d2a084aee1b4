"""Can the prior reach the telemetry? Simulations of prior draws against what was measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..problem import Problem, Window
from ..scenario import HalfNormal, HalfStudentT, heat_of
from ..simulator import FloatArray, SimulationFailure, Trajectory
from .centre import Centre
from .evaluate import ManyRuns

BAND = 0.95
_WHOLE = 0.99
"""Share of the prior's simulations in the band that telemetry must reach at all."""
_QUIET = 0.1
"""Quantile of a noise level's prior that counts as the least plausible noise."""
EDGE = 0.01
"""Share of a prior beyond the centre's value below which the telemetry pulls a parameter to its prior's edge."""
_ASKED = 3
"""So many simulations that failed are made again, to say why."""


@dataclass(frozen=True)
class ChannelReach:
    """Telemetry of a channel in one window against the prior."""

    window: str
    """Its label."""
    channel: str
    inside: float
    """Share inside the 95% band of the prior predictive distribution, noise and discrepancy included."""
    reached: float
    """Share that the simulator itself reaches with the prior: inside its 99% band and twice the least noise."""
    beyond: float
    """K by which telemetry leaves that band at most: above (positive) or below it."""


@dataclass(frozen=True)
class HeaterReach:
    """Duty cycle of a heater in one window against the prior's 95%."""

    window: str
    """Its label."""
    heater: str
    observed: float
    """NaN where the status is not measured."""
    lower: float
    upper: float

    @property
    def reached(self) -> bool:
        """Whether the measured duty lies within what the prior gives."""
        return not (self.observed < self.lower - 1e-9 or self.observed > self.upper + 1e-9)


@dataclass(frozen=True)
class Pressed:
    """A parameter that the telemetry pulls to an edge of its prior."""

    name: str
    theta: float
    """SI, at the centre."""
    probability: float
    """Share of the prior below it."""


@dataclass(frozen=True)
class Bands:
    """What the prior gives in one window."""

    quantiles: FloatArray
    """[3, T, N] K: lower edge of the 95% band, median, upper edge; noise and discrepancy included."""
    model: FloatArray
    """[2, T, N] K: the 99% band of the simulations themselves, and twice the least noise."""


@dataclass(frozen=True)
class PriorPredictive:
    """What the prior gives, and where telemetry is beside it."""

    draws: int
    failed: int
    why: tuple[str, ...]
    """What failed simulations say, each once; of thermal networks, which tell when asked again."""
    bands: tuple[Bands, ...]
    """Of each window."""
    channels: tuple[ChannelReach, ...]
    heaters: tuple[HeaterReach, ...]
    pressed: tuple[Pressed, ...]


def prior_predictive(
    problem: Problem, prior_runs: tuple[FloatArray, ManyRuns], centre: Centre, seed: int
) -> PriorPredictive:
    """Bands and shares of the prior's draws; prior_runs: thetas [S, d] and their simulations."""
    thetas, runs = prior_runs
    whole = np.array([trajectories is not None for trajectories in runs])
    rng = np.random.default_rng(seed)
    quiet = problem.priors.quantile(_QUIET)
    bands: list[Bands] = []
    channels: list[ChannelReach] = []
    heaters: list[HeaterReach] = []
    for k, window in enumerate(problem.windows):
        of_window = [trajectories[k] for trajectories in runs if trajectories is not None]
        least = 2.0 * window.noise(problem.at(window, quiet))
        bands.append(_bands(window, of_window, problem.at(window, thetas[whole]), least, rng))
        channels += _channels(window, bands[-1])
        heaters += _heaters(window, np.stack([run.duty_cycle for run in of_window]))
    return PriorPredictive(
        draws=len(thetas),
        failed=int((~whole).sum()),
        why=_why(problem, thetas[~whole][:_ASKED]),
        bands=tuple(bands),
        channels=tuple(channels),
        heaters=tuple(heaters),
        pressed=_pressed(problem, centre),
    )


def _why(problem: Problem, thetas: FloatArray) -> tuple[str, ...]:
    """What simulations at thetas [S, d] say that fail."""
    if not all(window.is_network for window in problem.windows):
        return ()
    said: dict[str, None] = {}
    for theta in thetas:
        try:
            problem.simulate(theta)
        except SimulationFailure as failure:
            said.setdefault(str(failure))
    return tuple(said)


def _bands(
    window: Window, runs: Sequence[Trajectory], thetas: FloatArray, least: FloatArray, rng: np.random.Generator
) -> Bands:
    """runs: at thetas [S, q] of the window. least: [N] K, twice the least noise."""
    temperatures = np.stack([run.temperatures for run in runs])
    predicted = temperatures + np.stack([window.draw_errors(theta, rng) for theta in thetas])
    tail = 0.5 * (1.0 - BAND)
    quantiles = np.quantile(predicted, [tail, 0.5, 1.0 - tail], axis=0)
    model = np.quantile(temperatures, [0.5 * (1.0 - _WHOLE), 0.5 * (1.0 + _WHOLE)], axis=0)
    model += least * np.array([-1.0, 1.0])[:, None, None]
    return Bands(quantiles, model)


def _channels(window: Window, bands: Bands) -> list[ChannelReach]:
    found = []
    for k, channel in enumerate(window.simulator.channels):
        valid = window.valid[:, k]
        seen = window.observed[valid, k]
        above = seen - bands.model[1, valid, k]
        below = bands.model[0, valid, k] - seen
        most_above, most_below = float(above.max(initial=0.0)), float(below.max(initial=0.0))
        beyond = most_above if most_above >= most_below else -most_below
        inside = (seen >= bands.quantiles[0, valid, k]) & (seen <= bands.quantiles[2, valid, k])
        reached = (above <= 0.0) & (below <= 0.0)
        found.append(ChannelReach(window.label, channel, _share(inside), _share(reached), beyond))
    return found


def _share(values: NDArray[np.bool_] | FloatArray) -> float:
    """Mean; NaN of nothing."""
    return float(values.mean()) if len(values) else np.nan


def _heaters(window: Window, duty: FloatArray) -> list[HeaterReach]:
    """duty: [S, H] of the simulations."""
    tail = 0.5 * (1.0 - BAND)
    found = []
    for k, heater in enumerate(window.simulator.heaters):
        status = window.status[:, k]
        lower, upper = np.quantile(duty[:, k], [tail, 1.0 - tail])
        found.append(HeaterReach(window.label, heater, _share(status[np.isfinite(status)]), lower, upper))
    return found


def _pressed(problem: Problem, centre: Centre) -> tuple[Pressed, ...]:
    """A level near zero, such as a noise's, is at no edge where its prior has its mode there.

    Nor is noise that stands for the unmodelled heat, which the centre does not have.
    """
    with_heat = heat_of(problem.scenario) is not None
    theta = problem.to_theta(centre.z)
    lower, upper = problem.priors.quantile(EDGE), problem.priors.quantile(1.0 - EDGE)
    found = []
    for k, name in enumerate(problem.names):
        if with_heat and problem.entries[k].kind == "noise":
            continue
        one_sided = isinstance(problem.priors.priors[k], (HalfNormal, HalfStudentT))
        if theta[k] > upper[k] or (theta[k] < lower[k] and not one_sided):
            found.append(Pressed(name, float(theta[k]), _probability_below(problem, k, float(theta[k]))))
    return tuple(found)


def _probability_below(problem: Problem, parameter: int, theta: float) -> float:
    """Share of a prior below a value, by halving."""
    lower, upper = 0.0, 1.0
    for _ in range(40):
        middle = 0.5 * (lower + upper)
        if problem.priors.quantile(middle)[parameter] < theta:
            lower = middle
        else:
            upper = middle
    return 0.5 * (lower + upper)
