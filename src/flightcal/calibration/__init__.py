"""The methods that calibrate a problem: a genetic algorithm, and the mode and draws of its posterior.

Imports: errors, probability, problem, progress, run, scenario, simulator, telemetry.
"""

from .diagnostics import (
    EMULATED_DENSITY,
    EMULATOR_ERROR,
    HELD_OUT,
    LINEAR,
    OF_EMULATOR,
    Diagnostics,
    Gate,
    PriorScore,
    gate,
    least_effective,
    with_gate,
)
from .find_heat import with_found_states
from .fixed_numbers import FixedNumbers
from .heat_file import heat_content, with_kept_heat
from .methods import calibrate_nuts
from .mode import climb, find_mode
from .nuts import sample_problem
from .optimisation import (
    calibrate_genetic,
    genetic_points,
    genetic_run_points,
    posterior_mean,
    with_residual_noise,
)
from .posterior import Posterior, mean_and_some, some_of
from .results import (
    BEST_FIT_FILE,
    CALIBRATED_FILE,
    RESULTS,
    RESULTS_FILE,
    TABLE_FILE,
    read_calibrated,
    read_fixed_numbers,
)
from .stages import COMPILE, GENETIC, NUTS, Sampled, keep_sample, posterior_draws, rough_seconds, warm
from .table import Calibrated, html_table
