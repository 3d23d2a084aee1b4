"""Where a campaign runs: on a Dask cluster that is already there."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import Any, Final
from uuid import uuid4

from distributed import CancelledError, Client, Future, KilledWorker, WorkerPlugin, get_worker
from distributed.comm import CommClosedError

from ..errors import RunError
from ..simulator import FloatArray
from .job import Job
from .run import Tell, cannot_record, nobody, tasks_of

_CONNECTING: Final = 10.0  # s
_NO_WORKERS: Final = 60.0  # s that a cluster may take to get its first worker
_MOST_SUBMITTED: Final = 1000
"""Tasks that Dask knows of at a time: enough for every worker, and little memory however long the campaign."""
_LOOK_AFTER: Final = 1.0  # s


@contextmanager
def remote_cluster(address: str) -> Iterator[Cluster]:
    """The cluster of the scheduler at `address`, such as ``tcp://host:8786``.

    Raises RunError where there is none, or where it has no worker.
    """
    try:
        client = Client(address, timeout=_CONNECTING, set_as_default=False)
    except (OSError, ValueError) as error:  # a time-out is an OSError
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise RunError(
            f"--scheduler {address}: found no Dask scheduler there within {_CONNECTING:g} s ({reason})"
        ) from None
    with client:
        try:
            client.wait_for_workers(1, timeout=_NO_WORKERS)
        except TimeoutError:
            raise RunError(
                f"--scheduler {address}: found no worker within {_NO_WORKERS:g} s, expected at least one; "
                f"start one with 'dask worker {address}'"
            ) from None
        yield Cluster(client)


@dataclass(frozen=True)
class Cluster:
    """The workers of a Dask client; a `Runner`."""

    client: Client

    @property
    def workers(self) -> int:
        """Runs that go on at a time."""
        return max(1, sum(self.client.nthreads().values()))

    def run_missing(self, job: Job, thetas: FloatArray, chunk: int = 1, on_progress: Tell = nobody) -> Counter[str]:
        """See `Runner`. A cluster looks after its own workers, and says how often a run may kill one."""
        outcomes: Counter[str] = Counter()
        waiting = deque(tasks_of(thetas, chunk))
        with _carried(self.client, job) as name:
            running: dict[Any, tuple[Future, FloatArray]] = {}  # Dask forgets a task that no future is kept of
            done: SimpleQueue[Future] = SimpleQueue()
            while waiting or running:
                free = _MOST_SUBMITTED - len(running)
                if waiting and free >= min(len(waiting), _MOST_SUBMITTED // 2):
                    tasks = [waiting.popleft() for _ in range(min(free, len(waiting)))]
                    for future, task in zip(self.client.map(_work, tasks, plugin=name, pure=False), tasks, strict=True):
                        running[future.key] = future, task
                        future.add_done_callback(done.put)
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


class _CarryJob(WorkerPlugin):
    """Brings the job to every worker once, also to those that come later."""

    def __init__(self, name: str, job: Job) -> None:
        self.name = name
        self.job = job


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
        return job.give_up(thetas[0])
    except (CancelledError, CommClosedError):
        raise RunError("the Dask scheduler is gone; the same command takes up where this one stopped") from None
    except OSError as error:
        if isinstance(error, TimeoutError) and future.status != "error":
            return None
        raise cannot_record(error) from None


@contextmanager
def _carried(client: Client, job: Job) -> Iterator[str]:
    name = f"flightcal-campaign-{uuid4().hex}"
    try:
        client.register_plugin(_CarryJob(name, job))
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        raise RunError(f"the workers cannot take the campaign ({reason}); do they have this flightcal?") from None
    try:
        yield name
    finally:
        # The cluster may be gone.
        with suppress(Exception):
            client.unregister_worker_plugin(name)
