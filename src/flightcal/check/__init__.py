"""Checks before sampling: what the data can tell, and whether prior and sampler will get along with them.

Imports: calibration, emulation, errors, external, probability, problem, progress, report, run,
simulator, telemetry.
"""

from .centre import find_centre
from .evaluate import THOROUGH, Effort, effort_for, runs_of_a_search
from .findings import Checked, findings_of, verdict_of
from .identifiability import identifiability
from .page import render
from .prior_predictive import prior_predictive
from .profile import check_names, profile
from .sensitivity import sensitivity
from .smoothness import smoothness
from .whole import CHECK, CheckSummary, check

__all__ = [
    "CHECK",
    "THOROUGH",
    "CheckSummary",
    "Checked",
    "Effort",
    "check",
    "check_names",
    "effort_for",
    "find_centre",
    "findings_of",
    "identifiability",
    "prior_predictive",
    "profile",
    "render",
    "runs_of_a_search",
    "sensitivity",
    "smoothness",
    "verdict_of",
]
