"""Where and when a simulation is farthest from the telemetry, where no simple wrong says why."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..environment import attitude_names, sunlit_share
from ..scenario import AttitudeTimeline
from ..simulator import FloatArray
from ..words import number
from .compared_window import INFERRED
from .network_view import View

_FEW = 0.1
"""Share of samples that a state has to have, and to lack, to be compared."""
_CLEARLY = 1.25
"""Times as large as over the whole window is a misfit that belongs to a state."""


@dataclass(frozen=True)
class Misfit:
    """What parameters alone leave of the telemetry, in the channel that is worst off."""

    channel: str
    typical: float
    """K, root mean square over the window."""
    when: str
    """A state of the satellite in which it is larger; empty: in none."""
    then: float
    """K, root mean square there; where there is no such state, that of the window."""

    @property
    def words(self) -> str:
        """Where it is largest, in a sentence."""
        where = f"The misfit is largest in {self.channel}: {number(self.typical, 2)} K"
        return f"{where}, and {number(self.then, 2)} K {self.when}." if self.when else f"{where}."


def misfit(view: View, z: FloatArray) -> Misfit | None:
    """Of a view, with its entries at z [d]; None: nothing is known there. Raises SimulationFailure."""
    t, count = len(view.rows.kept), len(view.channels)
    left = view.observed - view.temperatures(view.window, z)[: t * count].reshape(count, t).T
    known = [k for k in range(count) if np.isfinite(left[:, k]).any()]
    if not known:
        return None
    squares = {k: float(np.nanmean(left[:, k] ** 2)) for k in known}
    worst = max(known, key=lambda k: squares[k] / (view.rows.noise[k] ** 2 + 1.0))
    valid = np.isfinite(left[:, worst])
    found = [
        (float(np.mean(left[valid & inside, worst] ** 2)), words)
        for words, inside in _states(view)
        if _FEW * valid.sum() < (valid & inside).sum() < (1.0 - _FEW) * valid.sum()
    ]
    typical = float(np.sqrt(squares[worst]))
    square, when = max(found, default=(0.0, ""))
    if square < _CLEARLY**2 * squares[worst]:
        return Misfit(view.channels[worst], typical, "", typical)
    return Misfit(view.channels[worst], typical, when, float(np.sqrt(square)))


def _states(view: View) -> Iterator[tuple[str, NDArray[np.bool_]]]:
    """States of the satellite that come and go, in words, each with the rows [t] in which it is in them."""
    window, kept = view.window, view.rows.kept
    lit = sunlit_share(window.scenario.environment, window.times[kept], window.scenario.folder)
    if np.isfinite(lit).all():
        yield "in sunlight", lit > 0.5
        yield "in the shadow", lit <= 0.5
    drive, columns = view.network.drive, view.network.network.columns
    seconds = view.network.observation.times[kept]
    step = np.clip(np.searchsorted(drive.times, seconds, side="right") - 1, 0, len(drive.times) - 2)
    for mode in window.scenario.network.modes:
        yield f"in mode '{mode}'", drive.inputs[step, 0, columns.index(f"mode.{mode}")] > 0.5
    for k, (name, heater) in enumerate(window.scenario.network.switches.items()):
        if not (heater.measured_by or "").startswith(INFERRED):
            on = drive.measured[step, k]
            yield f"while {name} is on", on > 0.5
            yield f"while {name} is off", on <= 0.5
    attitude = window.scenario.environment.attitude
    if isinstance(attitude, AttitudeTimeline):
        flown = np.array(attitude_names(attitude, window.times[kept]))
        for name in dict.fromkeys(filter(None, flown.tolist())):
            yield f"in attitude '{name}'", flown == name
    yield "in the first half of the window", seconds < seconds[len(seconds) // 2]
    yield "in the second half of the window", seconds >= seconds[len(seconds) // 2]
