"""The page of `flightcal backtest`: did intervals hold, and how good are predictions by how far ahead they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import plotly.graph_objects as go
import xarray as xr

from ..errors import RunError
from ..prediction import HELD
from ..run import read_tree, write_text
from ..validation import ALL, ahead
from ..words import count, duration, listed, minute, number, percent
from . import block
from .block import Block, Section
from .findings import Finding
from .page import compose
from .run_files import Record, read_content
from .style import (
    BAND,
    LINE,
    STOCHASTIC,
    TELEMETRY,
    TEXT,
    WARNING,
    band,
    chain_colour,
    finish,
    plots,
    polygons,
    small_titles,
)
from .tables import Cell, Table
from .thinning import extremes, followed
from .windows import broken, column, names

MOST_COLUMNS = 5
ROW_HEIGHT = 150
_POINTS = 24_000
"""Of all plots together, about, so that the page stays small."""
_NARROW = 18
"""Letters of a channel's name in a line of an axis."""


def write_backtest(folder: Path, output: Path | None = None) -> Path:
    """Writes report.html from backtest.json and backtest.nc in `folder`.

    Raises RunError where these are not there, or were made by an earlier version.
    """
    content = read_content(folder, "backtest")
    if not all("why" in origin for origin in content["origins"]):
        raise RunError(
            f"{folder / 'backtest.json'}: found no `why`, expected what this version writes: run `flightcal backtest` "
            "into this folder again, which keeps what is calibrated"
        )
    tree = read_tree(folder / "backtest.nc")
    predictions = {origin["name"]: tree[origin["name"]].to_dataset() for origin in content["origins"]}
    output = output or folder / "report.html"
    sections = [
        Section("hold", "Did intervals hold tomorrow?", _hold(content, predictions)),
        Section("horizon", "By horizon", _horizon(content)),
        *([Section("heaters", "Heaters", _heaters(content))] if content["duty"] else []),
        Section("scores", "Scores", _scores(content)),
    ]
    write_text(output, compose("flightcal backtest", content["name"], folder, "", findings(content), sections))
    return output


# --- the verdict --------------------------------------------------------------------------------------------


def first_tables(content: Record) -> list[Table]:
    """Scores by horizon, of all origins and channels; none where no sample is scored."""
    return [_by_horizon(content)] if _seen(content) else []


def findings(content: Record) -> list[Finding]:
    """Whether intervals held, whether these are forecasts, and what stands in doubt."""
    found = [_held(content), _inputs(content)]
    failed = [origin for origin in content["origins"] if not origin["passed"]]
    if failed:
        details = tuple(f"{minute(failure['origin'])}: {failure['failed_gates']}" for failure in failed)
        title = f"The sampling failed a gate before {len(failed)} of {len(content['origins'])} origins"
        found.append(Finding("warn", title, "Scores of these origins stand among the others.", details))
    bent = [origin for origin in content["origins"] if origin["passed"] and origin["failed_gates"]]
    if bent:
        title = f"The response to heat is not linear before {len(bent)} of {len(content['origins'])} origins"
        text = "Take no parameters from these. What is predicted is simulated with its heat, and judged all the same."
        found.append(Finding("warn", title, text, tuple(minute(bend["origin"]) for bend in bent)))
    if content["skipped"]:
        text = "The telemetry there does not carry a training and an orbit after it."
        found.append(Finding("warn", "No origin in parts of the telemetry", text, tuple(content["skipped"])))
    return found


def _held(content: Record) -> Finding:
    origins, worst = content["origins"], content["worst"]
    title = f"Intervals held after {content['held']} of {len(origins)} origins"
    if not worst:
        return Finding("none", title, "No sample after an origin is scored.")
    whole = _record(content, ALL, ALL, ALL)
    share = percent(content["interval"], 0)
    least = f"of a right prediction {percent(worst['lower'])} or more"
    text = (
        f"Worst: {worst['channel']} after {minute(worst['time'])}, with {percent(worst['coverage'])} of "
        f"its telemetry inside the {share} interval, {worst['why'] or least}. All "
        f"together: {percent(whole['coverage'])} ± {percent(whole['coverage_error'])} inside, RMSE "
        f"{number(whole['rmse'], 3)} K, CRPS {number(whole['crps'], 3)} K, interval {number(whole['width'], 3)} K wide."
    )
    details = [
        f"{minute(origin['origin'])}: {listed(_below(origin, content['channels']))}."
        for origin in origins
        if not origin["holds"]
    ]
    wide = sorted({name for origin in origins for name in origin["too_wide"]})
    if wide:
        details.append(f"Wider than need be: {listed(wide)}.")
    if duty := content["duty"]:
        details.append(f"Duty cycles inside their interval: {sum(row['hit'] for row in duty)} of {len(duty)}.")
    return Finding("good" if content["holds"] else "bad", title, text, tuple(details))


def _below(record: Record, channels: list[str]) -> list[str]:
    """Channels whose intervals did not hold after an origin, with what does not."""
    found = zip(channels, record["coverage"], record["why"], strict=True)
    return [f"{channel} {percent(share)}, {why}" for channel, share, why in found if why]


def _inputs(content: Record) -> Finding:
    if not content["measured"]:
        text = "Orbit, attitude and timeline are all that drives the simulator after an origin."
        return Finding("good", "A plan drives the predictions: they are forecasts", text)
    text = (
        f"After an origin too the simulator is driven by measured channels: {listed(content['measured'])}. A forecast "
        "would have to plan these. No temperature is used after an origin but as such a driver, and for its first "
        "minutes, which are not scored."
    )
    return Finding("warn", "Measured drivers: these predictions are not forecasts", text)


# --- did intervals hold -------------------------------------------------------------------------------------


def _hold(content: Record, predictions: dict[str, xr.Dataset]) -> list[Block]:
    share, period = percent(content["interval"], 0), content["period"]
    drawn = f"{share} interval (blue) and telemetry (dots; red: outside of the interval) since the origin"
    rows = "A row is a channel, a column an origin."
    origins = content["origins"]
    groups = [origins[first : first + MOST_COLUMNS] for first in range(0, len(origins), MOST_COLUMNS)]
    less = [figure_hold(shown, predictions, period, less_mean=True) for shown in groups]
    whole = [figure_hold(shown, predictions, period) for shown in groups]
    return [
        block.text(
            f"Before each origin {number(content['train'] / period, 3)} orbits are trained on. After it nothing but "
            "the first minutes, which are not scored, is known of the temperatures. A plot's title is the share of "
            "telemetry inside the interval. It did not hold where that share is below the band of telemetry drawn "
            f"from the prediction itself, in which {percent(HELD, 0)} of right predictions have all their channels, or "
            "errors are larger than theirs."
        ),
        *(block.figure(figure, f"{drawn}, both less the predicted mean. {rows}", wide=True) for figure in less),
        block.table(_origins(content)),
        block.heading("The temperatures themselves"),
        *(block.figure(figure, f"{drawn}. {rows}", wide=True) for figure in whole),
    ]


def figure_hold(
    origins: list[Record], predictions: dict[str, xr.Dataset], period: float, *, less_mean: bool = False
) -> go.Figure:
    """Interval and telemetry over the time since the origin: a row for each channel, a column for each origin.

    origins: their records of backtest.json; predictions: groups of backtest.nc by origin; period: of the orbit, s.
    less_mean: draw both less the predicted mean, which shows a narrow interval of a temperature that swings widely.
    """
    channels = names(predictions[origins[0]["name"]], "channel")
    columns = len(origins)
    titles = [_title(origin, k) for k in range(len(channels)) for origin in origins]
    figure, height = plots(titles, columns, ROW_HEIGHT, gap=34, horizontal_spacing=0.12 / columns, shared_yaxes=True)
    bins = int(np.clip(_POINTS // (8 * len(titles)), 25, 200))
    for c, origin in enumerate(origins):
        for r, channel in enumerate(channels):
            place = {"row": r + 1, "col": c + 1}
            _draw(figure, predictions[origin["name"]], channel, period, bins, less_mean, place)
        figure.update_xaxes(showticklabels=False, col=c + 1)
        figure.update_xaxes(
            title_text="orbits since the origin", title_font_size=11, showticklabels=True, row=len(channels), col=c + 1
        )
        figure.add_annotation(
            text=f"<b>{minute(origin['origin'])}</b>", x=0.5, xref=f"x{c + 1 if c else ''} domain", y=1, yref="paper",
            yanchor="bottom", yshift=20, showarrow=False, font={"size": 12, "color": TEXT},
        )  # fmt: skip
    for r, channel in enumerate(channels):
        figure.update_yaxes(
            title_text=f"{_broken(channel)}, {'K' if less_mean else '°C'}",
            title_font_size=11,
            nticks=5,
            row=r + 1,
            col=1,
        )
    finish(figure, height + 20, top=50)
    figure.update_layout(legend={"y": 1 + 44 / (height - 100), "itemsizing": "constant"})
    figure.update_annotations(font_size=11)
    return figure


def _title(record: Record, k: int) -> str:
    """Of one plot: the coverage, and where it did not hold why."""
    share, why = percent(record["coverage"][k]), record["why"][k]
    return f'<b><span style="color:{WARNING}">✕ {share}, {why}</span></b>' if why else share


def _draw(
    figure: go.Figure,
    prediction: xr.Dataset,
    channel: str,
    period: float,
    bins: int,
    less_mean: bool,
    place: dict[str, int],
) -> None:
    time, orbits = prediction["time"].values, ahead(prediction) / period
    mean, lower, upper = (column(prediction, name, channel, "stochastic") for name in ("mean", "lower", "upper"))
    observed = column(prediction, "observed", channel)
    if less_mean:
        mean, lower, upper, observed = (values - mean for values in (mean, lower, upper, observed))
    shown = "%{y:.2f} K" if less_mean else "%{y:.2f} °C"
    drawn, (x, middle, low, high) = broken(
        prediction, followed(time, [mean, lower, upper], 6 * bins), [orbits, mean, lower, upper]
    )
    # A break has no orbit count of its own.
    x = np.where(np.isfinite(x), x, np.interp(drawn.astype(float), time.astype(float), orbits))
    outline = polygons(x, low, high)
    band(figure, outline[0], outline[1].astype(np.float32), "interval", "interval", BAND, **place)
    figure.add_scatter(
        x=x, y=middle.astype(np.float32), mode="lines", line={"color": STOCHASTIC, "width": 1.2}, name="prediction",
        legendgroup="prediction", showlegend=place == {"row": 1, "col": 1}, hovertemplate=shown, **place,
    )  # fmt: skip
    scored = prediction["scored"].values.astype(bool) & np.isfinite(observed)
    outside = scored & ((observed < lower) | (observed > upper))
    for name, part, colour in (
        ("telemetry", scored & ~outside, TELEMETRY),
        ("telemetry outside of the interval", outside, WARNING),
    ):
        chosen = np.flatnonzero(part)
        if chosen.size:
            chosen = chosen[extremes([observed[chosen]], 2 * bins)]
        group = {"name": name, "legendgroup": name, "showlegend": not any(t.legendgroup == name for t in figure.data)}
        figure.add_scatter(
            x=orbits[chosen], y=observed[chosen].astype(np.float32), mode="markers", hovertemplate=shown,
            marker={"color": colour, "size": 2.6}, **group, **place,
        )  # fmt: skip


def _origins(content: Record) -> Table:
    rows = [
        [
            minute(origin["origin"]),
            minute(origin["predicted_to"]),
            Cell("✓ held", "good") if origin["holds"] else Cell("✕ did not hold", "bad"),
            origin["worst"] or "–",
            *_range(origin),
            number(_record(content, origin["name"], ALL, ALL)["crps"], 3),
            "yes" if origin["passed"] else Cell("no", "warn"),
            duration(origin["seconds"]),
        ]
        for origin in content["origins"]
    ]
    header = ("origin, UTC", "predicted to", "intervals", "worst channel", "its coverage", "its band", "CRPS, K",
              "converged", "took")  # fmt: skip
    return Table(header, rows, (4, 5, 6, 8))


def _range(record: Record) -> tuple[str, str]:
    """Coverage of an origin's worst channel, and its band."""
    k = record["worst_place"]
    if k < 0:
        return "–", "–"
    return percent(record["coverage"][k]), f"{percent(record['lower'][k])} to {percent(record['upper'][k])}"


# --- by horizon ---------------------------------------------------------------------------------------------


def _seen(content: Record) -> list[str]:
    """Bands of the horizon in which any sample is scored."""
    return [band for band in content["bands"] if _record(content, ALL, ALL, band)["samples"]]


def _by_horizon(content: Record) -> Table:
    rows = [_row(content, ALL, ALL, band, band) for band in [*_seen(content), ALL]]
    return Table(("horizon, all channels", *_SCORES), rows, range(1, len(_SCORES) + 1))


def _horizon(content: Record) -> list[Block]:
    if not (seen := _seen(content)):
        return [block.note("No sample after an origin is scored.")]
    caption = (
        "All origins together. Left: share of the telemetry inside the interval, with its standard error; dotted: the "
        "interval's probability. Right: CRPS, which is lower the better and the sharper a prediction is."
    )
    of_channels = [_row(content, ALL, c, band, f"{c}, {band}") for c in content["channels"] for band in seen]
    return [
        block.figure(figure_horizon(content, seen), caption, wide=True),
        block.table(_by_horizon(content)),
        block.folded(
            "By channel and horizon", Table(("channel, horizon", *_SCORES), of_channels, range(1, len(_SCORES) + 1))
        ),
        block.text(
            "± is the standard error of a coverage, of as many samples as are effective: by the residuals' "
            "autocorrelation with Geyer's initial monotone sequence (1992), by Agresti and Coull's formula (1998). "
            "Origins whose predictions share telemetry are not independent, so errors of all origins together are "
            "larger than they say."
        ),
    ]


def figure_horizon(content: Record, bands: list[str]) -> go.Figure:
    """Coverage and CRPS of each channel by band of the horizon, of all origins together."""
    figure, height = plots(["coverage", "CRPS"], 2, 260, horizontal_spacing=0.09)
    channels = content["channels"]
    for c, channel in enumerate(channels):
        records = [_record(content, ALL, channel, name) for name in bands]
        x = np.arange(len(bands)) + (c - (len(channels) - 1) / 2) * 0.5 / max(len(channels), 4)
        for col, key in enumerate(("coverage", "crps"), start=1):
            factor = 100 if key == "coverage" else 1
            error = {
                "type": "data",
                "array": [100 * _value(record["coverage_error"]) for record in records],
                "width": 2,
            }
            figure.add_scatter(
                x=x, y=[factor * _value(record[key]) for record in records], mode="lines+markers",
                line={"color": chain_colour(c), "width": 1.2}, marker={"size": 5}, name=channel.replace("_", " "),
                legendgroup=channel, showlegend=col == 1, error_y=error | {"thickness": 1} if col == 1 else None,
                hovertemplate="%{y:.3g}", row=1, col=col,
            )  # fmt: skip
    figure.add_hline(y=100 * content["interval"], line={"color": LINE, "width": 1, "dash": "dot"}, row=1, col=1)
    figure.update_xaxes(tickvals=list(range(len(bands))), ticktext=bands, range=[-0.5, len(bands) - 0.5])
    figure.update_yaxes(title_text="inside the interval, %", row=1, col=1)
    figure.update_yaxes(title_text="CRPS, K", rangemode="tozero", row=1, col=2)
    finish(figure, height)
    small_titles(figure)
    return figure


# --- tables -------------------------------------------------------------------------------------------------

_SCORES = ("coverage", "samples (effective)", "RMSE, K", "bias, K", "interval, K", "CRPS, K")


def _scores(content: Record) -> list[Block]:
    numbers = range(1, len(_SCORES) + 1)
    rows = [_row(content, ALL, channel, ALL, channel) for channel in [*content["channels"], ALL]]
    by_origin = [
        _row(content, origin["name"], channel, ALL, f"{minute(origin['origin'])}, {channel}")
        for origin in content["origins"]
        for channel in [*content["channels"], ALL]
    ]
    return [
        block.table(Table(("channel, all origins", *_SCORES), rows, numbers)),
        block.folded("By origin and channel", Table(("origin, channel", *_SCORES), by_origin, numbers)),
        block.text(
            "Bias: prediction minus telemetry. CRPS judges the whole predicted distribution, width and all: rank "
            "models by it. backtest.json has the same by origin, channel and horizon."
        ),
    ]


def _row(content: Record, origin: str, channel: str, band: str, title: str) -> list[str]:
    record = _record(content, origin, channel, band)
    if not record["samples"]:
        return [title, *("–" for _ in _SCORES)]
    return [
        title,
        f"{percent(record['coverage'])} ± {percent(record['coverage_error'])}",
        f"{count(record['samples'])} ({count(record['effective'])})",
        number(record["rmse"], 3),
        number(record["bias"], 2),
        number(record["width"], 3),
        number(record["crps"], 3),
    ]


def _heaters(content: Record) -> list[Block]:
    hits = sum(duty["hit"] for duty in content["duty"])
    moments = {origin["name"]: minute(origin["origin"]) for origin in content["origins"]}
    rows = [
        [
            moments[duty["origin"]], duty["heater"], percent(duty["measured"]), percent(duty["mean"]),
            f"{percent(duty['lower'])} to {percent(duty['upper'])}",
            Cell("✓ inside", "good") if duty["hit"] else Cell("✕ outside", "bad"),
        ]
        for duty in content["duty"]
    ]  # fmt: skip
    share = percent(content["interval"], 0)
    header = ("origin, UTC", "heater", "duty measured", "predicted, mean", f"{share} interval", "measured duty")
    return [
        block.text(
            f"The {share} interval of the duty cycle has {count(hits)} of {count(len(rows))} measured ones, each over "
            "the whole prediction. What is measured is the share of the status samples, which errs too where a heater "
            "switches often between samples or the status has gaps."
        ),
        block.table(Table(header, rows, (2, 3, 4))),
    ]


def _record(content: Record, origin: str, channel: str, band: str) -> Record:
    wanted = (origin, channel, band)
    return next(score for score in content["scores"] if (score["origin"], score["channel"], score["band"]) == wanted)


def _value(value: float | None) -> float:
    return float("nan") if value is None else value


def _broken(channel: str) -> str:
    """A channel's name in lines that fit beside a plot."""
    lines = [""]
    for word in channel.replace("_", " ").split():
        if lines[-1] and len(lines[-1]) + len(word) >= _NARROW:
            lines.append("")
        lines[-1] = f"{lines[-1]} {word}".strip()
    return "<br>".join(lines)
