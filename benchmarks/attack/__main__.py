"""`python -m benchmarks.attack`: run every campaign of this package, a module each, and print its table.

A campaign's `main()` returns how many faults it found.
"""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules


def main() -> int:
    """The faults of all campaigns."""
    names = [module.name for module in iter_modules([str(Path(__file__).parent)]) if not module.name.startswith("_")]
    return sum(import_module(f"{__package__}.{name}").main() for name in names)


if __name__ == "__main__":
    sys.exit(1 if main() else 0)
