"""How a planned window begins: as what is known before it, simulated on up to there.

Nobody knows at which temperatures a plan begins. The last telemetry tells it where it is recent; else where training
had the temperatures, for what is off there fades in the days that are simulated before the plan.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray

from ..environment import as_datetime, timespan
from ..errors import FlightcalError
from ..problem import Problem, Window, build_window, dressed
from ..scenario import Window as Span
from ..simulator import FloatArray, Trajectory
from ..telemetry import driver_gaps, when_read
from .ensemble import simulated
from .errors import white_errors
from .heat import DrawnHeat, heated_window
from .initial import around_usual, begun, final_temperatures, initial_places

LEAD: Final = "lead"
"""The window before a plan."""
UNKNOWN: Final = "as training has it at that place in the orbit, for the time before cannot be simulated"
"""Where a plan begins that nothing leads up to."""
_LONGEST, _ORBITS = 2.0 * 86400.0, 3.0
"""s, and orbits: what is simulated before a plan at the most, and at the least where telemetry is older."""
_BRIDGED = 3600.0
"""s before a plan that are simulated though drivers are not known there."""


@dataclass(frozen=True)
class Led:
    """What a plan begins with, in S draws."""

    thetas: FloatArray
    """[S, q] of the plan's window, with its initial temperatures."""
    on: FloatArray
    """[S, H] heaters that are on."""
    words: str
    """Where it is from."""


def lead_up_to(
    problem: Problem,
    telemetry: xarray.Dataset,
    window: Window,
    draws: FloatArray,
    thetas: FloatArray,
    drawn: DrawnHeat | None,
    rng: np.random.Generator,
) -> Led | None:
    """Simulate draws [S, d] up to a window of which no sample is known at its start; thetas: [S, q], theirs of it.

    None: its first samples are known, or nothing of the time before it is. drawn: heat of the draws, if any.
    """
    span = problem.scenario.calibration.prediction.initial_span
    early = window.times < window.start + timespan(span)
    if not window.is_network or np.isfinite(window.observed[early]).any():
        return None
    start, words = _start(problem, telemetry, window)
    if start >= window.start:
        return None
    ahead = Span(start=as_datetime(start), end=as_datetime(window.start), planned=True)
    scenario = problem.scenario.model_copy(update={"windows": {**problem.scenario.windows, LEAD: ahead}})
    try:
        lead, first = (build_window(scenario, telemetry, LEAD, span=length) for length in (None, span))
    except FlightcalError:  # orbit or attitude are not known so long before
        return None
    if problem.heat is not None:
        lead, first = dressed(lead, problem.heat), dressed(first, problem.heat)
    inside = problem.at(lead, problem.priors.median()[None]).repeat(len(thetas), axis=0)
    shared = [name for name in lead.names if not name.startswith("initial.")]
    inside[:, [lead.names.index(name) for name in shared]] = thetas[:, [window.names.index(name) for name in shared]]
    first = around_usual(first, problem, draws)
    if drawn is None:
        inside, on = begun(problem, first, inside, white_errors(first, inside), rng, None)
        runs = simulated(lead, inside, rng, on=on)
    else:
        heated = heated_window(problem, lead, inside, drawn, len(first.times), rng)
        inside, on = begun(problem, first, inside, heated.errors.at_first(), rng, heated.injected.on(first))
        runs = simulated(lead, inside, rng, heated.injected.on(lead), heated.thresholds, on)
    return _at_the_end(window, thetas, runs, words, rng)


def _start(problem: Problem, telemetry: xarray.Dataset, window: Window) -> tuple[np.datetime64, str]:
    """From when on is simulated, and what is known there."""
    span = problem.scenario.calibration.prediction.initial_span
    read = when_read(telemetry)
    before = read[read < window.start]
    earliest = window.start - timespan(max(_LONGEST, _ORBITS * window.period))
    for name, channel in problem.scenario.telemetry.channels.items():
        if channel.kind == "driver" and name in telemetry:
            for begin, end in driver_gaps(telemetry, name, channel.bridge)[0]:
                if begin < window.start:
                    earliest = max(earliest, end)
    if len(before) and before[-1] >= min(earliest, window.start - timespan(_BRIDGED)):
        return before[-1] - timespan(span), "that of the last telemetry, simulated on"
    hours = (window.start - earliest) / np.timedelta64(1, "h")
    return earliest, f"simulated from {hours:.0f} h before on, from where training had it"


def _at_the_end(
    window: Window, thetas: FloatArray, runs: list[Trajectory | None], words: str, rng: np.random.Generator
) -> Led | None:
    """What the window begins with; a draw whose simulation failed has what another one has."""
    finals = final_temperatures(window, runs)
    done = np.flatnonzero(np.isfinite(finals).all(axis=1))
    if not len(done):
        return None
    taken = np.where(np.isin(np.arange(len(runs)), done), np.arange(len(runs)), rng.choice(done, len(runs)))
    thetas = thetas.copy()
    thetas[:, initial_places(window)] = finals[taken]
    return Led(thetas, np.stack([np.round(run.status[-1]) for k in taken if (run := runs[k]) is not None]), words)
