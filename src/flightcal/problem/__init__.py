"""The calibration problem: priors and windows of telemetry, and the log density on unconstrained z."""

from .coordinates import Whitening, whitening
from .joint import AnyProblem, JointProblem, calibration_problem, join, label_of, warm_problem
from .native import STOPPED, NativeDensity
from .problem import Problem, build_problem
from .synthetic import simulate_telemetry, with_telemetry

__all__ = [
    "STOPPED",
    "AnyProblem",
    "JointProblem",
    "NativeDensity",
    "Problem",
    "Whitening",
    "build_problem",
    "calibration_problem",
    "join",
    "label_of",
    "simulate_telemetry",
    "warm_problem",
    "whitening",
    "with_telemetry",
]
