"""Optima nearly as good as the one that was sampled, where no chain has been: other explanations of the telemetry.

A sensor that starts near its thermostat's threshold is one: on either side of it the heater starts otherwise, and both
may fit. Chains start around the best optimum and do not cross between them, and their agreement does not tell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..problem import Problem
from ..simulator import FloatArray
from .mode import SAME, Mode

_NEARLY = 5.0  # nats: less than a hundredth of the best density is no explanation worth a word


@dataclass(frozen=True)
class Explanation:
    """An optimum that the chains have not been near."""

    below: float
    """Nats, from the best optimum's log density."""
    differs: tuple[tuple[str, float, float], ...]
    """Name of an entry of theta, its posterior median, and its value there, both SI; the most different first."""


def other_explanations(problem: Problem, modes: Sequence[Mode], z: FloatArray) -> tuple[Explanation, ...]:
    """Of `modes`, best first, those within 5 nats of the first that lie outside of all draws z [S, d].

    Outside: in some entry by more than its standard deviation beyond the outermost draw.
    """
    deviation = z.std(axis=0)
    lower, upper = z.min(axis=0) - deviation, z.max(axis=0) + deviation
    median = np.median(problem.to_theta(z), axis=0)
    found: list[Explanation] = []
    for mode in modes:
        below = modes[0].log_density - mode.log_density
        outside = (mode.z < lower) | (mode.z > upper)
        if not mode.converged or not below < _NEARLY or not outside.any():
            continue
        far = np.abs(mode.z - z.mean(axis=0)) / np.maximum(deviation, np.finfo(float).tiny)
        order = [k for k in np.argsort(-far) if outside[k]]
        value = problem.to_theta(mode.z)
        differs = tuple((problem.names[k], float(median[k]), float(value[k])) for k in order)
        explanation = Explanation(float(below), differs)
        if not any(_same(explanation, other) for other in found):
            found.append(explanation)
    return tuple(found)


def _same(one: Explanation, other: Explanation) -> bool:
    """Whether two climbs ended in one optimum."""
    return {name for name, *_ in one.differs} == {name for name, *_ in other.differs} and bool(
        np.isclose(one.below, other.below, atol=SAME)
    )
