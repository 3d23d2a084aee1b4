"""Numbers as colours: the correlations of a posterior, and what a check finds by parameter."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from .style import DIVERGING, finish


def heat_map(
    values: NDArray[Any],
    columns: Sequence[str],
    rows: Sequence[str],
    height: int,
    *,
    signed: bool = True,
    written: bool = True,
    pair: str = "%{y}, %{x}",
    angle: int = -40,
    **axis: Any,
) -> go.Figure:
    """Values [row, column] as colours, from -1 or 0 to 1; height in px; written: with the numbers themselves.

    pair: names of a row and a column for the reader's pointer; angle: of the columns' names, degrees; axis: more
    of their axis.
    """
    colours = DIVERGING if signed else DIVERGING[2:]
    text = [[f"{value:.2f}" if written and abs(value) >= 0.05 else "" for value in row] for row in values]
    figure = go.Figure(
        go.Heatmap(
            z=values.astype(np.float32), x=list(columns), y=list(rows), zmin=-1 if signed else 0, zmax=1,
            colorscale=[[i / (len(colours) - 1), colour] for i, colour in enumerate(colours)],
            text=text, texttemplate="%{text}", textfont={"size": 10}, xgap=1, ygap=1,
            colorbar={"thickness": 12, "len": 0.7, "y": 0.35}, hovertemplate=pair + ": %{z:.3f}<extra></extra>",
        )
    )  # fmt: skip
    finish(figure, height, legend=False, top=8)
    figure.update_xaxes(tickangle=angle, automargin=True, showgrid=False, ticks="", **axis)
    figure.update_yaxes(autorange="reversed", automargin=True, showgrid=False, ticks="")
    return figure


def figure_correlation(names: Sequence[str], correlation: NDArray[Any]) -> go.Figure:
    """Correlation of quantities: [quantity, quantity], -1 to 1."""
    size = len(names)
    height = 60 + 5 * max(map(len, names)) + max(26 * size, 200)
    return heat_map(correlation, names, names, height, written=size <= 16, pair="%{y} and %{x}", angle=-50)
