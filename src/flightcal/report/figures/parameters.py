"""What was learnt about the parameters: densities (figure 5 of the paper), correlations, pairs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from arviz_stats.base import array_stats
from numpy.typing import NDArray

from ..run_files import ParameterInfo
from ..text import labelled, number, unit
from .style import DIVERGING, GENETIC, GENETIC_BEST, LINE, PRIOR, STOCHASTIC, WARNING, chain_colour, finish

Array = NDArray[np.float64]

ZOOM = 12.0
"""A prior wider than so many posteriors is not shown whole: the posterior would be a needle."""


def figure_density(
    info: ParameterInfo, prior: Array, posterior: Array, genetic: float | None = None, *, large: bool = False
) -> go.Figure:
    """Prior and posterior density of one parameter for each chain (figure 5), each scaled to its own peak.

    prior: [draw], posterior: [chain, draw], SI; genetic: the genetic algorithm's value, SI.
    The axis holds the prior's central 95% and the posterior; where the prior is more than 12 times as wide it
    holds the posterior's surroundings only.
    """
    figure = go.Figure()
    prior, posterior = prior + info.offset, posterior + info.offset
    low, high = _shown(prior, posterior)
    support = (float(prior.min()), float(prior.max()))
    x, density = _density(prior, support, smoothing=2.0)
    figure.add_scatter(
        x=x, y=density, name="prior", mode="lines", line={"color": PRIOR, "width": 1.5, "dash": "dash"},
        hovertemplate="prior, %{x:.5g}<extra></extra>",
    )  # fmt: skip
    for chain, values in enumerate(posterior):
        x, density = _density(values, support)
        figure.add_scatter(
            x=x, y=density, name=f"chain {chain + 1}", mode="lines",
            line={"color": chain_colour(chain), "width": 1.6},
            hovertemplate=f"chain {chain + 1}, %{{x:.5g}}<extra></extra>",
        )  # fmt: skip
    if genetic is not None:
        value = genetic + info.offset
        low, high = min(low, value), max(high, value)
        figure.add_scatter(
            x=[value], y=[0.0], name="genetic algorithm", mode="markers", cliponaxis=False,
            marker={"symbol": "triangle-up", "size": 11, "color": GENETIC},
            hovertemplate="genetic algorithm, %{x:.5g}<extra></extra>",
        )  # fmt: skip
    finish(figure, 340 if large else 230, legend=False, top=12)
    pad = 0.03 * (high - low)
    figure.update_layout(margin={"l": 40, "r": 14, "b": 46}, meta={"tools": False})
    title = labelled(info.name, info.unit)
    # A long name, as of a discrepancy's amplitude, has to fit under a small plot.
    font = {"size": min(12, max(9, 12 * 36 // len(title)))}
    figure.update_xaxes(title={"text": title, "font": font}, range=[low - pad, high + pad], nticks=6)
    figure.update_yaxes(range=[0, 1.08], tickvals=[0, 1], title_text="density / peak, –", rangemode="nonnegative")
    return figure


def _density(
    values: Array, support: tuple[float, float], smoothing: float = 1.0
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Kernel density of draws on 200 points, scaled to a peak of one; a spike where they are all the same.

    support: where the quantity can be. The density ends at zero inside it and is mirrored at its bounds, so that a
    posterior pressed against a prior's bound does not seem to fall off before it.
    """
    if np.ptp(values) == 0:
        return np.repeat(values[0], 2).astype(np.float32), np.array([0, 1], np.float32)
    margin = 0.8 * values.std()
    limits = (max(support[0], values.min() - margin), min(support[1], values.max() + margin))
    limits = (min(limits[0], values.min()), max(limits[1], values.max()))
    grid, density, _ = array_stats.kde(
        values, bound_correction=True, bw="silverman", bw_fct=smoothing, grid_len=200, custom_lims=limits
    )
    return np.asarray(grid, np.float32), np.asarray(density / density.max(), np.float32)


def _shown(prior: Array, posterior: Array) -> tuple[float, float]:
    """Range of the axis."""
    low, high = np.quantile(posterior, [0.0005, 0.9995])
    prior_low, prior_high = np.quantile(prior, [0.025, 0.975])
    if prior_high - prior_low > ZOOM * (high - low):
        return float(low - (high - low)), float(high + (high - low))
    return float(min(low, prior_low)), float(max(high, prior_high))


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


def wrapped(info: ParameterInfo, width: int = 16) -> str:
    """Name and unit in lines of about `width` characters, broken where the name has a mark."""
    lines, line = [], ""
    for word in info.name.replace("_", "_\0").replace(".", ".\0").replace("-", "-\0").split("\0"):
        if line and len(line) + len(word) > width:
            lines.append(line)
            line = ""
        line += word
    return "<br>".join([*lines, line, unit(info.unit) or "–"])


def figure_correlation(names: Sequence[str], correlation: Array) -> go.Figure:
    """Correlation of the posterior's quantities as a heat map: [quantity, quantity], -1 to 1."""
    size = len(names)
    text = [[f"{v:.2f}" if size <= 16 and abs(v) >= 0.05 else "" for v in row] for row in correlation]
    figure = go.Figure(
        go.Heatmap(
            z=correlation.astype(np.float32), x=list(names), y=list(names), zmin=-1, zmax=1,
            colorscale=[[i / 4, colour] for i, colour in enumerate(DIVERGING)],
            text=text, texttemplate="%{text}", textfont={"size": 10}, xgap=1, ygap=1,
            colorbar={"thickness": 12, "len": 0.7, "y": 0.35},
            hovertemplate="%{y} and %{x}: %{z:.3f}<extra></extra>",
        )
    )  # fmt: skip
    finish(figure, 60 + 5 * max(map(len, names)) + max(26 * size, 200), legend=False, top=8)
    figure.update_xaxes(tickangle=-50, automargin=True, showgrid=False, ticks="")
    figure.update_yaxes(autorange="reversed", automargin=True, showgrid=False, ticks="")
    return figure


def figure_genetic_spread(
    infos: Sequence[ParameterInfo], runs: Array, best: Array, mean: Array, posterior: Array | None
) -> go.Figure:
    """Parameters of every run of the genetic algorithm, its best and its mean, within the prior's central 95%.

    runs: [run, parameter], best, mean: [parameter]; posterior: median [parameter] or None; SI.
    """
    figure = go.Figure()
    low = np.array([i.prior_quantiles[0] for i in infos])
    span = np.array([i.prior_quantiles[2] for i in infos]) - low
    labels = [i.name for i in infos]

    def marks(values: Array, name: str, colour: str, symbol: str, size: int, opacity: float = 1.0) -> None:
        shown = [
            [number(v + i.offset) + (f" {unit(i.unit)}" if i.unit else "") for v, i in zip(row, infos, strict=True)]
            for row in np.atleast_2d(values)
        ]
        figure.add_scatter(
            x=((np.atleast_2d(values) - low) / span).ravel().astype(np.float32),
            y=labels * len(np.atleast_2d(values)), customdata=np.ravel(shown).tolist(), name=name, mode="markers",
            marker={"color": colour, "symbol": symbol, "size": size, "opacity": opacity},
            hovertemplate="%{y}: %{customdata}",
        )  # fmt: skip

    marks(runs, "each run", GENETIC, "circle-open", 8, 0.8)
    marks(mean, "mean of the runs (as published)", GENETIC, "diamond", 11)
    marks(best, "best run", GENETIC_BEST, "star", 11)
    if posterior is not None:
        marks(posterior, "posterior median", STOCHASTIC, "line-ns-open", 16)
    finish(figure, 150 + 28 * len(infos), top=8)
    figure.update_xaxes(title_text="place in the prior's<br>central 95%, –", zeroline=False)
    for edge in (0, 1):
        figure.add_vline(x=edge, line={"color": LINE, "width": 1, "dash": "dot"})
    figure.update_yaxes(autorange="reversed", automargin=True)
    return figure
