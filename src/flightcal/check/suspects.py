"""Which simple wrong explains best what telemetry and prior disagree about: before any sampling, in seconds.

What a channel shows by itself (`broken`) comes first, and is left out of the rest. Then every wrong of `wrongs` is
tried, beside a thermal network (`white_box`) or beside runs of another simulator (`black_box`). One is named only where
it is better by far than nothing wrong (`suspicion`).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
import xarray
from numpy.typing import NDArray

from ..errors import FlightcalError, TelemetryError
from ..problem import Problem, Window, build_problem
from ..progress import SILENT, Progress
from ..run import Run, Stage, plain, read_json, typed
from ..scenario import Scenario
from ..simulator import FloatArray, SimulationFailure
from ..telemetry import select_window
from .black_box import PriorEnsemble, compared_by_runs, ensemble_of, no_temperatures, told_by_status
from .broken import Broken, broken, stuck_throughout
from .compared_window import known_thermostats
from .evaluate import PriorRuns
from .evidence import Fit, climbed
from .jumps import Jump, in_turns, in_words, jumps
from .misfit import misfit
from .network_view import View
from .prepared import prepared
from .suspicion import (
    BAD,
    HELPS,
    NOT_IMITATED,
    Suspects,
    Suspicion,
    nothing_simple,
    part_of,
    ranked,
    suspicion_of,
    unexplained,
)
from .thermostat import copied, disobeyed, exchanged, inferred, unfollowed
from .white_box import OF_THERMOSTATS, compared
from .wrongs import in_other_units

SUSPECTS_FILE = "suspects.json"
_RUN_ONLY = "the simulator is no thermal network, or a reduced one: it is run, and not looked into"
_LEFT_BY_RUNS, _FAR_BY_RUNS = 0.5, 8.0
"""What one wrong may lack, and how far a parameter may then be, beside a simulator that is only run (see `ranked`):
where a wrong is put right, how it begins is linear there."""
_MANY = 3
"""Channels that show the same, from which that has one reason:"""
_OF_MANY = {
    "spike": (
        "have spikes",
        "Whole rows may be damaged.",
        "Find what tells damaged rows, as a checksum, and write it as 'valid_where' of the channels in 'telemetry: "
        "channels'; else leave these rows out",
    ),
    "held": (
        "hold their readings",
        "What keeps telemetry may give the last reading again.",
        "Take the readings as they were sent, or keep one of so many samples",
    ),
    "interpolated": (
        "have straight lines between readings",
        "What keeps telemetry may have kept few readings, and filled in the rest.",
        "Take the readings as they were sent, or keep one of so many samples",
    ),
}
"""by kind: what they do, why, and what to do."""
_OF_READINGS = frozenset({"gain", "drift", "curve", "slow", "earlier mean"})
"""Kinds of wrongs that explain why a status that changes does not do what thresholds say; see `OF_THERMOSTATS`."""


def suspects(
    problem: Problem, telemetry: xarray.Dataset, prior_runs: PriorRuns | None = None, *, progress: Progress = SILENT
) -> Suspects:
    """What is likely to be wrong with a scenario or its telemetry, by its first training window.

    What a channel shows by itself is looked for in every window. telemetry: what the problem was built from.
    prior_runs: of a simulator that is no thermal network; None: it is simulated here.
    """
    window, why_not = problem.windows[0], _RUN_ONLY
    modelled, ensemble = np.full(window.observed.shape, np.nan), None
    try:
        view = prepared(problem.scenario, telemetry)
        if view is not None:
            simulated = view.simulated(view.window, view.middle)
            modelled = _throughout(problem)
            modelled[: len(simulated)] = simulated
        else:
            ensemble = _ensemble(problem, telemetry, prior_runs or PriorRuns(problem))
            modelled = ensemble.simulated.mean(axis=0)
    except (FlightcalError, SimulationFailure) as error:
        view, why_not = None, str(error)
    seen = _seen(window.simulator.channels, window.times, window.observed, modelled)
    of_channels = _of_many([channel.suspicion for channel in (*seen, *_elsewhere(problem, telemetry, seen))])
    of_status = [*copied(window), *exchanged(window)]
    turning = in_turns(window.simulator.channels, window.observed, modelled)
    known_broken = {broken_channel.suspicion.about for broken_channel in seen}
    jumped = in_words(_jumps(window, modelled, known_broken), turning)
    found = [*jumped, *of_channels, *of_status]
    if any(suspicion.kind == "order" for suspicion in jumped):
        why_not = "telemetry that is not in order is not compared with the simulator"
        view = None
        ensemble = None
    if ensemble is not None:
        return _beside_runs(replace(ensemble, telemetry=_known(telemetry, window.times, seen)), found)
    if view is None:
        return Suspects(tuple(found), False, why_not)
    known = replace(view, telemetry=_known(view.telemetry, window.times, seen))
    judged = _beside_a_network(known, found, progress)
    misread = None if judged.misfit is None else _misread(problem.scenario, telemetry, judged.misfit.channel)
    if misread is None:
        return judged
    by_themselves = (suspicion for suspicion in judged.found if suspicion.nats is None)
    return replace(judged, found=(misread, *by_themselves), misfit=None, partly=None)


def _of_many(of_channels: Sequence[Suspicion]) -> list[Suspicion]:
    """What channels show by themselves, with what many of them show for one reason as one."""
    found = list(of_channels)
    for kind, (title, why, advice) in _OF_MANY.items():
        alike = [suspicion for suspicion in found if suspicion.kind == kind]
        names = list(dict.fromkeys(suspicion.about for suspicion in alike))
        if len(names) >= _MANY:
            sentence = f"{why} {names[0]}, for one: {alike[0].sentence}"
            one = Suspicion(kind, " ".join(names), f"{len(names)} channels {title}", sentence, advice)
            found = [one, *(suspicion for suspicion in found if suspicion.kind != kind)]
    return found


def _seen(
    channels: Sequence[str], times: NDArray[np.datetime64], observed: FloatArray, modelled: FloatArray
) -> list[Broken]:
    """What channels show by themselves; observed, modelled: [T, C] K."""
    looks = (broken(name, times, observed[:, k], modelled[:, k]) for k, name in enumerate(channels))
    return [look for look in looks if look is not None]


def _elsewhere(problem: Problem, telemetry: xarray.Dataset, seen: list[Broken]) -> Iterator[Broken]:
    """What channels show by themselves in all windows but the first to train on, of which this is seen."""
    scenario, first = problem.scenario, problem.windows[0]
    useful = first.observed.copy()
    channels = first.simulator.channels
    for told in seen:
        useful[told.useless, channels.index(told.suspicion.about)] = np.nan
    for name, window in scenario.windows.items():
        if name == first.name:
            continue
        try:
            samples = select_window(telemetry, window, first.period, name)
        except TelemetryError:  # it is told where the window is used
            continue
        values = np.stack([samples[channel].to_numpy() for channel in channels], axis=1)
        times = samples["time"].to_numpy()
        seen_here = _seen(channels, times, values, np.full(values.shape, np.nan))
        if any(found.suspicion.kind == "spike" for found in seen_here):
            # A short eclipse cools a panel as suddenly.
            seen_here = _seen(channels, times, values, _simulated(problem, telemetry, name, times))
        yield from seen_here
        looks = (stuck_throughout(channel, times, values[:, k], useful[:, k]) for k, channel in enumerate(channels))
        yield from (found for found in looks if found is not None)


def _throughout(problem: Problem) -> FloatArray:
    """[T, C] K in the first training window at the prior's median; NaN where it cannot be simulated.

    What explains the telemetry is looked for in its first orbits, and what a channel shows by itself in all of it.
    """
    window = problem.windows[0]
    try:
        return window.simulate(problem.at(window, problem.priors.median())).temperatures.copy()
    except SimulationFailure:
        return np.full(window.observed.shape, np.nan)


def _simulated(problem: Problem, telemetry: xarray.Dataset, name: str, times: NDArray[np.datetime64]) -> FloatArray:
    """[T, C] K in another window at the prior's median; NaN where it cannot be simulated."""
    try:
        other = build_problem(problem.scenario, telemetry, name)
    except FlightcalError:
        return np.full((len(times), len(problem.windows[0].simulator.channels)), np.nan)
    simulated_at, at = other.windows[0].times.astype(float), times.astype(float)
    return np.stack([np.interp(at, simulated_at, values) for values in _throughout(other).T], axis=1)


def _jumps(window: Window, modelled: FloatArray, known: Collection[str]) -> list[Jump]:
    """Of channels of which nothing is known yet."""
    chosen = [k for k, channel in enumerate(window.simulator.channels) if channel not in known]
    names = [window.simulator.channels[k] for k in chosen]
    return jumps(names, window.times, window.observed[:, chosen], modelled[:, chosen])


def _known(data: xarray.Dataset, times: NDArray[np.datetime64], seen: list[Broken]) -> xarray.Dataset:
    """Telemetry without the samples that are known to be of no use."""
    for broken_channel in seen:
        channel = broken_channel.suspicion.about
        useless = np.isin(data["time"].to_numpy(), times[broken_channel.useless])
        data = data.assign({channel: ("time", np.where(useless, np.nan, data[channel].to_numpy()))})
    return data


def _ensemble(problem: Problem, telemetry: xarray.Dataset, prior_runs: PriorRuns) -> PriorEnsemble:
    """Simulations of a simulator that is run and not looked into. Raises SimulationFailure where too few finish."""
    ensemble = ensemble_of(problem, telemetry, prior_runs.thetas, prior_runs.runs)
    if ensemble is None:
        raise SimulationFailure("too few simulations at draws of the prior finish")
    return ensemble


def _beside_a_network(view: View, found: list[Suspicion], progress: Progress) -> Suspects:
    """What was found, and what explains the telemetry of a thermal network."""
    if not np.isfinite(view.observed).any():
        return Suspects(tuple(found), True)
    odd = list(disobeyed(view.window))
    try:
        nothing, helps = _tried(view, [suspicion.about for suspicion, _ in odd], progress)
        likely, where, partly = ranked(helps, nothing), None, None
        if likely and likely[0].kind == "unrelated":
            likely = [*_beside_the_unrelated(view, likely, progress), *likely]
    except SimulationFailure as failure:
        return Suspects(tuple(found), False, str(failure))
    if not likely and not nothing.is_usual:
        where = misfit(view, nothing.z)
        likely = unexplained(nothing, where, helps)
        partly = None if likely else part_of(helps, nothing)
    if likely or not nothing.is_usual:
        # What makes up for missed switches may be a capacity.
        found = [*found, *unfollowed(view.window)]
    kinds = {suspicion.kind for suspicion in (*found, *likely)}
    for suspicion, constant in odd:
        if not kinds & (OF_THERMOSTATS if constant else OF_THERMOSTATS | _OF_READINGS):
            found.append(suspicion)
    every = [*found, *likely]
    if likely and likely[0].kind == "clock":
        # Times that are wrong make spikes of what changes fast.
        every.sort(key=lambda suspicion: suspicion.kind == "spike")
    return Suspects(tuple(every), True, "", where, partly)


def _misread(scenario: Scenario, telemetry: xarray.Dataset, channel: str) -> Suspicion | None:
    """What is said where another unit of a silent heater's sensor explains all, the usual ones first; None: none does.

    By its readings as they are such a heater was never on, or always, so that `units` does not find it.
    """
    node = scenario.observations[channel].node
    silent = [
        name
        for name, heater in scenario.network.switches.items()
        if heater.measured_by is None and heater.sensor == node
    ]
    states = [set(np.unique(inferred(scenario, telemetry, name))) for name in silent]
    if not any(state in ({0.0}, {1.0}) for state in states):
        return None
    for read, wrong in in_other_units(channel, telemetry[channel].to_numpy()):
        try:
            view = prepared(scenario, telemetry.assign({channel: ("time", read)}))
            assert view is not None
            fit = climbed(view, view.window, view.observed, view.point(view.window, view.middle))
        except (FlightcalError, SimulationFailure):
            continue
        if fit.is_usual:
            return suspicion_of(wrong, fit, None)
    return None


def _tried(view: View, odd: Sequence[str], progress: Progress) -> tuple[Fit, list[tuple[Fit, Suspicion]]]:
    """How the telemetry is with nothing wrong, and what helps. odd: heaters that do not what their thresholds say.

    Raises SimulationFailure.
    """
    base = view.point(view.window, view.middle)
    nothing = climbed(view, view.window, view.observed, base)
    better = compared(view, base, nothing, _concerned(view, odd), progress)
    return nothing, [(fit, suspicion_of(wrong, fit, nats)) for fit, wrong, nats in better]


def _beside_the_unrelated(view: View, likely: Sequence[Suspicion], progress: Progress) -> list[Suspicion]:
    """What explains the telemetry without the channels that seem not to belong to their nodes.

    A light array alone shows to the second when the Sun comes and goes. Where an eclipse is far off, that array is what
    disagrees most; and what makes the other channels more probable is then wrong for all. Raises SimulationFailure.
    """
    unrelated = {suspicion.about for suspicion in likely if suspicion.kind == "unrelated"}
    nowhere = np.full(view.telemetry.sizes["time"], np.nan)
    others = replace(view, telemetry=view.telemetry.assign(dict.fromkeys(unrelated, ("time", nowhere))))
    nothing, helps = _tried(others, [], progress)
    known = {(suspicion.kind, suspicion.about) for suspicion in likely}
    better = [suspicion for suspicion in ranked(helps, nothing) if suspicion.kind in NOT_IMITATED]
    return [suspicion for suspicion in better if (suspicion.kind, suspicion.about) not in known]


def _beside_runs(ensemble: PriorEnsemble, found: list[Suspicion]) -> Suspects:
    """What was found, and what explains the telemetry of a simulator that is run and not looked into."""
    strange = list(no_temperatures(ensemble))
    if strange or not np.isfinite(ensemble.observed).any():
        return Suspects((*strange, *found), False, "temperatures that no satellite has are not compared")
    found = [*found, *told_by_status(ensemble)]
    nothing, better = compared_by_runs(ensemble)
    helps = [(fit, suspicion_of(wrong, fit, nats)) for fit, wrong, nats in better]
    named = ranked(helps, nothing, _LEFT_BY_RUNS, _FAR_BY_RUNS, BAD)
    if not named and not nothing.is_usual:
        named = unexplained(nothing, None, helps, run_only=True)
    if not named and helps and (helps[0][1].nats or 0.0) > HELPS:
        sentence = f"What helps most explains a part of it: {helps[0][1].title}."
        advice = "Check that first; then what the simulator has otherwise"
        named = [nothing_simple(sentence, advice)]
    return Suspects((*found, *named), True, _RUN_ONLY)


def _concerned(view: View, heaters: Collection[str]) -> set[str]:
    """Heaters and the channels of their sensors."""
    known = {name: channel for name, _, channel in known_thermostats(view.window)}
    return {*heaters, *(known[name] for name in heaters)}


def _make(run: Run, problem: Problem, telemetry: xarray.Dataset, prior_runs: PriorRuns | None = None) -> None:
    run.folder.write_json(SUSPECTS_FILE, plain(suspects(problem, telemetry, prior_runs, progress=run.progress)))


def _kept(run: Run, *_: Any) -> Suspects:
    content = read_json(run.folder.file(SUSPECTS_FILE))
    return typed(Suspects, content)


SUSPECTS: Final = Stage("suspects", "looking for what may be wrong", (SUSPECTS_FILE,), _make, _kept)
"""Of a problem, its telemetry and simulations at draws of its prior."""
