"""Runs the thetas of a campaign on the workers of a Dask client.

The store is the only memory: a worker records each run as it ends, and what has a record is not run again. So it does
not matter when this process, a worker or the whole machine is killed, and a task that Dask runs twice runs nothing
twice.
"""

from __future__ import annotations

import signal
from collections import Counter, deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from queue import Empty, SimpleQueue
from time import monotonic
from typing import Any, Final
from uuid import uuid4

from distributed import CancelledError, Client, Future, KilledWorker, WorkerPlugin, get_worker
from distributed.comm import CommClosedError

from ..errors import RunError
from ..simulator.system import FloatArray
from .job import Job

_MOST_SUBMITTED: Final = 1000
"""Tasks that Dask knows of at a time: enough for every worker, and little memory however long the campaign."""
_LOOK_AFTER: Final = 1.0  # s, at least, from one look at the workers to the next
_RESTART: Final = 10.0  # s; a worker that has been missing for so long may not come back by itself


class _CarryJob(WorkerPlugin):
    """Brings the job to every worker once, also to those that come later."""

    def __init__(self, name: str, job: Job, local: bool) -> None:
        self.name = name
        self.job = job
        self.local = local

    def setup(self, worker: Any) -> None:
        """Where the worker is this machine's own, leave a Ctrl-C in the terminal to the process that runs the campaign.

        It reaches the whole group of processes, and would make the runs that are going on look like crashes.
        """
        if self.local:
            signal.signal(signal.SIGINT, signal.SIG_IGN)


def run_missing(
    client: Client,
    job: Job,
    thetas: FloatArray,
    *,
    chunk: int = 1,
    on_progress: Callable[[Counter[str]], None] = lambda _: None,
) -> Counter[str]:
    """Run those of thetas [S, d] that have no record, `chunk` of them to a task; how many have which outcome.

    on_progress: told the outcomes so far. A run that kills the worker again and again is recorded as crashed. Runs
    that were going on when this is interrupted are not recorded, and run again in the next call.
    Raises RunError where the workers cannot run or record.
    """
    outcomes: Counter[str] = Counter()
    waiting = deque(thetas[first : first + chunk] for first in range(0, len(thetas), chunk))
    with _carried(client, job) as name:
        running: dict[Any, tuple[Future, FloatArray]] = {}  # Dask forgets a task that no future is kept of
        done: SimpleQueue[Future] = SimpleQueue()
        workers = _Workers(client)
        while waiting or running:
            free = _MOST_SUBMITTED - len(running)
            if waiting and free >= min(len(waiting), _MOST_SUBMITTED // 2):
                tasks = [waiting.popleft() for _ in range(min(free, len(waiting)))]
                for future, task in zip(client.map(_work, tasks, plugin=name, pure=False), tasks, strict=True):
                    running[future.key] = future, task
                    future.add_done_callback(done.put)
            workers.replace_lost()
            try:
                future = done.get(timeout=_LOOK_AFTER)
            except Empty:
                continue
            found = _outcome(future, running[future.key][1], job, waiting)
            if found is None:
                done.put(future)
                continue
            del running[future.key]
            outcomes += found
            on_progress(outcomes)
    return outcomes


class _Workers:
    """Sees to it that a cluster of this machine keeps as many workers as it began with.

    Dask restarts a worker that dies, but not one that dies in the moment of its start, as a run that kills its worker
    may have it. A cluster elsewhere looks after its own.
    """

    def __init__(self, client: Client) -> None:
        self._client = client
        self._wanted = len(client.nthreads())
        self._all_seen = monotonic()
        self._patience = _RESTART
        self._looked = monotonic()

    def replace_lost(self) -> None:
        """Start new workers for those that have been missing for longer than a restart takes."""
        cluster, now = self._client.cluster, monotonic()
        if cluster is None or now < self._looked + _LOOK_AFTER:
            return
        self._looked = now
        missing = self._wanted - len(self._client.nthreads())
        if missing <= 0:
            self._all_seen = now
        elif now > self._all_seen + self._patience:
            cluster.scale(len(cluster.worker_spec) + missing)
            self._all_seen = now
            # It may only be slow to start, on a busy machine: more and more of them would not help.
            self._patience *= 2.0


def _work(thetas: FloatArray, *, plugin: str) -> Counter[str]:
    """The task, on a worker."""
    carried: Any = get_worker().plugins[plugin]
    found: Counter[str] = carried.job.record_missing(thetas)
    return found


def _outcome(future: Future, thetas: FloatArray, job: Job, waiting: deque[FloatArray]) -> Counter[str] | None:
    """What became of a task's runs; None where a worker died with the answer, so that Dask asks for it again.

    The runs of a task that kills workers are tried one by one, then given up.
    """
    try:
        found: Counter[str] = future.result(timeout=_LOOK_AFTER)
        return found
    except KilledWorker:
        if len(thetas) > 1:
            waiting.extend(theta[None] for theta in thetas)
            return Counter()
        job.store.write(thetas[0], job.crashed(thetas[0], "the worker process died each time that it was run"))
        return job.record_missing(thetas)
    except (CancelledError, CommClosedError):
        raise RunError("the Dask scheduler is gone; the same command takes up where this one stopped") from None
    except OSError as error:
        if isinstance(error, TimeoutError) and future.status != "error":
            return None
        raise RunError(f"a worker cannot record its run: {error}; do all workers see the campaign's folder?") from None


@contextmanager
def _carried(client: Client, job: Job) -> Iterator[str]:
    name = f"flightcal-campaign-{uuid4().hex}"
    try:
        client.register_plugin(_CarryJob(name, job, local=client.cluster is not None))
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        raise RunError(f"the workers cannot take the campaign ({reason}); do they have this flightcal?") from None
    try:
        yield name
    finally:
        # The cluster may be gone.
        with suppress(Exception):
            client.unregister_worker_plugin(name)
