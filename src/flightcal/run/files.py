"""Files that are replaced whole or not at all, and the lock of a folder."""

from __future__ import annotations

import fcntl
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from errno import EDQUOT, ENOSPC
from pathlib import Path
from typing import Final

from ..errors import RunError

_PART: Final = ".part"
"""Ends the name of a file that is being written; a dot begins it."""


def write_bytes(file: Path, content: bytes | memoryview, *, lasting: bool = True) -> None:
    """Replace a file: readers see the old one or the new one, never half of one.

    lasting: wait until the disk has it, so that this also holds after a power cut.
    Raises OSError, which names the file.
    """
    with naming(file):
        handle, name = tempfile.mkstemp(prefix=f".{file.name}.", suffix=_PART, dir=file.parent)
        temporary = Path(name)
        try:
            with open(handle, "wb") as stream:
                stream.write(content)
                stream.flush()
                if lasting:
                    os.fsync(handle)
            temporary.chmod(0o644)
            os.replace(temporary, file)
        finally:
            temporary.unlink(missing_ok=True)
        if lasting:
            _keep_names(file.parent)


def is_part(file: Path) -> bool:
    """Whether a file is what `write_bytes` was writing when it was killed."""
    return file.name.startswith(".") and file.name.endswith(_PART)


def sweep(folder: Path) -> None:
    """Delete what was being written into a folder when it was killed. The folder is locked, or nobody writes there."""
    for file in folder.glob(f".*{_PART}"):
        file.unlink(missing_ok=True)


@contextmanager
def locked(folder: Path, name: str) -> Iterator[None]:
    """Hold a folder by a lock on its file `name`. The system lets go of the lock of a process that ends or is killed.

    Raises RunError where another process holds it.
    """
    with naming(folder / name):
        file = (folder / name).open("a")
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise RunError(f"{folder}: another process is at work in this folder; wait for it or stop it") from None
        yield


@contextmanager
def naming(file: Path) -> Iterator[None]:
    """Have an error of the system say which file could not be written, and why in words."""
    try:
        yield
    except OSError as error:
        full = "the disk is full; free space and run the same command again, which takes up where this one stopped"
        words = full if error.errno in (ENOSPC, EDQUOT) else f"cannot be written: {error.strerror or error}"
        raise OSError(error.errno, words, str(file)) from None


def _keep_names(folder: Path) -> None:
    """Wait until the disk has the names in a folder; some file systems cannot say."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
