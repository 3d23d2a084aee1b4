"""What is predicted of planned windows, of which there is no telemetry."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import xarray as xr

from ...prediction import Extreme, extremes
from ...scenario import ICE_POINT
from ...words import moment, number
from .. import block
from ..block import Block, section
from ..run_files import RunFiles, bins, has_prediction
from ..tables import Cell, Table
from ..windows import degrees
from .picture import HEIGHTS
from .prediction import figure_stochastic, unseen

_SHOWN: Final = 2
"""Channels whose prediction is drawn, the likeliest to pass a limit first."""
_FINELY: Final = 50
"""Stretches of a series of which a figure has the extremes."""


@section("plans", "Plans")
def panel(run: RunFiles) -> list[Block]:
    """How low and how high each channel goes, and the chance that it passes a limit; nothing without a plan."""
    windows = {name: window for name, window in run.test_windows.items() if has_prediction(window, "stochastic")}
    found = {
        name: window_extremes for name, window in windows.items() if (window_extremes := list(extremes(window, name)))
    }
    if not found:
        return []
    words = (
        "Of what is still to come. Lowest and highest: of the temperature itself, without measurement noise, in "
        f"brackets with its {run.interval}; beside it when the predicted mean is there, UTC."
    )
    if any(not np.isnan(extreme.limit) for of in found.values() for extreme in of):
        words += " Chance: that the limit is passed at any of its times, as the draws of the posterior have it."
    else:
        words += " With “limits: [0 degC, 45 degC]” of a channel the chance that it passes one stands here too."
    blocks = []
    for name, of in found.items():
        blocks += [block.heading(f"“{name}”"), block.table(table(windows[name], of))]
        begins = windows[name].attrs.get("initial_state")
        told = [words for words in (begins and f"Initial state: {begins}.", unseen(windows[name])) if words]
        blocks += [block.text(" ".join(told))] if told else []
        likeliest = sorted(
            (extreme for extreme in of if not np.isnan(extreme.limit)), key=lambda extreme: -extreme.chance
        )
        if shown := list(dict.fromkeys(extreme.channel for extreme in likeliest))[:_SHOWN]:
            window = windows[name].sel(channel=shown)
            figure = figure_stochastic(window, max(bins(run), _FINELY), heights=HEIGHTS)
            figure.update_layout(showlegend=False, margin={"t": 24})
            caption = f"Line and band: predicted mean and {run.interval} of telemetry. Dashed: limits near it."
            blocks.append(block.figure(figure, caption))
    return [*blocks, block.text(words)]


def table(window: xr.Dataset, found: Sequence[Extreme]) -> Table:
    """A row for each channel."""
    rows: dict[str, list[str]] = {}
    limited = {extreme.channel for extreme in found if not np.isnan(extreme.limit)}
    for extreme in found:
        when = moment(extreme.time)[len("2024-") : 16]
        middle, lower, upper = (
            number(value - ICE_POINT, 3) for value in (extreme.median, extreme.lower, extreme.upper)
        )
        row = rows.setdefault(extreme.channel, [extreme.channel])
        row += [f"{middle} ({lower} to {upper})", when]
        if limited:
            row += _against_limit(extreme)
    unit = degrees(window)
    of_limit = ("limit", "chance") if limited else ()
    header = ("channel", f"lowest, {unit}", "at", *of_limit, f"highest, {unit}", "at", *of_limit)
    return Table(header, list(rows.values()), range(1, len(header)))


def _against_limit(extreme: Extreme) -> list[str]:
    if np.isnan(extreme.limit):
        return ["–", "–"]
    return [f"{extreme.limit - ICE_POINT:.6g}".replace("-", "−"), Cell(extreme.chance_in_words, extreme.state)]
