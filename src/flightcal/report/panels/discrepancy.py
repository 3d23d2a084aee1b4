"""What the simulator lacks, as far as it was modelled: numbers, size, and how far it stands in for parameters."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import plotly.graph_objects as go
import xarray as xr
from numpy.typing import NDArray

from ...words import interval, number, percent
from .. import block
from ..block import Block, section
from ..run_files import RunFiles, draws
from ..style import BAND, LINE, STOCHASTIC, TELEMETRY, band, finish, plots, polygons, small_titles, title_below
from ..tables import Cell, Table
from ..windows import names
from .parameters import contraction

STANDS_IN = -0.9
"""Correlation below which a discrepancy is said to stand in for a parameter: to know the one would more than halve the
other's standard deviation."""

APART = -0.5
"""Correlation above which a parameter and the discrepancy are said to be told apart."""

LEARNT = 0.2
"""Contraction below which telemetry is said to tell little of a parameter."""

ROW_HEIGHT = 200

Columns = list[NDArray[np.float64]]
"""Mean, lower and upper bound, and telemetry minus simulation, [T] each, K."""


@section("discrepancy", "Discrepancy")
def panel(run: RunFiles) -> list[Block]:
    """What the simulator lacks, as far as it was modelled."""
    windows = {name: window for name, window in run.windows.items() if "discrepancy_mean" in window}
    if not windows:
        return []
    name, window = next(iter(windows.items()))
    blocks = [
        block.text(
            "What the simulator lacks is calibrated with the parameters, as a Gaussian process for each channel. "
            "It is the same in every orbit, so it carries over to every window as it was learnt. It is added to the "
            "simulation in the mean and in the intervals."
        ),
        block.table(numbers(run), "Amplitudes and lengthscales are all fixed by the scenario."),
        block.figure(
            figure_discrepancy(window),
            f"Discrepancy over the orbit, from its start as the window “{name}” counts it: mean and interval of the "
            "posterior. Dots: telemetry minus the simulation alone, which is what the discrepancy has to explain.",
        ),
        block.text(
            "The interval is that of the discrepancy alone. Each draw's discrepancy makes up for its own simulation, "
            "so their sum, the prediction, is known better than either."
        ),
        block.table(sizes(windows)),
        block.heading("How far it can stand in for a parameter"),
    ]
    if run.posterior is None or "discrepancy" not in run.posterior.children:
        why = "It was not determined: there are several training windows, or no posterior (posterior.nc)."
        return [*blocks, block.note(why)]
    return [
        *blocks,
        block.text(
            "Correlation over the posterior's draws of a parameter with how much of the discrepancy lies in the "
            "direction in which that parameter moves the temperatures. Near −1 what the one gives, the other takes: "
            "the parameter's value then rests on the prior of the discrepancy. Near 0 the telemetry tells the two "
            "apart, or, where the contraction is small, nothing about the parameter at all."
        ),
        block.table(confounded(run)),
    ]


def numbers(run: RunFiles) -> Table:
    """Amplitudes and lengthscales, prior and posterior, one row each: K and orbits."""
    rows = []
    sampled = {info.name for info in run.sampled}
    for info in (i for i in run.parameters if i.kind == "discrepancy"):
        _, _, what, *channel = info.name.split(".", 3)
        low, median, high = info.prior_quantiles
        posterior = "–"
        if info.name in sampled and run.posterior is not None:
            q = np.quantile(draws(run.posterior, "posterior", [info.name]), [0.025, 0.5, 0.975])
            posterior = interval(q[1], q[0], q[2])
        rows.append(
            [channel[0] if channel else "all together", f"{what}, {info.unit}", interval(median, low, high), posterior]
        )
    return Table(("channel", "quantity", "prior, median [95%]", "posterior, median [95%]"), rows, (2, 3))


def sizes(windows: Mapping[str, xr.Dataset]) -> Table:
    """How large the discrepancy is in each window, by channel."""
    rows = []
    for name, window in windows.items():
        for channel in _discrepant(window):
            dataset = window.sel(channel=channel)
            mean, width = dataset["discrepancy_mean"], dataset["discrepancy_upper"] - dataset["discrepancy_lower"]
            residual = (dataset["observed"] - dataset["mean"].sel({"by": "stochastic"})).where(
                dataset["scored"].astype(bool)
            )
            rows.append(
                [name, channel, number(_rms(mean), 3), number(float(np.abs(mean).max()), 3),
                 number(float(width.mean()), 3), number(_rms(residual + mean), 3), number(_rms(residual), 3)]
            )  # fmt: skip
    header = ("window", "channel", "mean's RMS", "largest", "95% band, mean width", "without it", "with it")
    return Table(header, rows, range(2, 7), groups=(("", 2), ("discrepancy, K", 3), ("RMS of residuals, K", 2)))


def _rms(values: xr.DataArray) -> float:
    return float(np.sqrt(np.square(values).mean()))


def confounded(run: RunFiles) -> Table:
    """How far the discrepancy can stand in for each parameter, the worst first."""
    rows = []
    for name, correlation in stand_ins(run).items():
        narrowed = contraction(run, name)
        if correlation <= STANDS_IN:
            words: str = Cell("the telemetry tells the sum of the two, not the parameter", "warn")
        elif correlation <= APART:
            words = "the two are told apart in part"
        elif narrowed is not None and narrowed < LEARNT:
            words = "the telemetry tells little of the parameter"
        else:
            words = Cell("the two are told apart", "good")
        rows.append([name, number(correlation, 2), percent(narrowed, 0), words])
    header = ("parameter", "correlation", "contraction", "in words")
    return Table(header, rows, (1, 2))


def stand_ins(run: RunFiles) -> dict[str, float]:
    """Correlation of each parameter with the discrepancy along its effect, the worst (most negative) first."""
    if run.posterior is None or "discrepancy" not in run.posterior.children:
        return {}
    found = run.posterior["discrepancy"].to_dataset()["correlation"]
    pairs = zip(found["parameter"].values, found.values, strict=True)
    return dict(sorted(((str(n), float(v)) for n, v in pairs if np.isfinite(v)), key=lambda pair: pair[1]))


def figure_discrepancy(prediction: xr.Dataset) -> go.Figure:
    """Discrepancy over the orbit, two channels in a row. prediction: a group of prediction.nc."""
    channels = _discrepant(prediction)
    columns = min(2, len(channels))
    figure, height = plots([c.replace("_", " ") for c in channels], columns, ROW_HEIGHT, horizontal_spacing=0.1)
    phase = np.mod(prediction["orbit_phase"].values, 1.0)
    order = np.argsort(phase)
    for k, channel in enumerate(channels):
        found = [values[order] for values in _columns(prediction, channel)]
        _draw(figure, phase[order], found, k // columns + 1, k % columns + 1)
        figure.update_yaxes(title_text="discrepancy, K", nticks=6, row=k // columns + 1, col=k % columns + 1)
    finish(figure, height)
    small_titles(figure)
    figure.update_xaxes(range=[0, 1], nticks=6)
    title_below(figure, "orbit phase, orbits", len(channels), columns)
    return figure


def _discrepant(prediction: xr.Dataset) -> list[str]:
    """Channels that have a discrepancy."""
    found = prediction["discrepant"].values
    return [name for name, discrepant in zip(names(prediction, "channel"), found, strict=True) if discrepant]


def _columns(prediction: xr.Dataset, channel: str) -> Columns:
    dataset = prediction.sel(channel=channel)
    mean, lower, upper = (dataset[f"discrepancy_{name}"].values for name in ("mean", "lower", "upper"))
    return [mean, lower, upper, (dataset["observed"] - dataset["mean"].sel({"by": "stochastic"})).values + mean]


def _draw(figure: go.Figure, x: NDArray, found: Columns, row: int, column: int) -> None:
    mean, lower, upper, missing = found
    place = {"row": row, "col": column}
    first = not figure.data
    figure.add_scatter(
        x=x, y=missing.astype(np.float32), mode="markers", marker={"size": 3, "color": TELEMETRY, "opacity": 0.45},
        name="telemetry − simulation", legendgroup="missing", showlegend=first, hovertemplate="%{y:.2f} K", **place,
    )  # fmt: skip
    outline, bounds = polygons(x, lower, upper)
    band(figure, outline, bounds.astype(np.float32), "interval", "interval", BAND, **place)
    figure.add_scatter(
        x=x, y=mean.astype(np.float32), mode="lines", line={"color": STOCHASTIC, "width": 1.8},
        name="discrepancy, mean", legendgroup="mean", showlegend=first, hovertemplate="%{y:.2f} K", **place,
    )  # fmt: skip
    figure.add_hline(y=0.0, line={"color": LINE, "width": 1}, **place)
