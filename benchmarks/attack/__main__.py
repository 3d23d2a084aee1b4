"""`python -m benchmarks.attack`: run every campaign of this package, a module each, and print its table.

A campaign's `main()` returns how many faults it found.
"""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from types import ModuleType


def campaigns() -> list[ModuleType]:
    """The modules of this package that have a `main`."""
    names = [module.name for module in iter_modules([str(Path(__file__).parent)]) if not module.name.startswith("_")]
    return [module for name in names if hasattr(module := import_module(f"{__package__}.{name}"), "main")]


def main() -> int:
    """The faults of all campaigns."""
    return sum(campaign.main() for campaign in campaigns())


if __name__ == "__main__":
    sys.exit(1 if main() else 0)
