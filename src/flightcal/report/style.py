"""Colours and layout that all figures share. The page's script turns them into dark ones where the reader has dark."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from ..telemetry import spells

# Okabe & Ito (2008), Color Universal Design, darkened where a thin line on white needs it.
TELEMETRY = "#262626"
GENETIC = "#d97706"
GENETIC_BEST = "#7a4a00"
STOCHASTIC = "#0068b4"
UNCALIBRATED = "#b0508c"
POORLY_CALIBRATED = "#00805d"
NUMBERS = "#6a4fc4"
PRIOR = "#7f7f7f"
WARNING = "#c1272d"
CHAINS = ("#0068b4", "#b0508c", "#00805d", "#56b4e9", "#7a5c00", "#6a4fc4", "#8c3b3b", "#595959")
BAND = "rgba(40,130,205,0.24)"
MODEL_BAND = "rgba(40,130,205,0.45)"
STATUS_FILL = "rgba(110,110,110,0.42)"
UNKNOWN = "rgba(205,145,20,0.30)"
ECLIPSE = "rgba(85,110,200,0.15)"
TEXT = "#333333"
FAINT = "#dddddd"
LINE = "#999999"

DIVERGING = ("#b35806", "#fdb863", "#f4f4f4", "#92b9de", "#0a4a8a")
"""From −1 over 0 to 1."""


class Method(NamedTuple):
    """How a method of prediction.nc is shown."""

    title: str
    short: str
    """For narrow columns of tables."""
    colour: str


METHODS = {
    "uncalibrated": Method("uncalibrated", "uncal.", UNCALIBRATED),
    "poorly_calibrated": Method("poorly calibrated", "poorly cal.", POORLY_CALIBRATED),
    "genetic": Method("genetic algorithm, mean of its runs", "GA mean", GENETIC),
    "genetic_best": Method("genetic algorithm, best run", "GA best", GENETIC_BEST),
    "calibrated": Method("calibrated numbers alone", "numbers alone", NUMBERS),
    "stochastic": Method("stochastic", "stoch.", STOCHASTIC),
}


def method(name: str) -> Method:
    """How a method is shown; one that the report does not know, by its name."""
    return METHODS.get(name, Method(name, name, STOCHASTIC))


DARK = {
    TELEMETRY: "#e6e6e6",
    GENETIC: "#ffab40",
    GENETIC_BEST: "#e9d2a4",
    STOCHASTIC: "#5cb3f5",
    UNCALIBRATED: "#e58cc4",
    POORLY_CALIBRATED: "#3ecfa3",
    PRIOR: "#a0a0a0",
    WARNING: "#ff6b6b",
    "#56b4e9": "#c9e7fb",
    "#6a4fc4": "#ab9bff",
    "#7a5c00": "#d9b94a",
    "#8c3b3b": "#e08f8f",
    "#595959": "#b5b5b5",
    TEXT: "#d6d9de",
    FAINT: "#3a3f48",
    LINE: "#6b7280",
    BAND: "rgba(92,179,245,0.28)",
    MODEL_BAND: "rgba(92,179,245,0.50)",
    STATUS_FILL: "rgba(165,165,165,0.40)",
    UNKNOWN: "rgba(233,180,70,0.32)",
    ECLIPSE: "rgba(130,150,255,0.14)",
    **dict(zip(DIVERGING, ("#ff9f45", "#8a5a24", "#2a2f38", "#35618c", "#6cc0ff"), strict=True)),
}
"""Colour on dark paper of each colour on white."""

FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif"

AXIS = {
    "gridcolor": FAINT,
    "zeroline": False,
    "showline": True,
    "linecolor": LINE,
    "tickcolor": LINE,
    "ticks": "outside",
    "ticklen": 4,
    "title": {"standoff": 8},
}

TEMPLATE = go.layout.Template(
    layout={
        "xaxis": AXIS,
        "yaxis": AXIS,
        "font": {"family": FONT, "size": 12, "color": TEXT},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "hoverlabel": {"font": {"family": FONT, "size": 12}},
        "dragmode": "zoom",
    }
)


def chain_colour(index: int) -> str:
    """Colour of a chain."""
    return CHAINS[index % len(CHAINS)]


def finish(figure: go.Figure, height: int, *, legend: bool = True, top: int = 30) -> go.Figure:
    """The figure with the shared layout; height in px; the legend in a row above the plots, tools at the right."""
    margin = {"l": 64, "r": 40, "t": top + (34 if legend else 0), "b": 52}
    plot_height = max(height - margin["t"] - margin["b"], 1)
    figure.update_layout(
        template=TEMPLATE,
        height=height,
        margin=margin,
        showlegend=legend,
        legend={"orientation": "h", "x": 0, "xanchor": "left", "y": 1 + (top + 4) / plot_height, "yanchor": "bottom"},
        modebar={"orientation": "v"},
    )
    return figure


def plots(titles: Sequence[str], columns: int, row_height: int, *, gap: int = 60, **more: Any) -> tuple[go.Figure, int]:
    """Empty plots in rows of `columns`, and the height of the figure; heights and gaps in px."""
    rows = -(-len(titles) // columns)
    inner = rows * row_height + (rows - 1) * gap
    spacing = gap / inner if rows > 1 else 0.0
    figure = make_subplots(rows, columns, subplot_titles=list(titles), vertical_spacing=spacing, **more)
    return figure, inner + 34 + 30 + 52


def small_titles(figure: go.Figure, *, left: bool = False) -> None:
    """Subplot titles in bold, over the middle of their plots or at the left edge of the figure."""
    edge = {"x": 0, "xanchor": "left"} if left else {}
    titles = [annotation.to_plotly_json() for annotation in figure.layout.annotations]
    bold = {"font": {"size": 13, "color": TEXT}, "yshift": 2, **edge}
    # All at once: one by one takes long.
    figure.layout.annotations = [title | bold | {"text": f"<b>{title['text']}</b>"} for title in titles]


def levels(figure: go.Figure, y: float, rows: Iterable[int], column: int, dash: str = "solid") -> None:
    """Horizontal lines at y through the plots of some rows of a column. All at once: one by one takes long."""
    axes = [figure.get_subplot(row, column) for row in rows]
    names = [(axis.xaxis.plotly_name, axis.yaxis.plotly_name) for axis in axes]
    line = {"type": "line", "y0": y, "y1": y, "x0": 0, "x1": 1, "line": {"color": LINE, "width": 1, "dash": dash}}
    places = [{"xref": f"{x.replace('axis', '')} domain", "yref": y.replace("axis", "")} for x, y in names]
    # Not update_layout: it would merge these into the shapes that are there, one by one.
    figure.layout.shapes = [*figure.layout.shapes, *(line | place for place in places)]


def title_below(figure: go.Figure, text: str, count: int, columns: int) -> None:
    """A title of the horizontal axis under the last of `count` plots in each column."""
    for column in range(1, columns + 1):
        figure.update_xaxes(title_text=text, row=-(-(count - column + 1) // columns), col=column)


def polygons(
    x: NDArray[Any], low: NDArray[np.float64], high: NDArray[np.float64]
) -> tuple[NDArray[Any], NDArray[np.float64]]:
    """Outline of the area between two lines for ``fill="toself"``, one polygon for each stretch without NaN.

    x, low, high: [T]. Plotly's own fill between two traces draws across gaps.
    """
    outline_x, outline_y = [], []
    for start, end in spells(np.isfinite(low) & np.isfinite(high)):
        part = slice(start, end)
        outline_x += [x[part], x[part][::-1], x[end - 1 : end]]
        outline_y += [low[part], high[part][::-1], np.array([np.nan])]
    if not outline_x:
        return x[:0], low[:0]
    return np.concatenate(outline_x), np.concatenate(outline_y)


def band(figure: go.Figure, x: Any, y: Any, name: str, group: str, colour: str = STATUS_FILL, **place: int) -> None:
    """Fills the outline x, y; its entry in the legend stands once for all plots of the figure. place: row and col."""
    figure.add_scatter(
        x=x, y=y, mode="lines", line={"width": 0}, fill="toself", fillcolor=colour, name=name, legendgroup=group,
        showlegend=not any(trace.legendgroup == group for trace in figure.data), hoverinfo="skip", **place,
    )  # fmt: skip
