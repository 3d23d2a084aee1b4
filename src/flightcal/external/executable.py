"""An executable as a simulator: files from templates, a fresh folder for each run, a CSV file back."""

from __future__ import annotations

import csv
import os
import shutil
import signal
import subprocess
import tempfile
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Any

import numpy as np

from ..scenario import Executable
from ..simulator import FloatArray
from ._processes import kill_group, live
from .program import Outputs, RunFailure

_MOST_WORDS = 300
"""Characters of what a crashed simulator said last that its message quotes."""
_MOST_BYTES = 300_000_000
"""Of an output file: a simulator that writes for ever must not fill the memory too."""
_TOLERANCE = 1e-3  # s; times written with fewer digits than they have are still the same times


@dataclass(frozen=True)
class ExecutableProgram:
    """Runs the command line of a scenario on one window."""

    block: Executable
    folder: Path
    """Of the scenario."""
    start: datetime
    end: datetime
    times: FloatArray
    """[T] s from `start`."""
    outputs: tuple[str, ...]
    """Columns of the temperatures [N]."""
    heaters: tuple[str, ...]
    """Columns of the heaters' status [H]."""

    @property
    def has_gradient(self) -> bool:
        """Never."""
        return False

    def pull_back(self, inputs: Mapping[str, float], temperatures_bar: FloatArray, timeout: float) -> FloatArray:
        """An executable has no derivative."""
        raise NotImplementedError

    def run(self, inputs: Mapping[str, float], timeout: float) -> Outputs:
        """One run in a folder of its own. Raises RunFailure."""
        try:
            place = Path(tempfile.mkdtemp(prefix="flightcal-"))
            try:
                return self._run_in(place, inputs, timeout)
            finally:
                shutil.rmtree(place, ignore_errors=True)
        except OSError as error:
            raise RunFailure("crashed", f"the folder of the run cannot be used: {error}") from None

    def _run_in(self, place: Path, inputs: Mapping[str, float], timeout: float) -> Outputs:
        try:
            self._prepare(place, inputs)
            self._execute(place, timeout)
            return self._read(place)
        except RunFailure as failure:
            if self.block.keep_failed is None:
                raise
            kept = _keep(place, self.folder / self.block.keep_failed)
            raise RunFailure(failure.outcome, f"{failure.message}; folder of the run: {kept}") from None

    def _prepare(self, place: Path, inputs: Mapping[str, float]) -> None:
        from jinja2 import StrictUndefined, TemplateError
        from jinja2.sandbox import SandboxedEnvironment

        known = {"inputs": dict(inputs), "times": self.times.tolist(), "start": self.start, "end": self.end}
        environment = SandboxedEnvironment(undefined=StrictUndefined, keep_trailing_newline=True, autoescape=False)
        try:
            for name in self.block.files:
                shutil.copy(self.folder / name, place / Path(name).name)
            for name, template in self.block.templates.items():
                text = (self.folder / template).read_text(encoding="utf-8")
                (place / name).parent.mkdir(parents=True, exist_ok=True)
                (place / name).write_text(environment.from_string(text).render(known), encoding="utf-8")
        except UnicodeDecodeError as error:
            raise RunFailure("crashed", f"template '{template}' is not UTF-8: {error}") from None
        except (TemplateError, ArithmeticError, LookupError, TypeError, ValueError) as error:
            raise RunFailure("crashed", f"template '{template}' of '{name}' cannot be filled in: {error}") from None

    def _execute(self, place: Path, timeout: float) -> None:
        command = [self.block.program(self.folder), *self.block.command[1:]]
        with (place / "stdout.txt").open("wb") as out, (place / "stderr.txt").open("w+b") as said:
            try:
                # A session of its own, so that all that the simulator starts can be killed with it.
                process = subprocess.Popen(
                    command, cwd=place, stdin=subprocess.DEVNULL, stdout=out, stderr=said, start_new_session=True
                )
            except OSError as error:
                raise RunFailure("crashed", f"'{command[0]}' cannot be started: {error.strerror}") from None
            expired = threading.Event()

            def expire() -> None:
                expired.set()
                kill_group(process)

            timer = threading.Timer(timeout, expire)
            with live(process, place):
                timer.start()
                try:
                    code = process.wait()
                finally:
                    timer.cancel()
            if expired.is_set():
                raise RunFailure("timed out", f"still running after {timeout:g} s, killed{last_words(said)}")
            if code:
                raise RunFailure("crashed", f"{ending(code)}{last_words(said)}")

    def _read(self, place: Path) -> Outputs:
        path = place / self.block.output
        if not path.is_file():
            there = ", ".join(sorted(str(p.relative_to(place)) for p in place.rglob("*") if p.is_file()))
            message = f"no output file '{self.block.output}', though the exit code is 0; the folder has {there}"
            raise RunFailure("partial output", message)
        if path.stat().st_size > _MOST_BYTES:
            found = f"{path.stat().st_size / 1e6:.0f} MB"
            most = f"{_MOST_BYTES / 1e6:.0f} MB at most"
            raise RunFailure("wrong shape", f"{self.block.output}: found {found}, expected {most}")
        seconds, values = _read_table(path, self.block, self.start, (*self.outputs, *self.heaters))
        values = _at_samples(seconds, values, self.times, len(self.outputs), self.block)
        return Outputs(values[:, : len(self.outputs)], values[:, len(self.outputs) :])


def ending(code: int) -> str:
    """How a process ended, in words: its exit code, or the signal that killed it."""
    if code >= 0:
        return f"exit code {code}"
    try:
        name = signal.Signals(-code).name
    except ValueError:
        name = "unknown"
    return f"killed by signal {-code} ({name})"


def last_words(file: IO[bytes]) -> str:
    """What a process wrote last into an open file, as the end of a message; nothing where it wrote nothing."""
    file.seek(max(0, os.fstat(file.fileno()).st_size - 4 * _MOST_WORDS))
    words = " ".join(file.read().decode("utf-8", "replace").split())
    return f"; it said: {words[-_MOST_WORDS:]}" if words else ""


def _keep(place: Path, folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    kept = Path(tempfile.mkdtemp(prefix="run-", dir=folder))
    shutil.copytree(place, kept, dirs_exist_ok=True, symlinks=True)
    return kept


def _read_table(
    path: Path, block: Executable, start: datetime, columns: tuple[str, ...]
) -> tuple[FloatArray, FloatArray]:
    """Times [R] s from the start and values [R, columns]; NaN where a cell is 'nan'. Raises RunFailure."""
    name = block.output
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = [row for row in csv.reader(file) if row]
    except (UnicodeDecodeError, csv.Error) as error:
        raise RunFailure("wrong shape", f"{name} is not a CSV file: {error}") from None
    if not rows:
        raise RunFailure("partial output", f"{name} is empty")
    header = [cell.strip() for cell in rows[0]]
    missing = [column for column in (block.time.column, *columns) if column not in header]
    if missing:
        found = ", ".join(header)[:_MOST_WORDS]
        raise RunFailure("wrong shape", f"{name}: found the columns {found}, expected {', '.join(missing)} too")
    places = [header.index(column) for column in (block.time.column, *columns)]
    dated = block.time.format == "iso8601"
    table = np.empty((len(rows) - 1, len(places)))
    for number, row in enumerate(rows[1:]):
        if len(row) != len(header):
            last = number == len(rows) - 2
            message = f"{name}, row {number + 2}: found {len(row)} values, expected {len(header)}"
            raise RunFailure("partial output" if last else "wrong shape", message)
        for k, column in enumerate(places):
            try:
                table[number, k] = _seconds(row[column], start) if dated and k == 0 else float(row[column])
            except ValueError:
                wanted = "a time in ISO 8601" if dated and k == 0 else "a number"
                found = f"{name}, row {number + 2}, '{header[column]}': found {row[column][:40]!r}"
                raise RunFailure("wrong shape", f"{found}, expected {wanted}") from None
    return table[:, 0], table[:, 1:]


def _seconds(text: str, start: datetime) -> float:
    """From the start to an ISO 8601 time, UTC where it names no other zone. Raises ValueError."""
    time = datetime.fromisoformat(text.strip())
    utc = time if time.tzinfo is None else time.astimezone(UTC).replace(tzinfo=None)
    return (utc - start).total_seconds()


def _at_samples(
    seconds: FloatArray, values: FloatArray, times: FloatArray, temperatures: int, block: Executable
) -> FloatArray:
    """Values [T, .] at the sample times: the very same ones, or interpolated where the scenario says so."""
    name, count = block.output, len(times)
    span = f"{count} times from {times[0]:g} s to {times[-1]:g} s"
    if not len(seconds):
        raise RunFailure("partial output", f"{name}: found no row, expected {span}")
    found = f"{name}: found {len(seconds)} times from {seconds[0]:g} s to {seconds[-1]:g} s"
    if not np.isfinite(seconds).all() or (np.diff(seconds) <= 0).any():
        raise RunFailure("wrong times", f"{name}: found times that do not rise, expected {span}")
    if not block.interpolate:
        shared = min(len(seconds), count)
        if np.abs(seconds[:shared] - times[:shared]).max() <= _TOLERANCE and len(seconds) <= count:
            if len(seconds) < count:
                raise RunFailure("partial output", f"{found}, expected {span}")
            return values
        hint = "; 'interpolate: true' allows other times" if seconds[0] <= times[0] and seconds[-1] >= times[-1] else ""
        raise RunFailure("wrong times", f"{found}, expected {span}{hint}")
    if seconds[0] > times[0] + _TOLERANCE:
        raise RunFailure("wrong times", f"{found}, expected some from {times[0]:g} s on")
    if seconds[-1] < times[-1] - _TOLERANCE:
        outcome: Any = "partial output" if seconds[-1] >= times[0] else "wrong times"
        raise RunFailure(outcome, f"{found}, expected some up to {times[-1]:g} s")
    continuous = [np.interp(times, seconds, column) for column in values[:, :temperatures].T]
    latest = np.clip(np.searchsorted(seconds, times + _TOLERANCE, side="right") - 1, 0, None)
    return np.column_stack([*continuous, values[latest, temperatures:]])
