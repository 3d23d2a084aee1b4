"""How good a prediction is, and whether its residuals are what the likelihood took them for.

Imports: calibration, errors, prediction, probability, problem, progress, reduction, run, simulator.
"""

from .block_loo import BlockLoo, block_log_likelihood, blocks_of, leave_blocks_out
from .full_simulator import full_check_stage
from .reliability import (
    Coverage,
    Uniformity,
    chance_band,
    coverage_by_hour,
    coverage_by_phase,
    probability_integral_transform,
    uniformity,
)
from .residuals import (
    SIGNIFICANCE,
    ResidualCheck,
    autocorrelation,
    check_residuals,
    check_window,
    effective_samples,
    ljung_box,
)
from .simulation_based import INTERVALS, Band, RankCheck, Repeat, check_ranks, ecdf, ecdf_band, joint, ranks

__all__ = [
    "INTERVALS",
    "SIGNIFICANCE",
    "Band",
    "BlockLoo",
    "Coverage",
    "RankCheck",
    "Repeat",
    "ResidualCheck",
    "Uniformity",
    "autocorrelation",
    "block_log_likelihood",
    "blocks_of",
    "chance_band",
    "check_ranks",
    "check_residuals",
    "check_window",
    "coverage_by_hour",
    "coverage_by_phase",
    "ecdf",
    "ecdf_band",
    "effective_samples",
    "full_check_stage",
    "joint",
    "leave_blocks_out",
    "ljung_box",
    "probability_integral_transform",
    "ranks",
    "uniformity",
]
