"""The problem, its priors and likelihood, and the methods that solve it."""

from .diagnostics import Diagnostics, Gate, diagnose
from .methods import (
    Posterior,
    calibrate_genetic,
    calibrate_nuts,
    genetic_points,
    mean_and_some,
    posterior_tree,
    with_residual_noise,
)
from .mode import Mode, climb, find_mode
from .priors import Priors
from .problem import Problem, build_problem

__all__ = [
    "Diagnostics",
    "Gate",
    "Mode",
    "Posterior",
    "Priors",
    "Problem",
    "build_problem",
    "calibrate_genetic",
    "calibrate_nuts",
    "climb",
    "diagnose",
    "find_mode",
    "genetic_points",
    "mean_and_some",
    "posterior_tree",
    "with_residual_noise",
]
