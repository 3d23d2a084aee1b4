"""Mean and interval of the stochastic update: figure 6 of the paper."""

from __future__ import annotations

import json
from collections.abc import Mapping

import numpy as np
import plotly.graph_objects as go
import xarray as xr

from ...prediction import ANY
from ...scenario import ICE_POINT, is_trained
from ...words import letter, percent
from .. import block
from ..block import Block, section
from ..run_files import RunFiles, bins, has_prediction
from ..style import BAND, MODEL_BAND, STOCHASTIC, WARNING, band, polygons
from ..thinning import followed
from ..windows import (
    HEIGHTS,
    Heights,
    broken,
    column,
    degrees,
    draw_status,
    draw_telemetry,
    names,
    scatter,
    window_canvas,
)

_LIMITS = ("lower_limit", "upper_limit")
_NEAR = 1.0
"""Of what a prediction spans, from it to a limit that its figure shows."""


@section("prediction", "Prediction with interval")
def panel(run: RunFiles) -> list[Block]:
    """Figure 6: mean and interval of the stochastic update."""
    order = run.test_windows | {n: w for n, w in run.windows.items() if is_trained(n)}
    blocks = []
    for i, (name, window) in enumerate(order.items()):
        if not has_prediction(window, "stochastic"):
            continue
        attributes = [
            f"{words}: {window.attrs[key]}."
            for key, words in (("interval_contains", "The interval contains"), ("initial_state", "Initial state"))
            if window.attrs.get(key)
        ]
        beneath = "; beneath, the probability that each heater is on" if window.sizes.get("heater", 0) else ""
        caption = (
            f"Figure 6{letter(i, order)}. Mean and interval of the posterior's prediction against telemetry of the "
            f"window “{name}”{beneath}. {' '.join(attributes)}"
        )
        blocks.append(block.figure(figure_stochastic(window, bins(run)), caption))
        if words := unseen(window):
            blocks.append(block.text(f"Window “{name}”: {words}"))
    return blocks or [block.note("Figure 6: there is no stochastic prediction in this run.")]


def unseen(window: xr.Dataset) -> str:
    """How much of a window training contained nothing like, by name, the most first; nothing where it contained all."""
    shares = _unseen_shares(window)
    named = ", ".join(f"{name} ({percent(share, 0)})" for name, share in shares.items() if name != ANY)
    if not named:
        return ""
    return (
        f"{percent(shares[ANY], 0)} of the time lies outside of what training contained: {named}. There the telemetry "
        "has not tested the model."
    )


def unseen_share(window: xr.Dataset) -> float:
    """Of a window's time, in which anything is outside of what training contained."""
    return _unseen_shares(window).get(ANY, 0.0)


def _unseen_shares(window: xr.Dataset) -> dict[str, float]:
    found = sorted(json.loads(window.attrs.get("unseen", "[]")), key=lambda item: -item["share"])
    return {share["name"]: share["share"] for share in found}


def figure_stochastic(
    prediction: xr.Dataset,
    bins: int,
    heights: Heights = HEIGHTS,
    titles: Mapping[str, str] | None = None,
) -> go.Figure:
    """Mean and interval of the posterior's prediction, and probability that a heater is on (figure 6).

    heights, titles: see `window_canvas`.
    """
    channels, heaters = names(prediction, "channel"), names(prediction, "heater")
    figure, rows = window_canvas(prediction, channels, heaters, heights, titles)
    for channel in names(prediction, "channel"):
        _stochastic(figure, prediction, channel, rows[channel], bins)
        _limits(figure, prediction, channel, rows[channel])
    for heater in names(prediction, "heater"):
        draw_status(figure, prediction, ["stochastic"], heater, rows[heater], bins, title="P(on)")
    return figure


def _limits(figure: go.Figure, prediction: xr.Dataset, channel: str, row: int) -> None:
    """Limits of operations that lie near the prediction, as dashed lines."""
    lower, upper = (column(prediction, name, channel, "stochastic") for name in ("lower", "upper"))
    lowest, highest = np.nanmin(lower), np.nanmax(upper)
    near, ends = _NEAR * (highest - lowest), prediction["time"].values[[0, -1]]
    for limit in (float(prediction[name].sel(channel=channel)) - ICE_POINT for name in _LIMITS if name in prediction):
        if lowest - near < limit < highest + near:
            scatter(
                figure, row, ends, np.full(2, limit), "limit", mode="lines",
                hovertemplate=f"%{{y:.4g}} {degrees(prediction)}",
                line={"color": WARNING, "width": 1.4, "dash": "dash"},
            )  # fmt: skip


def _stochastic(figure: go.Figure, prediction: xr.Dataset, channel: str, row: int, bins: int) -> None:
    """Interval with noise, interval of the model alone, telemetry, and mean of the stochastic prediction."""
    share = f"{100 * float(prediction.attrs.get('interval', 0.95)):g}%"
    columns = [
        column(prediction, "mean", channel, "stochastic"),
        column(prediction, "lower", channel, "stochastic"),
        column(prediction, "upper", channel, "stochastic"),
        column(prediction, "model_lower", channel),
        column(prediction, "model_upper", channel),
    ]
    indices = followed(prediction["time"].values, columns, 6 * bins)
    time, (mean, lower, upper, model_lower, model_upper) = broken(prediction, indices, columns)
    for name, low, high, colour in (
        (f"{share} interval", lower, upper, BAND),
        (f"{share} of the model, without noise", model_lower, model_upper, MODEL_BAND),
    ):
        x, y = polygons(time, low, high)
        band(figure, x, y.astype(np.float32), name, name, colour, row=row, col=1)
    draw_telemetry(figure, prediction, channel, row, bins)
    scatter(
        figure, row, time, mean, "stochastic mean", mode="lines", line={"color": STOCHASTIC, "width": 1.8},
        customdata=np.stack([lower, upper], axis=1).astype(np.float32),
        hovertemplate=f"%{{y:.2f}} {degrees(prediction)} (%{{customdata[0]:.2f}} to %{{customdata[1]:.2f}})",
    )  # fmt: skip
