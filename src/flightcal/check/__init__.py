"""Checks before sampling: what the data can tell, and whether prior and sampler will get along with them.

Imports: calibration, emulation, environment, errors, probability, problem, progress, report, run, scenario,
simulator, telemetry, words.
"""

from .evaluate import PriorRuns, effort_for
from .profile import check_names
from .run_check import CHECK, CheckSummary, check
from .suspects import SUSPECTS, suspects
from .suspicion import Suspects
