"""Correlations of the posterior, as a map and as draws."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from ...words import listed, unit
from .. import block
from ..block import Block, section
from ..heat_map import figure_correlation
from ..run_files import ParameterInfo, RunFiles, draws
from ..style import STOCHASTIC, WARNING, finish
from ..thinning import Array

MOST_PAIRS = 8


@section("pairs", "Correlations")
def panel(run: RunFiles) -> list[Block]:
    """Correlations, as a map and as draws."""
    if run.posterior is None or not run.parameters:
        return [block.note("There is no posterior in this run (posterior.nc).")]
    infos = run.sampled
    values = draws(run.posterior, "posterior", [i.name for i in infos]).reshape(-1, len(infos))
    vary = np.ptp(values, axis=0) > 0
    infos, values = [i for i, v in zip(infos, vary, strict=True) if v], values[:, vary]
    if len(infos) < 2:
        return [block.note("There are fewer than two quantities, so none to compare.")]
    correlation = np.corrcoef(values.T)
    chosen = most_correlated(correlation, MOST_PAIRS)
    diverging = np.zeros(len(values), bool)
    if "sample_stats" in run.posterior.children and "diverging" in run.posterior["sample_stats"]:
        diverging = run.posterior["sample_stats"]["diverging"].transpose("chain", "draw").values.astype(bool).ravel()
    others = [i.name for k, i in enumerate(infos) if k not in chosen]
    rest = f" Not shown: {listed(others)}; the heat map above has them all." if others else ""
    return [
        block.figure(
            figure_correlation([i.name for i in infos], correlation),
            "Correlation of the posterior's quantities.", wide=True,
        ),
        block.figure(
            figure_pairs([infos[k] for k in chosen], values[:, chosen], diverging),
            f"Posterior draws of the {len(chosen)} quantities that correlate most (300 draws; red crosses: divergent "
            f"draws, {int(diverging.sum())} in all).{rest}",
            wide=True,
        ),
    ]  # fmt: skip


def most_correlated(correlation: Array, limit: int) -> list[int]:
    """Indices of at most `limit` quantities that correlate most with any other, in their given order."""
    strength = np.abs(correlation - np.eye(len(correlation))).max(axis=0)
    return sorted(np.argsort(-strength, kind="stable")[:limit].tolist())


def figure_pairs(infos: Sequence[ParameterInfo], posterior: Array, diverging: NDArray[np.bool_]) -> go.Figure:
    """Posterior draws of every pair of some parameters; histograms on the diagonal, divergent draws as crosses.

    posterior: [draw, quantity] SI, diverging: [draw]. At most 300 draws are shown, and every divergent one.
    """
    chosen = np.unique(np.linspace(0, len(posterior) - 1, 300).astype(int))
    usual, bad = chosen[~diverging[chosen]], np.flatnonzero(diverging)[:200]
    columns = [posterior[:, i] + info.offset for i, info in enumerate(infos)]
    ranges = [_stretched(column) for column in columns]
    size = len(infos)
    traces: list[dict[str, Any]] = []
    axes: dict[str, Any] = {}
    for i in range(size):
        for j in range(i + 1):
            # Only cells on and under the diagonal have axes; plotly's grid of subplots would have all.
            number_ = i * (i + 1) // 2 + j + 1
            place = {"xaxis": f"x{number_}", "yaxis": f"y{number_}"}
            axes |= _cell(infos, ranges, i, j, number_)
            if i == j:
                traces.append(_histogram(columns[i]) | place)
            else:
                traces.append(_draws(columns[j][usual], columns[i][usual], STOCHASTIC, "circle", 3) | place)
                traces.append(_draws(columns[j][bad], columns[i][bad], WARNING, "x", 6) | place)
    figure = go.Figure({"data": traces, "layout": axes})
    finish(figure, size * 128 + 110, legend=False, top=8)
    figure.update_layout(margin={"l": 92, "b": 84}, bargap=0)
    return figure


def _cell(
    infos: Sequence[ParameterInfo], ranges: list[tuple[float, float]], row: int, column: int, number_: int
) -> dict[str, Any]:
    """The two axes of a cell of the grid of pairs; names and ticks at the left and lower edge only."""
    size, gap = len(infos), 0.012
    width = (1 - gap * (size - 1)) / size
    left, top = column * (width + gap), 1 - row * (width + gap)
    at_bottom, at_left = row == size - 1, column == 0 and row > 0
    look = {"tickfont": {"size": 10}, "tickangle": 0}
    x_axis = look | {"domain": [left, left + width], "anchor": f"y{number_}", "showticklabels": at_bottom}
    y_axis = look | {"domain": [top - width, top], "anchor": f"x{number_}", "showticklabels": at_left}
    x_axis |= {"range": ranges[column], "tickvals": _ticks(*ranges[column])}
    title = {"font": {"size": 11}, "standoff": 8}
    if at_bottom:
        x_axis["title"] = title | {"text": wrapped(infos[column])}
    if at_left:
        y_axis["title"] = title | {"text": wrapped(infos[row])}
    if row == column:
        y_axis["visible"] = False
    else:
        first = row * (row + 1) // 2 + 1
        y_axis |= {"range": ranges[row], "tickvals": _ticks(*ranges[row])}
        y_axis |= {"matches": f"y{first}"} if column else {}
    lowest = (size - 1) * size // 2 + column + 1
    x_axis |= {} if at_bottom else {"matches": f"x{lowest}"}
    return {f"xaxis{number_}": x_axis, f"yaxis{number_}": y_axis}


def _stretched(values: Array) -> tuple[float, float]:
    """Range of an axis that holds the values with a margin."""
    margin = 0.06 * float(np.ptp(values))
    return float(values.min()) - margin, float(values.max()) + margin


def _ticks(low: float, high: float) -> list[float]:
    """Two or three round numbers well inside a range, with so few digits that their labels do not meet."""
    span = high - low
    low, high = low + 0.1 * span, high - 0.1 * span
    labels: list[str] = []
    for step in (0.1, 0.2, 0.25, 0.5, 1.0, 2.0):
        step *= 10.0 ** np.floor(np.log10(span))
        coarser = [f"{k * step:.10g}" for k in range(int(np.ceil(low / step)), int(np.floor(high / step)) + 1)]
        if len(coarser) < 2:
            break
        labels = coarser
        if len(labels) <= 3 and sum(map(len, labels)) <= 10:
            return [float(label) for label in labels]
    # Too long for three, too coarse for fewer: the outer two.
    return [float(label) for label in (labels[0], labels[-1])] if labels else []


def _draws(x: Array, y: Array, colour: str, symbol: str, size: int) -> dict[str, Any]:
    return {
        "type": "scatter",
        "x": x.astype(np.float32),
        "y": y.astype(np.float32),
        "mode": "markers",
        "marker": {"size": size, "color": colour, "opacity": 0.55, "symbol": symbol},
        "hovertemplate": "%{x:.4g}, %{y:.4g}<extra></extra>",
    }


def _histogram(values: Array) -> dict[str, Any]:
    counts, edges = np.histogram(values, bins=24)
    return {
        "type": "bar",
        "x": ((edges[1:] + edges[:-1]) / 2).astype(np.float32),
        "y": (counts / counts.max()).astype(np.float32),
        "width": edges[1] - edges[0],
        "marker": {"color": STOCHASTIC, "opacity": 0.6, "line": {"width": 0}},
        "hovertemplate": "%{x:.4g}<extra></extra>",
    }


def wrapped(info: ParameterInfo) -> str:
    """Name and unit in lines of about 16 characters, broken where the name has a mark."""
    lines, line = [], ""
    for word in info.name.replace("_", "_\0").replace(".", ".\0").replace("-", "-\0").split("\0"):
        if line and len(line) + len(word) > 16:
            lines.append(line)
            line = ""
        line += word
    return "<br>".join([*lines, line, unit(info.unit) or "–"])
