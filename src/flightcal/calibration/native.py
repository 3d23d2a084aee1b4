"""The log density of thermal networks, and its gradient, as one C function.

Nothing of Python is in it: chains run side by side without a common lock, and no time goes into handing arrays over.
It is a table of kernels (a Program), for one window as for many, in three phases: all windows forwards, what they have
in common, all windows backwards.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
from numba import types

from ..compiled import CallType, Program, Row, c_function
from ..probability.likelihood import residual_memory
from ..probability.priors import NDTRI, Priors
from ..probability.residuals import ResidualModel
from ..probability.status import HeaterStatus
from ..probability.switching import status_work
from ..simulator import NetworkSimulator
from ..simulator.kernels.forward import NOT_FINITE, TOO_MANY_SWITCHES
from ..simulator.system import FloatArray, IntArray
from . import whitening
from .kernels import density as kernels
from .kernels.density import DENSITY_NOT_FINITE, DRAWS, FAILURES, GRADIENTS, REASON, STOP, STOPPED

__all__ = ["DENSITY_NOT_FINITE", "REASONS", "STOPPED", "NativeDensity", "WindowParts", "native_density"]

REASONS = {
    NOT_FINITE: "a temperature is not finite",
    TOO_MANY_SWITCHES: "heaters switch too often: a thermostat chatters",
    DENSITY_NOT_FINITE: "the log density or its gradient is not finite",
}


@dataclass(frozen=True)
class WindowParts:
    """What a density reads of one window, and how the window's theta [m] follows from the problem's [d]."""

    simulator: NetworkSimulator
    priors: Priors
    """Of the window's theta; what drifts is transformed by them."""
    observed: FloatArray
    residuals: ResidualModel
    simulated: IntArray
    """Places in the window's theta of what the simulator takes."""
    places: tuple[IntArray, IntArray, IntArray]
    """Of the residuals' numbers that are entries: channels, columns and places in the window's theta."""
    status: HeaterStatus | None
    settings: tuple[IntArray, IntArray]
    """Of the status' settings that are entries: which, and places in the window's theta."""
    columns: IntArray
    """[m] places in the problem's theta."""
    drifts: tuple[IntArray, IntArray]
    """[m] places in the problem's theta of tau and xi; -1: it does not drift."""


@dataclass(frozen=True)
class NativeDensity:
    """A density of its own memory, for one thread at a time."""

    program: Program
    call: Row
    """Of what nutpie calls."""
    dimensions: int

    @cached_property
    def _functions(self) -> tuple[Any, Any]:
        return _functions(self.call.kind)

    @property
    def function(self) -> Any:
        """(d, w, gradient, log density, `address`) -> 0, or another number where there is no density."""
