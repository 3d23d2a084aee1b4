"""The report's figures: plain functions from data to a plotly figure."""

from .convergence import figure_genetic_history, figure_traces
from .discrepancy import figure_discrepancy_in_phase, figure_discrepancy_in_time
from .parameters import (
    figure_correlation,
    figure_density,
    figure_genetic_spread,
    figure_pairs,
    most_correlated,
)
from .reliability import figure_reliability
from .residuals import figure_residual_distribution, figure_residuals
from .validation import figure_contraction, figure_ranks
from .windows import figure_heater_status, figure_point, figure_stochastic

__all__ = [
    "figure_contraction",
    "figure_correlation",
    "figure_density",
    "figure_discrepancy_in_phase",
    "figure_discrepancy_in_time",
    "figure_genetic_history",
    "figure_genetic_spread",
    "figure_heater_status",
    "figure_pairs",
    "figure_point",
    "figure_ranks",
    "figure_reliability",
    "figure_residual_distribution",
    "figure_residuals",
    "figure_stochastic",
    "figure_traces",
    "most_correlated",
]
