"""From a calibration to temperatures and heater duty with intervals, on windows seen and unseen."""

from .ensemble import Ensemble, propagate
from .errors import WhiteErrors, WindowErrors, window_errors
from .initial import condition_initial
from .predict import STOCHASTIC, predict

__all__ = [
    "STOCHASTIC",
    "Ensemble",
    "WhiteErrors",
    "WindowErrors",
    "condition_initial",
    "predict",
    "propagate",
    "window_errors",
]
