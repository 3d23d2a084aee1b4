"""`python -m benchmarks [--only NAME ...] [--quick] [--out FILE]`: measure the tables and write docs/benchmarks.md."""

from __future__ import annotations

import argparse
import time
import traceback
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from .report import DataMissingError, Section, machine, write

TABLES = {
    "gradient": "gradient:measure",
    "reduced": "reduced:measure",
    "forward": "forward:measure",
    "residuals": "residuals:measure",
    "sampling": "sampling:measure",
    "batch": "batch:measure_batch",
    "genetic": "batch:measure_genetic",
    "scaling": "scaling:measure",
    "campaign": "campaign:measure",
    "forecast": "forecast:measure",
    "whole": "whole:measure",
}
_OUT = Path(__file__).parents[1] / "docs" / "benchmarks.md"


def main() -> int:
    """Exit code 1 where a table could not be measured."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument(
        "--only", nargs="+", choices=TABLES, default=list(TABLES), metavar="NAME", help=", ".join(TABLES)
    )
    parser.add_argument("--quick", action="store_true", help="fewer rounds and smaller sizes")
    parser.add_argument("--out", type=Path, default=_OUT, help="the document (default: docs/benchmarks.md)")
    given = parser.parse_args()
    before = machine()
    sections, failed = [], []
    for name in TABLES:
        if name not in given.only:
            continue
        begin = time.perf_counter()
        try:
            section = _table(name)(given.quick)
        except DataMissingError as reason:
            print(f"\n[{name}: skipped: {reason}]", flush=True)
            continue
        except Exception as error:  # one table that cannot be made must not cost the others
            traceback.print_exc()
            failed.append(name)
            section = Section(
                name.capitalize(),
                f"Could not be measured: {type(error).__name__}: {str(error)[:200].splitlines()[:1]}",
                [],
            )
        print(f"\n{section.markdown()}\n\n[{name}: {time.perf_counter() - begin:.0f} s]", flush=True)
        sections.append(section)
    write(given.out, sections, before)
    return 1 if failed else 0


def _table(name: str) -> Callable[[bool], Section]:
    """Imported when it is measured: each needs other packages."""
    module, function = TABLES[name].split(":")
    found: Callable[[bool], Section] = getattr(import_module(f".tables.{module}", __package__), function)
    return found


if __name__ == "__main__":
    raise SystemExit(main())
