"""A campaign on one worker and on two: how much of the second worker's time it gets."""

from __future__ import annotations

import multiprocessing
import tempfile
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from flightcal.campaign import Design, Subject, run_campaign
from flightcal.campaign.run import Here
from flightcal.external.record import Record

from ..report import Section, Table
from ..timing import Timing, duration, ratio_text

_SAMPLES, _CHANNELS = 200, 8
_SUBJECT = Subject(
    {"simulator": "busy"},
    {},
    ("number",),
    tuple(f"channel_{k}" for k in range(_CHANNELS)),
    ("heater",),
    np.datetime64("2024-03-01", "ns") + np.arange(_SAMPLES) * np.timedelta64(60, "s"),
)


@dataclass(frozen=True)
class Busy:
    """A simulator that computes for `seconds` a run by the clock, or, with `rounds`, does so much work."""

    seconds: float
    rounds: int | None = None

    def __call__(self, thetas: Any) -> list[Record]:
        """Records of the runs."""
        return [self._run(theta) for theta in thetas]

    def _run(self, theta: Any) -> Record:
        begin = perf_counter()
        if self.rounds is None:
            while perf_counter() - begin < self.seconds:
                _work(100)
        else:
            _work(self.rounds)
        temperatures = np.full((_SAMPLES, _CHANNELS), 280.0 + theta[0])
        return Record(theta, "finished", "", 1, perf_counter() - begin, temperatures, np.zeros((_SAMPLES, 1)))


def _work(rounds: int) -> float:
    total = 0.0
    for k in range(rounds):
        total += (k % 7) * 1e-9
    return total


def _rounds(seconds: float) -> int:
    """Rounds of `_work` that take so long on a free core."""
    rates = []
    for _ in range(5):
        begin = perf_counter()
        _work(200_000)
        rates.append(200_000 / (perf_counter() - begin))
    return round(seconds * max(rates))


def _bare(rounds: int, runs: int, workers: int) -> float:
    """Seconds of the same work in processes that share nothing and record nothing."""
    barrier = multiprocessing.Barrier(workers + 1)

    def work() -> None:
        barrier.wait()
        for _ in range(runs // workers):
            _work(rounds)

    processes = [multiprocessing.Process(target=work) for _ in range(workers)]
    for process in processes:
        process.start()
    barrier.wait()
    begin = perf_counter()
    for process in processes:
        process.join()
    return perf_counter() - begin


def _campaign(workers: int, simulator: Busy, runs: int) -> float:
    """Seconds of a campaign in a new folder."""
    design = Design("prior", 1, {}, np.arange(runs, dtype=float)[:, None])
    with tempfile.TemporaryDirectory() as folder:
        begin = perf_counter()
        tally = run_campaign(Path(folder) / "campaign", _SUBJECT, design, simulator, lambda: nullcontext(Here(workers)))
        seconds = perf_counter() - begin
    if tally.outcomes != {"finished": runs}:
        raise AssertionError(f"found {tally}")
    return seconds


def measure(quick: bool) -> Section:
    """Efficiency: time on one worker over twice the time on two."""
    runs, seconds, rounds_of_measuring = (20, 0.1, 2) if quick else (60, 0.2, 3)
    rounds = _rounds(seconds)
    for workers in (1, 2):
        _campaign(workers, Busy(0.0), 20)
    cases: dict[str, Callable[[int], float]] = {
        "runs of known length": lambda k: _campaign(k, Busy(seconds), runs),
        "runs of known work": lambda k: _campaign(k, Busy(seconds, rounds), runs),
        "the same work, bare processes": lambda k: _bare(rounds, runs, k),
    }
    samples: dict[str, list[tuple[float, float]]] = {name: [] for name in cases}
    for _ in range(rounds_of_measuring):
        for name, case in cases.items():
            samples[name].append((case(1), case(2)))
    rows = []
    for name, pairs in samples.items():
        alone, both = (Timing(tuple(pair[k] for pair in pairs)) for k in (0, 1))
        efficiency = Timing(tuple(a / (2.0 * b) for a, b in pairs))
        rows.append([name, str(alone), str(both), ratio_text(efficiency)])
    return Section(
        "Campaigns",
        f"A campaign of {runs} runs, one run a task, each busy for {duration(seconds)} and recorded with {_SAMPLES} "
        f"samples of {_CHANNELS} channels, on one worker process and on two.",
        [Table(["", "one worker", "two workers", "efficiency"], rows)],
        [
            "Efficiency: the time on one worker over twice the time on two, by rounds; starting workers counts.",
            "Runs of known length are busy for that time by the clock, so what is lost is the campaign's. Those of "
            "known work lose, besides, what two busy cores lose to each other, which bare processes show.",
        ],
    )
