"""Kernels, tables of them, and the cache: it holds until a file of a kernel's folder changes."""

import os
import subprocess
import sys
from typing import Any, NamedTuple

import numpy as np
import pytest

from flightcal.compiled import Program, inlined, kernel, kind_of, warm


class Inner(NamedTuple):
    square: Any
    whole: Any


class SumCall(NamedTuple):
    values: Any
    wanted: Any
    inner: Inner
    scale: float
    offset: int
    total: Any


@kernel
def add_up(call):
    values, total = call.values, call.total
    for k in range(values.shape[0]):
        if call.wanted[k]:
            total[0] += call.scale * values[k]
    total[0] += call.offset + call.inner.square[1, 0] + call.inner.whole[-1]
    return 0


@kernel(long=True)
def at_most(call):
    """1 where the total is more than the scale."""
    return 1 if call.total[0] > call.scale else 0


class PartlyCall(NamedTuple):
    missing: Any
    total: Any


@inlined
def first_of(missing):
    if missing is None:
        return -1.0
    return missing[0]


@kernel
def add_first(call):
    call.total[0] += first_of(call.missing)
    return 0


def call_of(values, scale=2.0):
    inner = Inner(np.array([[1.0, 2.0], [30.0, 4.0]]), np.array([7, 500]))
    wanted = np.array([True, False, True])
    return SumCall(np.array(values), wanted, inner, scale, 9000, np.zeros(1))


def test_a_kernel_reads_and_fills_what_its_call_holds():
    call = call_of([1.0, 100.0, 3.0])
    assert add_up(call) == 0
    assert call.total[0] == 2.0 * 4.0 + 9000 + 30 + 500


@pytest.mark.parametrize(("missing", "expected"), [(None, 1.0), (np.array([5.0]), 7.0)])
def test_an_inlined_function_is_compiled_for_what_is_missing(missing, expected):
    total = np.array([2.0])
    assert add_first(PartlyCall(missing, total)) == 0
    assert total[0] == expected


def test_a_row_reads_anew_what_is_in_its_arrays():
    call = call_of([1.0, 100.0, 3.0])
    row = add_up.row(call)
    for expected in (9538.0, 19076.0):
        assert row() == 0
        assert call.total[0] == expected
    call.values[:] = 0.0
    row()
    assert call.total[0] == 19076.0 + 9530.0


def test_a_kernel_is_compiled_for_each_kind_of_call():
    other = call_of([1, 100, 3])
    assert kind_of(other) != kind_of(call_of([1.0, 100.0, 3.0]))
    assert kind_of(other) == kind_of(call_of([5, 6, 7, 8]))
    add_up(other)
    assert other.total[0] == 9538.0


def test_an_array_with_gaps_is_refused():
    with pytest.raises(TypeError, match="not contiguous"):
        add_up(call_of([1.0])._replace(values=np.arange(6.0)[::2]))


def test_a_program_runs_until_a_kernel_does_not_return_0():
    call = call_of([1.0, 100.0, 3.0], scale=10000.0)
    rows = [add_up.row(call), at_most.row(call)]
    assert Program([]).run() == 0
    program = Program(rows * 3)
    assert program.run() == 1
    assert call.total[0] == 40000.0 + 9530.0
    call.total[0] = -60000.0 - 2 * 9530.0
    assert program.run() == 1
    assert call.total[0] == 20000.0, "the second at_most ended it"
    assert Program([program.row, add_up.row(call)]).run() == 1


# --- the cache ------------------------------------------------------------------------------------------------

MAIN = """
from typing import Any, NamedTuple
import numpy as np
from flightcal.compiled import inlined, kernel
from .other import addend

class Call(NamedTuple):
    x: Any

@inlined
def fused(x):
    return x[0] * x[1] + x[2]

@kernel
def plus(call):
    call.x[0] = fused(call.x) + addend()
    return 0
"""
OTHER = """
from flightcal.compiled import inlined

@inlined
def addend():
    return {}
"""
USE = """
import sys
import numpy as np
from flightcal.compiled import warm
from package.{}.main import Call, plus
call = Call(np.array([1.0 + 2.0**-30, 1.0 - 2.0**-30, -1.0]))
row = plus.row(call)
hit = plus.is_cached(row.call.kind)
{}
row()
print(call.x[0], int(hit))
"""


@pytest.fixture
def package(tmp_path):
    """A function that writes a package with a folder of kernels."""

    def write(folder="kernels", addend=1):
        kernels = tmp_path / "package" / folder
        kernels.mkdir(parents=True, exist_ok=True)
        for init in (kernels.parent / "__init__.py", kernels / "__init__.py"):
            init.touch()
        (kernels / "main.py").write_text(MAIN)
        (kernels / "other.py").write_text(OTHER.format(addend))
        return kernels

    return write


def used(package, between="", **environment):
    """What plus gives in a process of its own, and whether it came from the cache."""
    folder = package.parent.parent
    path = os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "cache"), "PYTHONPATH": path, **environment}
    code = USE.format(package.name, between)
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment, cwd=folder
    )
    value, hit = done.stdout.split()
    return float(value), int(hit)


def test_a_change_in_a_folder_of_kernels_is_noticed_and_one_outside_of_it_is_not(package):
    kernels = package()
    assert used(kernels)[1] == 0
    value, hit = used(kernels)
    assert hit == 1
    (kernels.parent / "outside.py").write_text("'''Another module.'''")
    (kernels.parent / "__init__.py").write_text("'''Another docstring.'''")
    assert used(kernels) == (value, 1)
    package(addend=5)
    again, hit = used(kernels)
    assert (again, hit) == (value + 4.0, 0)


@pytest.mark.slow
def test_a_kernel_in_another_folder_holds_until_its_own_file_changes(package):
    kernels = package("elsewhere")
    assert used(kernels)[1] == 0
    package("elsewhere", addend=5)
    assert used(kernels)[1] == 1
    with (kernels / "main.py").open("a") as file:
        file.write("# another line\n")
    assert used(kernels)[1] == 0


@pytest.mark.slow
def test_strict_code_rounds_every_product_and_has_a_cache_of_its_own(package):
    kernels = package(addend=0)
    strict, hit = used(kernels, FLIGHTCAL_STRICT="1")
    assert (strict, hit) == (0.0, 0), "1 - 2^-60 is rounded to 1 before 1 is taken off"
    assert used(kernels)[1] == 0
    assert used(kernels, FLIGHTCAL_STRICT="1") == (0.0, 1)
    assert used(kernels)[1] == 1


@pytest.mark.slow
def test_a_cache_that_names_a_class_of_an_earlier_version_is_no_hindrance(package):
    kernels = package("elsewhere")
    used(kernels)
    (kernels / "main.py").write_text(MAIN.replace("Call", "Other") + "\nCall = Other\n")
    assert used(kernels)[1] == 0
    assert used(kernels)[1] == 1


ROWS = "\nwarm([row, plus.row(Call(np.array([1, 2, 3])))])\n"
CACHED = "hit = plus.is_cached(row.call.kind) and plus.is_cached(plus.row(Call(np.array([1, 2, 3]))).call.kind)"
ALONE = {
    "this process": "sys.executable = sys.executable + '-that-does-not-exist'",
    "the other one": "from flightcal import compiled; compiled._claimed = lambda *_: []",
}


@pytest.mark.slow
@pytest.mark.parametrize("alone", ALONE.values(), ids=ALONE.keys())
def test_this_process_and_another_fill_the_cache_and_one_alone_does_too(package, alone):
    kernels = package()
    assert used(kernels, alone + ROWS)[1] == 0
    assert used(kernels, CACHED)[1] == 1


def test_what_is_in_the_cache_is_not_compiled_again():
    rows = [add_up.row(call_of(values)) for values in ([1.0, 2.0, 3.0], [1, 2, 3])]
    for row in rows:
        row()
    warm(rows)
    assert all(row.kernel.is_cached(row.call.kind) for row in rows)
