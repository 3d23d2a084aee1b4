"""A task done for each of many items, in processes of their own on this machine."""

from __future__ import annotations

import os
import pickle
import signal
import sys
import traceback
from collections import Counter, deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from multiprocessing import get_context, parent_process
from multiprocessing.connection import wait
from threading import Thread
from typing import Any, Final, TypeVar

from ..errors import RunError

Item = TypeVar("Item")
Result = TypeVar("Result")

ATTEMPTS: Final = 3
"""Processes that an item may cost."""
_ENDING: Final = 5.0  # s that a process may take to end before it is killed
# A server that has imported the task's module once forks the processes: those that replace dead ones start at once.
_PROCESSES: Final = get_context("forkserver")


def each(
    task: Callable[[Item], Result],
    items: Iterable[Item],
    workers: int,
    *,
    done: Callable[[Item, Result], None],
    lost: Callable[[Item], Result],
) -> None:
    """Do the task for each item in `workers` processes; task, items and results must be picklable.

    done: told each item and its result as they end. A process that dies is replaced, and costs only the item that it
    was at, which is tried again; lost: the result of an item that has cost three processes. Both are called here.
    An error of the task is raised here. However this ends, the processes end with it, as they do when this process is
    killed. A Ctrl-C in the terminal reaches this process alone.
    Raises RunError where the processes cannot start.
    """
    _PROCESSES.set_forkserver_preload([getattr(task, "func", task).__module__])
    waiting, packed = deque(enumerate(items)), pickle.dumps(task)
    pool: dict[Any, _Worker] = {}
    deaths, failed_starts, whole = Counter[int](), 0, False

    def hand_out() -> int:
        """Have no process idle while items wait; how many are busy."""
        for worker in pool.values():
            if waiting and worker.up and worker.at is None:
                worker.at = waiting.popleft()
                worker.tell(pickle.dumps(worker.at[1]))
        return sum(worker.at is not None for worker in pool.values())

    try:
        while (busy := hand_out()) or waiting:
            while len(pool) < min(workers, busy + len(waiting)):
                worker = _Worker(packed)
                pool[worker.connection] = worker
            for connection in wait(list(pool)):
                worker = pool[connection]
                at, worker.at = worker.at, None
                try:
                    kind, answer = pickle.loads(worker.connection.recv_bytes())
                except (EOFError, OSError):
                    del pool[worker.connection]
                    worker.stop()
                    worker.join()
                    if at is not None:
                        number, item = at
                        deaths[number] += 1
                        if deaths[number] < ATTEMPTS:
                            waiting.appendleft(at)
                        else:
                            done(item, lost(item))
                    elif not worker.up:
                        failed_starts += 1
                        if failed_starts == ATTEMPTS:
                            raise RunError("the worker processes die when they start") from None
                    continue
                if kind == "raised":
                    raise answer
                worker.up = True
                hand_out()
                if at is not None:
                    done(at[1], answer)
        whole = True
    finally:
        for worker in pool.values():
            worker.stop(at_once=not whole)
        for worker in pool.values():
            worker.join()


class _Worker:
    """A process that has been told its task, the line to it, and the numbered item that it is at."""

    def __init__(self, task: bytes) -> None:
        self.connection, theirs = _PROCESSES.Pipe()
        self.process = _PROCESSES.Process(target=_serve, args=(theirs,), daemon=True)
        self.at: tuple[int, Any] | None = None
        self.up = False
        # A child keeps the signals blocked that are blocked when it starts.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT, signal.SIGTERM])
        try:
            self.process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        theirs.close()
        self.tell(task)

    def tell(self, message: bytes) -> None:
        """Send a pickled message. Of a process that is dead the next look at the line tells."""
        with suppress(OSError):
            self.connection.send_bytes(message)

    def stop(self, *, at_once: bool = False) -> None:
        """Have the process end: when it is next idle, or at once."""
        if at_once:
            self.process.terminate()
        self.connection.close()

    def join(self) -> None:
        """Wait for its end."""
        self.process.join(_ENDING)
        self.process.kill()
        self.process.join()


def _serve(connection: Any) -> None:
    """What a process does: take the task, then do it for one item after the other until there is no more."""
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")  # of programs that the task starts: the processes are parallel already
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # what it has started or written is then cleaned up
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGTERM])
    Thread(target=_end_with_parent, daemon=True).start()
    task: Callable[[Any], Any] | None = None
    try:
        while True:
            message = connection.recv_bytes()
            try:
                given = pickle.loads(message)
                answer = None if task is None else task(given)
                task = task or given
                reply = pickle.dumps(("done", answer))
            except Exception as error:
                reply = _packed(error)
            connection.send_bytes(reply)
    except (EOFError, OSError):  # the other end is closed
        return


def _packed(error: Exception) -> bytes:
    """An error with its traceback as a note; those that cannot be pickled as words."""
    error.add_note(traceback.format_exc())
    try:
        packed = pickle.dumps(("raised", error))
        pickle.loads(packed)
        return packed
    except Exception:
        return pickle.dumps(("raised", RuntimeError(f"{type(error).__name__}: {error}")))


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
