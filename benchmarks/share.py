"""The compiled integration without the Python around it, as the sampler runs it: alone, and with its adjoint."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numba import types

from flightcal.calibration import Problem
from flightcal.calibration.native import FOLDERS
from flightcal.calibration.whitening import Whitening
from flightcal.compiled import callback, make_stored, store, stored
from flightcal.simulator import Drive, Structure, simulate
from flightcal.simulator.adjoint import adjoint
from flightcal.simulator.forward import COUNTERS, REALS, forward
from flightcal.simulator.integrate import NOTHING, make_outputs, make_record, step_memory


def integration_alone(problem: Problem, z: Any) -> Callable[[], Any]:
    """What `problem.log_density_and_gradient(z)` spends its time in: the same integration and adjoint, nothing else."""
    density = problem.native_density(Whitening(np.zeros(len(z)), np.eye(len(z))))
    assert density is not None
    density(z)
    made = callback(_integration, types.int64(types.voidptr), [*FOLDERS, Path(__file__).parent])
    function = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p)(made.address)
    return lambda: (function(density.address), density)


_stored_forward = make_stored()


def forward_alone(structure: Structure, packed: Any, drive: Drive) -> Callable[[], Any]:
    """A function that simulates a packed system [P] and returns states [K+1, n].

    Everything that is not the simulation is done here, once: its memory and arguments are prepared.
    """
    heaters, switches = len(structure.sensor), len(drive.times)
    record = make_record(structure, drive, 1, 2 * switches, None)
    outputs = make_outputs(structure, NOTHING, 1, switches)
    arguments = (  # no named tuple: Numba would look for its class in every process that shares the cache
        structure, packed[None], drive.times, drive.series, drive.measured, drive.initially_on,
        NOTHING.sampling, NOTHING.sensors, np.zeros((1, 3, 0)), np.zeros((1, 0, heaters)),
        step_memory(structure, 0)[0], np.empty((COUNTERS, 1), np.int64), np.empty((REALS, 1)),
        np.empty((1, heaters), np.bool_), record, outputs,
    )  # fmt: skip
    kept = store(arguments)
    folder = Path(simulate.__file__ or "").parent
    made = callback(_forward, types.int64(types.voidptr), [folder, Path(__file__).parent])
    function = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p)(made.address)
    address = kept.ctypes.data
    return lambda: (function(address), record.states[0], arguments, kept)[1]


def _forward(address):  # type: ignore[no-untyped-def]
    arguments = _stored_forward(address)
    arguments[-1].noted[0] = 0
    forward(*arguments)
    return 0


def _integration(address):  # type: ignore[no-untyped-def]
    call = stored(address)
    window, work = call.posterior.window, call.work
    work.outputs.noted[0] = 0
    forward(
        window.structure, work.packed, window.times, window.series, window.measured, window.initially_on,
        window.sampling, window.sensors, work.errors, work.scatter,
        work.memory, work.counters, work.reals, work.driven, work.record, work.outputs,
    )  # fmt: skip
    adjoint(
        window.structure, work.packed[0], window.times, window.series, work.record,
        work.states_bar, work.switches_bar[: work.outputs.switches[0]],
        work.adjoint_memory, work.heat_bar, work.packed_bar,
    )  # fmt: skip
    return 0
