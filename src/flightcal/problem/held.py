"""What heaters do in an open loop while their status is not measured: as a simulation or the telemetry has it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from ..simulator import Drive, FloatArray, IntArray, Switch, divided, integrate
from .heat_model import Held
from .window import Switching, Window

_HELD = 300.0
"""s, within which a switch lies whose time the status does not tell."""


def held_by(window: Window, theta: FloatArray) -> Held | None:
    """What the heaters do at theta [q] where a window in open loop has no status; None: it always has.

    Thermostats act there. Raises SimulationFailure.
    """
    drive, simulator = window.network.drive, window.network
    steps, heaters = np.nonzero(np.isnan(drive.measured))
    if window.switching is None or not len(steps):
        return None
    run = integrate(simulator.network.structure, simulator.system(theta[window.simulated]), drive, derivative=False)
    gaps, on, switches = [], [], []
    for heater in np.unique(heaters).tolist():
        switched = np.sort(steps[heaters == heater])
        for gap in np.split(switched, np.flatnonzero(np.diff(switched) > 1) + 1):
            first, moments = _in_gap(drive, run.switches, run.status, heater, gap)
            edges = [float(drive.times[gap[0]]), *(time for time, _ in moments), float(drive.times[gap[-1] + 1])]
            gaps.append((edges[0], edges[-1], heater))
            on += [(begin, end, heater) for begin, end in list(pairwise(edges))[0 if first else 1 :: 2]]
            switches += [(time, heater, within) for time, within in moments]
    return Held(window.name, tuple(gaps), tuple(on), tuple(switches))


def _in_gap(
    drive: Drive, switches: Switch, status: FloatArray, heater: int, gap: IntArray
) -> tuple[bool, list[tuple[float, float]]]:
    """Whether a heater is on where the steps of a gap in its status begin, and when it switches in it, within how long.

    As the simulation has it, with its status [K+1, H] on the grid. If that leaves the gap in another
    state than the telemetry, it switches once more: any time after its last switch.
    """
    begin, end = float(drive.times[gap[0]]), float(drive.times[gap[-1] + 1])
    inside = (switches.heater == heater) & (switches.time > begin) & (switches.time < end)
    moments = [(time, _HELD) for time in switches.time[inside].tolist()]
    first = not switches.on[inside][0] if moments else bool(status[gap[0], heater])
    after = drive.measured[gap[-1] + 1, heater] if gap[-1] + 1 < len(drive.measured) else np.nan
    if after in (0.0, 1.0) and bool(after) != (first ^ bool(len(moments) % 2)):
        last = moments[-1][0] if moments else begin
        moments.append((0.5 * (last + end), end - last))
    return first, moments


def with_other(held: Held, heater: int, on: Sequence[tuple[float, float]], within: Mapping[float, float]) -> Held:
    """The same with one heater that is on in other spans, s from the window's start.

    within: of their moments, how many s each is known within; at the ends of a gap nothing switches.
    """
    gaps = [(begin, end) for begin, end, which in held.gaps if which == heater]
    edges = {time for span in on for time in span} - {time for gap in gaps for time in gap}
    spans = [stretch for stretch in held.on if stretch[2] != heater] + [(begin, end, heater) for begin, end in on]
    switches = [switch for switch in held.switches if switch[1] != heater]
    switches += [(time, heater, within[time]) for time in edges]
    return Held(held.window, held.gaps, tuple(sorted(spans)), tuple(sorted(switches)))


def hold(window: Window, held: Held) -> Window:
    """A window in open loop whose heaters do what is held where their status is not known."""
    assert window.switching is not None
    heaters = window.network.heaters
    drive = divided(window.network.drive, np.array([time for begin, end, _ in held.on for time in (begin, end)]))
    measured, middle = drive.measured.copy(), 0.5 * (drive.times[1:] + drive.times[:-1])
    for spans, state in ((held.gaps, 0.0), (held.on, 1.0)):
        for begin, end, heater in spans:
            measured[(middle > begin) & (middle < end), heater] = state
    switches = window.switching
    switching = Switching(
        np.concatenate([switches.time, [time for time, _, _ in held.switches]]),
        np.concatenate([switches.interval, [within for _, _, within in held.switches]]),
        (*switches.heater, *(heaters[heater] for _, heater, _ in held.switches)),
    )
    simulator = replace(window.network, drive=replace(drive, measured=measured))
    status = window.status.copy()
    seconds = window.network.observation.times
    for heater in window.unmeasured:
        status[:, heater] = 0.0
        for begin, end, which in held.on:
            if which == heater:
                status[(seconds >= begin) & (seconds < end), heater] = 1.0
    return replace(window, simulator=simulator, switching=switching, status=status)
