"""What stands in for a simulator without derivatives: Gaussian processes that learn from its runs.

Imports: calibration, errors, external, probability, problem, progress, run, scenario, simulator, telemetry.
"""

from .emulated import needs_emulator
from .emulator import EmulatedSimulator
from .stage import NUTS_THROUGH_EMULATOR, Emulation, emulator_stage, window_emulator
