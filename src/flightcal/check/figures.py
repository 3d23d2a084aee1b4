"""Figures of a check, in the report's style: plain functions from data to a plotly figure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go

from ..problem import Window
from ..report import (
    BAND,
    CHANNEL_HEIGHT,
    GENETIC,
    LINE,
    MODEL_BAND,
    PRIOR,
    STOCHASTIC,
    TELEMETRY,
    WARNING,
    ParameterInfo,
    break_lines,
    extremes,
    finish,
    followed,
    heat_map,
    polygons,
    scatter,
    time_canvas,
)
from ..scenario import ICE_POINT
from ..words import labelled, number
from .identifiability import UNTOLD, Identifiability
from .prior_predictive import Bands
from .profile import DROP, Profile
from .sensitivity import Sensitivity
from .smoothness import Scan

_BINS, _DIRECTIONS = 300, 6
_LEAST = 1e-3
"""Information below this is drawn here."""
_DEPTHS = (8.0, 40.0)
"""Nats below the best that a scan shows at least and at most."""


def figure_widths(found: Identifiability) -> go.Figure:
    """Width of each posterior as a share of its prior's, and what it were if all others were known."""
    figure = go.Figure()
    x: list[float | None] = []
    y: list[str | None] = []
    for name, alone, width in zip(found.names, found.known_alone, found.width, strict=True):
        x += [float(alone), float(width), None]
        y += [name, name, None]
    figure.add_scatter(x=x, y=y, mode="lines", line={"color": LINE, "width": 2}, showlegend=False, hoverinfo="skip")
    for values, name, colour, symbol in (
        (found.known_alone, "if all others were known", PRIOR, "circle-open"),
        (found.width, "posterior", STOCHASTIC, "circle"),
    ):
        figure.add_scatter(
            x=values, y=list(found.names), name=name, mode="markers",
            marker={"color": colour, "symbol": symbol, "size": 9},
            hovertemplate="%{y}: %{x:.3g} of the prior's width",
        )  # fmt: skip
    figure.add_vline(x=1.0, line={"color": LINE, "width": 1, "dash": "dot"})
    finish(figure, 140 + 24 * len(found.names), top=8)
    figure.update_xaxes(title_text="width / prior's width, –", type="log", dtick=1)
    figure.update_yaxes(autorange="reversed", automargin=True)
    return figure


def figure_spectrum(found: Identifiability) -> go.Figure:
    """Information in every direction: how many times the data count for more than the prior."""
    order = np.arange(1, len(found.information) + 1)
    text = [
        ", ".join(f"{found.names[k]} {number(float(column[k]), 2)}" for k in np.argsort(-np.abs(column))[:4])
        for column in found.directions.T
    ]
    colours = [WARNING if value < UNTOLD else STOCHASTIC for value in found.information]
    figure = go.Figure(
        go.Scatter(
            x=order, y=np.maximum(found.information, _LEAST), customdata=text, mode="markers",
            marker={"color": colours, "size": 9, "symbol": ["x" if c == WARNING else "circle" for c in colours]},
            hovertemplate="information %{y:.3g}<br>%{customdata}<extra></extra>",
        )
    )  # fmt: skip
    figure.add_hline(y=UNTOLD, line={"color": LINE, "width": 1, "dash": "dot"})
    finish(figure, 300, legend=False, top=8)
    figure.update_xaxes(title_text="direction, least known first", dtick=max(1, len(order) // 20))
    figure.update_yaxes(title_text="data / prior, –", type="log", exponentformat="power", dtick=1)
    return figure


def figure_directions(found: Identifiability) -> go.Figure:
    """What the least known directions are made of, in standard deviations of the priors."""
    count = min(_DIRECTIONS, len(found.information))
    weights = found.directions[:, :count]
    weights = weights * np.sign(weights[np.abs(weights).argmax(axis=0), np.arange(count)])
    titles = [f"{k + 1}: {number(float(value), 2)}" for k, value in enumerate(found.information[:count])]
    return _heat_map(weights, titles, found.names, "data / prior in the direction", signed=True)


def figure_sensitivity(found: Sensitivity) -> go.Figure:
    """Indices of every output by every parameter."""
    outputs = [name.replace("_", " ") for name in found.outputs]
    return _heat_map(np.clip(found.strongest, 0.0, 1.0).T, outputs, found.names, "", signed=False)


def _heat_map(values: Any, columns: Sequence[str], rows: Sequence[str], title: str, *, signed: bool) -> go.Figure:
    """[row, column] with its numbers, from -1 or 0 to 1."""
    height = 110 + 4 * max(map(len, columns)) + max(22 * len(rows), 160)
    return heat_map(values, columns, rows, height, signed=signed, title_text=title, type="category")


def figure_scan(scan: Scan, info: ParameterInfo) -> go.Figure:
    """The log density along a parameter; lines where the heaters switch otherwise, crosses at jumps."""
    figure = go.Figure()
    x = scan.theta + info.offset
    height = np.where(np.isfinite(scan.log_density), scan.log_density, np.nan)
    span = float(np.nanmax(height) - np.nanmin(height)) if np.isfinite(height).any() else 0.0
    depth = min(max(span, _DEPTHS[0]), _DEPTHS[1])
    figure.add_scatter(
        x=x, y=-0.5 * scan.place**2, mode="lines", line={"color": PRIOR, "width": 1.2, "dash": "dash"}, hoverinfo="skip"
    )
    figure.add_scatter(
        x=x, y=height, mode="lines", line={"color": STOCHASTIC, "width": 1.8},
        hovertemplate="%{x:.5g}: %{y:.3g} nats<extra></extra>",
    )  # fmt: skip
    for i in np.flatnonzero(np.diff(scan.sequence)):
        figure.add_vline(x=0.5 * (x[i] + x[i + 1]), line={"color": GENETIC, "width": 1, "dash": "dot"})
    if scan.jumps:
        figure.add_scatter(
            x=[jump.theta + info.offset for jump in scan.jumps],
            y=np.maximum(np.interp([jump.place for jump in scan.jumps], scan.place, height), -depth),
            mode="markers", marker={"color": WARNING, "symbol": "x", "size": 9},
            text=[f"{jump.nats:.3g} nats {jump.heater}" for jump in scan.jumps],
            hovertemplate="%{text}<extra></extra>",
        )  # fmt: skip
    return _small(figure, info, [-1.05 * depth, 0.1 * depth])


def figure_profile(profile: Profile, info: ParameterInfo) -> go.Figure:
    """The profile of the log density, and its likelihood alone."""
    figure = go.Figure()
    x = profile.theta + info.offset
    for values, name, colour, dash in (
        (profile.log_likelihood, "likelihood alone", PRIOR, "dash"),
        (profile.log_density, "log density", STOCHASTIC, "solid"),
    ):
        figure.add_scatter(
            x=x, y=values, name=name, mode="lines+markers", marker={"size": 4},
            line={"color": colour, "width": 1.8, "dash": dash},
            hovertemplate=name + " %{x:.5g}: %{y:.3g}<extra></extra>",
        )  # fmt: skip
    figure.add_hline(y=-DROP, line={"color": LINE, "width": 1, "dash": "dot"})
    lowest = float(min(profile.log_density.min(), profile.log_likelihood.min(), -2.0 * DROP))
    highest = float(max(profile.log_likelihood.max(), 0.0))
    return _small(figure, info, [1.1 * lowest, highest - 0.1 * lowest])


def _small(figure: go.Figure, info: ParameterInfo, span: list[float]) -> go.Figure:
    finish(figure, 230, legend=False, top=12)
    figure.update_layout(margin={"l": 56, "r": 14, "b": 46}, meta={"tools": False})
    figure.update_xaxes(title_text=labelled(info.name, info.unit), nticks=5)
    figure.update_yaxes(title_text="nats", range=span, nticks=5)
    return figure


def figure_predictive(window: Window, found: Bands) -> go.Figure:
    """Telemetry of a window over the prior's bands, one plot a channel."""
    channels = window.simulator.channels
    figure = time_canvas(list(channels), [CHANNEL_HEIGHT] * len(channels))
    for k in range(len(channels)):
        columns = [row[:, k] - ICE_POINT for row in (*found.quantiles, *found.model)]
        time, columns = break_lines(window.times, followed(window.times, columns, 6 * _BINS), columns)
        for name, low, high, colour in (
            ("95% of the prior, noise and discrepancy included", columns[0], columns[2], BAND),
            ("99% of the simulations", columns[3], columns[4], MODEL_BAND),
        ):
            x, y = polygons(time, low, high)
            scatter(
                figure, k + 1, x, y, name,
                mode="lines", line={"width": 0}, fill="toself", fillcolor=colour, hoverinfo="skip",
            )  # fmt: skip
        scatter(
            figure, k + 1, time, columns[1], "prior's median", mode="lines",
            line={"color": STOCHASTIC, "width": 1.6}, hovertemplate="%{y:.2f} °C",
        )  # fmt: skip
        seen = np.flatnonzero(window.valid[:, k])
        if len(seen):
            values = window.observed[seen, k] - ICE_POINT
            kept = extremes([values], 3 * _BINS)
            scatter(
                figure, k + 1, window.times[seen[kept]], values[kept], "telemetry", mode="markers",
                marker={"color": TELEMETRY, "size": 3.5}, hovertemplate="%{y:.2f} °C",
            )  # fmt: skip
        figure.update_yaxes(title_text="temperature, °C", row=k + 1)
    return figure
