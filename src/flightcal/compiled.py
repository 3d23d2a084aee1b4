"""How compiled functions are made: by Numba, at the first call, and kept in a cache on disk.

Numba's cache looks at the file of a function alone; what it calls in other files may change unseen. So the stamp that a
cached function carries is that of all files of its folder, and a compiled function calls no one outside of it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit, typeof
from numba.core import sigutils, types
from numba.core.ccallback import CFunc
from numba.extending import intrinsic
from numpy.typing import NDArray

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
    _stamp(dispatcher, _digest(Path(function.__code__.co_filename).parent))
    return dispatcher


def _stamp(function: Any, stamp: str) -> None:
    """Have a function's cache hold only while the stamp stays, and be empty where it cannot be read.

    Numba reads an index before it looks at the stamp, and the index names the classes of arguments: after an upgrade,
    perhaps ones that are no longer there.
    """
    file = function._cache._cache_file
    load = file._load_index

    def load_index() -> Any:
        try:
            return load()
        except (ImportError, AttributeError):
            return {}

    file._source_stamp, file._load_index = stamp, load_index


inlined: Any = njit(forceinline=True, **_OPTIONS)
"""A function that compiled functions call; a call that is not inlined copies every array's description, which takes
longer than the work on a small network."""


# --- functions that need no Python ----------------------------------------------------------------------------


class _Stored:
    """Numba's type of the value that `store` has put away; a compiled function that calls `stored` is made for it."""

    kind: Any = None


def make_stored() -> Any:
    """A function `stored` for C functions of another kind of value: Numba asks each for its type only once."""

    @intrinsic
    def stored(typing_context: Any, address: Any) -> Any:
        """The value at an address; see `store`."""
        kind = _Stored.kind

        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            return builder.load(builder.bitcast(args[0], context.get_value_type(kind).as_pointer()))

        return kind(types.voidptr), generate

    return stored


stored = make_stored()


@intrinsic
def _put(typing_context: Any, address: Any, value: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = builder.inttoptr(args[0], context.get_value_type(value).as_pointer())
        builder.store(args[1], pointer)
        return context.get_constant(types.int64, context.get_abi_sizeof(context.get_value_type(value)))

    return types.int64(types.int64, value), generate


@compiled
def _store(address: Any, value: Any) -> Any:
    return _put(address, value)  # type: ignore[call-arg]


def store(value: Any) -> NDArray[np.uint8]:
    """Memory that holds `value`, a named tuple of arrays, as compiled code has it; the arrays must outlive its use.

    To hand many arrays to a compiled function takes longer than a short one runs, and only Python can do it.
    """
    kind = typeof(value)
    leaves = _leaves(kind)
    memory = np.zeros(_MOST_WORDS * leaves, np.uint64)
    _store(memory.ctypes.data, value)
    _Stored.kind = kind
    return memory.view(np.uint8)


_MOST_WORDS = 16
"""Of an array of up to four dimensions: five, and two for each dimension; with room to spare."""


def _leaves(kind: Any) -> int:
    """How many arrays and numbers it holds."""
    return sum(_leaves(part) for part in kind.types) if hasattr(kind, "types") else 1


def callback(function: Callable[..., Any], signature: Any, folders: Sequence[Path]) -> Any:
    """A C function, compiled and cached until a file of the folders, or the type of what is `stored`, changes."""
    compiled_function: Any = CFunc(function, sigutils.normalize_signature(signature), locals={}, options=_OPTIONS)
    compiled_function.enable_caching()
    kind = hashlib.sha256(str(_Stored.kind).encode()).hexdigest()
    stamp = "".join([*(_digest(folder) for folder in folders), kind])
    _stamp(compiled_function, stamp)
    compiled_function.compile()
    return compiled_function
