"""A reduction in a folder: the reduced model, its certificate, and a scenario that calibrates through it."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..errors import RunError
from ..progress import SILENT, Progress
from ..run import REDUCED, hash_of, hash_of_file, numbers_told, read_json, write_json, write_text
from ..scenario import (
    Channel,
    InitialState,
    Observation,
    Scenario,
    TelemetryFile,
    TimeColumn,
    Window,
    input_files,
    resolved_yaml,
)
from .certificate import certificate, certificate_lines, measure_speed, sensor_errors
from .file import Task, load_task, written_time
from .full_heat import full_heat
from .reduce import Reduced, reduce
from .reduced_model import ReducedModel
from .reduced_scenario import reduced_scenario
from .schema import FlightWindow
from .storage import load, save, stored_of
from .thermostats import switching_shifts

MODEL_FILE, CERTIFICATE = "reduced_model.nc", "certificate.json"
_FILES = ("certificate.txt", "scenario.yaml", MODEL_FILE, CERTIFICATE)
"""In the order in which they are written: the last one says that all are there."""
_OF_SCENARIO = {"name", "description", "telemetry", "windows", "calibration"}
"""What of a reduction file the reduced model does not hang on."""
_BELIEVABLE = ("-200 degC", "300 degC")


@numbers_told("reduction", "check the spacecraft's capacities and links, and the priors of the parameters")
def reduce_to_folder(path: Path, out: Path, progress: Progress = SILENT) -> list[str]:
    """Reduce what the file at `path` names; nothing is overwritten. Returns the certificate, and what was written.

    Raises ScenarioError, RunError where `out` holds something already, and FlightcalError where a simulation fails.
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise RunError(f"{out}: found something there, expected a new or empty folder: nothing is overwritten")
    task = load_task(path)
    reduced = _as_the_software_switches(task, reduce(task, progress))
    with progress.stage("measuring the speed"):
        speed = measure_speed(task, reduced)
    content = certificate(task, reduced, speed)
    lines = certificate_lines(content)
    out.mkdir(parents=True, exist_ok=True)
    write_text(out / "certificate.txt", "\n".join(lines) + "\n")
    block = reduced_scenario(task.scenario, reduced.model, task.reduction.step).network
    stored = stored_of(reduced.model, task.scenario, block, sensor_errors(task, reduced), full_heat(task))
    save(out / MODEL_FILE, stored)
    write_text(out / "scenario.yaml", _scenario_text(task, reduced.model, path, out, MODEL_FILE))
    write_json(out / CERTIFICATE, {"made_from": _made_from(path, task), **content})
    return [*lines, *(f"wrote {out / name}" for name in _FILES)]


def scenario_of(path: Path, out: Path, progress: Progress = SILENT) -> Path:
    """A scenario of the reduction file at `path`, to calibrate in the folder `out`; it is written in `reduced` there.

    Its reduced model is that of the folder `reduced` beside the file, or else of the one in `out`, where that was made
    from the same. Otherwise it is made in `out`. Raises ScenarioError, and RunError where `out` holds something else.
    """
    task, reduced_path = load_task(path), out / REDUCED
    origin = _made_from(path, task)
    kept = [folder for folder in (path.parent / REDUCED, reduced_path) if _is_from(folder, origin)]
    if not kept:
        if out.exists() and (not out.is_dir() or {file.name for file in out.iterdir()} - {REDUCED}):
            raise RunError(f"{out}: found something else than a run of {path} as it is, expected a new or empty folder")
        for name in _FILES if reduced_path.is_dir() else ():
            (reduced_path / name).unlink(missing_ok=True)
        for line in reduce_to_folder(path, reduced_path, progress):
            progress.say(line)
        kept = [reduced_path]
    reduced_path.mkdir(parents=True, exist_ok=True)
    file = kept[0] / MODEL_FILE
    text = _scenario_text(task, load(file).model, path, reduced_path, os.path.relpath(file, reduced_path))
    write_text(reduced_path / "scenario.yaml", text)
    return reduced_path / "scenario.yaml"


def _is_from(folder: Path, origin: str) -> bool:
    certificate = folder / CERTIFICATE
    return certificate.is_file() and read_json(certificate).get("made_from") == origin


def _made_from(path: Path, task: Task) -> str:
    """Hash of what a reduced model follows from: the reduction file at `path`, its spacecraft and that one's files."""
    files = [path.parent / task.reduction.spacecraft, *map(Path, input_files(task.scenario))]
    asked = task.reduction.model_dump(mode="json", exclude=_OF_SCENARIO)
    return hash_of(list(map(hash_of_file, files)), asked)


def _as_the_software_switches(task: Task, reduced: Reduced) -> Reduced:
    """Its thermostats where the on-board software really switches; the certificate compares without."""
    shifts = switching_shifts(task.mission)
    model = reduced.model
    return replace(reduced, model=replace(model, shifts=tuple(shifts[name] for name in model.heaters)))


def _scenario_text(task: Task, reduced: ReducedModel, path: Path, out: Path, file: str) -> str:
    """A scenario for the telemetry of the spacecraft file's flight; file: of the reduced model, from `out`."""
    flight = FlightWindow.model_construct(start=written_time(task.mission.start), end=None, orbits=1.0, timeline=None)
    flown = task.with_timeline(flight)
    scenario = reduced_scenario(task.scenario, reduced, task.reduction.step)
    model = scenario.network.model_copy(update={"reduced_model": file, "checked_on": os.path.relpath(path, out)})
    channels = {
        # No thermistor reads what lies outside of this: it is a mark of the ground's.
        name: Channel.model_construct(column=(name,), kind="temperature", unit="degC", valid_range=_BELIEVABLE)
        for name in scenario.observations
    }
    statuses = {f"{name}_status": f"heater.{name}" for name in model.heaters}
    channels |= {name: Channel.model_construct(column=(column,), kind="status") for name, column in statuses.items()}
    heaters = {
        name: heater.model_copy(update={"measured_by": f"{name}_status"}) for name, heater in model.switches.items()
    }
    status = {f"{name}_status": Observation.model_construct(heater=name) for name in model.heaters}
    telemetry = os.path.relpath(path.parent / task.reduction.telemetry, out)
    chosen = Scenario.model_construct(
        name=task.reduction.name,
        description=f"Written by flightcal reduce: {task.reduction.method} with {len(reduced.states)} states",
        telemetry=TelemetryFile.model_construct(
            file=(telemetry,), time=TimeColumn.model_construct(column=("time",)), channels=channels
        ),
        environment=scenario.environment,
        simulator=model.model_copy(
            update={"heaters": heaters, "timeline": flown.network.timeline, "step": task.reduction.step}
        ),
        initial_state=InitialState(),
        parameters=scenario.parameters,
        observations={**scenario.observations, **status},
        windows=_windows(task),
        calibration=task.reduction.calibration,
        folder=out,
    )
    return resolved_yaml(chosen)


def _windows(task: Task) -> dict[str, Window]:
    """Those of the file, or two orbits after the settling and the two that follow."""
    if task.reduction.windows:
        return dict(task.reduction.windows)
    start = task.mission.start + np.timedelta64(round(task.settling), "s")
    later = start + np.timedelta64(round(2.0 * task.period), "s")
    return {
        name: Window.model_construct(start=written_time(time), orbits=2.0)
        for name, time in (("train", start), ("test", later))
    }
