"""How compiled functions are made: by Numba, at the first call, and kept in a cache on disk.

Numba's cache looks at the file of a function alone; what it calls in other files may change unseen. So the stamp that a
cached function carries is that of all files of its folder, and a compiled function calls no one outside of it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from numba import njit

_OPTIONS: dict[str, Any] = {
    "error_model": "numpy",
    "fastmath": {"contract", "nsz", "arcp"},
    "_nrt": False,
}
"""Products and sums may be fused and divisions by the same number shared; nothing is reordered, and NaN and infinity
keep their meaning. Compiled code allocates nothing (its memory comes from Python), so Numba need not count references
to arrays, which it otherwise does at every access."""


@cache
def _digest(folder: Path) -> str:
    digest = hashlib.sha256()
    for file in sorted(folder.glob("*.py")):
        digest.update(file.read_bytes())
    return digest.hexdigest()


def compiled(function: Callable[..., Any]) -> Any:
    """A short function that Python calls: compiled at its first call, and cached until a file of its folder changes."""
    return _cached(function, nogil=False)


def compiled_long(function: Callable[..., Any]) -> Any:
    """The same for what takes long: the interpreter lock is free while it runs.

    To get the lock back while other threads want it may take longer than a short function.
    """
    return _cached(function, nogil=True)


def _cached(function: Callable[..., Any], *, nogil: bool) -> Any:
    dispatcher: Any = njit(cache=True, nogil=nogil, **_OPTIONS)(function)
    dispatcher._cache._cache_file._source_stamp = _digest(Path(function.__code__.co_filename).parent)
    return dispatcher


inlined: Any = njit(forceinline=True, **_OPTIONS)
"""A function that compiled functions call; a call that is not inlined copies every array's description, which takes
longer than the work on a small network."""
