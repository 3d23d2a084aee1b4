"""Telemetry and predictions of a window in time, as several panels draw them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import plotly.graph_objects as go
import xarray as xr
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from ..scenario import ICE_POINT
from .style import ECLIPSE, TELEMETRY, UNKNOWN, band, finish, method, small_titles
from .thinning import Array, Indices, break_lines, changes, extremes, followed, stretches, usual_step

CHANNEL_HEIGHT, HEATER_HEIGHT, GAP = 190, 96, 44


class Heights(NamedTuple):
    """px of a plot of temperatures, a plot of heater status, and the room between two plots."""

    channel: int = CHANNEL_HEIGHT
    heater: int = HEATER_HEIGHT
    gap: int = GAP


HEIGHTS = Heights()
MOST_SHAPES = 150

Rows = dict[str, int]
"""Row of each channel or heater, from 1."""


def names(prediction: xr.Dataset, coordinate: str) -> list[str]:
    """Values of a coordinate as text; empty where the prediction has none."""
    return [str(v) for v in prediction[coordinate].values] if coordinate in prediction.coords else []


def figure_point(prediction: xr.Dataset, methods: Sequence[str], bins: int) -> go.Figure:
    """Temperatures and heater status of methods that give one value (figures 1, 2 and 4).

    prediction: a group of prediction.nc; methods: the first is drawn solid, others dotted.
    """
    figure, rows = window_canvas(prediction, names(prediction, "channel"), names(prediction, "heater"))
    for channel in names(prediction, "channel"):
        draw_telemetry(figure, prediction, channel, rows[channel], bins)
        for name in methods:
            _line(figure, prediction, name, channel, rows[channel], bins, dash=_dash(name, methods))
    for heater in names(prediction, "heater"):
        draw_status(figure, prediction, methods, heater, rows[heater], bins)
    return figure


def time_canvas(titles: Sequence[str], heights: Sequence[int], gap: int = GAP) -> go.Figure:
    """Empty plots above each other on one UTC axis; heights and the gap between two in px."""
    rows = len(titles)
    inner = sum(heights) + gap * (rows - 1)
    figure = make_subplots(
        rows=rows, cols=1, shared_xaxes=True, subplot_titles=[t.replace("_", " ") for t in titles],
        row_heights=list(heights), vertical_spacing=gap / inner if rows > 1 else 0.0,
    )  # fmt: skip
    finish(figure, inner + 30 + 34 + 52)
    small_titles(figure, left=True)
    figure.update_xaxes(type="date")
    figure.update_xaxes(title_text="time, UTC", row=rows)
    figure.update_layout(hovermode="x unified")
    return figure


def shade_eclipse(figure: go.Figure, prediction: xr.Dataset, rows: int) -> None:
    """Shades the stretches with less than half of the solar disc in view, in every plot."""
    if "eclipse" not in prediction:
        return
    time, dark = prediction["time"].values, prediction["eclipse"].values < 0.5
    dark_stretches = stretches(dark, time, _usual(prediction))
    whole = len(dark_stretches) * rows > MOST_SHAPES
    shapes = [
        {
            "type": "rect", "xref": "x", "yref": "paper" if whole else f"y{row if row > 1 else ''} domain",
            "x0": _iso(time[start]), "x1": _iso(time[end]), "y0": 0, "y1": 1, "fillcolor": ECLIPSE,
            "line": {"width": 0}, "layer": "below", "name": "eclipse", "legendgroup": "eclipse",
            "showlegend": number == 0 and row == 1,
        }
        for number, (start, end) in enumerate(dark_stretches)
        for row in range(1, 2 if whole else rows + 1)
    ]  # fmt: skip
    # Not update_layout: it would merge these into the shapes that are there, one by one.
    figure.layout.shapes = [*figure.layout.shapes, *shapes]


def _usual(prediction: xr.Dataset) -> float | None:
    return usual_step(prediction["time"].values, np.asarray(prediction["observed"].values, float))


def broken(
    prediction: xr.Dataset, indices: Indices, columns: Sequence[Array]
) -> tuple[NDArray[np.datetime64], list[Array]]:
    """Chosen samples of columns [T] of a prediction, as lines that break where its telemetry pauses."""
    return break_lines(prediction["time"].values, indices, columns, _usual(prediction))


def _iso(time: np.datetime64) -> str:
    return str(np.datetime_as_string(time, unit="ms"))


def window_canvas(
    prediction: xr.Dataset,
    channels: list[str],
    heaters: list[str],
    heights: Heights = HEIGHTS,
    titles: Mapping[str, str] | None = None,
) -> tuple[go.Figure, Rows]:
    """Plots for channels and, beneath, heaters, with eclipses; and their rows.

    titles: of plots that are called more than their name.
    """
    plots = [*channels, *heaters]
    named = [(titles or {}).get(name, name) for name in plots]
    figure = time_canvas(named, [heights.channel] * len(channels) + [heights.heater] * len(heaters), heights.gap)
    for row in range(1, len(channels) + 1):
        figure.update_yaxes(title_text=f"temperature, {degrees(prediction)}", row=row)
    shade_eclipse(figure, prediction, len(plots))
    return figure, {name: row for row, name in enumerate(plots, start=1)}


def degrees(prediction: xr.Dataset) -> str:
    """The unit in which its temperatures are shown: K where an offset is taken off them that is not told."""
    return "K" if "masked" in prediction.attrs else "°C"


def column(prediction: xr.Dataset, variable: str, channel: str, method: str | None = None) -> NDArray[np.float64]:
    """A variable of one channel in degC, [T]."""
    selector = {"channel": channel} | ({"by": method} if method else {})
    return np.asarray(prediction[variable].sel(selector).values, float) - ICE_POINT


def scatter(figure: go.Figure, row: int, x: NDArray, y: NDArray, name: str, **more: object) -> None:
    """Adds a trace whose legend entry stands once for all rows."""
    first = not any(t.legendgroup == name and t.showlegend is not False for t in figure.data)
    figure.add_scatter(
        x=x, y=y.astype(np.float32), name=name, legendgroup=name, showlegend=first, row=row, col=1, **more
    )


def draw_telemetry(figure: go.Figure, prediction: xr.Dataset, channel: str, row: int, bins: int) -> None:
    """Telemetry as dots; samples that are not scored as open ones."""
    observed = column(prediction, "observed", channel)
    scored = prediction["scored"].values.astype(bool)
    time = prediction["time"].values
    for name, part, symbol in (("telemetry", scored, "circle"), ("telemetry, not scored", ~scored, "circle-open")):
        chosen = np.flatnonzero(part & np.isfinite(observed))
        if not chosen.size:
            continue
        chosen = chosen[extremes([observed[chosen]], 3 * bins)]
        scatter(
            figure, row, time[chosen], observed[chosen], name, mode="markers",
            marker={"color": TELEMETRY, "size": 3.5, "symbol": symbol, "line": {"width": 1}},
            hovertemplate=f"%{{y:.2f}} {degrees(prediction)}",
        )  # fmt: skip


def _dash(method: str, methods: Sequence[str]) -> str:
    """Lines are told apart by more than colour: the first method's is solid."""
    return "solid" if method == methods[0] else "dot"


def _line(figure: go.Figure, prediction: xr.Dataset, name: str, channel: str, row: int, bins: int, dash: str) -> None:
    mean = column(prediction, "mean", channel, name)
    time, (mean,) = broken(prediction, followed(prediction["time"].values, [mean], 6 * bins), [mean])
    scatter(
        figure, row, time, mean, method(name).title, mode="lines",
        hovertemplate=f"%{{y:.2f}} {degrees(prediction)}",
        line={"color": method(name).colour, "width": 1.8, "dash": dash},
    )  # fmt: skip


def unknown_stretches(
    observed: NDArray[np.float64], time: NDArray[np.datetime64]
) -> tuple[NDArray[np.datetime64], NDArray[np.datetime64]]:
    """Starts and ends of the stretches in which telemetry does not tell a status [T], NaN where it has none.

    A sample tells it for as long as nine in ten samples take to the next.
    """
    known = time[np.isfinite(observed)]
    if known.size < 2:
        return time[:1], time[-1:]
    steps = np.diff(known)
    usual = np.quantile(steps.astype(np.int64), 0.9, method="lower").astype(steps.dtype)
    edges = [time[:1] - usual, known, time[-1:]]
    before, after = np.concatenate(edges)[:-1] + usual, np.concatenate(edges)[1:]
    longer = after - before > usual // 2
    return before[longer], after[longer]


def draw_status(
    figure: go.Figure, prediction: xr.Dataset, methods: Sequence[str], heater: str, row: int, bins: int,
    title: str = "status",
) -> None:  # fmt: skip
    """Status of telemetry as an area, of methods as step lines; for the posterior the probability of on."""
    time = prediction["time"].values
    observed = np.asarray(prediction["observed_status"].sel(heater=heater).values, float)
    known = np.isfinite(observed)
    on = np.array(stretches(observed[known] > 0.5, time[known]), int).reshape(-1, 2)
    x, y = time[known][on][:, [0, 0, 1, 1, 1]].ravel(), np.tile([0.0, 1.0, 1.0, 0.0, np.nan], len(on))
    on_in_telemetry = "heater on in telemetry"
    band(figure, x, y.astype(np.float32), on_in_telemetry, on_in_telemetry, row=row, col=1)
    starts, ends = unknown_stretches(observed, time)
    if len(starts):
        x = np.stack([starts, starts, ends, ends, ends], axis=1).ravel()
        y = np.tile(np.array([0.0, 1.0, 1.0, 0.0, np.nan], np.float32), len(starts))
        band(figure, x, y, "status unknown", "status unknown", UNKNOWN, row=row, col=1)
    for name in methods:
        status = np.asarray(prediction["status"].sel({"by": name, "heater": heater}).values, float)
        drawn = changes(status)
        drawn = drawn if drawn.size <= 6 * bins else extremes([status], 3 * bins)
        x, (y,) = broken(prediction, drawn, [status])
        shown = "probability of on (posterior)" if name == "stochastic" else method(name).title
        scatter(
            figure, row, x, y, shown, mode="lines", hovertemplate="%{y:.2f}",
            line={"color": method(name).colour, "width": 1.8, "shape": "hv", "dash": _dash(name, methods)},
        )  # fmt: skip
    ticks = {"tickvals": [0, 0.5, 1]} if title == "P(on)" else {"tickvals": [0, 1], "ticktext": ["off", "on"]}
    figure.update_yaxes(range=[-0.08, 1.12], title_text=title, row=row, **ticks)
