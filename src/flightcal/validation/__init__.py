"""How good a prediction is, and whether its residuals are what the likelihood took them for.

Imports: calibration, emulation, environment, errors, prediction, probability, problem, progress, reduction, run,
scenario, simulator, telemetry.
"""

from .block_loo import BlockLoo
from .comparison import MODELS, block_loo, comparison_of, variant
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
from .repeats import Validation, judge, prepared, run_repeats, short
from .residuals import SIGNIFICANCE, ResidualCheck, autocorrelation, check_window, effective_samples
from .simulation_based import INTERVALS, Band, ecdf, ecdf_band, joint

__all__ = [
    "FULL_SIMULATOR",
    "INTERVALS",
    "MODELS",
    "SIGNIFICANCE",
    "Band",
    "BlockLoo",
    "Coverage",
    "ResidualCheck",
    "Uniformity",
    "Validation",
    "autocorrelation",
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
    "prepared",
    "probability_integral_transform",
    "run_repeats",
    "short",
    "uniformity",
    "variant",
]
