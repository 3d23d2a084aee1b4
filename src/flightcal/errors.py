"""Errors that are the user's to mend, shown as a message, never as a traceback; and how commands end."""

from __future__ import annotations

import math
import os
from importlib.util import find_spec
from typing import Final

USER_ERROR: Final = 1
GATE_FAILED: Final = 3
"""The sampling cannot be believed, or a check found what matters."""
MODEL_FAILED: Final = 4
"""The model does not fit, or its intervals do not hold."""
WITH_LIMITS: Final = 5
"""To be used for some of it, and not for the rest."""
INTERRUPTED: Final = 130


class FlightcalError(Exception):
    """Something in the user's input or run is wrong; the message names place, what was found and what was expected."""


class ScenarioError(FlightcalError):
    """The scenario file is wrong."""


class TelemetryError(FlightcalError):
    """The telemetry cannot be used as the scenario describes it."""


class OrbitError(FlightcalError):
    """The orbit or attitude cannot be evaluated."""


class RunError(FlightcalError):
    """A run directory is not what the command needs."""


def require(module: str, extra: str, what: str) -> None:
    """Raise FlightcalError where a module that `what` needs is not installed; extra: what installs it."""
    if find_spec(module) is None:
        raise FlightcalError(f"{what}: found no package '{module}', which it needs: pip install \"flightcal[{extra}]\"")


def require_memory(size: float, what: str) -> None:
    """Raise FlightcalError where `what` needs more bytes than the machine has."""
    if size > physical_memory():
        raise FlightcalError(f"{what}: needs {memory_size(size)} of memory, found {memory_size(physical_memory())}")


def physical_memory() -> float:
    """Of this machine, in bytes; infinite where the system does not say."""
    try:
        return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, ValueError, OSError):
        return math.inf


def memory_size(size: float) -> str:
    """Bytes as messages give them."""
    return f"{size / 2**30:.3g} GiB"
