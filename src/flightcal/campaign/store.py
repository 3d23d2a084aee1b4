"""The records of a campaign's runs, one small file each, found by the hash of simulator, inputs and theta.

One file a run costs 0.4 ms more than appending to one large file and 0.3 ms more than SQLite (two processes writing
20 kB a run), which is little beside any run worth keeping. For that a reader needs no lock and no index, writers on
several machines need no more of the file system than a rename, and damage to one file costs one run.
"""

from __future__ import annotations

import io
import time
import zipfile
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Final, get_args

import numpy as np

from ..external import FINISHED, Outcome, Record
from ..run import hash_of, write_bytes
from ..simulator import FloatArray

_ABANDONED: Final = 3600.0  # s; a file that was begun so long ago and never renamed is of a process that was killed
_FIELDS: Final = tuple(field.name for field in fields(Record))


class DamagedRecord(Exception):  # noqa: N818 - data that a disk lost, not a programming error
    """A record's file is not whole."""


@dataclass(frozen=True)
class RunStore:
    """Records in `folder`, which exists, of runs of the simulator whose code and inputs have the hash `identity`."""

    folder: Path
    identity: str

    def key(self, theta: FloatArray) -> str:
        """Hash of simulator, inputs and theta [d] (every bit of it)."""
        return hash_of(self.identity, np.asarray(theta, float).tolist())

    def file(self, theta: FloatArray) -> Path:
        """Where the record of theta [d] is, or would be."""
        key = self.key(theta)
        return self.folder / key[:2] / f"{key}.npz"

    def write(self, theta: FloatArray, record: Record) -> None:
        """Keep a run's record, atomically. One that finished is never replaced by one that did not."""
        file = self.file(theta)
        if record.outcome != FINISHED and self._finished(theta):
            return
        # Not its parents: on a machine that does not see the campaign's folder a record would be lost.
        file.parent.mkdir(exist_ok=True)
        content = io.BytesIO()
        np.savez(content, **{name: np.asarray(getattr(record, name)) for name in _FIELDS})  # type: ignore[arg-type]
        # A power cut may cost the last records, which are run again; to wait for the disk would cost more.
        write_bytes(file, content.getbuffer(), lasting=False)

    def read(self, theta: FloatArray) -> Record | None:
        """The record of theta [d]; None where there is none. Raises DamagedRecord."""
        file = self.file(theta)
        try:
            with np.load(file, allow_pickle=False) as content:
                values = {name: content[name] for name in _FIELDS}
        except FileNotFoundError:
            return None
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            raise DamagedRecord(f"{file}: found a damaged record ({error})") from None
        if values["outcome"].item() not in get_args(Outcome) or not np.array_equal(values["theta"], theta):
            raise DamagedRecord(f"{file}: found the record of another run")
        scalars = {name: value.item() for name, value in values.items() if value.ndim == 0}
        return Record(**(values | scalars))

    def discard(self, theta: FloatArray) -> None:
        """Forget the record of theta [d]: it will be run again."""
        self.file(theta).unlink(missing_ok=True)

    def tidy(self) -> None:
        """Delete what writers that were killed left half written."""
        for file in self.folder.glob("??/.*.npz.*"):
            if time.time() - file.stat().st_mtime > _ABANDONED:
                file.unlink(missing_ok=True)

    def _finished(self, theta: FloatArray) -> bool:
        try:
            found = self.read(theta)
        except DamagedRecord:
            return False
        return found is not None and found.outcome == FINISHED
