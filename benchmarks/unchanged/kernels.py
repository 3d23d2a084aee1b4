"""Whether compiled code of two checkouts gives the same log densities, gradients and temperatures.

    python benchmarks/unchanged/kernels.py BASE BRANCH SCENARIO... [--strict] [--points 200]

Each checkout runs in a process of its own, with a cache of its own, on the same scenario files. With --strict both are
compiled without fast-math flags (FLIGHTCAL_STRICT=1), and how code is cut up can change nothing: expect 0 everywhere,
but for several windows, whose parts may be added up in another order. Without it expect less than 1e-12.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))
from benchmarks.unchanged.either import problem_of, temperatures

QUANTITIES = ("density", "gradient", "temperatures", "side_by_side")


def dump(scenario: str, points: int, file: str) -> None:
    """What this checkout gives at points around the prior's median."""
    problem = problem_of(scenario)
    centre = problem.to_z(problem.priors.median())
    z = centre + 0.5 * np.random.default_rng(0).standard_normal((points, len(centre)))
    values, gradients = zip(*map(problem.log_density_and_gradient, z), strict=True)
    thetas = problem.to_theta(z)
    alone = np.concatenate([temperatures(problem, theta[None]) for theta in thetas[::8]])
    found = (np.array(values), np.array(gradients), alone, temperatures(problem, thetas))
    np.savez(file, **dict(zip(QUANTITIES, found, strict=True)))


def difference(found: Any, expected: Any) -> float:
    """The largest, of the size of each point's largest number; infinite where only one of the two is finite."""
    if not np.array_equal(np.isfinite(found), np.isfinite(expected)):
        return np.inf
    flat = [array.reshape(len(array), -1) for array in (found, expected)]
    found, expected = (np.where(np.isfinite(array), array, 0.0) for array in flat)
    size = np.abs(expected).max(axis=1, keepdims=True)
    return float((np.abs(found - expected) / np.where(size > 0.0, size, 1.0)).max())


def main() -> None:
    """Run both checkouts and compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("checkouts", nargs=2, type=Path)
    parser.add_argument("scenarios", nargs="+", type=Path)
    parser.add_argument("--strict", action="store_true")
    parser.add_argument("--points", type=int, default=200)
    parser.add_argument("--caches", type=Path, help="folder to keep the compiled code in")
    options = parser.parse_args()
    worst = 0.0
    with tempfile.TemporaryDirectory() as folder:
        for scenario in options.scenarios:
            found = []
            for checkout in options.checkouts:
                cache = (options.caches or Path(folder)) / f"{checkout.resolve().name}-{options.strict}"
                file = Path(folder) / f"{checkout.resolve().name}.npz"
                environment = os.environ | {
                    "PYTHONPATH": str(checkout.resolve() / "src"), "NUMBA_CACHE_DIR": str(cache),
                    "FLIGHTCAL_STRICT": str(int(options.strict)),
                }  # fmt: skip
                of_dump = ["--dump", str(scenario.resolve()), str(options.points), str(file)]
                subprocess.run([sys.executable, __file__, *of_dump], check=True, env=environment)
                found.append(dict(np.load(file)))
            differences = {name: difference(found[1][name], found[0][name]) for name in QUANTITIES}
            print(scenario, int(np.isfinite(found[0]["density"]).sum()), "finite", differences, flush=True)
            worst = max(worst, *differences.values())
    sys.exit(worst > 1e-12)


if __name__ == "__main__":
    if sys.argv[1] == "--dump":
        dump(sys.argv[2], int(sys.argv[3]), sys.argv[4])
    else:
        main()
