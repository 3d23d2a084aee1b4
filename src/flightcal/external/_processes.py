"""Child processes that never outlive what they were started for."""

from __future__ import annotations

import atexit
import os
import signal
import subprocess
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

_LIVE: set[Any] = set()
_LOCK = threading.Lock()


def kill_group(process: Any) -> None:
    """Kill a process that leads a session, with all that it has started."""
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)


@contextmanager
def live(process: subprocess.Popen[bytes]) -> Iterator[None]:
    """While the block runs the process may live; after it, nothing of its group does."""
    with _LOCK:
        _LIVE.add(process)
    try:
        yield
    finally:
        kill_group(process)
        process.wait()
        with _LOCK:
            _LIVE.discard(process)


@atexit.register
def kill_all() -> None:
    """Kill what still runs: when the user interrupts, and at the end of this process."""
    with _LOCK:
        processes = list(_LIVE)
    for process in processes:
        kill_group(process)


def at_fork(forget: Callable[[], object]) -> None:
    """Have a fork of this process forget the children of its parent, which are not its own to use or to kill."""
    if hasattr(os, "register_at_fork"):
        os.register_at_fork(after_in_child=forget)


at_fork(_LIVE.clear)
