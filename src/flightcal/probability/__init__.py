"""The probability model: priors of theta, and how telemetry differs from a simulation (noise, discrepancy, switches).

It knows of no calibration: `problem/problem.py` puts it together with a simulator.

Imports: compiled, environment, errors, scenario, simulator, telemetry.
"""

from .designs import GROWING, KINDS, around_posterior, latin_hypercube, prior_draws, sobol
from .kernels.switching import NO_STATUS, StatusCall, status_work, switching
from .likelihood import (
    Likelihood,
    LikelihoodTogether,
    WindowMemory,
    information,
    likelihood_calls,
    precision_times,
    weights_given,
    weights_together,
    window_memory,
)
from .noise import INDEPENDENT, called
from .noise.kind import DEVIATION
from .priors import Priors, PriorTerms
from .residuals import TIME_LENGTH, TIME_SIZE, ResidualModel, residual_model
from .shapes import shrinkage
from .status import THRESHOLD_ERROR, HeaterStatus, heater_status, measured_switches
from .surrogate_error import ErrorShapes, error_shapes, low_rank_log_likelihood, with_error_shapes

__all__ = [
    "DEVIATION",
    "GROWING",
    "INDEPENDENT",
    "KINDS",
    "NO_STATUS",
    "THRESHOLD_ERROR",
    "TIME_LENGTH",
    "TIME_SIZE",
    "ErrorShapes",
    "HeaterStatus",
    "Likelihood",
    "LikelihoodTogether",
    "PriorTerms",
    "Priors",
    "ResidualModel",
    "StatusCall",
    "WindowMemory",
    "around_posterior",
    "called",
    "error_shapes",
    "heater_status",
    "information",
    "latin_hypercube",
    "likelihood_calls",
    "low_rank_log_likelihood",
    "measured_switches",
    "precision_times",
    "prior_draws",
    "residual_model",
    "shrinkage",
    "sobol",
    "status_work",
    "switching",
    "weights_given",
    "weights_together",
    "window_memory",
    "with_error_shapes",
]
