"""What heaters do in an open loop while their status is not measured: as one simulation had it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..simulator import Drive, FloatArray, IntArray, Switch, integrate
from .heat_model import Held
from .window import Switching, Window

_HELD = 300.0
"""s, within which a switch lies that a simulation had where the status is not measured."""


def held_by(window: Window, theta: FloatArray) -> Held | None:
    """What the heaters do at theta [q] where a window in open loop has no status; None: it always has."""
    assert window.network is not None
    drive = window.network.drive
    steps, heaters = np.nonzero(np.isnan(drive.measured))
    if window.switching is None or not len(steps):
        return None
    simulator = window.network
    run = integrate(simulator.network.structure, simulator.system(theta[window.simulated]), drive, derivative=False)
    shares, switches = [], []
    for heater in np.unique(heaters).tolist():
        own = np.sort(steps[heaters == heater])
        for gap in np.split(own, np.flatnonzero(np.diff(own) > 1) + 1):
            first, moments = _in_gap(drive, run.switches, run.status, heater, gap)
            edges = np.array([drive.times[gap[0]], *(time for time, _ in moments), drive.times[gap[-1] + 1]])
            for step in gap.tolist():
                inside = np.diff(np.clip(edges, drive.times[step], drive.times[step + 1]))
                on = float(inside[0 if first else 1 :: 2].sum())
                shares.append((step, heater, on / float(drive.times[step + 1] - drive.times[step])))
            switches += [(time, heater, within) for time, within in moments]
    return Held(window.name, tuple(shares), tuple(switches))


def _in_gap(
    drive: Drive, switches: Switch, status: FloatArray, heater: int, gap: IntArray
) -> tuple[bool, list[tuple[float, float]]]:
    """Whether a heater is on where the steps of a gap in its status begin, and when it switches in it, within how long.

    As the simulation has it, with its status [K+1, H] on the grid. If that leaves the gap in another
    state than the telemetry, it switches once more: any time after its last switch.
    """
    begin, end = drive.times[gap[0]], drive.times[gap[-1] + 1]
    inside = (switches.heater == heater) & (switches.time > begin) & (switches.time < end)
    moments = [(time, _HELD) for time in switches.time[inside].tolist()]
    first = not switches.on[inside][0] if moments else bool(status[gap[0] + 1, heater])
    after = drive.measured[gap[-1] + 1, heater] if gap[-1] + 1 < len(drive.measured) else np.nan
    if after in (0.0, 1.0) and bool(after) != (first ^ bool(len(moments) % 2)):
        last = moments[-1][0] if moments else float(begin)
        moments.append((0.5 * (last + float(end)), float(end) - last))
    return first, moments


def hold(window: Window, held: Held) -> Window:
    """A window in open loop whose heaters do what is held where their status is not known."""
    assert window.network is not None
    assert window.switching is not None
    drive, heaters = window.network.drive, window.network.heaters
    measured = drive.measured.copy()
    for step, heater, share in held.shares:
        measured[step, heater] = share
    own = window.switching
    switching = Switching(
        np.concatenate([own.time, [time for time, _, _ in held.switches]]),
        np.concatenate([own.interval, [within for _, _, within in held.switches]]),
        (*own.heater, *(heaters[heater] for _, heater, _ in held.switches)),
    )
    simulator = replace(window.network, drive=replace(drive, measured=measured))
    return replace(window, simulator=simulator, switching=switching)
