"""A small network in the place of a large one, and how far it may be off.

Imports: environment, errors, operational, probability, progress, run, scenario, simulator, telemetry.
"""

from .check import Flown, compare, fly_at
from .error_model import shapes
from .file import is_reduction, load_task, spacecraft_of
from .folder import reduce_to_folder, scenario_of
from .reduced_model import initial_given
from .reduced_scenario import network_for
from .storage import load
