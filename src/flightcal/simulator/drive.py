"""What acts on a network in a window, and what steps make of it: sunlight, modes, measured drivers and heaters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ..environment import RINGS, face_fluxes, sample_times, seconds_later, shadow_edges, slew_edges, sun_edges
from ..errors import require_memory
from ..scenario import FaceNormal, Scenario, SpinningAttitude, SunTracking, load_driver
from ..telemetry import (
    driver_corners,
    driver_series,
    status_changes,
    status_fraction,
    status_or_unknown,
    switch_bounds,
)
from .network import Network, flux_kinds
from .system import Drive, FloatArray

_SETTLING = np.array([1e-4, 2e-4, 3e-4])  # s; steps so short bring massless nodes into balance and move no other

_TURN = np.deg2rad(2.0)
"""By which attitudes are turned to either side for the slope of a flux, which has kinks where a face loses the Sun."""

_FINE = 10.0  # s; linear between such times, sunlight on a turning face is right to 1e-5 of its amplitude
_TURN_PARTS = 360
"""So many such times there are in a body's turn."""
_CLOSEST_EDGES = 30.0
"""s, how close together, in the mean, a step is cut where a face gains or loses the Sun."""

_PARTS = 8
"""The least number of such times between two breaks."""
_COPIES = 6
"""Of the inputs, while they are made."""
_CLOSEST = 1e-3
"""s, between two of such times that lie between breaks."""
_CLOSE = 0.6
"""Of a step's length: corners of the inputs that are closer together do not end it."""
_LONGER = 0.1
"""Of a step, that may be shared out among the others."""
_LOOKED_AT = np.union1d(np.linspace(0.0, 1.0, 17), np.geomspace(1e-3, 1.0, 21))
"""Places between two breaks, at which it is looked at how long steps may be."""

Times = NDArray[np.datetime64]


@dataclass(frozen=True)
class Inputs:
    """What acts on a network in a window, as exactly as it is known: steps of any length make a `Drive` of it."""

    times: FloatArray
    """[M] s from the window's start, not decreasing; two at the same time mark a jump."""
    values: FloatArray
    """w [q, M], linear between the times."""
    driven: FloatArray
    """[M - 1, H] as `Drive.measured`, between the times."""
    breaks: FloatArray
    """[B] s, ascending, from the start to the end of the window: where a step has to end."""
    corners: FloatArray
    """s, ascending: where one had better end, for the inputs change their course (at a driver's samples)."""
    settling: FloatArray
    """s, ascending: where massless nodes have to find into balance anew."""
    initially_on: FloatArray
    """[H], see `Drive`."""


def make_grid(inputs: Inputs, length: float | Callable[[FloatArray], FloatArray]) -> FloatArray:
    """Grid points [K+1] s, at all breaks and so close together that no step is much longer than `length` s.

    length: the same everywhere, or a function of time [.] -> [.] that varies slowly; then steps end at corners too,
    where these are not much closer together than that.
    """
    breaks = inputs.breaks
    if callable(length) and len(inputs.corners):
        spaced = np.diff(np.concatenate([breaks[:1], inputs.corners])) > _CLOSE * length(inputs.corners)
        breaks = _apart(np.concatenate([breaks, inputs.corners[spaced]]))
    settling = np.add.outer(inputs.settling, _SETTLING).ravel()
    between = _evenly(breaks, length) if callable(length) else _equally(breaks, length)
    return np.unique(np.concatenate([breaks, between, settling[settling < breaks[-1]]]))


def _equally(breaks: FloatArray, length: float) -> FloatArray:
    """Between breaks [B] s, the fewest steps of one length each that are at most so long."""
    steps = np.maximum(1, np.ceil(np.diff(breaks) / length - 1e-9)).astype(int)
    between = zip(breaks[:-1], breaks[1:], steps, strict=True)
    return np.concatenate([np.linspace(begin, end, count, endpoint=False) for begin, end, count in between])


def _evenly(breaks: FloatArray, length: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """Between breaks [B] s, as many steps as the density 1 / length has room for, each with the same share of it."""
    fine = breaks[:-1, None] + _LOOKED_AT * np.diff(breaks)[:, None]
    density = 1.0 / length((0.5 * (fine[:, 1:] + fine[:, :-1])).ravel()).reshape(len(fine), -1)
    covered = np.cumsum(density * np.diff(fine), axis=1)
    whole = covered[:, -1]
    steps = np.maximum(1, np.ceil(whole - _LONGER)).astype(int)
    before = np.concatenate([[0.0], np.cumsum(whole)])
    interval = np.repeat(np.arange(len(steps)), steps)
    place = np.arange(len(interval)) - np.repeat(np.cumsum(steps) - steps, steps)
    wanted = (before[interval] + place * (whole / steps)[interval])[place > 0]
    ends = np.concatenate([[0.0], (before[:-1, None] + covered).ravel()])
    return np.interp(wanted, ends, np.concatenate([breaks[:1], fine[:, 1:].ravel()]))


def drive_on(inputs: Inputs, grid: FloatArray) -> Drive:
    """The inputs in the steps of a grid [K+1]: in each step the line that is nearest to them in the mean square.

    So what a step gets in all, and its centre of gravity in time, are exact, however long the step. A jump that
    massless nodes follow takes as long as their settling: one at once throws a node that only radiates far off.
    """
    times = inputs.times.copy()
    jumps = 1 + np.flatnonzero((np.diff(times) == 0.0) & np.isin(times[1:], inputs.settling))
    times[jumps] += _SETTLING[-1]
    ends = in_steps(times, inputs.values, grid)
    middle = 0.5 * (grid[1:] + grid[:-1])
    driven = inputs.driven[np.searchsorted(inputs.times, middle) - 1]
    return Drive(grid, np.ascontiguousarray(ends.T), driven, inputs.initially_on)


def divided(drive: Drive, times: FloatArray) -> Drive:
    """The same with steps that end at these times [.] s too, those aside that are next to the end of a step."""
    after = np.searchsorted(drive.times, times).clip(1, len(drive.times) - 1)
    inside = (times - drive.times[after - 1] > _CLOSEST) & (drive.times[after] - times > _CLOSEST)
    grid = np.union1d(drive.times, times[inside])
    step = np.searchsorted(drive.times, 0.5 * (grid[1:] + grid[:-1])) - 1
    length = np.diff(drive.times)[step]
    first, last = drive.inputs[step, 0], drive.inputs[step, 1]
    shares = [(edges - drive.times[step]) / length for edges in (grid[:-1], grid[1:])]
    inputs = np.stack([first + share[:, None] * (last - first) for share in shares], axis=1)
    return Drive(grid, inputs, drive.measured[step], drive.initially_on)


def in_steps(times: FloatArray, values: FloatArray, grid: FloatArray) -> FloatArray:
    """Values [q, M] that are linear between times [M] as the nearest line in each step of a grid [K+1]: [q, 2, K].

    Times do not decrease and cover the grid; two at the same time mark a jump.
    """
    return spread(step_weights(times, grid), values)


def spread(weights: csr_array, values: FloatArray) -> FloatArray:
    """The same of values [q, M], by the `step_weights` of their times: [q, 2, K]."""
    return np.asarray((weights @ values.T).T).reshape(len(values), 2, weights.shape[0] // 2)


def step_weights(times: FloatArray, grid: FloatArray) -> csr_array:
    """What `in_steps` makes of values at times [M]: [2 K, M], of the beginnings of all steps, and of their ends."""
    extra = np.setdiff1d(grid, times)
    right = np.searchsorted(times, extra)
    share = (extra - times[right - 1]) / (times[right] - times[right - 1])
    # Each point of both is a mean of two values, the second of weight `share`.
    sample = np.arange(len(times))
    before, after = np.insert(sample, right, right - 1), np.insert(sample, right, right)
    share = np.insert(np.zeros(len(times)), right, share)
    times = np.insert(times, right, extra)
    cell = np.flatnonzero(np.diff(times) > 0.0)
    step = np.searchsorted(grid, times[cell], side="right") - 1
    length = np.diff(grid)[step]
    u0, u1 = (times[cell] - grid[step]) / length, (times[cell + 1] - grid[step]) / length
    rows, columns, weights = [], [], []
    # A step's line is 4 means less 6 first moments where it begins, and 6 moments less 2 means where it ends.
    for point, moment in ((cell, 2.0 * u0 + u1), (cell + 1, u0 + 2.0 * u1)):
        for of_steps, weight in ((step, 2.0 - moment), (len(grid) - 1 + step, moment - 1.0)):
            weight = weight * (u1 - u0)
            for column, part in ((before[point], 1.0 - share[point]), (after[point], share[point])):
                rows.append(of_steps)
                columns.append(column)
                weights.append(weight * part)
    places = (np.concatenate(rows), np.concatenate(columns))
    found = csr_array((np.concatenate(weights), places), shape=(2 * (len(grid) - 1), len(sample)))
    found.eliminate_zeros()
    return found


def window_inputs(
    scenario: Scenario,
    network: Network,
    telemetry: xarray.Dataset,
    start: np.datetime64,
    end: np.datetime64,
    samples: Times,
    *,
    period: float,
) -> Inputs:
    """What acts in a window, until its end or the last of `samples` [T].

    Raises TelemetryError when a driver cannot be bridged over a gap, or heaters driven by measurement lack status.
    """
    model = scenario.network
    end = max(end, samples[-1]) if len(samples) else end
    duration = float(_seconds(np.array([end]), start)[0])
    fine = _fineness(scenario)
    points_needed = duration / max(fine, _CLOSEST)
    what = f"window from {start} to {end}: what acts on the nodes at {points_needed:.3g} times"
    require_memory(8 * _COPIES * points_needed * len(network.columns), what)

    def inside(times: Times | Sequence[Any]) -> FloatArray:
        seconds = np.unique(_seconds(np.array(times, dtype="datetime64[ns]"), start))
        return seconds[(seconds > 0.0) & (seconds < duration)]

    changes = _seconds(np.array([change.at for change in model.timeline], dtype="datetime64[ns]"), start)
    eclipse = scenario.environment.eclipse
    flagged = inside([] if eclipse is None else status_changes(telemetry, eclipse.measured_by))
    jumps = np.union1d(inside([change.at for change in model.timeline]), flagged)
    # A measured switch lies anywhere between two samples: in between the heater has half of its power.
    switched = inside([time for name in filter(None, _driving(scenario)) for time in switch_bounds(telemetry, name)])
    kinks = inside(_kinks(scenario, start, end))
    breaks = _apart(np.concatenate([[0.0], jumps, switched, kinks, [duration]]))
    channels = scenario.telemetry.channels
    fills: dict[str, Any] = {load.driver: channels[load.driver].bridge for load in model.loads.values()}
    fills |= {node.boundary: "interpolate" for node in model.nodes.values() if isinstance(node.boundary, str)}
    bends = [driver_corners(telemetry, name, fill, period) for name, fill in fills.items()]
    corners = inside(np.concatenate([sample_times(scenario.environment, scenario.folder), *bends]))
    known = _apart(np.concatenate([breaks, corners]))
    # At least a few in each stretch: in a penumbra of seconds sunlight is no straight line.
    least = _PARTS if np.isfinite(fine) else 1
    counts = np.minimum(np.maximum(least, np.ceil(np.diff(known) / fine)), np.diff(known) / _CLOSEST)
    counts = np.maximum(1, counts).astype(int)
    points = np.concatenate(
        [np.linspace(a, b, count, endpoint=False) for a, b, count in zip(known[:-1], known[1:], counts, strict=True)]
        + [known[-1:]]
    )
    points = np.sort(np.concatenate([points, points[np.searchsorted(points, jumps - 1e-6)]]))
    times = seconds_later(start, points)

    series = {"one": np.ones(len(points))}
    series |= face_series(scenario, times, None if eclipse is None else _sunlit(telemetry, eclipse.measured_by, times))
    for mode, active in _mode_indicators(scenario, points, changes).items():
        series[f"mode.{mode}"] = active
    for name, load in model.loads.items():
        measured = driver_series(telemetry, load.driver, times, fill=fills[load.driver], period=period)
        series[f"driver.{name}"] = load_driver(load, channels[load.driver])(measured)
    for name, node in model.nodes.items():
        if isinstance(node.boundary, str):
            measured = driver_series(telemetry, node.boundary, times, fill="interpolate", period=period)
            series[f"temperature.{name}"] = measured
            series[f"temperature2.{name}"] = measured**2
            series[f"temperature4.{name}"] = measured**4
    series |= {f"heat.{name}": np.zeros(len(points)) for name in network.heated}
    middle = 0.5 * (points[1:] + points[:-1])
    return Inputs(
        times=points,
        values=np.stack([series[column] for column in network.columns]),
        driven=_measured_heaters(scenario, telemetry, start, breaks)[np.searchsorted(breaks, middle) - 1],
        breaks=breaks,
        corners=corners,
        settling=np.empty(0) if network.structure.mass.all() else np.array([0.0, *jumps]),
        initially_on=_initial_status(scenario, telemetry, start),
    )


def _kinks(scenario: Scenario, start: np.datetime64, end: np.datetime64) -> Times:
    """When sunlight on a face begins or ends, or changes its course."""
    faces, environment = scenario.network.faces, scenario.environment
    if not faces or environment.orbit is None:
        return np.empty(0, "datetime64[ns]")
    edges = shadow_edges(environment, start, end, scenario.folder)
    edges = np.concatenate([edges, slew_edges(environment)])
    normals = list(dict.fromkeys(face.normal for face in faces.values()))
    turns = sun_edges(environment, normals, start, end, scenario.folder)
    # Of a body that spins quickly they would be the steps of the integration; there means will do.
    often = len(turns) * _CLOSEST_EDGES > (end - start) / np.timedelta64(1, "s")
    return edges if often else np.concatenate([edges, turns])


def _fineness(scenario: Scenario) -> float:
    """How far apart, in s, the inputs are looked up: linear in between."""
    model, attitude = scenario.network, scenario.environment.attitude
    fine = _FINE if model.faces or any(isinstance(node.boundary, str) for node in model.nodes.values()) else np.inf
    if isinstance(attitude, SpinningAttitude) and attitude.period is not None and model.faces:
        fine = min(fine, attitude.period / _TURN_PARTS)
    return fine if model.step is None else min(fine, model.step)


def _apart(points: FloatArray) -> FloatArray:
    """Points in order, of those closer together than a microsecond the first; the last stays where it is."""
    points = np.unique(points)
    found = points[np.concatenate([[True], np.diff(points) > 1e-6])]
    found[-1] = points[-1]
    return np.asarray(found)


def _sunlit(telemetry: xarray.Dataset, flag: str, times: Times) -> FloatArray:
    """[M] 1 in sunlight, 0 in the shadow as a flag has it, NaN where that is not known, at times [M].

    Of two points at the same time, the first has what was before.
    """
    lasting = np.diff(times) > np.timedelta64(0, "ns")
    edges = times[np.concatenate([[True], lasting])]
    lit = 1.0 - status_or_unknown(telemetry, flag, edges)
    after = np.searchsorted(edges, times, side="right") - 1
    before = np.concatenate([~lasting, [True]])  # its twin comes next
    return np.asarray(lit[np.clip(after - before, 0, len(lit) - 1)])


def face_series(
    scenario: Scenario, times: Times, sunlit: FloatArray | None = None, rings: int = RINGS
) -> dict[str, FloatArray]:
    """Input series of the faces by column, such as ``solar.<face>`` [K] (W/m^2), at `times` [K]; see `flux_kinds`.

    sunlit, rings: see `face_fluxes`.
    """
    faces = scenario.network.faces
    if not faces:
        return {}
    # Many faces of a meshed spacecraft look the same way.
    ways = {face.normal: str(k) for k, face in enumerate(faces.values())}
    normals: dict[str, FaceNormal] = {way: normal for normal, way in ways.items()}
    turned = {
        f"{way}{axis}{sign}": _turned(normal, axis, sign)
        for way, normal in normals.items()
        for axis in ("xyz" if scenario.environment.attitude_offset is not None else "")
        for sign in (1, -1)
    }
    fluxes = face_fluxes(scenario.environment, normals | turned, times, scenario.folder, sunlit=sunlit, rings=rings)
    place = {way: k for k, way in enumerate(fluxes.names)}
    series = {}
    for name, face in faces.items():
        way = ways[face.normal]
        for kind in flux_kinds(scenario):
            flux, _, axis = kind.partition("_")
            of_kind = getattr(fluxes, flux)
            series[f"{kind}.{name}"] = (
                (of_kind[:, place[f"{way}{axis}1"]] - of_kind[:, place[f"{way}{axis}-1"]]) / (2.0 * _TURN)
                if axis
                else of_kind[:, place[way]]
            )
    return series


def _turned(normal: FaceNormal, axis: str, sign: int) -> FaceNormal:
    """A face's normal in the body's frame as it was before the body was turned by a small angle about its axis."""
    if normal == "all":
        return normal
    if isinstance(normal, SunTracking):
        return normal.model_copy(update={"tracks_sun_about": _turned(normal.tracks_sun_about, axis, sign)})
    turn = np.zeros(3)
    turn["xyz".index(axis)] = sign * _TURN
    unit = np.array(normal) / np.linalg.norm(normal)
    x, y, z = (unit + np.cross(turn, unit)).tolist()
    return x, y, z


def _seconds(times: Times, start: np.datetime64) -> FloatArray:
    return (times - start) / np.timedelta64(1, "ns") * 1e-9


def _mode_indicators(scenario: Scenario, grid: FloatArray, changes: FloatArray) -> dict[str, FloatArray]:
    """1 while in the mode; before the first change the timeline's first mode holds."""
    model = scenario.network
    modes = tuple(model.modes)
    if not modes:
        return {}
    if not model.timeline:
        return {mode: np.ones(len(grid)) for mode in modes[:1]} | {mode: np.zeros(len(grid)) for mode in modes[1:]}
    second = np.concatenate([[False], np.diff(grid) == 0.0])  # the later one of two points at the same time
    later = np.searchsorted(changes, grid + np.where(second, 1e-6, -1e-6), side="right")
    later = np.where(grid == 0.0, np.searchsorted(changes, 1e-6, side="right"), later)
    active = [model.timeline[max(k - 1, 0)].mode for k in later]
    return {mode: np.array([float(name == mode) for name in active]) for mode in modes}


def _driving(scenario: Scenario) -> list[str | None]:
    """Channels of the measured status that drives the heaters."""
    if scenario.network.heater_input != "measured":
        return []
    return [heater.measured_by for heater in scenario.network.switches.values()]


def _measured_heaters(
    scenario: Scenario, telemetry: xarray.Dataset, start: np.datetime64, breaks: FloatArray
) -> FloatArray:
    """[B - 1, H] between breaks [B] s, see `Inputs`: the same all the time between two samples that show a switch."""
    edges = seconds_later(start, breaks)
    measured = np.full((len(edges) - 1, len(scenario.network.switches)), np.nan)
    for k, channel in enumerate(_driving(scenario)):
        if channel is not None:
            measured[:, k] = status_fraction(telemetry, channel, edges)
    return measured


def _initial_status(scenario: Scenario, telemetry: xarray.Dataset, start: np.datetime64) -> FloatArray:
    """State of the heaters at the window's start: the nearest valid status sample, else what the scenario says.

    Samples after the initial span are scored in unseen windows, so they are not looked at.
    """
    state = []
    latest = start + np.timedelta64(round(scenario.calibration.prediction.initial_span * 1e9), "ns")
    for heater in scenario.network.switches.values():
        state.append(float(heater.initially_on))
        if heater.measured_by is not None:
            valid = telemetry[heater.measured_by].sel(time=slice(None, latest)).dropna("time")
            if valid.sizes["time"]:
                state[-1] = float(valid.sel(time=start, method="nearest").item() > 0.5)
    return np.array(state)
