"""The grid of the integration and the input series on it: sunlight, modes, measured drivers, measured heaters."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray
from numpy.typing import NDArray

from ..environment import face_fluxes, shadow_edges
from ..errors import TelemetryError
from ..scenario import Scenario
from ..telemetry import driver_series, status_fraction
from .network import Network, flux_kinds
from .sampling import Sampling, locate
from .system import Drive, FloatArray

_SETTLING = np.array([1e-4, 2e-4, 3e-4])  # s; steps so short bring massless nodes into balance and move no other

_TURN = np.deg2rad(2.0)
"""By which attitudes are turned to either side for the slope of a flux, which has kinks where a face loses the Sun."""

Times = NDArray[np.datetime64]


def make_grid(
    duration: float, step: float, samples: FloatArray, kinks: FloatArray, jumps: FloatArray, settle: bool
) -> FloatArray:
    """Grid points [K+1] s from 0 to `duration`, no further apart than `step`.

    The samples are grid points unless they are denser than half a step (then outputs are interpolated); so are
    the kinks of the inputs; a jump stands twice, once for each side. The start and every jump are followed by settling
    steps if `settle`.
    """
    jumps = np.unique(jumps[(jumps > 0) & (jumps < duration)])
    fixed = [np.array([0.0, duration]), kinks[(kinks > 0) & (kinks < duration)], jumps]
    if len(samples) > 1 and np.median(np.diff(samples)) >= 0.5 * step:
        fixed.append(samples[(samples > 0) & (samples < duration)])
    points = np.unique(np.concatenate(fixed))
    # Points closer together than a microsecond are one point.
    points = points[np.concatenate([[True], np.diff(points) > 1e-6])]
    counts = np.maximum(1, np.ceil(np.diff(points) / step - 1e-9).astype(int))
    grid = np.concatenate(
        [np.linspace(a, b, count, endpoint=False) for a, b, count in zip(points[:-1], points[1:], counts, strict=True)]
        + [points[-1:]]
    )
    twice = grid[np.searchsorted(grid, jumps - 1e-6)]
    settling = np.add.outer([0.0, *twice], _SETTLING).ravel() if settle else np.empty(0)
    return np.sort(np.concatenate([grid, twice, settling]))


def build_drive(
    scenario: Scenario,
    network: Network,
    telemetry: xarray.Dataset,
    start: np.datetime64,
    end: np.datetime64,
    samples: Times,
    *,
    period: float,
) -> tuple[Drive, Sampling]:
    """Grid, inputs and wiring of a window, and where `samples` [T] lie on the grid.

    Raises TelemetryError when a driver cannot be bridged over a gap, or heaters driven by measurement lack status.
    """
    model = scenario.network
    relative = _seconds(samples, start)
    duration = max(float(_seconds(np.array([end]), start)[0]), float(relative[-1]) if len(relative) else 0.0)
    changes = _seconds(np.array([change.at for change in model.timeline], dtype="datetime64[ns]"), start)
    kinks = np.empty(0)
    if model.faces and scenario.environment.orbit is not None:
        kinks = _seconds(shadow_edges(scenario.environment, start, end, scenario.folder), start)
    grid = make_grid(duration, model.step, relative, kinks, changes, settle=not network.structure.mass.all())
    times = start.astype("datetime64[ns]") + np.round(grid * 1e9).astype("timedelta64[ns]")
    steps = len(grid) - 1

    series = {"one": np.ones(len(grid))}
    series |= face_series(scenario, times)
    for mode, active in _mode_indicators(scenario, grid, changes).items():
        series[f"mode.{mode}"] = active
    for name, load in model.loads.items():
        series[f"driver.{name}"] = driver_series(
            telemetry, load.driver, times, fill=scenario.telemetry.channels[load.driver].fill, period=period
        )
    for name, node in model.nodes.items():
        if isinstance(node.boundary, str):
            measured = driver_series(telemetry, node.boundary, times, fill="interpolate", period=period)
            series[f"temperature.{name}"] = measured
            series[f"temperature4.{name}"] = measured**4

    drive = Drive(
        times=grid,
        inputs=np.stack([series[column] for column in network.columns], axis=1),
        measured=_measured_heaters(scenario, telemetry, times, steps),
        initially_on=_initial_status(scenario, telemetry, start),
    )
    return drive, locate(relative, grid)


def face_series(scenario: Scenario, times: Times) -> dict[str, FloatArray]:
    """Input series of the faces by column, such as ``solar.<face>`` [K] (W/m^2), at `times` [K]; see `flux_kinds`."""
    faces = scenario.network.faces
    if not faces:
        return {}
    # Many faces of a meshed spacecraft look the same way.
    ways = {face.normal: str(k) for k, face in enumerate(faces.values())}
    normals: dict[str, Any] = {way: normal for normal, way in ways.items()}
    turned = {
        f"{way}{axis}{sign}": _turned(normal, axis, sign)
        for way, normal in normals.items()
        for axis in ("xyz" if scenario.environment.attitude_offset is not None else "")
        for sign in (1, -1)
    }
    fluxes = face_fluxes(scenario.environment, normals | turned, times, scenario.folder)
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


def _turned(normal: Any, axis: str, sign: int) -> Any:
    """A face's normal in the body's frame as it was before the body was turned by a small angle about its axis."""
    if normal == "all":
        return normal
    turn = np.zeros(3)
    turn["xyz".index(axis)] = sign * _TURN
    unit = np.array(normal) / np.linalg.norm(normal)
    return tuple((unit + np.cross(turn, unit)).tolist())


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


def _measured_heaters(scenario: Scenario, telemetry: xarray.Dataset, times: Times, steps: int) -> FloatArray:
    heaters = scenario.network.heaters
    measured = np.full((steps, len(heaters)), np.nan)
    if scenario.network.heater_input == "measured":
        for k, (name, heater) in enumerate(heaters.items()):
            if heater.measured_by is None:
                raise TelemetryError(
                    f"heater '{name}' is to be driven by its measured status, but has no 'measured_by' channel"
                )
            # A jump's step of length zero has no share of anything; the integration skips it.
            lasting = np.diff(times) > np.timedelta64(0, "ns")
            edges = times[np.concatenate([[True], lasting])]
            measured[lasting, k] = status_fraction(telemetry, heater.measured_by, edges)
            measured[~lasting, k] = 0.0
    return measured


def _initial_status(scenario: Scenario, telemetry: xarray.Dataset, start: np.datetime64) -> FloatArray:
    """State of the heaters at the window's start: the nearest valid status sample, else what the scenario says.

    Samples after the initial span are scored in unseen windows, so they are not looked at.
    """
    state = []
    latest = start + np.timedelta64(round(scenario.calibration.prediction.initial_span * 1e9), "ns")
    for heater in scenario.network.heaters.values():
        state.append(float(heater.initially_on))
        if heater.measured_by is not None:
            valid = telemetry[heater.measured_by].sel(time=slice(None, latest)).dropna("time")
            if valid.sizes["time"]:
                state[-1] = float(valid.sel(time=start, method="nearest").item() > 0.5)
    return np.array(state)
