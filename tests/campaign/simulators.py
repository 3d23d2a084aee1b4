"""Functions that campaigns of the tests run; each writes down, outside of the store, that it was called."""

from __future__ import annotations

import os
import signal
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flightcal.external.record import Record

TIMES, CHANNELS, HEATERS = 5, 2, 1


def record(theta, outcome="finished", message=""):
    values = theta.sum() if outcome == "finished" else np.nan
    return Record(
        theta, outcome, message, 1, 0.0, np.full((TIMES, CHANNELS), values), np.full((TIMES, HEATERS), values)
    )


def executions(log: Path) -> Counter:
    """How often each theta was begun."""
    return Counter(log.read_text().split()) if log.exists() else Counter()


def label(theta) -> str:
    return ",".join(map(repr, np.asarray(theta).tolist()))


@dataclass(frozen=True)
class Sleeper:
    """Takes `seconds` a run, and says in `log` which run it begins; in one write each, so that none tear another."""

    log: Path
    seconds: float = 0.0

    def __call__(self, thetas):
        records = []
        for theta in thetas:
            with self.log.open("a") as file:
                file.write(label(theta) + "\n")
            time.sleep(self.seconds)
            records.append(self.outcome(theta))
        return records

    def outcome(self, theta):
        return record(theta)


@dataclass(frozen=True)
class Various(Sleeper):
    """theta[0] says what happens: 1 time-out, 2 not finite, 3 an error."""

    def outcome(self, theta):
        if theta[0] == 3.0:
            raise ValueError("no such thing")
        return record(theta, {1.0: "timed out", 2.0: "not finite"}.get(theta[0], "finished"), "because")


@dataclass(frozen=True)
class Deadly(Sleeper):
    """The run with theta[0] == 7 kills its worker: the first `times` times, or always."""

    times: int = 1

    def outcome(self, theta):
        if theta[0] == 7.0 and executions(self.log)[label(theta)] <= self.times:
            os.kill(os.getpid(), signal.SIGKILL)
        return record(theta)
