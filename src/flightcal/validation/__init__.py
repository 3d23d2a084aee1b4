"""How good a prediction is, and whether its residuals are what the likelihood took them for.

Imports: calibration, emulation, environment, errors, prediction, probability, problem, progress, reduction, run,
scenario, simulator, telemetry.
"""

from .block_loo import BlockLoo, block_log_likelihood, blocks_of, leave_blocks_out
from .comparison import COMPARED, MODELS, block_loo, comparison_of, recommend, variant
from .full_simulator import FULL_SIMULATOR
from .left_out import check_windows, leave_windows_out
from .reliability import (
    Coverage,
    Uniformity,
    chance_band,
    coverage_by_hour,
    coverage_by_phase,
    probability_integral_transform,
    uniformity,
)
from .repeats import Validation, judge, prepared, run_repeat, run_repeats, short
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
    "COMPARED",
    "FULL_SIMULATOR",
    "INTERVALS",
    "MODELS",
    "SIGNIFICANCE",
    "Band",
    "BlockLoo",
    "Coverage",
    "RankCheck",
    "Repeat",
    "ResidualCheck",
    "Uniformity",
    "Validation",
    "autocorrelation",
    "block_log_likelihood",
    "block_loo",
    "blocks_of",
    "chance_band",
    "check_ranks",
    "check_residuals",
    "check_window",
    "check_windows",
    "comparison_of",
    "coverage_by_hour",
    "coverage_by_phase",
    "ecdf",
    "ecdf_band",
    "effective_samples",
    "joint",
    "judge",
    "leave_blocks_out",
    "leave_windows_out",
    "ljung_box",
    "prepared",
    "probability_integral_transform",
    "ranks",
    "recommend",
    "run_repeat",
    "run_repeats",
    "short",
    "uniformity",
    "variant",
]
