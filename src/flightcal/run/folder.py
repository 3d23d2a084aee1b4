"""The folder that one calibration writes: atomically, never pickled, and never a mixture of two scenarios.

Every stage leaves its files and, in provenance.json, the hash of all that went into it. A stage whose hash is
unchanged is not run again, which is what makes a run resumable.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from time import perf_counter
from typing import Any

import xarray

from ..errors import RunError
from .records import read_dataset, read_tree, write_json, write_netcdf, write_text

_PACKAGES = ("flightcal", "numba", "numpy", "nutpie", "scipy", "xarray", "pyerfa", "sgp4")


@dataclass(frozen=True)
class RunDirectory:
    """A run's folder. `identity` is the hash of what is calibrated on; see `open_run`."""

    path: Path
    identity: str

    def file(self, name: str) -> Path:
        """Path of a file of the run."""
        return self.path / name

    def is_done(self, stage: str, inputs: str, files: tuple[str, ...]) -> bool:
        """Whether the stage's files are here and were made from the same inputs (a hash)."""
        made_from = read_provenance(self.path).get("stage_inputs", {}).get(stage)
        return made_from == inputs and all(self.file(name).exists() for name in files)

    @contextmanager
    def stage(self, stage: str, inputs: str) -> Iterator[None]:
        """Time a stage and record it as done when the block ends without an error."""
        started = self.begin(stage)
        yield
        self.end(stage, inputs, started)

    def begin(self, stage: str) -> float:
        """Mark a stage as not done, for its files are about to change. Returns the time, for `end`."""
        provenance = read_provenance(self.path)
        if provenance.get("stage_inputs", {}).pop(stage, None) is not None:
            self.write_json("provenance.json", provenance)
        self.log(stage=stage, event="start")
        return perf_counter()

    def end(self, stage: str, inputs: str, started: float) -> None:
        """Record a stage as done from these inputs (a hash)."""
        seconds = round(perf_counter() - started, 3)
        provenance = read_provenance(self.path)
        done = {
            "stages": {**provenance.get("stages", {}), stage: seconds},
            "stage_inputs": {**provenance.get("stage_inputs", {}), stage: inputs},
        }
        self.write_json("provenance.json", {**provenance, **done})
        self.log(stage=stage, event="end", seconds=seconds)

    def log(self, **record: Any) -> None:
        """Append a line to log.jsonl."""
        with self.file("log.jsonl").open("a", encoding="utf-8") as file:
            file.write(json.dumps({"time": _now(), **record}) + "\n")

    def write_json(self, name: str, content: Any) -> None:
        """Write a JSON file; see `records.write_json`."""
        write_json(self.file(name), content)

    def write_netcdf(self, name: str, data: xarray.Dataset | xarray.DataTree) -> None:
        """Write a dataset or a tree of them."""
        write_netcdf(self.file(name), data)

    def read_dataset(self, name: str) -> xarray.Dataset:
        """A dataset of the run, in memory."""
        return read_dataset(self.file(name))

    def read_tree(self, name: str) -> xarray.DataTree:
        """A tree of datasets of the run, in memory."""
        return read_tree(self.file(name))


def open_run(
    path: Path, parts: Mapping[str, str], scenario_text: str, inputs: Mapping[str, str], seed: int
) -> RunDirectory:
    """Create the folder, or reopen it when it belongs to the same scenario and inputs.

    parts: hashes of all that the folder is bound to, by names that a message can say.
    Raises RunError for a folder that holds another scenario's run, that of an earlier flightcal, or no run at all.
    """
    identity = hash_of(dict(parts))
    if path.exists():
        if not path.is_dir():
            raise RunError(f"{path}: found a file, expected a folder for the run")
        provenance = read_provenance(path)
        if not provenance and any(path.iterdir()):
            raise RunError(f"{path}: the folder holds files but no run; expected an empty or new folder")
        found = provenance.get("parts", {})
        if provenance and not found:
            raise RunError(
                f"{path}: the folder holds the run of an earlier flightcal, which cannot be taken up; choose another "
                "--out, or delete the folder ('flightcal report' still reads it)"
            )
        if provenance and found != parts:
            names = [name for name in {**found, **parts} if found.get(name) != parts.get(name)]
            raise RunError(
                f"{path}: the folder holds the run of another scenario or of other telemetry (what differs: "
                f"{', '.join(names)}); choose another --out, or delete the folder"
            )
    path.mkdir(parents=True, exist_ok=True)
    run = RunDirectory(path, identity)
    provenance = read_provenance(path)
    write_text(run.file("scenario.yaml"), scenario_text)
    run.write_json(
        "provenance.json",
        {
            "identity": identity,
            "parts": dict(parts),
            "created": provenance.get("created", _now()),
            "flightcal": _version("flightcal"),
            "python": sys.version.split()[0],
            "packages": {name: _version(name) for name in _PACKAGES},
            "inputs": dict(inputs),
            "seed": seed,
            "machine": {"cpu_count": os.cpu_count(), "platform": platform.platform()},
            "stages": provenance.get("stages", {}),
            "stage_inputs": provenance.get("stage_inputs", {}),
        },
    )
    return run


def read_provenance(path: Path) -> dict[str, Any]:
    """Content of provenance.json; empty where there is none. Raises RunError when it is damaged."""
    file = path / "provenance.json"
    if not file.exists():
        return {}
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except ValueError as error:
        raise RunError(f"{file}: found damaged JSON ({error}); delete the folder and run again") from None
    if not isinstance(content, dict):
        raise RunError(f"{file}: found {type(content).__name__}, expected a JSON object")
    return content


def hash_of(*parts: Any) -> str:
    """SHA-256 of JSON-like values."""
    text = json.dumps(parts, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()


def hash_of_file(path: Path) -> str:
    """SHA-256 of a file's content."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
