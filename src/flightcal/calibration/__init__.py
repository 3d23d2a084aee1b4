"""The problem, its priors and likelihood, and the methods that solve it."""

from ..probability.priors import Priors
from .diagnostics import Diagnostics, Gate, diagnose
from .joint import AnyProblem, JointProblem, calibration_problem, warm_problem
from .methods import (
    Posterior,
    calibrate_genetic,
    calibrate_nuts,
    genetic_points,
    mean_and_some,
    posterior_tree,
    search_record,
    with_residual_noise,
)
from .mode import Mode, climb, find_mode
from .problem import Problem, build_problem

__all__ = [
    "AnyProblem",
    "Diagnostics",
    "Gate",
    "JointProblem",
    "Mode",
    "Posterior",
    "Priors",
    "Problem",
    "build_problem",
    "calibrate_genetic",
    "calibrate_nuts",
    "calibration_problem",
    "climb",
    "diagnose",
    "find_mode",
    "genetic_points",
    "mean_and_some",
    "posterior_tree",
    "search_record",
    "warm_problem",
    "with_residual_noise",
]
