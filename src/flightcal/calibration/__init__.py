"""The problem, its priors and likelihood, and the methods that solve it.

Imports: errors, probability, problem, scenario, simulator.
"""

from .diagnostics import Diagnostics, Gate, diagnose, least_effective, with_gate
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
from .nuts import sample

__all__ = [
    "Diagnostics",
    "Gate",
    "Mode",
    "Posterior",
    "calibrate_genetic",
    "calibrate_nuts",
    "climb",
    "diagnose",
    "find_mode",
    "genetic_points",
    "least_effective",
    "mean_and_some",
    "posterior_tree",
    "sample",
    "search_record",
    "with_gate",
    "with_residual_noise",
]
