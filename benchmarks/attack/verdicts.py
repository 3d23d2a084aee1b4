"""`python -m benchmarks.attack.verdicts`: exit codes of whole calibrations, of wrong set-ups and of correct ones.

The set-ups are those of `benchmarks.wrongs`. None is to end with exit code 0; of twenty correct ones, nineteen are.
Correct are satellites whose unmodelled heat, if any, comes again with the orbit: what drifts for a day nobody foresees.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import dataclass
from itertools import count, islice
from pathlib import Path
from typing import Any

from benchmarks.truth.flight import KINDS
from benchmarks.wrongs import SEED, SETUPS, Case, SetUp, case_of
from flightcal.commands.calibrate import run_experiment
from flightcal.errors import FlightcalError

from .files import not_well, put

_CALIBRATION: dict[str, Any] = {"genetic": {"runs": 2, "population": 32, "generations": 20}}
"""A shorter search than by default: the verdict is about the posterior."""
_CORRECT = 500
"""The number of the first correct satellite."""


@dataclass(frozen=True)
class Ended:
    """How one calibration ended."""

    setup: str
    satellite: int
    code: int
    why: tuple[str, ...]
    """What is not well, the worst first."""
    seconds: float

    @property
    def right(self) -> bool:
        return (self.code == 0) == (self.setup == "correct")


def ended(setup: SetUp | None, number: int, case: Case) -> Ended:
    """The exit code of `flightcal calibrate` for a case."""
    spoiled = case.copy()
    if setup is not None:
        setup.spoil(spoiled)
    spoiled.written["calibration"] = _CALIBRATION
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        file = put(folder, spoiled.written, spoiled.table)
        try:
            verdict = run_experiment(file, folder / "run").verdict
        except FlightcalError as error:
            code, why = 1, (str(error)[:100],)
        else:
            assert verdict is not None
            code, why = verdict.exit_code, not_well(verdict, "bad", "warn")
    return Ended(setup.name if setup else "correct", number, code, why, time.perf_counter() - begin)


def main() -> int:
    """How many wrong set-ups pass, and how many correct ones fail beyond one in twenty."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.attack.verdicts", description=__doc__)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--correct", type=int, default=20, help="correct satellites")
    parser.add_argument("--only", nargs="*", default=[], help="set-ups whose name has one of these words")
    given, _ = parser.parse_known_args()
    chosen = [setup for setup in SETUPS if not given.only or any(word in setup.name for word in given.only)]
    numbers = islice((k for k in count(_CORRECT) if KINDS[k % len(KINDS)] != "slow drift"), given.correct)
    results = [_said(ended(None, k, case_of(given.seed, k))) for k in numbers]
    results += [_said(ended(setup, *setup.satellite(given.seed))) for setup in chosen]
    wrong = [result for result in results if result.setup != "correct"]
    passed = sum(not result.right for result in wrong)
    failed = sum(not result.right for result in results) - passed
    print(f"exit code 0: {passed} of {len(wrong)} wrong set-ups, {given.correct - failed} of {given.correct} correct")
    return passed + max(0, failed - given.correct // 20)


def _said(ended: Ended) -> Ended:
    why = "; ".join(ended.why[:3])[:150]
    mark = "" if ended.right else "WRONG"
    print(
        f"{ended.setup:34} {ended.satellite:4d}  exit {ended.code} {mark:5} {ended.seconds:5.0f} s  {why}", flush=True
    )
    return ended


if __name__ == "__main__":
    raise SystemExit(main())
