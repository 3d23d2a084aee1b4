"""A campaign's folder: what is run, at which thetas, and the records of the runs.

- campaign.json: hashes of the simulator, its inputs and the design; versions
- scenario.yaml: the scenario, resolved
- design.nc: theta [run, parameter], and the names and times of what a run gives
- runs/: the records (`RunStore`)
- campaign.lock: held by the one process that runs the campaign
"""

from __future__ import annotations

import json
import platform
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray

from ..errors import RunError
from ..probability import GROWING
from ..run import labelled, read_dataset, sweep, write_json, write_netcdf, write_text
from ..run import locked as held
from ..simulator import FloatArray
from .store import DamagedRecord, RunStore
from .subject import Subject

_LABELS: Final = {
    "theta": ("SI", "value of each parameter, in its own SI unit"),
    "temperatures": ("K", "simulated temperature"),
    "status": ("1", "simulated status of the heater"),
    "outcome": ("", "how the run ended"),
    "message": ("", "what a run that failed says"),
    "attempts": ("1", "times that the run was tried"),
    "seconds": ("s", "how long the run took"),
}
"""Variable -> its unit and what it is."""
NOT_RUN: Final = "not run"
DAMAGED: Final = "damaged"
_DESCRIPTION, _DESIGN, _SCENARIO = "campaign.json", "design.nc", "scenario.yaml"
_LOCK, _RUNS = "campaign.lock", "runs"
_BEFORE_DESCRIPTION: Final = (_DESIGN, _SCENARIO, _LOCK, _RUNS)
"""What there may be of a campaign that was killed before its description was written."""


@dataclass(frozen=True)
class Design:
    """The thetas of a campaign and where they come from."""

    kind: str
    seed: int
    origin: Mapping[str, Any]
    """What else the thetas follow from, such as the hash of the priors, by a name that a message can say."""
    theta: FloatArray
    """[S, d]."""


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Create the folder if need be, and hold it. The system lets go of the lock of a process that is killed.

    Raises RunError where another process holds it, or where the folder cannot be a campaign's.
    """
    if folder.exists() and not folder.is_dir():
        raise RunError(f"{folder}: found a file, expected a folder for the campaign")
    if folder.exists() and not (folder / _DESCRIPTION).exists():
        names = [file.name for file in folder.iterdir()]
        foreign = [name for name in names if name not in _BEFORE_DESCRIPTION and not name.startswith(".")]
        if foreign:
            raise RunError(f"{folder}: the folder holds {foreign[0]} but no campaign; expected an empty or new folder")
    folder.mkdir(parents=True, exist_ok=True)
    with held(folder, _LOCK):
        sweep(folder)
        yield


def prepare(folder: Path, subject: Subject, design: Design) -> RunStore:
    """Describe the campaign in its folder, or check that the folder's is the same one, perhaps to be grown.

    The folder is locked. Raises RunError where the simulator, its inputs or the design are others.
    """
    description: dict[str, Any] = {
        "identity": subject.identity,
        "parts": dict(subject.parts),
        "inputs": dict(subject.inputs),
        "design": {"kind": design.kind, "seed": design.seed, **design.origin},
    }
    file = folder / _DESCRIPTION
    if file.exists():
        found = _read_description(folder)
        _check_subject(folder, found, subject)
        _check_design(folder, found["design"], description["design"])
    if not file.exists() or _extends(folder, design):
        write_netcdf(folder / _DESIGN, _described(subject, design))
    (folder / _RUNS).mkdir(exist_ok=True)
    if not file.exists():
        write_text(folder / _SCENARIO, subject.text)
        made_with = {"flightcal": metadata.version("flightcal"), "python": platform.python_version()}
        write_json(file, {**description, "made_with": made_with})
    return RunStore(folder / _RUNS, subject.identity)


def open_campaign(folder: Path | str) -> xarray.Dataset:
    """All runs of a campaign, also of one that is still running, in memory.

    theta [run, parameter] SI; temperatures [run, time, channel] K and status [run, time, heater], NaN where a run did
    not finish; outcome, message, attempts and seconds [run]. The outcome of a run that is still to be done is
    'not run', of one whose file is not whole, 'damaged'. Raises RunError for a folder that holds no campaign.
    """
    folder = Path(folder)
    identity = _read_description(folder)["identity"]
    data = read_dataset(folder / _DESIGN)
    store = RunStore(folder / _RUNS, identity)
    runs, times, channels, heaters = (data.sizes[name] for name in ("run", "time", "channel", "heater"))
    temperatures, status = np.full((runs, times, channels), np.nan), np.full((runs, times, heaters), np.nan)
    outcome, message, attempts, seconds = [NOT_RUN] * runs, [""] * runs, np.zeros(runs, int), np.full(runs, np.nan)
    for k, theta in enumerate(data["theta"].values):
        try:
            record = store.read(theta)
        except DamagedRecord as damage:
            outcome[k], message[k] = DAMAGED, str(damage)
            continue
        if record is not None:
            temperatures[k], status[k] = record.temperatures, record.status
            outcome[k], message[k] = record.outcome, record.message
            attempts[k], seconds[k] = record.attempts, record.seconds
    found = data.assign(
        temperatures=(("run", "time", "channel"), temperatures),
        status=(("run", "time", "heater"), status),
        outcome=("run", np.array(outcome, dtype=str)),
        message=("run", np.array(message, dtype=str)),
        attempts=("run", attempts),
        seconds=("run", seconds),
    )
    return labelled(found, _LABELS)


def _described(subject: Subject, design: Design) -> xarray.Dataset:
    data = xarray.Dataset(
        {"theta": (("run", "parameter"), design.theta)},
        coords={
            "run": np.arange(len(design.theta)),
            "parameter": list(subject.parameters),
            "time": np.asarray(subject.times),
            "channel": np.array(subject.channels, dtype=str),
            "heater": np.array(subject.heaters, dtype=str),
        },
        attrs={"design": design.kind, "seed": design.seed},
    )
    return labelled(data, _LABELS)


def _read_description(folder: Path) -> dict[str, Any]:
    file = folder / _DESCRIPTION
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        return {name: content[name] for name in ("identity", "parts", "inputs", "design")}
    except (FileNotFoundError, NotADirectoryError):
        raise RunError(f"{folder}: found no {_DESCRIPTION}, expected the folder of a campaign") from None
    except (ValueError, KeyError, TypeError) as error:
        raise RunError(f"{file}: found damaged content ({error}), expected the description of a campaign") from None


def _check_subject(folder: Path, found: Mapping[str, Any], subject: Subject) -> None:
    if found["identity"] == subject.identity:
        return
    changed = [name for name, part in subject.parts.items() if found["parts"].get(name) != part]
    changed += [Path(name).name for name, content in subject.inputs.items() if content not in found["inputs"].values()]
    raise RunError(
        f"{folder}: the folder holds the campaign of another simulator, or the scenario has changed since "
        f"(what differs: {', '.join(changed) or 'the telemetry'}); choose another --out"
    )


def _check_design(folder: Path, found: Mapping[str, Any], asked: Mapping[str, Any]) -> None:
    for name in {**found, **asked}:
        if found.get(name) != asked.get(name):
            raise RunError(
                f"{folder}: the campaign's design has another {name} (found {_short(found.get(name))}, expected "
                f"{_short(asked.get(name))}); give the one that it began with, or choose another --out"
            )


def _extends(folder: Path, design: Design) -> bool:
    """Whether the design is a longer one than the folder's. Raises RunError where their thetas differ."""
    found = read_dataset(folder / _DESIGN)["theta"].values
    if len(found) != len(design.theta) and design.kind not in GROWING:
        raise RunError(
            f"{folder}: found a {design.kind} design of {len(found)} runs, which cannot become one of "
            f"{len(design.theta)}; choose another --out, or a design that can grow ({', '.join(GROWING)})"
        )
    common = min(len(found), len(design.theta))
    if not np.array_equal(found[:common], design.theta[:common]):
        raise RunError(
            f"{folder}: the design gives other thetas than those that the campaign began with, although made from "
            "the same; were other versions of scipy or numpy used? Choose another --out"
        )
    return len(design.theta) > len(found)


def _short(value: Any) -> str:
    """Hashes are cut."""
    return "none" if value is None else str(value)[:12]
