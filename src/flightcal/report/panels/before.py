"""The window before calibration: figures 1 to 3 of the paper."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
import xarray as xr

from ...words import number
from .. import block
from ..block import Block, section
from ..run_files import RunFiles, bins, has_prediction
from ..windows import draw_status, figure_point, names, window_canvas

VISIBLY = 1.25
"""Times the RMSE of the uncalibrated model, from which on a calibration is visibly worse."""


@section("before", "Before calibration")
def panel(run: RunFiles) -> list[Block]:
    """Figures 1 to 3: before calibration."""
    if not run.windows:
        return [block.note("There is no prediction in this run (prediction.nc): figures 1 to 4 and 6 are missing.")]
    name, window = next(iter(run.windows.items()))
    blocks = []
    for figure, method, words in (
        (1, "uncalibrated", "Uncalibrated: every parameter at its prior's median"),
        (
            2,
            "poorly_calibrated",
            "Poorly calibrated: a draw from the priors that fits worse than three in four",
        ),
    ):
        if has_prediction(window, method):
            caption = f"Figure {figure}. {words}, against telemetry of the window “{name}”."
            if "eclipse" in window and (window["eclipse"] < 0.5).any():
                caption += " Eclipses are shaded."
            if method == "poorly_calibrated":
                caption += poorly_in_words(window)
            if figure == 1 and window.sizes["time"] > 6 * bins(run):
                caption += (
                    " Of a long series like this one, figures show a part: of dots the extremes of each stretch, of "
                    "lines where they bend."
                )
            blocks.append(block.figure(figure_point(window, [method], bins(run)), caption))
        else:
            blocks.append(block.note(f"Figure {figure}: the prediction has no method “{method}”."))
    methods = [m for m in ("uncalibrated", "poorly_calibrated") if has_prediction(window, m)]
    if window.sizes.get("heater", 0) and methods:
        caption = f"Figure 3. Heater status of both against telemetry (grey area: on) in the window “{name}”."
        blocks.append(block.figure(figure_heater_status(window, methods, bins(run)), caption))
    else:
        why = "neither was simulated" if window.sizes.get("heater", 0) else "the scenario has no heaters"
        blocks.append(block.note(f"Figure 3: {why}."))
    return blocks


def poorly_in_words(window: xr.Dataset) -> str:
    """By how much the poor calibration is worse than none; why, where that cannot be seen. "" without the two."""
    errors = [_rmse(window, name) for name in ("uncalibrated", "poorly_calibrated") if has_prediction(window, name)]
    if len(errors) < 2 or not np.isfinite(errors).all():
        return ""
    without, poor = errors
    words = f" RMSE {number(poor, 3)} K, uncalibrated {number(without, 3)} K."
    if poor >= VISIBLY * without:
        return words
    return (
        f"{words} It is not visibly worse: the priors' medians are as far off as most of what the priors allow, or the "
        "priors are so narrow that all of it fits alike."
    )


def _rmse(window: xr.Dataset, method: str) -> float:
    scored = window.isel(time=window["scored"].values.astype(bool)).sel({"by": method})
    return float(np.sqrt(((scored["observed"] - scored["mean"]) ** 2).mean()))


def figure_heater_status(prediction: xr.Dataset, methods: Sequence[str], bins: int) -> go.Figure:
    """Heater status of several methods over that of telemetry (figure 3)."""
    figure, rows = window_canvas(prediction, [], names(prediction, "heater"))
    for heater in names(prediction, "heater"):
        draw_status(figure, prediction, methods, heater, rows[heater], bins)
    return figure
