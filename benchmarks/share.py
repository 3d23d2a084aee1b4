"""How much of a log density with its gradient is the compiled integration and its adjoint."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numba import types

from flightcal.calibration import Problem, native
from flightcal.calibration.whitening import Whitening
from flightcal.compiled import callback, stored
from flightcal.simulator import simulate
from flightcal.simulator.adjoint import adjoint
from flightcal.simulator.forward import forward


def integration_alone(problem: Problem, z: Any) -> Callable[[], Any]:
    """What `problem.log_density_and_gradient(z)` spends its time in: the same integration and adjoint, nothing else."""
    density = problem.native_density(Whitening(np.zeros(len(z)), np.eye(len(z))))
    assert density is not None
    density(z)
    folders = [Path(module.__file__ or "").parent for module in (native, simulate)]
    made = callback(_integration, types.int64(types.voidptr), [*folders, Path(__file__).parent])
    function = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p)(made.address)
    return lambda: (function(density.address), density)


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
