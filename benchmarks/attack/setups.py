"""`python -m benchmarks.attack.setups`: what is named first before sampling.

The set-ups are those of `benchmarks.wrongs`. The twenty satellites after them are as they should be: there nothing is
to be named.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass

from benchmarks.wrongs import SEED, SETUPS, Case, SetUp, case_of
from flightcal.errors import FlightcalError

from .files import looked_at

_CORRECT = 500
"""The number of the first correct satellite."""


@dataclass(frozen=True)
class Result:
    """What was named first."""

    setup: str
    satellite: int
    named: str
    right: bool
    seconds: float


def result(setup: SetUp | None, number: int, case: Case) -> Result:
    """What is named of a case with a set-up, or with none."""
    spoiled, about = case.copy(), ""
    if setup is not None:
        about = setup.spoil(spoiled)
    begin = time.perf_counter()
    try:
        found = looked_at(spoiled.written, spoiled.table).found
        named, kind, whom = (found[0].title, found[0].kind, found[0].about) if found else ("nothing", "", "")
    except FlightcalError as error:
        named, kind, whom = f"error: {error}"[:100], "", ""
    right = not kind if setup is None else kind in setup.kinds and (not about or whom in about or about in whom)
    return Result(setup.name if setup else "correct", number, named, right, time.perf_counter() - begin)


def main() -> int:
    """Exit code 1 where fewer than 80% are named, or a correct satellite is suspected more than once in twenty."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.attack.setups", description=__doc__)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--correct", type=int, default=20, help="correct satellites")
    parser.add_argument("--only", nargs="*", default=[], help="set-ups whose name has one of these words")
    given = parser.parse_args()
    chosen = [setup for setup in SETUPS if not given.only or any(word in setup.name for word in given.only)]
    results = [_said(result(setup, *setup.satellite(given.seed))) for setup in chosen]
    right = range(_CORRECT, _CORRECT + given.correct)
    correct = [_said(result(None, number, case_of(given.seed, number))) for number in right]
    share = sum(result.right for result in results) / max(len(results), 1)
    cried = sum(not result.right for result in correct)
    print(f"named first: {share:.0%} of {len(results)}; suspected though correct: {cried} of {len(correct)}")
    return int(share < 0.8 or 20 * cried > len(correct))


def _said(result: Result) -> Result:
    mark = "right" if result.right else "WRONG"
    print(f"{result.setup:34} {result.satellite:4d}  {mark:5}  {result.seconds:5.1f} s  {result.named}", flush=True)
    return result


if __name__ == "__main__":
    raise SystemExit(main())
