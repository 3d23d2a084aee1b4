"""Calibrate spacecraft operational simulation models in flight, with honest uncertainty."""

from __future__ import annotations

import importlib
from importlib import metadata
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .calibration import Posterior, calibrate_genetic, calibrate_nuts, genetic_points
    from .campaign import open_campaign
    from .commands.calibrate import Summary, run_experiment
    from .errors import FlightcalError
    from .prediction import comparison_table, predict, score
    from .problem import Problem, build_problem
    from .report import write_report
    from .scenario import Scenario, lint, load_scenario
    from .telemetry import read

    __version__: str

_PLACES = {
    "Posterior": "calibration",
    "Problem": "problem",
    "Scenario": "scenario",
    "Summary": "commands.calibrate",
    "FlightcalError": "errors",
    "build_problem": "problem",
    "calibrate_genetic": "calibration",
    "calibrate_nuts": "calibration",
    "comparison_table": "prediction",
    "genetic_points": "calibration",
    "lint": "scenario",
    "load_scenario": "scenario",
    "open_campaign": "campaign",
    "predict": "prediction",
    "read": "telemetry",
    "run_experiment": "commands.calibrate",
    "score": "prediction",
    "write_report": "report",
}

__all__ = [
    "FlightcalError",
    "Posterior",
    "Problem",
    "Scenario",
    "Summary",
    "build_problem",
    "calibrate_genetic",
    "calibrate_nuts",
    "comparison_table",
    "genetic_points",
    "lint",
    "load_scenario",
    "open_campaign",
    "predict",
    "read",
    "run_experiment",
    "score",
    "write_report",
]


def __getattr__(name: str) -> Any:
    # Imported on first use: the numerical packages take seconds to load, and `flightcal --help` needs none.
    if name == "__version__":
        return metadata.version("flightcal")
    if name not in _PLACES:
        raise AttributeError(f"module 'flightcal' has no attribute '{name}'")
    return getattr(importlib.import_module(f".{_PLACES[name]}", __name__), name)


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
