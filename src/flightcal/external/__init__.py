"""Simulators that flightcal did not write, behind the one `Simulator` protocol.

Imports: errors, scenario, simulator, telemetry.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .build import build_external
    from .program import RunFailure
    from .record import FINISHED, Outcome, Record
    from .simulator import ExternalSimulator, status_switches

_PLACES = {
    "build_external": "build",
    "RunFailure": "program",
    "FINISHED": "record",
    "Outcome": "record",
    "Record": "record",
    "ExternalSimulator": "simulator",
    "status_switches": "simulator",
}


def __getattr__(name: str) -> Any:
    # Imported on first use: a worker process, which runs what is not ours, needs none of it.
    if name not in _PLACES:
        raise AttributeError(f"module 'flightcal.external' has no attribute '{name}'")
    return getattr(importlib.import_module(f".{_PLACES[name]}", __name__), name)
