"""How good a prediction is, and whether its residuals are what the likelihood took them for.

Imports: calibration, emulation, environment, errors, prediction, probability, problem, progress, reduction, run,
scenario, simulator, telemetry.
"""

from .backtest import backtest_record, check_simulator, origin_settings, origin_stage
from .comparison import MODELS, USUAL, comparison_of, models_of, scored_by_all, variant
from .full_simulator import FULL_SIMULATOR, flown_from
from .horizon import ALL, ahead, band_scores
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
from .repeats import Validation, judge_repeats, prepared, run_repeats, short
from .residuals import SIGNIFICANCE, ResidualCheck, autocorrelation, check_window, effective_samples, nominal_spacing
from .simulation_based import Band, ecdf, ecdf_band, joint
