"""The same scheme in C (rodas3.c), compiled when the benchmark runs, and called through ctypes."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from flightcal.simulator import Drive, Structure, System

FLAGS = ("-O3", "-march=native", "-std=c11", "-fPIC", "-shared")
_SOURCE = Path(__file__).with_name("rodas3.c")

_COUNTS = ("n", "heaters", "steps", "inputs", "forcings", "heatings")
_ARRAYS = (
    "mass", "a_start", "a_col", "a_slot", "n_start", "n_col", "n_slot", "f_start", "f_col", "f_diag",
    "b_row", "b_col", "g_heater", "g_row", "sensor",
    "A", "N", "B", "g", "lower", "upper", "x0", "times", "w", "on0",
)  # fmt: skip


class _Problem(ctypes.Structure):
    _fields_ = (*((name, ctypes.c_int64) for name in _COUNTS), *((name, ctypes.c_void_p) for name in _ARRAYS))


def compiler_version() -> str:
    """First line of `gcc --version`; empty where there is none."""
    found = shutil.which("gcc")
    if found is None:
        return ""
    printed = subprocess.run([found, "--version"], capture_output=True, text=True, check=True).stdout
    return printed.splitlines()[0]


@cache
def _library() -> ctypes.CDLL:
    with tempfile.TemporaryDirectory() as folder:
        built = Path(folder) / "rodas3.so"
        subprocess.run(["gcc", *FLAGS, "-o", str(built), str(_SOURCE), "-lm"], check=True)
        library = ctypes.CDLL(str(built))
    library.simulate.argtypes = [ctypes.POINTER(_Problem), ctypes.c_void_p]
    library.simulate.restype = ctypes.c_int64
    return library


def forward(structure: Structure, system: System, drive: Drive) -> Callable[[], Any]:
    """A function that simulates and returns states [K+1, n]; all heaters by their thermostats.

    Everything that is not the simulation is done here, once.
    """
    library = _library()
    inputs = np.concatenate([drive.inputs[:1, 0], drive.inputs[:, 1]])  # linear between grid points
    arrays = [
        structure.mass, structure.linear_start, structure.linear_column, structure.linear_slot,
        structure.radiative_start, structure.radiative_column, structure.radiative_slot,
        structure.factor_start, structure.factor_column, structure.factor_diagonal,
        structure.forcing_row, structure.forcing_column, structure.heating_heater, structure.heating_row,
        structure.sensor, system.linear, system.radiative, *system[3:], drive.times, inputs, drive.initially_on,
    ]  # fmt: skip
    kept = [
        np.ascontiguousarray(array, np.int64 if np.issubdtype(np.asarray(array).dtype, np.integer) else np.float64)
        for array in arrays
    ]
    n, steps = len(structure.mass), len(drive.times) - 1
    counts = (n, len(structure.sensor), steps, inputs.shape[1], len(system.forcing), len(system.heating))
    problem = _Problem(*counts, *(array.ctypes.data for array in kept))
    states = np.empty((steps + 1, n))
    address = states.ctypes.data

    def simulate(_: Any = kept) -> Any:
        if library.simulate(ctypes.byref(problem), address) < 0:
            raise MemoryError("the C program found no memory")
        return states

    return simulate
