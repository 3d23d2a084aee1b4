"""What heaters do in an open loop while their status is not measured: as a simulation or the telemetry has it."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ..simulator import Drive, FloatArray, IntArray, divided, integrate
from .heat_model import Held
from .window import Switching, Window

_HELD = 300.0
"""s, within which a switch lies whose time the status does not tell."""


def held_by(window: Window, theta: FloatArray) -> Held | None:
    """What the heaters do at theta [q] where a window in open loop has no status; None: it always has.

    Thermostats act there. Raises SimulationFailure.
    """
    assert window.network is not None
    drive, simulator = window.network.drive, window.network
    heaters = np.flatnonzero(np.isnan(drive.measured).any(axis=0)).tolist()
    if window.switching is None or not heaters:
        return None
    run = integrate(simulator.network.structure, simulator.system(theta[window.simulated]), drive, derivative=False)
    found = []
    for heater in heaters:

        def acts(gap: IntArray) -> tuple[bool, list[float]]:
            switches, begin, end = run.switches, drive.times[gap[0]], drive.times[gap[-1] + 1]
            inside = (switches.heater == heater) & (switches.time > begin) & (switches.time < end)  # noqa: B023
            times = switches.time[inside].tolist()
            return not switches.on[inside][0] if times else bool(run.status[gap[0] + 1, heater]), times  # noqa: B023

        found.append(_held(window, heater, acts))
    gaps, on, switches = (sum((getattr(own, what) for own in found), ()) for what in ("gaps", "on", "switches"))
    return Held(window.name, gaps, on, switches)


def _held(window: Window, heater: int, acts: Callable[[IntArray], tuple[bool, list[float]]]) -> Held:
    """What one heater does; acts: of the steps of a gap, whether it is on where that begins, and when it switches."""
    assert window.network is not None
    drive = window.network.drive
    steps = np.flatnonzero(np.isnan(drive.measured[:, heater]))
    gaps, on, switches = [], [], []
    for gap in np.split(steps, np.flatnonzero(np.diff(steps) > 1) + 1):
        begin, end = float(drive.times[gap[0]]), float(drive.times[gap[-1] + 1])
        first, moments = _until_measured(drive, heater, gap, *acts(gap))
        edges = [begin, *(time for time, _ in moments), end]
        gaps.append((begin, end, heater))
        on += [(start, stop, heater) for start, stop in list(itertools.pairwise(edges))[0 if first else 1 :: 2]]
        switches += [(time, heater, within) for time, within in moments]
    return Held(window.name, tuple(gaps), tuple(on), tuple(switches))


def with_other(held: Held, heater: int, on: Sequence[tuple[float, float]], within: float) -> Held:
    """The same with one heater that is on in other spans, s from the window's start, each known within so many s."""
    gaps = [(begin, end) for begin, end, which in held.gaps if which == heater]
    edges = {time for span in on for time in span} - {time for gap in gaps for time in gap}
    spans = [own for own in held.on if own[2] != heater] + [(begin, end, heater) for begin, end in on]
    switches = [own for own in held.switches if own[1] != heater] + [(time, heater, within) for time in edges]
    return Held(held.window, held.gaps, tuple(sorted(spans)), tuple(sorted(switches)))


def _until_measured(
    drive: Drive, heater: int, gap: IntArray, first: bool, times: list[float]
) -> tuple[bool, list[tuple[float, float]]]:
    """When a heater switches in a gap, and within how many seconds each, so that it leaves it as the telemetry says.

    If it would leave it in another state, it switches once more: any time after its last switch.
    """
    begin, end = float(drive.times[gap[0]]), float(drive.times[gap[-1] + 1])
    moments = [(time, _HELD) for time in times]
    after = drive.measured[gap[-1] + 1, heater] if gap[-1] + 1 < len(drive.measured) else np.nan
    if after in (0.0, 1.0) and bool(after) != (first ^ bool(len(moments) % 2)):
        last = moments[-1][0] if moments else begin
        moments.append((0.5 * (last + end), end - last))
    return first, moments


def hold(window: Window, held: Held) -> Window:
    """A window in open loop whose heaters do what is held where their status is not known."""
    assert window.network is not None
    assert window.switching is not None
    heaters = window.network.heaters
    drive = divided(window.network.drive, np.array([time for begin, end, _ in held.on for time in (begin, end)]))
    measured, middle = drive.measured.copy(), 0.5 * (drive.times[1:] + drive.times[:-1])
    for spans, state in ((held.gaps, 0.0), (held.on, 1.0)):
        for begin, end, heater in spans:
            measured[(middle > begin) & (middle < end), heater] = state
    own = window.switching
    switching = Switching(
        np.concatenate([own.time, [time for time, _, _ in held.switches]]),
        np.concatenate([own.interval, [within for _, _, within in held.switches]]),
        (*own.heater, *(heaters[heater] for _, heater, _ in held.switches)),
        own.unmeasured,
    )
    simulator = replace(window.network, drive=replace(drive, measured=measured))
    status = window.status.copy()
    seconds = window.network.observation.times
    for name in own.unmeasured:
        heater = heaters.index(name)
        status[:, heater] = 0.0
        for begin, end, which in held.on:
            if which == heater:
                status[(seconds >= begin) & (seconds < end), heater] = 1.0
    return replace(window, simulator=simulator, switching=switching, status=status)
