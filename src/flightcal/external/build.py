"""The simulator that is not ours which a scenario describes."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import xarray

from ..errors import require
from ..scenario import (
    CallableSimulator,
    ExecutableSimulator,
    ExternalModel,
    FmuSimulator,
    Scenario,
    UmbridgeSimulator,
)
from ..simulator import FloatArray, IntArray, Times
from ..telemetry import driver_series
from .callable import FunctionDescription
from .executable import ExecutableProgram
from .fmu import FmuDescription
from .in_worker import WorkerProgram
from .program import ExternalProgram
from .simulator import ExternalSimulator, external_simulator
from .umbridge import ServerDescription


def build_external(
    scenario: Scenario,
    telemetry: xarray.Dataset,
    start: np.datetime64,
    end: np.datetime64,
    samples: Times,
    *,
    period: float,
) -> ExternalSimulator:
    """The external simulator of a scenario on the window [start, end], observed at `samples` [T] (UTC).

    Nothing that is not ours runs or is imported before the first simulation. Raises ScenarioError and TelemetryError.
    """
    model = scenario.simulator
    assert isinstance(model, ExternalModel)
    times = _seconds(samples, start)
    program = _program(scenario, model, telemetry, start, end, times, period)
    return external_simulator(scenario, model, program, times, float(_seconds(end, start)))


def _program(
    scenario: Scenario,
    model: ExternalModel,
    telemetry: xarray.Dataset,
    start: np.datetime64,
    end: np.datetime64,
    times: FloatArray,
    period: float,
) -> ExternalProgram:
    folder = scenario.folder.absolute()
    outputs = tuple(output.name or name for name, output in model.outputs.items())
    heaters = tuple(heater.name or name for name, heater in model.heaters.items())
    if isinstance(model, ExecutableSimulator):
        return ExecutableProgram(model.executable, folder, _utc(start), _utc(end), times, outputs, heaters)
    if isinstance(model, CallableSimulator):
        function = model.callable
        in_jax, place = function.gradient == "jax", folder / function.file
        if in_jax:
            require("jax", "jax", "simulator: gradient: jax")
        return WorkerProgram(
            FunctionDescription(
                place, function.function, in_jax, _utc(start), times, outputs, heaters, _modified(place)
            )
        )
    if isinstance(model, UmbridgeSimulator):
        require("umbridge", "umbridge", "simulator")
        server = model.umbridge
        config = {**server.config, "start": _utc(start).isoformat(), "times": times.tolist()}
        return WorkerProgram(ServerDescription(server.url, server.model, config, len(times), outputs, heaters))
    assert isinstance(model, FmuSimulator)
    require("fmpy", "fmu", "simulator")
    grid, samples = communication_points(times, model.fmu.step)
    at = start + np.round(grid * 1e9).astype("timedelta64[ns]")
    drivers = {
        variable: driver_series(telemetry, channel, at, fill=scenario.telemetry.channels[channel].bridge, period=period)
        for variable, channel in model.fmu.drivers.items()
    }
    place = folder / model.fmu.file
    return WorkerProgram(FmuDescription(place, grid, samples, drivers, outputs, heaters, _modified(place)))


def communication_points(times: FloatArray, step: float | None) -> tuple[FloatArray, IntArray]:
    """Points [K] s from 0 to the last of the times [T], no further apart than `step`, and where the times are [T]."""
    fixed = np.unique(np.concatenate([[0.0], times]))
    gaps = np.diff(fixed)
    counts = np.ones(len(gaps), int) if step is None else np.maximum(1, np.ceil(gaps / step - 1e-9).astype(int))
    parts = [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(fixed[:-1], fixed[1:], counts, strict=True)]
    grid = np.concatenate([*parts, fixed[-1:]])
    return grid, np.searchsorted(grid, times)


def _modified(file: Path) -> int:
    try:
        return file.stat().st_mtime_ns
    except OSError:
        return 0  # the first run says what is wrong


def _utc(time: np.datetime64) -> datetime:
    utc: datetime = time.astype("datetime64[us]").item()
    return utc


def _seconds(time: Any, start: np.datetime64) -> Any:
    return (time - start) / np.timedelta64(10**9, "ns")  # whole seconds come out exact
