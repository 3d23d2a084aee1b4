"""From a calibration to temperatures and heater duty with intervals, on windows seen and unseen.

Imports: calibration, emulation, environment, errors, probability, problem, run, scenario, simulator, telemetry.
"""

from .metrics import (
    ZERO_CELSIUS,
    Array,
    Metric,
    comparison_table,
    crps_of_draws,
    implied_energy,
    log_score_normal,
    mape_celsius,
    mape_kelvin,
    mean_absolute_error,
    mpiw,
    picp,
    probability_below,
    rmse,
    score,
    status_agreement,
)
from .predict import STOCHASTIC, predict
from .stages import PREDICT

__all__ = [
    "PREDICT",
    "STOCHASTIC",
    "ZERO_CELSIUS",
    "Array",
    "Metric",
    "comparison_table",
    "crps_of_draws",
    "implied_energy",
    "log_score_normal",
    "mape_celsius",
    "mape_kelvin",
    "mean_absolute_error",
    "mpiw",
    "picp",
    "predict",
    "probability_below",
    "rmse",
    "score",
    "status_agreement",
]
