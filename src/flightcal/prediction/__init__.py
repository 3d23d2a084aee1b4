"""From a calibration to temperatures and heater duty with intervals, on windows seen and unseen.

Imports: calibration, emulation, environment, errors, probability, problem, run, scenario, simulator, telemetry.
"""

from .holding import HELD, Holding, hold_together, replicates_of
from .limits import MAY_BE, Extreme, extremes, is_plan, limits_of, limits_told, read_limits_told
from .metrics import (
    GENETIC_RUNS,
    Metric,
    SimulatorError,
    by_place,
    comparison_table,
    crps_of_draws,
    implied_energy,
    score,
    simulator_errors,
    values_of,
)
from .predict import predict
from .stages import PREDICT, PREDICTION_FILE
from .unseen import AGES, ANY, Unseen, read_unseen
