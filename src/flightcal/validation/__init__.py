"""How good a prediction is, and whether its residuals are what the likelihood took them for.

Imports: calibration, emulation, environment, errors, prediction, probability, problem, progress, reduction, run,
scenario, simulator, telemetry.
"""

from .backtest import backtest_record, origin_settings, origin_stage
from .block_loo import BlockLoo
from .comparison import MODELS, USUAL, block_loo, comparison_of, models_of, variant
from .full_simulator import FULL_SIMULATOR
from .horizon import ALL, ahead
from .left_out import check_windows, leave_windows_out
from .origins import Plan, plan_origins, read_length
from .reliability import (
    Coverage,
    Uniformity,
    chance_band,
    coverage_by_hour,
    coverage_by_phase,
    probability_integral_transform,
    uniformity,
)
from .repeats import Validation, judge, prepared, run_repeats, short
from .residuals import SIGNIFICANCE, ResidualCheck, autocorrelation, check_window, effective_samples
from .simulation_based import INTERVALS, Band, ecdf, ecdf_band, joint

__all__ = [
    "ALL",
    "FULL_SIMULATOR",
    "INTERVALS",
    "MODELS",
    "SIGNIFICANCE",
    "USUAL",
    "Band",
    "BlockLoo",
    "Coverage",
    "Plan",
    "ResidualCheck",
    "Uniformity",
    "Validation",
    "ahead",
    "autocorrelation",
    "backtest_record",
    "block_loo",
    "chance_band",
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
    "leave_windows_out",
    "models_of",
    "origin_settings",
    "origin_stage",
    "plan_origins",
    "prepared",
    "probability_integral_transform",
    "read_length",
    "run_repeats",
    "short",
    "uniformity",
    "variant",
]
