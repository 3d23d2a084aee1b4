"""A small network in the place of a large one, and how far it may be off.

Imports: environment, errors, operational, probability, progress, run, scenario, simulator, telemetry.
"""

from .certificate import certificate, certificate_lines, measure_speed, sensor_errors
from .check import compare, fly_at
from .error_model import shapes
from .file import Task, load_task, written_time
from .folder import reduce_to_folder
from .reduce import Reduced, reduce
from .reduced_scenario import network_for, reduced_scenario
from .schema import FlightWindow
from .storage import load, save, stored_of
from .thermostats import switching_shifts

__all__ = [
    "FlightWindow",
    "Reduced",
    "Task",
    "certificate",
    "certificate_lines",
    "compare",
    "fly_at",
    "load",
    "load_task",
    "measure_speed",
    "network_for",
    "reduce",
    "reduce_to_folder",
    "reduced_scenario",
    "save",
    "sensor_errors",
    "shapes",
    "stored_of",
    "switching_shifts",
    "written_time",
]
