"""Times of a gradient and of simulations in two checkouts, in turns (A B A B ...) on one machine.

    python benchmarks/unchanged/speed.py BASE BRANCH SCENARIO [--rounds 60]

Each checkout is a process of its own that waits while the other measures. Given are medians over the rounds of the
shorter half of a round's calls (what interrupts a call is not the code), and of the ratio of neighbouring rounds.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))
from benchmarks.unchanged.either import problem_of

CALLS = {"gradient": 60, "simulate": 60, "simulate_many 64": 6, "simulate_many 2": 20}


def measure(scenario: str) -> None:
    """Answer each line of the input with a round's times (s)."""
    problem = problem_of(scenario)
    theta = problem.priors.median()
    z, thetas = problem.to_z(theta), np.tile(theta, (64, 1))
    work = {
        "gradient": lambda: problem.log_density_and_gradient(z),
        "simulate": lambda: problem.simulate(theta),
        "simulate_many 64": lambda: problem.simulate_many(thetas),
        "simulate_many 2": lambda: problem.simulate_many(thetas[:2]),
    }
    for run in work.values():
        run()
    print("ready", flush=True)
    for _ in sys.stdin:
        found = {}
        for name, run in work.items():
            times = []
            for _ in range(CALLS[name]):
                begin = time.perf_counter()
                run()
                times.append(time.perf_counter() - begin)
            found[name] = float(np.mean(sorted(times)[: len(times) // 2]))
        print(json.dumps(found), flush=True)


def main() -> None:
    """Start both and let them take turns."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("checkouts", nargs=2, type=Path)
    parser.add_argument("scenario", type=Path)
    parser.add_argument("--rounds", type=int, default=60)
    parser.add_argument("--caches", type=Path, help="folder to keep the compiled code in")
    options = parser.parse_args()
    workers = []
    for checkout in options.checkouts:
        environment = os.environ | {"PYTHONPATH": str(checkout.resolve() / "src")}
        if options.caches:
            environment["NUMBA_CACHE_DIR"] = str(options.caches / f"{checkout.resolve().name}-False")
        command = [sys.executable, __file__, "--measure", str(options.scenario.resolve())]
        worker = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment)
        workers.append(worker)
        assert worker.stdout is not None
        worker.stdout.readline()
    rounds: list[list[dict[str, float]]] = [[], []]
    for _ in range(options.rounds):
        for worker, found in zip(workers, rounds, strict=True):
            assert worker.stdin is not None
            assert worker.stdout is not None
            print(file=worker.stdin, flush=True)
            found.append(json.loads(worker.stdout.readline()))
    for name in CALLS:
        first, second = (np.array([found[name] for found in times]) for times in rounds)
        ratio = float(np.median(second / first))
        print(f"{name:18} {1e6 * np.median(first):10.1f} us {1e6 * np.median(second):10.1f} us  ratio {ratio:.3f}")
    for worker in workers:
        worker.communicate()


if __name__ == "__main__":
    if sys.argv[1] == "--measure":
        measure(sys.argv[2])
    else:
        main()
