"""Residuals of the stochastic prediction: in time, their distribution, their autocorrelation."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go
import xarray as xr
from numpy.typing import NDArray
from plotly.subplots import make_subplots
from scipy.stats import norm

from flightcal.probability.noise import called
from flightcal.validation import autocorrelation

from .style import GENETIC, LINE, PRIOR, STATUS_FILL, STOCHASTIC, finish, small_titles
from .thinning import extremes
from .windows import BINS, names, shade_eclipse, time_canvas

ROW_HEIGHT = 150
MOST_LAGS = 120


def residuals(prediction: xr.Dataset, method: str = "stochastic") -> NDArray[np.float64]:
    """Telemetry minus mean prediction, [time, channel], K; NaN where telemetry is missing or not scored."""
    difference = prediction["observed"] - prediction["mean"].sel({"method": method})
    return difference.where(prediction["scored"].astype(bool)).transpose("time", "channel").values


def figure_residuals(prediction: xr.Dataset, bins: int = BINS) -> go.Figure:
    """Residuals in time, one plot for each channel. prediction: a group of prediction.nc."""
    channels = names(prediction, "channel")
    figure, _ = time_canvas(channels, [ROW_HEIGHT] * len(channels))
    time = prediction["time"].values
    for row, values in enumerate(residuals(prediction).T, start=1):
        chosen = np.flatnonzero(np.isfinite(values))
        if chosen.size:
            chosen = chosen[extremes([values[chosen]], 3 * bins)]
        figure.add_scatter(
            x=time[chosen], y=values[chosen].astype(np.float32), mode="markers", name="telemetry − mean",
            legendgroup="residual", showlegend=row == 1, marker={"size": 3.5, "color": STOCHASTIC},
            hovertemplate="%{y:.3f} K", row=row, col=1,
        )  # fmt: skip
        figure.add_hline(y=0.0, line={"color": LINE, "width": 1}, row=row, col=1)
        figure.update_yaxes(title_text="residual, K", row=row, nticks=5)
    shade_eclipse(figure, prediction, len(channels))
    return figure


def figure_residual_distribution(prediction: xr.Dataset) -> go.Figure:
    """Histogram and autocorrelation of the residuals, one row for each channel.

    The histogram has the normal density of the same mean and deviation; the autocorrelation the band that holds 95% of
    the values under white noise, and beside it, of AR(1) noise, that of its innovations.
    """
    channels = names(prediction, "channel")
    rows, gap = len(channels), 60
    inner = rows * ROW_HEIGHT + (rows - 1) * gap
    plain = [c.replace("_", " ") for c in channels]
    figure = make_subplots(
        rows, 2, subplot_titles=[t for c in plain for t in (f"{c}: distribution", f"{c}: autocorrelation")],
        column_widths=[0.4, 0.6], horizontal_spacing=0.1, vertical_spacing=gap / inner if rows > 1 else 0.0,
    )  # fmt: skip
    time = prediction["time"].values
    for row, values in enumerate(residuals(prediction).T, start=1):
        present = np.isfinite(values)
        if present.sum() > 2:
            _histogram(figure, values[present], row)
            _autocorrelation(figure, values[present], time[present], row)
            if "innovation" in prediction and called(str(prediction["noise"].values[row - 1])).has_memory:
                innovations = prediction["innovation"].transpose("time", "channel").values[present, row - 1]
                _autocorrelation(figure, innovations, time[present], row, of_noise=True)
        figure.update_yaxes(title_text="density, 1/K", row=row, col=1, rangemode="tozero", nticks=5)
        figure.update_yaxes(title_text="autocorrelation, –", row=row, col=2, range=[-1.05, 1.05], tickvals=[-1, 0, 1])
    finish(figure, inner + 34 + 30 + 52)
    small_titles(figure)
    figure.update_xaxes(title_text="residual, K", row=rows, col=1)
    figure.update_xaxes(title_text="lag, min", row=rows, col=2)
    return figure


def _histogram(figure: go.Figure, values: NDArray[np.float64], row: int) -> None:
    density, edges = np.histogram(values, bins=30, density=True)
    figure.add_bar(
        x=((edges[1:] + edges[:-1]) / 2).astype(np.float32), y=density.astype(np.float32), width=edges[1] - edges[0],
        marker={"color": STOCHASTIC, "opacity": 0.55, "line": {"width": 0}}, name="residuals", legendgroup="residuals",
        showlegend=row == 1, hovertemplate="%{x:.3f} K: %{y:.3f} 1/K<extra></extra>", row=row, col=1,
    )  # fmt: skip
    grid = np.linspace(edges[0], edges[-1], 80)
    figure.add_scatter(
        x=grid.astype(np.float32), y=norm.pdf(grid, values.mean(), values.std()).astype(np.float32), mode="lines",
        line={"color": PRIOR, "width": 1.6, "dash": "dash"}, name="normal, same mean and deviation",
        legendgroup="normal", showlegend=row == 1, hoverinfo="skip", row=row, col=1,
    )  # fmt: skip


def _autocorrelation(
    figure: go.Figure,
    values: NDArray[np.float64],
    time: NDArray[np.datetime64],
    row: int,
    *,
    of_noise: bool = False,
) -> None:
    """Of residuals, with the band of white noise; of_noise: of innovations, over it."""
    lags = max(1, min(MOST_LAGS, values.size // 2))
    found = autocorrelation(values, time, lags)
    spacing = float(np.median(np.diff(time).astype("timedelta64[ns]").astype(np.int64))) * 1e-9
    minutes = np.arange(lags + 1) * spacing / 60
    half = 1.96 / np.sqrt(values.size)
    if not of_noise:
        figure.add_scatter(
            x=[0, minutes[-1], minutes[-1], 0], y=[-half, -half, half, half], fill="toself", fillcolor=STATUS_FILL,
            mode="lines", line={"width": 0}, name="95% band of white noise", legendgroup="band", showlegend=row == 1,
            hoverinfo="skip", row=row, col=2,
        )  # fmt: skip
    name = "innovations" if of_noise else "autocorrelation"
    shown = not any(trace.name == name for trace in figure.data)
    figure.add_scatter(
        x=minutes.astype(np.float32), y=found.astype(np.float32), mode="lines" if of_noise else "lines+markers",
        line={"color": GENETIC if of_noise else STOCHASTIC, "width": 1.6 if of_noise else 1.2}, marker={"size": 3.5},
        name=name, legendgroup=name, showlegend=shown, hovertemplate="%{x:.2f} min: %{y:.3f}<extra></extra>",
        row=row, col=2,
    )  # fmt: skip
