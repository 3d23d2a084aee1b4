"""Simulation-based calibration: ranks against their band, contraction and score of every quantity."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from flightcal.validation.simulation_based import Band, ecdf

from .style import LINE, STATUS_FILL, STOCHASTIC, WARNING, finish, small_titles

COLUMNS = 3
ROW_HEIGHT = 140


def figure_ranks(names: Sequence[str], ranks: NDArray[np.float64], inside: Sequence[bool], band: Band) -> go.Figure:
    """Distribution of each quantity's ranks less the uniform one, in the band of all together. ranks: [R, q]."""
    rows, gap = math.ceil(len(names) / COLUMNS), 56
    inner = rows * ROW_HEIGHT + (rows - 1) * gap
    figure = make_subplots(
        rows, COLUMNS, subplot_titles=list(names), horizontal_spacing=0.08, shared_yaxes="all",
        vertical_spacing=gap / inner if rows > 1 else 0.0,
    )  # fmt: skip
    points = np.concatenate([[0.0], band.points, [1.0]])
    low, high = (np.concatenate([[0.0], bound - band.points, [0.0]]) for bound in (band.lower, band.upper))
    for q, within in enumerate(inside):
        place = {"row": q // COLUMNS + 1, "col": q % COLUMNS + 1}
        figure.add_scatter(
            x=np.concatenate([points, points[::-1]]), y=np.concatenate([low, high[::-1]]), fill="toself",
            fillcolor=STATUS_FILL, mode="lines", line={"width": 0}, name="95% band of all quantities together",
            legendgroup="band", showlegend=q == 0, hoverinfo="skip", **place,
        )  # fmt: skip
        figure.add_scatter(
            x=points, y=ecdf(ranks[:, q], points) - points, mode="lines",
            line={"color": STOCHASTIC if within else WARNING, "width": 1.6, "shape": "hv"}, name="ranks",
            legendgroup="ranks", showlegend=q == 0, hovertemplate="%{x:.2f}: %{y:.3f}<extra></extra>", **place,
        )  # fmt: skip
        figure.update_yaxes(nticks=5, **place)
        figure.update_xaxes(range=[0, 1], nticks=5, **place)
        if place["col"] == 1:
            figure.update_yaxes(title_text="ECDF − uniform, –", **place)
        if q >= len(names) - COLUMNS:
            figure.update_xaxes(title_text="rank, –", **place)
    for empty in range(len(names), rows * COLUMNS):
        row, col = empty // COLUMNS + 1, empty % COLUMNS + 1
        figure.update_xaxes(visible=False, row=row, col=col)
        figure.update_yaxes(visible=False, row=row, col=col)
    finish(figure, inner + 34 + 30 + 52)
    small_titles(figure)
    return figure


def figure_contraction(
    names: Sequence[str], contractions: NDArray[np.float64], scores: NDArray[np.float64]
) -> go.Figure:
    """How much posteriors narrowed their priors, and by how many deviations they missed the truth; [R, q] each."""
    figure = make_subplots(1, 2, shared_yaxes=True, horizontal_spacing=0.04)
    for column, values in enumerate((contractions, scores), start=1):
        for q, name in enumerate(names):
            figure.add_box(
                x=values[:, q], y=[name] * len(values), orientation="h", name=name, boxpoints="outliers",
                marker={"color": STOCHASTIC, "size": 3}, line={"width": 1.2}, showlegend=False, row=1, col=column,
            )  # fmt: skip
    for bound in (-1.96, 0.0, 1.96):
        figure.add_vline(x=bound, line={"color": LINE, "width": 1, "dash": "solid" if not bound else "dot"}, col=2)
    finish(figure, 60 + 26 * len(names) + 82, legend=False)
    figure.update_layout(margin={"l": 160})
    figure.update_xaxes(title_text="contraction, –", range=[min(-0.05, np.nanmin(contractions)), 1.02], row=1, col=1)
    figure.update_xaxes(title_text="(posterior mean − truth) / deviation, –", row=1, col=2)
    figure.update_yaxes(autorange="reversed")
    return figure
