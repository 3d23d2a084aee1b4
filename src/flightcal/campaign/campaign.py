"""A campaign, whole: describe it in its folder, run what has no record, say what became of all runs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np

from ..external import FINISHED
from ..progress import SILENT, Progress, about
from ..simulator import FloatArray
from .folder import DAMAGED, NOT_RUN, Design, locked, prepare
from .job import Job, RunFunction
from .run import Runner
from .store import DamagedRecord, RunStore
from .subject import Subject


@dataclass(frozen=True)
class Tally:
    """What became of a campaign's runs."""

    outcomes: Counter[str]
    """Runs by outcome; those without a record are 'not run' or 'damaged'."""

    @property
    def total(self) -> int:
        """Runs of the design."""
        return self.outcomes.total()

    @property
    def left(self) -> int:
        """Runs that are still to be done."""
        return self.outcomes[NOT_RUN] + self.outcomes[DAMAGED]

    def __str__(self) -> str:
        counts = [
            f"{count} {outcome}" for outcome, count in self.outcomes.most_common() if outcome not in (NOT_RUN, DAMAGED)
        ]
        damaged = f", {self.outcomes[DAMAGED]} of them damaged" if self.outcomes[DAMAGED] else ""
        done = f"{self.total - self.left} of {self.total} runs done"
        return f"{done}{': ' if counts else ''}{', '.join(counts)}; {self.left} left{damaged}"


def run_campaign(
    folder: Path,
    subject: Subject,
    design: Design,
    run: RunFunction,
    connect: Callable[[], AbstractContextManager[Runner]],
    *,
    together: int = 1,
    retry_failed: bool = False,
    progress: Progress = SILENT,
) -> Tally:
    """Run the design's thetas that have no record yet in `folder`, and record them; the same call resumes.

    connect: gives what runs them; not called where nothing is left to do.
    together: at most so many thetas are one call of `run`; with more than one, a kill costs all of a call's runs.
    retry_failed: run those again, too, whose record says that they failed.
    Raises RunError where the folder is another campaign's, where another process runs it, or where the workers fail.
    """
    folder = folder.absolute()  # workers may have been started elsewhere
    with locked(folder):
        store = prepare(folder, subject, design)
        store.tidy()
        before = outcomes_of(store, design.theta)
        progress.say(f"found: {Tally(Counter(before))}")
        again = {NOT_RUN, DAMAGED} if not retry_failed else {outcome for outcome in before if outcome != FINISHED}
        # A theta that is in the design twice is one run.
        rows = [(row, outcome) for row, outcome in zip(design.theta, before, strict=True) if outcome in again]
        missing = {store.key(row): row for row, _ in rows}
        if missing:
            told: list[str] = []
            kept = Counter(outcome for outcome in before if outcome not in again)

            started = perf_counter()

            def tell(outcomes: Counter[str]) -> None:
                done, ended = kept + outcomes, outcomes.total()
                if not told and ended < len(missing):
                    left = about((perf_counter() - started) * (len(missing) - ended) / ended)
                    told.append(left)
                    progress.say(
                        f"{ended} done; the other {len(missing) - ended} take {left}, by the time of the first"
                    )
                tally = Tally(done + Counter({NOT_RUN: max(len(before) - done.total(), 0)}))
                running.at(tally.total - tally.left, str(tally))

            job = Job(run, store, len(subject.times), len(subject.channels), len(subject.heaters))
            with progress.stage("running", len(before)) as running, connect() as runner:
                for row, outcome in rows:
                    if outcome != NOT_RUN:
                        store.discard(row)
                chunk = max(1, min(together, len(missing) // runner.workers))
                runner.run_missing(job, np.array(list(missing.values())), chunk=chunk, on_progress=tell)
        return Tally(Counter(outcomes_of(store, design.theta)))


def outcomes_of(store: RunStore, thetas: FloatArray) -> list[str]:
    """Outcome [S] of the run at each of thetas [S, d]; 'not run' or 'damaged' where there is no record of it."""
    outcomes: list[str] = []
    for theta in thetas:
        try:
            record = store.read(theta)
        except DamagedRecord:
            outcomes.append(DAMAGED)
        else:
            outcomes.append(NOT_RUN if record is None else record.outcome)
    return outcomes
