"""The calibration problem: priors and windows of telemetry, and the log density on unconstrained z.

Imports: compiled, environment, errors, external, probability, reduction, scenario, simulator, telemetry.
"""

from .build import build_problem, build_window, initial_priors, initial_temperatures, open_windows, problem_of
from .coordinates import Whitening, whitening
from .entries import Entry, middle_of
from .heat import (
    as_sampled,
    at_sizes,
    dressed,
    exact_heat,
    followed,
    functions_of_heat,
    heat_in_prior,
    mixed,
    rehearsals,
    sampled_windows,
    whole_weights,
    with_heat,
)
from .heat_model import SLOW, HeatModel, Held, heat_model, knots_of, own_groups
from .heat_units import (
    Units,
    errors_of_weights,
    heat_of_weights,
    heated_switches,
    heater_watts,
    kept_responses,
    patterns_of,
    places_of,
    responses,
    responses_in,
    shifts_of_weights,
    split,
    unit_heats,
)
from .held import held_by, hold, with_other
from .native import STOPPED, NativeDensity
from .pinned import fast_heaters, pinned, pinned_heaters, pinned_nodes, unseen_heaters
from .problem import Problem, Runs
from .synthetic import simulate_telemetry, with_drawn_heat, with_telemetry
from .thresholds import SCATTERS, Passages, log_prior_of_scatter, passages
from .window import PIN, Window
