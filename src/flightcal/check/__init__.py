"""Checks before sampling: what the data can tell, and whether prior and sampler will get along with them.

Imports: calibration, emulation, errors, external, probability, problem, progress, report, run, scenario,
simulator, telemetry.
"""

from .evaluate import effort_for
from .profile import check_names
from .suspects import SUSPECTS, SUSPECTS_FILE, Suspects, Suspicion, suspects
from .whole import CHECK, CheckSummary, check

__all__ = [
    "CHECK",
    "SUSPECTS",
    "SUSPECTS_FILE",
    "CheckSummary",
    "Suspects",
    "Suspicion",
    "check",
    "check_names",
    "effort_for",
    "suspects",
]
