"""The folder that one calibration writes: atomically, never pickled, and never a mixture of two scenarios.

Every stage leaves its files and, in provenance.json, the hash of all that went into it. A stage whose hash is
unchanged is not run again, which is what makes a run resumable. digests.json has each file's length and SHA-256: what
it is about to be is told before it is replaced, so that a kill at any moment leaves a file that is known. A file that
is not as it was written counts for nothing. One process at a time holds the folder.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path, PurePosixPath
from time import perf_counter
from typing import Any, Final

import xarray

from ..errors import RunError
from ..progress import SILENT, Progress
from .files import is_part, locked, naming, sweep, write_bytes
from .records import json_bytes, netcdf_bytes, read_dataset, read_tree, write_json

DIGESTS: Final = "digests.json"
REDUCED: Final = "reduced"
"""Folder of a reduced model, in that of a run: it is made before the run."""
INPUT_FILES: Final = "input files"
"""How the name of a part ends that is the hash of files: a message names those that differ."""
_LOCK, _LOG, _PROVENANCE, _SCENARIO = "run.lock", "log.jsonl", "provenance.json", "scenario.yaml"
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
        return made_from == inputs and all(self.keeps(name) for name in files)

    def keeps(self, name: str) -> bool:
        """Whether a file is here, and is as it was written: `open_run` has removed those that are not."""
        return name in read_digests(self.path) and self.file(name).exists()

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
            self.write_json(_PROVENANCE, provenance)
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
        self.write_json(_PROVENANCE, {**provenance, **done})
        self.log(stage=stage, event="end", seconds=seconds)

    def log(self, **record: Any) -> None:
        """Append a line to log.jsonl."""
        file = self.file(_LOG)
        with naming(file), file.open("a", encoding="utf-8") as log:
            log.write(json.dumps({"time": _now(), **record}) + "\n")

    def write(self, name: str, content: bytes) -> None:
        """Replace a file of the run atomically, after digests.json tells what it is now and what it is to be."""
        file, digests, new = self.file(name), read_digests(self.path), _digest(content)
        now = _digest_of_file(file) if file.exists() else None
        write_json(self.file(DIGESTS), {**digests, name: [new, *(d for d in digests.get(name, []) if d == now != new)]})
        write_bytes(file, content)

    def write_text(self, name: str, text: str) -> None:
        """Write a text file, UTF-8."""
        self.write(name, text.encode())

    def write_json(self, name: str, content: Any) -> None:
        """Write a JSON file; see `records.write_json`."""
        self.write(name, json_bytes(content))

    def write_netcdf(self, name: str, data: xarray.Dataset | xarray.DataTree) -> None:
        """Write a dataset or a tree of them."""
        self.write(name, netcdf_bytes(data))

    def read_dataset(self, name: str) -> xarray.Dataset:
        """A dataset of the run, in memory."""
        return read_dataset(self.file(name))

    def read_tree(self, name: str) -> xarray.DataTree:
        """A tree of datasets of the run, in memory."""
        return read_tree(self.file(name))


class OtherRunError(RunError):
    """A folder holds another run: `names` are of the parts that differ."""

    def __init__(self, path: Path, names: Sequence[str]) -> None:
        super().__init__(
            f"{path}: the folder holds the run of another scenario, of other telemetry or of another command "
            f"(what differs: {', '.join(names)}); choose another --out, or delete the folder"
        )
        self.path, self.names = path, tuple(names)


@contextmanager
def open_run(
    path: Path,
    parts: Mapping[str, str],
    scenario_text: str,
    inputs: Mapping[str, str],
    seed: int,
    progress: Progress = SILENT,
) -> Iterator[RunDirectory]:
    """Create the folder, or reopen it when it belongs to the same scenario and inputs, and hold it during the block.

    A folder without any result yet, such as one of a command that was refused, belongs to none.

    parts: hashes of all that the folder is bound to, by names that a message can say; inputs: of each file. What a
    killed process was writing is deleted, and so are files that are not as they were written, which is said.
    Raises RunError for a folder that holds another scenario's run, that of an earlier flightcal, or no run at all, and
    where another process holds it.
    """
    identity = hash_of(dict(parts))
    _check_place(path)
    path.mkdir(parents=True, exist_ok=True)
    with locked(path, _LOCK):
        _tidy(path, progress)
        run = RunDirectory(path, identity)
        provenance = read_provenance(path)
        written = set(read_digests(path))
        if not written or written - {_PROVENANCE, _SCENARIO}:  # else it stopped before its first result
            _check_parts(path, provenance, parts, inputs)
        # First: without it the folder is nobody's, and no file in it may be replaced.
        run.write_json(
            _PROVENANCE,
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
        run.write_text(_SCENARIO, scenario_text)
        yield run


@contextmanager
def hold(path: Path) -> Iterator[RunDirectory]:
    """The run in a folder as it is, which no other process may hold. Raises RunError where one does."""
    with locked(path, _LOCK):
        yield RunDirectory(path, str(read_provenance(path).get("identity", "")))


def check_whole(path: Path) -> None:
    """Raises RunError with the first file of a run that is not as it was written."""
    for name, words in _broken(path):
        raise RunError(f"{path / name}: {words}; run the calibration again, which makes it anew")


def _check_place(path: Path) -> None:
    if path.exists() and not path.is_dir():
        raise RunError(f"{path}: found a file, expected a folder for the run")
    if not path.exists() or (path / _PROVENANCE).exists() or (path / DIGESTS).exists():
        return
    # A kill before the first file leaves these.
    if not all(is_part(file) or file.name in (_LOCK, REDUCED) for file in path.iterdir()):
        raise RunError(f"{path}: the folder holds files but no run; expected an empty or new folder")


def _check_parts(
    path: Path, provenance: Mapping[str, Any], parts: Mapping[str, str], inputs: Mapping[str, str]
) -> None:
    found = provenance.get("parts", {})
    if provenance and not found:
        raise RunError(
            f"{path}: the folder holds the run of an earlier flightcal, which cannot be taken up; choose another "
            "--out, or delete the folder"
        )
    if provenance and found != parts:
        names = [name for name in {**found, **parts} if found.get(name) != parts.get(name)]
        before, now = ({Path(file).name: part for file, part in of.items()} for of in (provenance["inputs"], inputs))
        changed = sorted(file for file in {**before, **now} if before.get(file) != now.get(file))
        names = [f"{name}: {', '.join(changed)}" if name.endswith(INPUT_FILES) and changed else name for name in names]
        raise OtherRunError(path, names)


def _tidy(path: Path, progress: Progress) -> None:
    """Delete what was being written at a kill, and what is not as it was written; end the log with a whole line."""
    if (path / _PROVENANCE).exists() and not read_digests(path):
        progress.say(f"{path / DIGESTS}: missing or damaged, so no file can be trusted; every stage is run again")
    for folder in {path, *((path / name).parent for name in read_digests(path))}:
        sweep(folder)
    for name, words in _broken(path):
        progress.say(f"{path / name}: {words}; it is made again")
        (path / name).unlink()
    if (log := path / _LOG).exists():
        os.truncate(log, log.read_bytes().rfind(b"\n") + 1)


def read_digests(path: Path) -> dict[str, list[dict[str, Any]]]:
    """Name of each file that the run wrote -> what it may be, the newest first; empty where that is not known."""
    try:
        content = json.loads((path / DIGESTS).read_text(encoding="utf-8"))
        return {name: list(digest) for name, digest in content.items() if _is_inside(name)}
    except (FileNotFoundError, NotADirectoryError, ValueError, AttributeError, TypeError):
        return {}


def _broken(path: Path) -> Iterator[tuple[str, str]]:
    """Files of a run that are not as they were written, and how they differ."""
    for name, digests in read_digests(path).items():
        if (path / name).is_file() and (found := _digest_of_file(path / name)) not in digests:
            lengths = [digest.get("bytes") for digest in digests]
            other = "content" if found["bytes"] in lengths else f"length ({found['bytes']} bytes, not {lengths[0]})"
            yield name, f"damaged, its {other} is another than was written"


def _is_inside(name: str) -> bool:
    return not PurePosixPath(name).is_absolute() and ".." not in PurePosixPath(name).parts


def _digest(content: bytes) -> dict[str, Any]:
    return {"bytes": len(content), "sha256": hashlib.sha256(content).hexdigest()}


def _digest_of_file(file: Path) -> dict[str, Any]:
    return {"bytes": file.stat().st_size, "sha256": hash_of_file(file)}


def read_provenance(path: Path) -> dict[str, Any]:
    """Content of provenance.json; empty where there is none. Raises RunError when it is damaged."""
    file = path / _PROVENANCE
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
