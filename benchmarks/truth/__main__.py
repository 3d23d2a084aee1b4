"""`python -m benchmarks.truth --count 20 --variant iid --out FILE [--beside FILE ...]`: measure, and print a table.

A satellite that FILE has is not measured again. `--beside` puts the records of other files into the table; the first of
all variants that shares satellites with another one, and lacks as much heat, is what its widths are compared with.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from .measure import read, run
from .summary import summary
from .variants import VARIANTS


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.truth", description=__doc__)
    parser.add_argument("--count", type=int, default=20, help="satellites (0: print the table alone)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--variant", choices=VARIANTS, default="iid")
    parser.add_argument("--out", type=Path, required=True, help="JSON lines, one a satellite")
    parser.add_argument("--workers", type=int, default=2, choices=(1, 2))
    parser.add_argument("--beside", type=Path, nargs="*", default=[], help="files of other variants")
    given = parser.parse_args()
    if not VARIANTS[given.variant].is_known:
        parser.error(f"--variant {given.variant}: found a flightcal without the block 'heat', expected one that has it")
    run(given.count, given.seed, given.variant, given.out, workers=given.workers)
    print(summary([record for file in (*given.beside, given.out) for record in read(file)]))


if __name__ == "__main__":
    main()
