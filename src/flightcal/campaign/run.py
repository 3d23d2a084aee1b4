"""Runs the thetas of a campaign on the processes of this machine, or of another kind of runner.

The store is the only memory: a worker records each run as it ends, and what has a record is not run again. So it does
not matter when this process, a worker or the whole machine is killed, and a task that is done twice runs nothing twice.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from ..errors import RunError
from ..run import ATTEMPTS, each
from ..simulator import FloatArray
from .job import Job

Tell = Callable[[Counter[str]], None]
"""Is told how many runs have had which outcome so far."""


def nobody(_: Counter[str]) -> None:
    """Whom to tell where nobody asks."""


class Runner(Protocol):
    """Where a campaign runs."""

    @property
    def workers(self) -> int:
        """Runs that go on at a time."""

    def run_missing(self, job: Job, thetas: FloatArray, chunk: int = 1, on_progress: Tell = nobody) -> Counter[str]:
        """Run those of thetas [S, d] that have no record, `chunk` of them to a task; how many have which outcome.

        on_progress: told the outcomes so far. A run that kills the worker again and again is recorded as crashed. Runs
        that were going on when this is interrupted are not recorded, and run again in the next call.
        Raises RunError where the workers cannot run or record.
        """


@dataclass(frozen=True)
class Here:
    """Processes on this machine, one run at a time in each; a `Runner`."""

    workers: int

    def run_missing(self, job: Job, thetas: FloatArray, chunk: int = 1, on_progress: Tell = nobody) -> Counter[str]:
        """See `Runner`."""
        outcomes: Counter[str] = Counter()

        def done(_: FloatArray, found: Counter[str]) -> None:
            outcomes.update(found)
            on_progress(outcomes)

        def lost(task: FloatArray) -> Counter[str]:
            """The runs of a task that kills workers are tried one by one, then given up."""
            return self.run_missing(job, task) if len(task) > 1 else job.give_up(task[0], ATTEMPTS)

        try:
            each(job.record_missing, tasks_of(thetas, chunk), self.workers, done=done, lost=lost)
        except OSError as error:
            raise cannot_record(error) from None
        return outcomes


def tasks_of(thetas: FloatArray, chunk: int) -> list[FloatArray]:
    """Thetas [S, d] in parts of `chunk` each, the last perhaps of fewer."""
    return [thetas[first : first + chunk] for first in range(0, len(thetas), chunk)]


def cannot_record(error: OSError) -> RunError:
    """What a worker that cannot write says."""
    return RunError(f"a worker cannot record its run: {error}; do all workers see the campaign's folder?")
