"""The calibration problem: priors and windows of telemetry, and the log density on unconstrained z.

Imports: compiled, environment, errors, external, probability, reduction, scenario, simulator, telemetry.
"""

from .build import build_problem, build_window, initial_priors, problem_of
from .coordinates import Whitening, whitening
from .entries import Entry
from .native import STOPPED, NativeDensity
from .problem import Problem, Runs
from .simulators import build_simulator
from .synthetic import simulate_telemetry, with_telemetry
from .window import Window

__all__ = [
    "STOPPED",
    "Entry",
    "NativeDensity",
    "Problem",
    "Runs",
    "Whitening",
    "Window",
    "build_problem",
    "build_simulator",
    "build_window",
    "initial_priors",
    "problem_of",
    "simulate_telemetry",
    "whitening",
    "with_telemetry",
]
