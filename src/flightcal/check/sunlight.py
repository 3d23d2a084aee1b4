"""What shines on the faces of a scenario, before, during and after one window."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np

from ..environment import seconds_later, shadow_edges
from ..errors import OrbitError
from ..scenario import Environment, Scenario
from ..simulator import FloatArray, Times, face_series

FINE = 60.0
"""s, how far apart sunlight is looked up,"""
REACH = 7800.0
"""s, and how far before and after the window."""
ZONES = 50_400.0
"""s, of which the clock of a time zone is off at most."""
_RINGS = 8
"""Of the quadrature of albedo, which is right to 1% of its peak on each face."""
_MARGIN = 1.1
"""Windows, for which sunlight is known: a clock may be too fast."""

Shone = tuple[FloatArray, dict[str, FloatArray]]
"""Times [M], s from the window's start, and what shines on the faces, by column [M] W/m^2."""


@dataclass(frozen=True)
class Sunlight:
    """That of a scenario, or of another in its place, around a window."""

    scenario: Scenario
    start: np.datetime64
    """Of the window, UTC,"""
    length: float
    """and how long that is, s."""

    def times(self, scenario: Scenario, first: float, last: float) -> FloatArray:
        """Times [M], s from the window's start, at which sunlight is looked up: also where a shadow begins and ends."""
        every = np.arange(first, last, FINE)
        if scenario.environment.orbit is None:
            return every
        start, end = self._utc(np.array([first, last]))
        edges = _edges(scenario.environment.model_copy(update={"attitude": "nadir"}), start, end, scenario.folder)
        return np.union1d(every, first + (edges - start) / np.timedelta64(1, "s"))

    def on_faces(self, scenario: Scenario, seconds: FloatArray) -> dict[str, FloatArray]:
        """What shines on a scenario's faces at times [M], s from the window's start, by column. Raises OrbitError."""
        return face_series(scenario, self._utc(seconds), rings=_RINGS)

    def before(self, seconds: float) -> Shone:
        """So many s before, up to `ZONES`, as if it were now. Raises OrbitError."""
        first, last = -FINE - seconds, _MARGIN * self.length + FINE - seconds
        try:
            if abs(seconds) <= REACH:
                return self._around
            times, lit = self._of_a_day
        except OrbitError:  # samples of orbit or attitude do not reach as far
            return self._between(first, last)
        then = slice(*np.searchsorted(times, [first, last]).tolist())
        return times[then], {column: sunlit[then] for column, sunlit in lit.items()}

    @cached_property
    def _around(self) -> Shone:
        """As far as `REACH`. Raises OrbitError."""
        return self._between(-REACH, self.length + REACH)

    @cached_property
    def _of_a_day(self) -> Shone:
        """As far as time zones reach. Raises OrbitError."""
        return self._between(-FINE - ZONES, _MARGIN * self.length + FINE + ZONES)

    def _between(self, first: float, last: float) -> Shone:
        seconds = self.times(self.scenario, first, last)
        return seconds, self.on_faces(self.scenario, seconds)

    def _utc(self, seconds: FloatArray) -> Times:
        return seconds_later(self.start, seconds)


@lru_cache(maxsize=32)
def _edges(environment: Environment, start: np.datetime64, end: np.datetime64, folder: Path) -> Times:
    """Where shadows begin and end. Most wrongs leave the orbit as it is."""
    return shadow_edges(environment, start, end, folder)
