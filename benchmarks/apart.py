"""To run a measure of `children` in a process of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any


def measured_apart(*arguments: Any, cache: Path | None = None) -> dict[str, float]:
    """What `python -m benchmarks.children` finds with these arguments.

    cache: folder of compiled functions other than the usual one.
    """
    command = [sys.executable, "-m", "benchmarks.children", *map(str, arguments)]
    environment = os.environ | ({} if cache is None else {"NUMBA_CACHE_DIR": str(cache)})
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    if done.returncode:
        raise AssertionError(f"{arguments}: {done.stderr.strip().splitlines()[-1:]}")
    result: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return result
