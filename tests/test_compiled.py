"""Compiled functions are taken from the cache until a file of their folder changes."""

import os
import subprocess
import sys

MAIN = """
from flightcal.compiled import compiled
from .other import addend

@compiled
def plus(x):
    return x + addend()
"""
OTHER = """
from flightcal.compiled import inlined

@inlined
def addend():
    return {}
"""


def call(folder):
    """What plus(1) gives in a process of its own, and how often it came from the cache."""
    code = "from package.main import plus; print(plus(1), sum(plus.stats.cache_hits.values()))"
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "cache"), "PYTHONPATH": str(folder)}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment, cwd=folder
    )
    return tuple(map(int, done.stdout.split()))


def test_a_change_in_a_file_that_a_compiled_function_calls_is_noticed(tmp_path):
    package = tmp_path / "package"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "main.py").write_text(MAIN)
    (package / "other.py").write_text(OTHER.format(1))
    assert call(tmp_path) == (2, 0)
    assert call(tmp_path) == (2, 1)
    (package / "other.py").write_text(OTHER.format(5))
    assert call(tmp_path) == (6, 0)


TAKES_A_PAIR = """
from flightcal.compiled import compiled
from .{} import Pair

@compiled
def added(pair):
    return pair.left + pair.right

def plus(x):
    return added(Pair(x, 1))

plus.stats = added.stats
"""
PAIR = """
from typing import NamedTuple

class Pair(NamedTuple):
    left: int
    right: int
"""


def test_a_cache_that_names_a_class_of_an_earlier_version_is_no_hindrance(tmp_path):
    package = tmp_path / "package"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "earlier.py").write_text(PAIR)
    (package / "main.py").write_text(TAKES_A_PAIR.format("earlier"))
    assert call(tmp_path) == (2, 0)
    assert call(tmp_path) == (2, 1)
    (package / "earlier.py").rename(package / "later.py")
    (package / "main.py").write_text(TAKES_A_PAIR.format("later"))
    assert call(tmp_path) == (2, 0)
    assert call(tmp_path) == (2, 1)
