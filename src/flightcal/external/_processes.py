"""Child processes that never outlive what they were started for."""

from __future__ import annotations

import atexit
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

_LIVE: set[Any] = set()
_LOCK = threading.Lock()
_WATCHERS: list[tuple[Any, int]] = []
"""None or one, started with the first child: the process, and the pipe that tells it what lives."""


def kill_group(process: Any) -> None:
    """Kill a process that leads a session, with all that it has started."""
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)


@contextmanager
def live(process: subprocess.Popen[bytes], folder: Path) -> Iterator[None]:
    """While the block runs the process may live; after it, nothing of its group does.

    folder: that it works in, which goes with it if this process is killed.
    """
    with _LOCK:
        _LIVE.add(process)
        _tell_watcher(f"+{process.pid} {folder}")
    try:
        yield
    finally:
        kill_group(process)
        process.wait()
        with _LOCK:
            _LIVE.discard(process)
            _tell_watcher(f"-{process.pid}")


def _tell_watcher(line: str) -> None:
    """Have the watcher know, which ends what is left if this process is killed and so cannot.

    A signal at the parent's death (Linux) would come at the end of the thread that started the child, and would not
    reach what that has started.
    """
    with suppress(OSError):  # without it children still end with this process, but for a kill of it
        if not _WATCHERS:
            reading, writing = os.pipe()
            try:
                command = [sys.executable, "-I", "-S", str(Path(__file__).with_name("watcher.py"))]
                # A session of its own: what interrupts this process must not end it first.
                none = subprocess.DEVNULL
                watcher = subprocess.Popen(command, stdin=reading, stdout=none, stderr=none, start_new_session=True)
            except OSError:
                os.close(writing)
                raise
            finally:
                os.close(reading)
            _WATCHERS.append((watcher, writing))
        os.write(_WATCHERS[0][1], f"{line}\n".encode())


def _forget_watcher() -> None:
    """In a fork: while its end of the pipe is open, the watcher of the parent does not see that end."""
    for _, writing in _WATCHERS:
        os.close(writing)
    _WATCHERS.clear()


@atexit.register
def kill_all() -> None:
    """Kill what still runs: when the user interrupts, and at the end of this process."""
    with _LOCK:
        processes = list(_LIVE)
    for process in processes:
        kill_group(process)


@atexit.register
def _end_watcher() -> None:
    for watcher, writing in _WATCHERS:
        os.close(writing)
        watcher.wait()
    _WATCHERS.clear()


def at_fork(forget: Callable[[], object]) -> None:
    """Have a fork of this process forget the children of its parent, which are not its own to use or to kill."""
    if hasattr(os, "register_at_fork"):
        os.register_at_fork(after_in_child=forget)


at_fork(_LIVE.clear)
at_fork(_forget_watcher)
