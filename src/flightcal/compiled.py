"""How compiled functions are made: by Numba, at the first call, and kept in a cache on disk.

A **kernel** is a C function of one address. It is compiled once, it is never linked into another, and others call it by
its address. So a log density is a table of kernels (`Program`), not code. To write one:

    class SumCall(NamedTuple):            # what it reads and what it fills: arrays, numbers, and named tuples of these
        values: Any                       # [n]
        total: Any                        # [1]

    @kernel                               # @kernel(long=True) for what takes long: Python's other threads run meanwhile
    def add_up(call):
        values, total = call.values, call.total    # name what loops use: each `call.x` reads the description anew
        total[0] = 0.0
        for k in range(values.shape[0]):
            total[0] += values[k]
        return 0                          # another number ends a Program: the reason

    total = np.empty(1)
    add_up(SumCall(values, total))        # from Python, once
    row = add_up.row(SumCall(values, total))       # stored once, to be called often: row() -> 0
    Program([row, other.row(...)]).run()  # one after the other, in C

Rules: arrays are C-contiguous; what is missing is None, which an `@inlined` function is compiled for (`if x is None`);
numbers are int or float and stay what they are (what changes is an array, and so is a
bool); a stored call's arrays stay where they are, so change what is in them, not which they are. A kernel allocates
nothing and raises nothing; its memory comes with the call. Inside of a kernel, `@inlined` functions are its parts. A
kernel is compiled for each kind of call (number of dimensions and type of each array) that it is asked for.

A cached kernel holds until a file of its folder changes, if that folder is called ``kernels``, or else until its own
file does; so a folder ``kernels`` holds compiled code alone, and calls no compiled code outside of it. With
FLIGHTCAL_STRICT=1 in the environment every product and sum is rounded by itself, however code is cut up and inlined.
"""

from __future__ import annotations

import ctypes
import hashlib
import importlib
import os
import pickle
import subprocess
import sys
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import cache, cached_property, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
from llvmlite import ir
from numba import from_dtype, njit
from numba.core import sigutils, types
from numba.core.caching import IndexDataCacheFile
from numba.core.ccallback import CFunc
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.extending import intrinsic, lower_getattr_generic, models, register_model
from numpy.typing import NDArray

_STRICT = os.environ.get("FLIGHTCAL_STRICT") == "1"

_OPTIONS: dict[str, Any] = {
    "error_model": "numpy",
    "fastmath": False if _STRICT else {"contract", "nsz", "arcp"},
    "_nrt": False,
}
"""Products and sums may be fused and divisions by the same number shared; nothing is reordered, and NaN and infinity
keep their meaning. Compiled code allocates nothing (its memory comes from Python), so Numba need not count references
to arrays, which it otherwise does at every access."""


@cache
def _digest(path: Path) -> str:
    """Of a file, or of all files of a folder."""
    digest = hashlib.sha256()
    for file in sorted(path.glob("*.py")) if path.is_dir() else [path]:
        digest.update(file.read_bytes())
    return digest.hexdigest()


def _cached(function: Any, code: Callable[..., Any], what: str) -> Any:
    """Have a function's cache hold as long as a kernel's; what: sets it apart from others of the same code.

    Numba reads an index before it looks at the stamp, and the index names the classes of arguments: after an upgrade,
    perhaps ones that are no longer there.
    """
    file, cached = Path(code.__code__.co_filename), function._cache
    stamp = _digest(file.parent if file.parent.name == "kernels" else file)
    name = hashlib.sha256(f"{what} {_STRICT}".encode()).hexdigest()[:12]
    cached._cache_file = IndexDataCacheFile(cached.cache_path, f"{cached._impl.filename_base}-{name}", stamp)
    load = cached._cache_file._load_index

    def load_index() -> Any:
        try:
            return load()
        except (ImportError, AttributeError):
            return {}

    cached._cache_file._load_index = load_index
    return function


inlined: Any = njit(**(_OPTIONS | {"forceinline": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}))
"""A function that compiled functions call; a call that is not inlined copies every array's description, which takes
longer than the work on a small network."""


# --- a call: what a kernel is given ---------------------------------------------------------------------------


class CallType(types.Type):
    """Numba's type of a kernel's argument: the address of a named tuple of type `kind`, whose fields can be read."""

    def __init__(self, kind: Any) -> None:
        self.kind = kind
        super().__init__(name=f"Call({kind})")


register_model(CallType)(models.OpaqueModel)


@infer_getattr
class _Fields(AttributeTemplate):
    key = CallType

    def generic_resolve(  # type: ignore[override]
        self, call: Any, name: str
    ) -> Any:
        return call.kind.types[call.kind.fields.index(name)] if name in call.kind.fields else None


@lower_getattr_generic(CallType)
def _read(context: Any, builder: Any, call: Any, address: Any, name: str) -> Any:
    pointer = builder.bitcast(address, context.get_value_type(call.kind).as_pointer())
    return _load(builder, builder.gep(pointer, [_word(0), _word(call.kind.fields.index(name))]))


def _word(number: int) -> Any:
    return ir.Constant(ir.IntType(32), number)


def _load(builder: Any, pointer: Any) -> Any:
    """What lies there, piece by piece: nothing of it changes while a kernel runs, which LLVM cannot see by itself."""
    kind = pointer.type.pointee
    if not isinstance(kind, ir.Aggregate):
        loaded = builder.load(pointer)
        loaded.set_metadata("invariant.load", builder.module.add_metadata([]))
        return loaded
    value = ir.Constant(kind, ir.Undefined)
    for k in range(len(kind)):
        value = builder.insert_value(value, _load(builder, builder.gep(pointer, [_word(0), _word(k)])), k)
    return value


@cache
def _array_kind(dtype: Any, dimensions: int) -> Any:
    return types.Array(from_dtype(dtype), dimensions, "C")


_TUPLE_KINDS: dict[tuple[Any, ...], Any] = {}
"""By class and identities of the kinds: to compare Numba's types takes long."""


def _tuple_kind(made_by: type, kinds: list[Any]) -> Any:
    key = (made_by, *map(id, kinds))
    if key not in _TUPLE_KINDS:
        _TUPLE_KINDS[key] = types.BaseTuple.from_types(kinds, made_by)
    return _TUPLE_KINDS[key]


def kind_of(value: Any) -> Any:
    """Numba's type of what a call holds."""
    if isinstance(value, np.ndarray):
        if not value.flags.c_contiguous:
            raise TypeError(f"found an array {value.shape} that is not contiguous, expected a contiguous one")
        return _array_kind(value.dtype, value.ndim)
    if isinstance(value, tuple):
        return _tuple_kind(type(value), [kind_of(part) for part in value])
    if value is None:
        return types.none
    return types.float64 if isinstance(value, float) else types.int64


def _words(value: Any) -> list[int]:
    """The same as compiled code has it in memory: of an array size, address, shape and strides."""
    if isinstance(value, np.ndarray):
        return [0, 0, value.size, value.itemsize, value.ctypes.data, *value.shape, *value.strides]
    if isinstance(value, tuple):
        return [word for part in value for word in _words(part)]
    if value is None:
        return [0]
    return [int(np.float64(value).view(np.int64)) if isinstance(value, float) else int(value)]


class Stored:
    """A call in memory as compiled code has it."""

    def __init__(self, call: NamedTuple) -> None:
        self.kind = kind_of(call)
        self._memory = np.array(_words(call), np.int64)
        self.address = self._memory.ctypes.data
        self.kept = call
        """The arrays that it refers to."""


# --- kernels ----------------------------------------------------------------------------------------------------


class Kernel:
    """A C function of the address of a call, compiled when it is first asked for."""

    def __init__(self, function: Callable[[Any], Any], long: bool) -> None:
        self.function, self._long = function, long
        self._compiled: dict[Any, Any] = {}

    def compile(self, kind: Any) -> tuple[int, Any]:
        """Address of the C function for one kind of call, and the same for Python; from the cache where it is there."""
        if kind not in self._compiled:
            made = c_function(self.function, types.int64(CallType(kind)))
            # ctypes holds the interpreter lock or frees it; to get it back may take longer than a short function.
            prototype = ctypes.CFUNCTYPE if self._long else ctypes.PYFUNCTYPE
            self._compiled[kind] = made, prototype(ctypes.c_int64, ctypes.c_void_p)(made)
        return self._compiled[kind]

    def is_cached(self, kind: Any) -> bool:
        """Whether nothing need be compiled."""
        made = _prepared(self.function, types.int64(CallType(kind)))
        return made._cache.load_overload(made._sig, made._targetdescr.target_context) is not None

    def row(self, call: NamedTuple) -> Row:
        """A call of this kernel."""
        return Row(self, call)

    def __call__(self, call: NamedTuple) -> int:
        """Run it once."""
        return self.row(call)()


def kernel(function: Callable[[Any], Any] | None = None, *, long: bool = False) -> Any:
    """Make a C function of one call; see the module. long: what Python calls frees the interpreter lock."""
    return (lambda made: Kernel(made, long)) if function is None else Kernel(function, long)


@dataclass(frozen=True, eq=False)
class Row:
    """A kernel with one call of it."""

    kernel: Kernel
    given: NamedTuple

    @cached_property
    def call(self) -> Stored:
        """What it is given, as compiled code has it: made when it is first needed, which some rows never are."""
        return Stored(self.given)

    @cached_property
    def _run(self) -> Any:
        return partial(self.kernel.compile(self.call.kind)[1], self.call.address)

    def __call__(self) -> int:
        """Run it; the kernel's result."""
        return int(self._run())

    @property
    def addresses(self) -> tuple[int, int]:
        """Of the C function and of the call."""
        return self.kernel.compile(self.call.kind)[0], self.call.address


def _prepared(function: Callable[..., Any], signature: Any) -> Any:
    made: Any = CFunc(function, sigutils.normalize_signature(signature), locals={}, options=_OPTIONS)
    made.enable_caching()
    return _cached(made, function, str(signature))


_MADE: list[Any] = []
"""What would else be freed while its address is in use."""


@cache
def c_function(function: Callable[..., Any], signature: Any) -> int:
    """Address of a C function of any signature, compiled and cached as a kernel is."""
    made = _prepared(function, signature)
    made.compile()
    _MADE.append(made)
    return int(made.address)


@intrinsic
def short_loops(typing_context: Any) -> Any:
    """Said first in a kernel whose loops have a few rounds each: they are left as they are written.

    To unroll them, which is good for long ones, costs more than a tenth of the time of a small network.
    """

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        builder.function.attributes.add("optsize")
        return context.get_dummy_value()

    return types.void(), generate


# --- a table of kernels ---------------------------------------------------------------------------------------


@intrinsic
def call_at(typing_context: Any, function: Any, call: Any) -> Any:
    """The kernel at an address, of the call at another."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        word = ir.IntType(64)
        return builder.call(builder.inttoptr(args[0], ir.FunctionType(word, [word]).as_pointer()), [args[1]])

    return types.int64(types.int64, types.int64), generate


@inlined
def run_rows(rows: Any) -> Any:
    """Run kernels (address, address of the call) [R, 2] in order until one does not return 0, which is the result."""
    for k in range(rows.shape[0]):
        outcome: Any = call_at(rows[k, 0], rows[k, 1])  # type: ignore[call-arg]
        if outcome != 0:
            return outcome
    return 0


class _Table(NamedTuple):
    rows: Any


@kernel(long=True)
def run_program(call: Any) -> Any:
    """The same as a kernel: one for every model."""
    return run_rows(call.rows)


class Program:
    """Kernels with their calls, run one after the other until one does not return 0: what is computed, as data."""

    def __init__(self, rows: Sequence[Row]) -> None:
        self.rows = tuple(rows)

    @cached_property
    def table(self) -> NDArray[np.int64]:
        """[R, 2] addresses; see `run_rows`."""
        return np.array([row.addresses for row in self.rows], np.int64).reshape(-1, 2)

    @cached_property
    def row(self) -> Row:
        """The whole Program as one row."""
        return run_program.row(_Table(self.table))

    def run(self) -> int:
        """0, or what the kernel returned that ended it; the interpreter lock is free meanwhile."""
        return self.row()


K = TypeVar("K")


class Spare(Generic[K]):
    """Memory of programs, each for one user at a time: what is free is used again, and made where nothing is free.

    Not a `threading.local`: a thread of nutpie's is a new one to Python at every call, and finds that empty. It keeps
    no function that makes memory: one that knows the owner would keep both alive until garbage is collected, which
    gigabytes of arrays do not hasten.
    """

    def __init__(self) -> None:
        self._free: defaultdict[tuple[Any, ...], list[K]] = defaultdict(list)

    @contextmanager
    def borrowed(self, make: Callable[..., K], *kind: Any) -> Iterator[K]:
        """Memory of a kind that nobody else has during the block; make(*kind): what is not there yet."""
        free = self._free[kind]
        try:
            memory = free.pop()
        except IndexError:  # looked for in one go: another thread may take the last one
            memory = make(*kind)
        try:
            yield memory
        finally:
            free.append(memory)


# --- ahead of time ----------------------------------------------------------------------------------------------


def warm(rows: Iterable[Row]) -> None:
    """Have the kernels of rows in the cache: what is missing is compiled by this process and another, side by side.

    Numba lets only one thread of a process compile.
    """
    wanted = {(row.kernel, row.call.kind): None for row in rows}
    missing = [(kernel, kind) for kernel, kind in wanted if not kernel.is_cached(kind)]
    # What is given much is long.
    missing.sort(key=lambda task: len(str(task[1])), reverse=True)
    if len(missing) < 2:
        return
    with TemporaryDirectory() as claims, ExitStack() as other:
        names = [(kernel.function.__module__, kernel.function.__name__, kind) for kernel, kind in missing]
        command = [sys.executable, "-c", f"from {__name__} import _compile_asked; _compile_asked()"]
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(part for part in sys.path if part)}
        with suppress(OSError):
            process = other.enter_context(subprocess.Popen(command, stdin=subprocess.PIPE, env=environment))
            assert process.stdin is not None
            with process.stdin:
                process.stdin.write(pickle.dumps((claims, names)))
        for kernel, kind in _claimed(claims, missing):
            kernel.compile(kind)


def _compile_asked() -> None:
    """What the other process does. Where it fails, the first one compiles what it then finds missing."""
    claims, names = pickle.load(sys.stdin.buffer)
    for module, name, kind in _claimed(claims, names):
        getattr(importlib.import_module(module), name).compile(kind)


def _claimed(folder: str, tasks: Sequence[Any]) -> Iterator[Any]:
    """Those that no other process works on."""
    for k, task in enumerate(tasks):
        with suppress(FileExistsError):
            Path(folder, str(k)).touch(exist_ok=False)
            yield task
