"""The problem, its priors and likelihood, and the methods that solve it.

Imports: errors, probability, problem, progress, run, scenario, simulator.
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
from .stages import COMPILE, GENETIC, NUTS, Sampled, keep_sample, posterior_draws, warm

__all__ = [
    "COMPILE",
    "GENETIC",
    "NUTS",
    "Diagnostics",
    "Gate",
    "Mode",
    "Posterior",
    "Sampled",
    "calibrate_genetic",
    "calibrate_nuts",
    "climb",
    "diagnose",
    "find_mode",
    "genetic_points",
    "keep_sample",
    "least_effective",
    "mean_and_some",
    "posterior_draws",
    "posterior_tree",
    "sample",
    "search_record",
    "warm",
    "with_gate",
    "with_residual_noise",
]
