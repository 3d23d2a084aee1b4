"""The probability model: priors of theta, and how telemetry differs from a simulation (noise, discrepancy, switches).

It knows of no calibration: `problem/problem.py` puts it together with a simulator.

Imports: compiled, environment, errors, scenario, simulator, telemetry.
"""

from .designs import GROWING, KINDS, around_posterior, latin_hypercube, prior_draws, sobol
from .heat import Follows, Profile, Sizes, Slow, WindowHeat, pattern, waves
from .kernels.switching import NO_STATUS, StatusCall, status_work, switching
from .likelihood import (
    Bars,
    Likelihood,
    Residuals,
    WindowMemory,
    information,
    likelihood_calls,
    weights_given,
    window_memory,
)
from .noise import INDEPENDENT, called
from .noise.kind import DEVIATION, NoiseKind
from .noise.shaped import Shaped, shape_of
from .priors import CENTRAL, Priors, PriorTerms, Tilt, signed
from .residuals import ResidualModel, residual_model
from .status import THRESHOLD_ERROR, HeaterStatus, heater_status, measured_switches
from .straight import Straight, straight
from .weighing import Evidence, Gains, Weighed, filter_of, through_noise, weigh
