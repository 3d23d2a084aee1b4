"""What the simulator lacks, with its interval: around the orbit, or in time."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go
import xarray as xr
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from .style import BAND, LINE, STOCHASTIC, TELEMETRY, finish, polygons, small_titles
from .thinning import break_lines, extremes
from .windows import BINS, names, shade_eclipse, time_canvas

ROW_HEIGHT, GAP = 200, 60
Columns = list[NDArray[np.float64]]
"""Mean, lower and upper bound, and telemetry minus simulation, [T] each, K."""


def figure_discrepancy_in_phase(prediction: xr.Dataset) -> go.Figure:
    """Discrepancy over the orbit, two channels in a row. prediction: a group of prediction.nc."""
    channels = _discrepant(prediction)
    columns = min(2, len(channels))
    rows = -(-len(channels) // columns)
    inner = rows * ROW_HEIGHT + (rows - 1) * GAP
    figure = make_subplots(
        rows, columns, subplot_titles=[c.replace("_", " ") for c in channels], horizontal_spacing=0.1,
        vertical_spacing=GAP / inner if rows > 1 else 0.0,
    )  # fmt: skip
    phase = np.mod(prediction["orbit_phase"].values, 1.0)
    order = np.argsort(phase)
    for k, channel in enumerate(channels):
        found = [values[order] for values in _columns(prediction, channel)]
        _draw(figure, phase[order], found, k // columns + 1, k % columns + 1)
        figure.update_yaxes(title_text="discrepancy, K", nticks=6, row=k // columns + 1, col=k % columns + 1)
    finish(figure, inner + 34 + 30 + 52)
    small_titles(figure)
    figure.update_xaxes(range=[0, 1], nticks=6)
    for column in range(1, columns + 1):
        last = -(-(len(channels) - column + 1) // columns)
        figure.update_xaxes(title_text="orbit phase, orbits", row=last, col=column)
    return figure


def figure_discrepancy_in_time(prediction: xr.Dataset, bins: int = BINS) -> go.Figure:
    """Discrepancy in time, one plot for each channel. prediction: a group of prediction.nc."""
    channels = _discrepant(prediction)
    figure, _ = time_canvas(channels, [ROW_HEIGHT] * len(channels))
    time = prediction["time"].values
    for row, channel in enumerate(channels, start=1):
        found = _columns(prediction, channel)
        chosen = extremes(found[:3], 3 * bins)
        x, drawn = break_lines(time, chosen, found)
        _draw(figure, x, drawn, row, 1)
        figure.update_yaxes(title_text="discrepancy, K", nticks=5, row=row)
    shade_eclipse(figure, prediction, len(channels))
    return figure


def _discrepant(prediction: xr.Dataset) -> list[str]:
    """Channels that have a discrepancy."""
    parts = prediction["discrepant"].values
    return [name for name, part in zip(names(prediction, "channel"), parts, strict=True) if part]


def _columns(prediction: xr.Dataset, channel: str) -> Columns:
    own = prediction.sel(channel=channel)
    mean, lower, upper = (own[f"discrepancy_{name}"].values for name in ("mean", "lower", "upper"))
    return [mean, lower, upper, (own["observed"] - own["mean"].sel({"method": "stochastic"})).values + mean]


def _draw(figure: go.Figure, x: NDArray, found: Columns, row: int, column: int) -> None:
    mean, lower, upper, missing = found
    place = {"row": row, "col": column}
    first = not figure.data
    figure.add_scatter(
        x=x, y=missing.astype(np.float32), mode="markers", marker={"size": 3, "color": TELEMETRY, "opacity": 0.45},
        name="telemetry − simulation", legendgroup="missing", showlegend=first, hovertemplate="%{y:.2f} K", **place,
    )  # fmt: skip
    outline, bounds = polygons(x, lower, upper)
    figure.add_scatter(
        x=outline, y=bounds.astype(np.float32), mode="lines", line={"width": 0}, fill="toself", fillcolor=BAND,
        name="interval", legendgroup="interval", showlegend=first, hoverinfo="skip", **place,
    )  # fmt: skip
    figure.add_scatter(
        x=x, y=mean.astype(np.float32), mode="lines", line={"color": STOCHASTIC, "width": 1.8},
        name="discrepancy, mean", legendgroup="mean", showlegend=first, hovertemplate="%{y:.2f} K", **place,
    )  # fmt: skip
    figure.add_hline(y=0.0, line={"color": LINE, "width": 1}, **place)
