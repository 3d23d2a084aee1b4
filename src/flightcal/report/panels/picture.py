"""The prediction against telemetry that it has not seen, of the worst and of a typical channel, with the heaters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from ...prediction import Holding, crps_of_draws, hold_together, replicates_of
from ...simulator import FloatArray
from ...words import percent
from .. import block
from ..block import Block, section
from ..run_files import RunFiles, bins, has_prediction
from ..windows import Heights, names
from .duty import duties
from .prediction import figure_stochastic
from .residuals import residuals

MOST_HEATERS = 3
MOST_OF_A_NAME = 24
"""Characters of a name beside which its title says more and fits on a phone."""
HEIGHTS = Heights(channel=128, heater=40, gap=30)
_WORST = "worst of {}"
_LEAST = 50
"""Stretches of a series of which the picture has the extremes, however many other plots the page has."""
_WIDE, _LEAST_WIDE = 2.0, 5.0
"""Times as wide as a channel's readings vary in training, and K, from which an interval may say less than these."""
_READINGS = 1_000
"""Of a channel, that say how it reads in training."""


@dataclass(frozen=True)
class WideInterval:
    """Of a channel, where its own readings in training say more than a prediction."""

    channel: str
    window: str
    """That was not trained on, and where the interval is widest."""
    width: float
    """K, the median over the window,"""
    varies: float
    """and K by which the channel varies in training."""


@dataclass(frozen=True)
class Chosen:
    """What the picture shows."""

    window: str
    worst: str
    typical: str | None
    """None where there is one channel."""
    share: dict[str, float]
    """Of each channel's telemetry inside its interval."""
    why: str
    """Why the first is shown."""

    @property
    def channels(self) -> list[str]:
        """The worst first."""
        return [self.worst, *([self.typical] if self.typical else [])]


@section("picture", "Prediction against telemetry")
def panel(run: RunFiles) -> list[Block]:
    """Mean and interval of two channels, and the status of heaters."""
    chosen = choose(run)
    if chosen is None:
        return [block.note("The run has no prediction with an interval: it did not finish.")]
    window = run.windows[chosen.window]
    heaters = [duty.heater for duty in duties(run) if duty.window == chosen.window][:MOST_HEATERS]
    shown = window.sel(channel=chosen.channels)
    if window.sizes.get("heater", 0):
        shown = shown.sel(heater=heaters)
    titles = {name: name for name in chosen.channels}
    for name in (title for title in titles if len(title) <= MOST_OF_A_NAME):
        if name in chosen.share:
            titles[name] += f": {percent(chosen.share[name], 0)} inside"
        if name == chosen.worst and chosen.typical is not None:
            titles[name] += f", {chosen.why}"
    figure = figure_stochastic(shown, max(bins(run) // 2, _LEAST), heights=HEIGHTS, titles=titles)
    figure.update_layout(showlegend=False, margin={"t": 24})
    seen = "which was not trained on" if chosen.window in run.test_windows else "which was trained on"
    words = f"Window “{chosen.window}”, {seen}. Dots: telemetry. Line and band: predicted mean and {run.interval}."
    if heaters:
        words += " Beneath: heaters; grey: on in telemetry, ochre: not known, line: predicted probability of on."
    if "eclipse" in window and bool((window["eclipse"] < 0.5).any()):
        words += " Shaded: eclipse."
    return [block.figure(figure, words)]


def holdings(run: RunFiles) -> dict[str, Holding]:
    """Whether intervals hold, by window that was not trained on, all together."""
    windows = {
        name: window
        for name, window in run.test_windows.items()
        if "coverage" in window and has_prediction(window, "stochastic")
    }
    if not windows:
        return {}
    return dict(zip(windows, hold_together([replicates_of(window) for window in windows.values()]), strict=True))


def wide_intervals(run: RunFiles) -> list[WideInterval]:
    """Channels of which a prediction says less than that they read what they read in training, the widest first.

    Such an interval holds whatever the model is. The readings in training are a prediction by themselves, as
    climatology is one of weather: a model has skill where its CRPS is smaller (Wilks 2011, Statistical Methods in the
    Atmospheric Sciences, 8.1.4).
    """
    found: dict[str, WideInterval] = {}
    trained = _trained(run)
    tails = [0.5 - 0.5 * run.nominal, 0.5 + 0.5 * run.nominal]
    for name, window in run.test_windows.items():
        if not has_prediction(window, "stochastic") or "crps" not in window:
            continue
        for channel in filter(trained.__contains__, names(window, "channel")):
            dataset = window.sel(channel=channel, by="stochastic")
            known = np.isfinite(dataset["crps"].values)
            if not known.any():
                continue
            varies = float(np.ptp(np.quantile(trained[channel], tails)))
            wide = WideInterval(
                channel, name, float(np.median((dataset["upper"] - dataset["lower"]).values[known])), varies
            )
            by_readings = crps_of_draws(dataset["observed"].values[known], trained[channel][:, None])
            says_less = dataset["crps"].values[known].mean() > by_readings.mean()
            if says_less and wide.width > max(_WIDE * varies, _LEAST_WIDE):
                found[channel] = max(wide, found.get(channel, wide), key=lambda each: each.width)
    return sorted(found.values(), key=lambda each: -each.width)


def _trained(run: RunFiles) -> dict[str, FloatArray]:
    """Readings of each channel in all windows that were trained on, K; at most some thousand of each."""
    windows = [window for name, window in run.windows.items() if name not in run.test_windows]
    found: dict[str, list[FloatArray]] = {}
    for window in windows:
        for channel, values in zip(names(window, "channel"), window["observed"].values.T, strict=True):
            found.setdefault(channel, []).append(values[np.isfinite(values)])
    joined = {channel: np.concatenate(parts) for channel, parts in found.items()}
    return {channel: values[:: 1 + len(values) // _READINGS] for channel, values in joined.items() if len(values)}


def choose(run: RunFiles) -> Chosen | None:
    """The channel that holds least on unseen telemetry, and the middle one of the others; None without a prediction."""
    rooms = {
        (name, str(channel)): (float(room), float(share))
        for name, held in holdings(run).items()
        for channel, room, share in zip(run.windows[name]["channel"].values, held.room, held.coverage, strict=True)
        if np.isfinite(room)
    }
    rooms = {place: room for place, room in rooms.items() if has_prediction(run.windows[place[0]], "stochastic")}
    if rooms:
        # Of channels that all hold, the one with least inside.
        window, worst = min(rooms, key=lambda place: (min(rooms[place][0], 0.0), rooms[place][1]))
        # Where all hold, what the verdict may name is the channel whose noise is not what was assumed, or a wide one.
        noisy = [check for of in run.checks_of_training.values() for check in of if check.verdict == "contradicted"]
        why = _WORST.format(sum(window_name == window for window_name, _ in rooms))
        if noisy and rooms[window, worst][0] >= 0.0:
            worst, why = max(noisy, key=lambda check: check.factor).channel, "noise not as assumed"
        elif (wide := wide_intervals(run)) and rooms[window, worst][0] >= 0.0:
            window, worst, why = wide[0].window, wide[0].channel, "interval says nothing"
        others = sorted((room, channel) for (window_name, channel), (room, _) in rooms.items() if window_name == window)
        others = [other for other in others if other[1] != worst]
        share = {channel: share for (window_name, channel), (_, share) in rooms.items() if window_name == window}
        return Chosen(window, worst, others[len(others) // 2][1] if others else None, share, why)
    predicted = [name for name, window in run.windows.items() if has_prediction(window, "stochastic")]
    if not predicted:
        return None
    window = next((name for name in predicted if name in run.test_windows), predicted[0])
    errors = _errors(run.windows[window])
    order = sorted(errors, key=lambda name: -errors[name])
    typical = order[(1 + len(order)) // 2] if len(order) > 1 else None
    return Chosen(window, order[0], typical, {}, _WORST.format(len(order)))


def _errors(window: xr.Dataset) -> dict[str, float]:
    """Root mean square error of each channel; zero where nothing is known."""
    found = residuals(window)
    errors = np.sqrt((found**2).mean(axis=0, where=np.isfinite(found)))
    return dict(zip(names(window, "channel"), np.nan_to_num(errors).tolist(), strict=True))
