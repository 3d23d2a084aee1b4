"""Whether predictions say how often what happens: transform, coverage by place in the orbit and by forecast hour."""

from __future__ import annotations

import math

import numpy as np
import plotly.graph_objects as go
import xarray as xr

from ...validation import (
    SIGNIFICANCE,
    Coverage,
    Uniformity,
    chance_band,
    coverage_by_hour,
    coverage_by_phase,
    effective_samples,
    probability_integral_transform,
    uniformity,
)
from ...words import chance, count, number
from .. import block
from ..block import Block, section
from ..run_files import RunFiles, has_prediction
from ..style import STATUS_FILL, STOCHASTIC, band, finish, levels, plots, small_titles
from ..tables import Cell, Table
from ..windows import names

ROW_HEIGHT = 150
BINS = 10


@section("reliability", "Reliability")
def panel(run: RunFiles) -> list[Block]:
    """Whether intervals hold what they promise."""
    windows = {name: window for name, window in run.windows.items() if has_prediction(window, "stochastic")}
    if not windows:
        return [block.note("There is no stochastic prediction in this run, so no reliability of one.")]
    blocks = [
        block.table(transforms({name: uniformity(window) for name, window in windows.items()})),
        block.text(
            "The transform of a sample is the share of the prediction's draws that are of a lower temperature: "
            "predictions that are right make it uniform, ones that are too narrow pile it up at 0 "
            "and 1, ones that are too wide in the middle, biased ones at one end. The test is that of Kolmogorov and "
            "Smirnov for as many independent samples as these are worth; bands of chance use the same number. An "
            "average coverage may be right while parts of the orbit or of the forecast are not covered."
        ),
    ]
    for name, window in windows.items():
        caption = (
            f"Reliability in the window “{name}”: probability integral transform, and share of telemetry inside the "
            "interval by place in the orbit and by hour of the forecast. Grey: what 95% of the values would be by "
            "chance where the interval is right; dotted: the interval's probability."
        )
        blocks.append(block.figure(figure_reliability(window), caption, wide=True))
    return blocks


def transforms(found: dict[str, list[Uniformity]]) -> Table:
    """Whether the probability integral transform is uniform, by window and channel."""
    rows = []
    for window, of_window in found.items():
        for u in of_window:
            verdict: str = "– unknown"
            if not math.isnan(u.p_value):
                verdict = Cell("✕ not uniform", "bad") if u.p_value < SIGNIFICANCE else Cell("✓ uniform", "good")
            rows.append(
                [window, u.channel, verdict, chance(u.p_value), number(u.distance, 2),
                 f"{count(u.effective)}\nof {count(u.samples)}"]
            )  # fmt: skip
    header = ("window", "channel", "transform", "Kolmogorov-Smirnov", "distance", "effective number")
    return Table(header, rows, range(3, 6))


def figure_reliability(prediction: xr.Dataset) -> go.Figure:
    """One row for each channel: histogram of the probability integral transform, coverage by phase and by hour.

    prediction: a group of prediction.nc. Grey: what 95% of the values would be where the intervals are right.
    """
    channels = names(prediction, "channel")
    time = prediction["time"].values
    transforms = probability_integral_transform(prediction)
    by = [("by hour", "forecast, h", coverage_by_hour(prediction))]
    # Without an orbit there is no place in it.
    if by_place := coverage_by_phase(prediction):
        by.insert(0, ("by place", "place in the orbit, –", by_place))
    parts = [found for _, _, found in by]
    titles = [title for channel in channels for title in (channel.replace("_", " "), *(title for title, _, _ in by))]
    figure, height = plots(titles, 1 + len(by), ROW_HEIGHT, horizontal_spacing=0.09)
    nominal = float(prediction.attrs.get("interval", 0.95))
    lowest = min([0.8, *(max(part.share - 0.05, 0.0) for found in parts for part in found)])
    for row, (channel, values) in enumerate(zip(channels, transforms.T, strict=True), start=1):
        present = np.isfinite(values)
        if present.sum() > 1:
            _histogram(figure, values[present], effective_samples(values[present], time[present]), row)
        for column, found in enumerate(parts, start=2):
            _coverage(figure, [part for part in found if part.channel == channel], row, column)
        figure.update_yaxes(title_text="density, –", nticks=5, row=row, col=1)
        for column in range(2, 2 + len(by)):
            figure.update_yaxes(title_text="coverage, –", range=[lowest, 1.01], nticks=5, row=row, col=column)
    for column, found in enumerate(parts, start=2):
        shown = {part.channel for part in found}
        levels(
            figure, nominal, [row for row, channel in enumerate(channels, start=1) if channel in shown], column, "dot"
        )
    finish(figure, height)
    small_titles(figure)
    figure.update_xaxes(range=[0, 1], col=1)
    figure.update_xaxes(title_text="predicted probability of less, –", row=len(channels), col=1)
    for column, (_, axis, _) in enumerate(by, start=2):
        figure.update_xaxes(title_text=axis, row=len(channels), col=column)
    return figure


def _histogram(figure: go.Figure, values: np.ndarray, effective: float, row: int) -> None:
    density, edges = np.histogram(values, bins=BINS, range=(0.0, 1.0), density=True)
    low, high = (BINS * share for share in chance_band(1.0 / BINS, effective))
    band(figure, [0, 1, 1, 0], [low, low, high, high], "95% band of chance", "band", row=row, col=1)
    figure.add_bar(
        x=(edges[1:] + edges[:-1]) / 2, y=density.astype(np.float32), width=1.0 / BINS,
        marker={"color": STOCHASTIC, "opacity": 0.55, "line": {"width": 0}}, name="telemetry", legendgroup="telemetry",
        showlegend=row == 1, hovertemplate="%{x:.2f}: %{y:.2f}<extra></extra>", row=row, col=1,
    )  # fmt: skip
    # A band of few effective samples may reach beyond the plot.
    figure.update_yaxes(range=[0.0, 1.1 * max(density.max(), min(high, 2.0))], row=row, col=1)


def _coverage(figure: go.Figure, parts: list[Coverage], row: int, column: int) -> None:
    if not parts:
        return
    steps = [(edge, value) for part in parts for edge, value in ((part.start, part.lower), (part.end, part.lower))]
    back = [(edge, part.upper) for part in reversed(parts) for edge in (part.end, part.start)]
    outline = [*steps, *back]
    figure.add_scatter(
        x=[x for x, _ in outline], y=[y for _, y in outline], fill="toself", fillcolor=STATUS_FILL, mode="lines",
        line={"width": 0}, legendgroup="band", showlegend=False, hoverinfo="skip", row=row, col=column,
    )  # fmt: skip
    figure.add_scatter(
        x=[(part.start + part.end) / 2 for part in parts], y=[part.share for part in parts], mode="lines+markers",
        line={"color": STOCHASTIC, "width": 1.2}, marker={"size": 6}, name="share inside the interval",
        legendgroup="share", showlegend=row == 1 and column == 2,
        customdata=[part.samples for part in parts],
        hovertemplate="%{y:.1%} of %{customdata} samples<extra></extra>", row=row, col=column,
    )  # fmt: skip
