"""Whether the residuals are what the likelihood took them for: tests, in time, distribution, autocorrelation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
import xarray as xr
from numpy.typing import NDArray
from scipy.stats import norm

from ...probability import INDEPENDENT, called
from ...validation import ResidualCheck, autocorrelation, nominal_spacing
from ...words import chance, count, listed, number
from .. import block
from ..block import Block, section
from ..run_files import RunFiles, bins
from ..style import GENETIC, PRIOR, STOCHASTIC, band, finish, levels, plots, small_titles
from ..tables import Cell, Table
from ..thinning import extremes
from ..windows import names, shade_eclipse, time_canvas

ROW_HEIGHT = 150
MOST_LAGS = 120

SHOWN = 0.1
"""Lag-1 autocorrelation above which residuals are called correlated as noise with a memory expects."""

TESTED = (
    "Tested are its innovations, the part of each residual that those before it do not tell. Whether sensors or "
    "simulator err in this way, telemetry does not tell."
)


@section("residuals", "Residuals")
def panel(run: RunFiles) -> list[Block]:
    """Tests and figures of the residuals, by window."""
    checks = run.checks
    if not checks:
        return [block.note("There is no stochastic prediction in this run, so no residuals.")]
    blocks = [
        *(block.text(words) for words in map(_contradiction, checks, checks.values()) if words),
        block.table(tests_of(checks)),
        block.text(
            "Residual: telemetry minus the posterior's mean, which includes the expected discrepancy or unmodelled "
            "heat where there is one. Tested are the residuals, of AR(1) noise its innovations (the part of each "
            "residual that those before it do not tell), of rounded telemetry the noise drawn within the step; the "
            "numbers are of that. With heat, the innovations of a training window are those of a simulation whose "
            "heaters follow their measured status, as the likelihood has it. "
            "“Too narrow by” is √(number / effective number): by about this factor intervals of parameters are too "
            "narrow where the likelihood takes for white what is not. "
            "The posterior rests on what was trained on; other windows show whether the model's error persists."
        ),
    ]
    for name in checks:
        window = run.windows[name]
        blocks.append(block.heading(f"Window “{name}”"))
        blocks.append(block.figure(figure_residuals(window, bins(run)), f"Residuals in time, window “{name}”."))
        caption = f"Distribution and autocorrelation, window “{name}”."
        blocks.append(block.figure(figure_residual_distribution(window), caption, wide=True))
    return blocks


def _contradiction(window: str, of_window: Sequence[ResidualCheck]) -> str:
    """In words, how many channels of a window contradict what is assumed; nothing where none can be judged."""
    judged = [c for c in of_window if c.verdict != "unknown"]
    against = [c for c in judged if c.verdict == "contradicted"]
    expected = [c for c in judged if c.verdict == "expected"]
    if not judged:
        return ""
    words = f"Window “{window}”: "
    if against:
        tested = listed(list(dict.fromkeys(c.tested for c in against)))
        alike = min(c.lag1 for c in against) > 0
        resembles = f"each of their {tested} resembles the one before"
        dependent = resembles if alike else f"their {tested} are not independent"
        words += (
            f"{len(against)} of {len(judged)} channels contradict the {assumption(against)} that the likelihood "
            f"assumes: {dependent} (lag-1 autocorrelation {spread([c.lag1 for c in against])}; 0 for what is assumed)."
        )
    else:
        words += f"no channel contradicts {assumption(judged)}."
    if expected:
        tested = listed(list(dict.fromkeys(c.tested for c in expected)))
        words += (
            f" The {tested} of {listed([c.channel for c in expected])} "
            "are correlated, as what the simulator lacks makes them where no telemetry tells it; the interval contains "
            "it."
        )
    return f"{words} {correlation_expected(judged)}".strip()


def assumption(of_window: Sequence[ResidualCheck]) -> str:
    """What is assumed of a window's residuals, in words."""
    noise = listed([called(name).in_full for name in noises(of_window)])
    discrepant = [c for c in of_window if c.discrepant]
    if not discrepant:
        return noise
    of = "" if len(discrepant) == len(of_window) else f" of {channels(discrepant, of_window)}"
    return f"{noise} beside a discrepancy{of} in orbit phase"


def noises(of_window: Sequence[ResidualCheck]) -> list[str]:
    """What kinds of noise are assumed, by name."""
    return list(dict.fromkeys(c.noise for c in of_window))


def correlation_expected(of_window: Sequence[ResidualCheck]) -> str:
    """That residuals are correlated as noise with a memory expects; nothing where there is no such, or none are."""
    found = [c for c in of_window if c.tested == "innovations" and c.residual_lag1 > SHOWN]
    if not found:
        return ""
    return (
        f"The residuals of the mean of {channels(found, of_window)} are correlated (lag-1 autocorrelation "
        f"{spread([c.residual_lag1 for c in found])}), which the {listed(noises(found))} expects."
    )


def spread(values: Sequence[float]) -> str:
    """``0.62`` or ``0.62 to 0.91``."""
    low, high = number(min(values), 2), number(max(values), 2)
    return low if low == high else f"{low} to {high}"


def channels(some: Sequence[ResidualCheck], every: Sequence[ResidualCheck]) -> str:
    """Names of some channels; how many they are where they are all."""
    named = list(dict.fromkeys(c.channel for c in some))
    if len(named) == len({c.channel for c in every}) > 2:
        return f"all {len(named)} channels"
    return listed(named)


def tests_of(checks: dict[str, list[ResidualCheck]]) -> Table:
    """Tests of the residuals by window and channel."""
    rows = []
    for window, of_window in checks.items():
        for c in of_window:
            p = chance(c.p_value)
            white = "iid" if c.noise == INDEPENDENT.words and not c.discrepant else "white"
            verdict = {
                "white": Cell(f"✓ {white}", "good"), "slight": Cell(f"✓ nearly {white}", "good"),
                "contradicted": Cell(f"✕ not {white}", "bad"), "expected": "– not white,\nas expected",
                "unknown": "– unknown",
            }[c.verdict]  # fmt: skip
            assumed = f"{c.noise},\ndiscrepancy" if c.discrepant else c.noise
            innovations = c.tested == "innovations"
            ar1 = "" if innovations else f"\nif AR(1): {number(c.factor_ar1, 3)}"
            of_residuals = f"\nof residuals {number(c.residual_lag1, 3)}" if innovations else ""
            rows.append(
                [window, f"{c.channel}\n{assumed}", verdict, f"{number(c.factor, 3)}{ar1}",
                 f"{count(c.effective)}\nof {count(c.samples)}", f"{number(c.lag1, 3)}{of_residuals}",
                 f"{p}\nQ = {number(c.ljung_box, 4)}, {c.lags} lags",
                 f"{number(c.mean, 2)}\nsd {number(c.standard_deviation, 3)}"]
            )  # fmt: skip
    header = (
        "window", "channel, and what is assumed", "verdict", "too narrow by", "effective number",
        "lag-1 auto\u00adcorrelation", "Ljung-Box", "mean, K",
    )  # fmt: skip
    return Table(header, rows, range(3, 8))


def residuals(prediction: xr.Dataset) -> NDArray[np.float64]:
    """Telemetry minus mean prediction, [time, channel], K; NaN where telemetry is missing or not scored."""
    difference = prediction["observed"] - prediction["mean"].sel({"by": "stochastic"})
    return difference.where(prediction["scored"].astype(bool)).transpose("time", "channel").values


def figure_residuals(prediction: xr.Dataset, bins: int) -> go.Figure:
    """Residuals in time, one plot for each channel. prediction: a group of prediction.nc."""
    channels = names(prediction, "channel")
    figure = time_canvas(channels, [ROW_HEIGHT] * len(channels))
    time = prediction["time"].values
    for row, values in enumerate(residuals(prediction).T, start=1):
        chosen = np.flatnonzero(np.isfinite(values))
        if chosen.size:
            chosen = chosen[extremes([values[chosen]], 3 * bins)]
        figure.add_scatter(
            x=time[chosen], y=values[chosen].astype(np.float32), mode="markers", name="telemetry − mean",
            legendgroup="residual", showlegend=row == 1, marker={"size": 3.5, "color": STOCHASTIC},
            hovertemplate="%{y:.3f} K", row=row, col=1,
        )  # fmt: skip
        figure.update_yaxes(title_text="residual, K", row=row, nticks=5)
    levels(figure, 0.0, range(1, len(channels) + 1), 1)
    shade_eclipse(figure, prediction, len(channels))
    return figure


def figure_residual_distribution(prediction: xr.Dataset) -> go.Figure:
    """Histogram and autocorrelation of the residuals, one row for each channel.

    The histogram has the normal density of the same mean and deviation; the autocorrelation the band that holds 95% of
    the values under white noise, and beside it, of AR(1) noise, that of its innovations.
    """
    channels = names(prediction, "channel")
    plain = [c.replace("_", " ") for c in channels]
    titles = [t for c in plain for t in (f"{c}: distribution", f"{c}: autocorrelation")]
    figure, height = plots(titles, 2, ROW_HEIGHT, column_widths=[0.4, 0.6], horizontal_spacing=0.1)
    time = prediction["time"].values
    for row, values in enumerate(residuals(prediction).T, start=1):
        present = np.isfinite(values)
        if present.sum() > 2:
            _histogram(figure, values[present], row)
            _autocorrelation(figure, values[present], time[present], row)
            if "innovation" in prediction and called(str(prediction["noise"].values[row - 1])).has_memory:
                innovations = prediction["innovation"].transpose("time", "channel").values[present, row - 1]
                _autocorrelation(figure, innovations, time[present], row, of_noise=True)
        figure.update_yaxes(title_text="density, 1/K", row=row, col=1, rangemode="tozero", nticks=5)
        figure.update_yaxes(title_text="autocorrelation, –", row=row, col=2, range=[-1.05, 1.05], tickvals=[-1, 0, 1])
    finish(figure, height)
    small_titles(figure)
    figure.update_xaxes(title_text="residual, K", row=len(channels), col=1)
    figure.update_xaxes(title_text="lag, min", row=len(channels), col=2)
    return figure


def _histogram(figure: go.Figure, values: NDArray[np.float64], row: int) -> None:
    density, edges = np.histogram(values, bins=30, density=True)
    figure.add_bar(
        x=((edges[1:] + edges[:-1]) / 2).astype(np.float32), y=density.astype(np.float32), width=edges[1] - edges[0],
        marker={"color": STOCHASTIC, "opacity": 0.55, "line": {"width": 0}}, name="residuals", legendgroup="residuals",
        showlegend=row == 1, hovertemplate="%{x:.3f} K: %{y:.3f} 1/K<extra></extra>", row=row, col=1,
    )  # fmt: skip
    grid = np.linspace(edges[0], edges[-1], 80)
    figure.add_scatter(
        x=grid.astype(np.float32), y=norm.pdf(grid, values.mean(), values.std()).astype(np.float32), mode="lines",
        line={"color": PRIOR, "width": 1.6, "dash": "dash"}, name="normal, same mean and deviation",
        legendgroup="normal", showlegend=row == 1, hoverinfo="skip", row=row, col=1,
    )  # fmt: skip


def _autocorrelation(
    figure: go.Figure, values: NDArray[np.float64], time: NDArray[np.datetime64], row: int, *, of_noise: bool = False
) -> None:
    """Of residuals, with the band of white noise; of_noise: of innovations, over it."""
    lags = max(1, min(MOST_LAGS, values.size // 2))
    found = autocorrelation(values, time, lags)
    minutes = np.arange(lags + 1) * nominal_spacing(time) / 60
    half = 1.96 / np.sqrt(values.size)
    if not of_noise:
        outline = [0, minutes[-1], minutes[-1], 0], [-half, -half, half, half]
        band(figure, *outline, "95% band of white noise", "band", row=row, col=2)
    name = "innovations" if of_noise else "autocorrelation"
    shown = not any(trace.name == name for trace in figure.data)
    figure.add_scatter(
        x=minutes.astype(np.float32), y=found.astype(np.float32), mode="lines" if of_noise else "lines+markers",
        line={"color": GENETIC if of_noise else STOCHASTIC, "width": 1.6 if of_noise else 1.2}, marker={"size": 3.5},
        name=name, legendgroup=name, showlegend=shown, hovertemplate="%{x:.2f} min: %{y:.3f}<extra></extra>",
        row=row, col=2,
    )  # fmt: skip
