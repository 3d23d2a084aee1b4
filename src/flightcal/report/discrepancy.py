"""What the report says of a discrepancy: its numbers, its size, and how far it stands in for parameters."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr

from .run_files import ParameterInfo, RunFiles, draws
from .tables import Table, interval
from .text import number, percent
from .verdict import STANDS_IN, stand_ins

APART = -0.5
"""Correlation above which a parameter and the discrepancy are said to be told apart."""

LEARNT = 0.2
"""Contraction below which telemetry is said to tell little of a parameter."""


def parts(windows: Mapping[str, xr.Dataset]) -> str:
    """`time`, `phase` or `time and phase`: what the discrepancy is made of; nothing where there is none."""
    found = [str(part) for window in windows.values() if "discrepant" in window for part in window["discrepant"].values]
    return next((part for part in found if part), "")


def carries_over(part: str) -> str:
    """In words, what of a discrepancy another window has of it."""
    words = {
        "phase": (
            "Its part in orbit phase is the same in every orbit, so it carries over to every window as it was learnt. "
        ),
        "time": (
            "Its part in time belongs to the stretch that it was learnt from: on another window it is continued from "
            "the nearer edge of that stretch and fades within a few lengthscales to its prior, a mean of zero with the "
            "width of its amplitude. "
        ),
    }
    return "".join(text for name, text in words.items() if name in part).strip()


def numbers(run: RunFiles) -> Table:
    """Amplitudes and lengthscales, prior and posterior, one row each: K, min and orbits."""
    rows = []
    available = run.posterior["posterior"].to_dataset().data_vars if run.posterior is not None else {}
    for info in (i for i in run.parameters if i.kind == "discrepancy"):
        _, part, what, *channel = info.name.split(".", 3)
        factor, unit = _scale(info)
        low, median, high = (factor * value for value in info.prior_quantiles)
        posterior = "–"
        if info.name in available and run.posterior is not None:
            q = factor * np.quantile(draws(run.posterior, "posterior", [info.name]), [0.025, 0.5, 0.975])
            posterior = interval(q[1], q[0], q[2])
        rows.append(
            [{"phase": "orbit phase"}.get(part, part), channel[0] if channel else "all together", f"{what}, {unit}",
             interval(median, low, high), posterior]
        )  # fmt: skip
    return Table(("in", "channel", "quantity", "prior, median [95%]", "posterior, median [95%]"), rows, (3, 4))


def _scale(info: ParameterInfo) -> tuple[float, str]:
    """What to multiply a number with to have it in a reader's unit, and that unit."""
    return (1.0 / 60.0, "min") if info.unit == "s" else (1.0, info.unit)


def sizes(windows: Mapping[str, xr.Dataset]) -> Table:
    """How large the discrepancy is in each window, by channel."""
    rows = []
    for name, window in windows.items():
        for channel, part in zip(window["channel"].values, window["discrepant"].values, strict=True):
            if not part:
                continue
            own = window.sel(channel=channel)
            mean, width = own["discrepancy_mean"], own["discrepancy_upper"] - own["discrepancy_lower"]
            residual = (own["observed"] - own["mean"].sel({"method": "stochastic"})).where(own["scored"].astype(bool))
            rows.append(
                [name, str(channel), number(_rms(mean), 3), number(float(np.abs(mean).max()), 3),
                 number(float(width.mean()), 3), number(_rms(residual + mean), 3), number(_rms(residual), 3)]
            )  # fmt: skip
    header = ("window", "channel", "mean's RMS", "largest", "95% band, mean width", "without it", "with it")
    return Table(header, rows, range(2, 7), groups=(("", 2), ("discrepancy, K", 3), ("RMS of residuals, K", 2)))


def _rms(values: xr.DataArray) -> float:
    return float(np.sqrt(np.square(values).mean()))


def confounded(run: RunFiles) -> Table:
    """How far the discrepancy can stand in for each parameter, the worst first."""
    rows: list[list[str]] = []
    states: dict[tuple[int, int], str] = {}
    for name, correlation in stand_ins(run).items():
        contraction = _contraction(run, name)
        if correlation <= STANDS_IN:
            words, states[len(rows), 3] = "the telemetry tells the sum of the two, not the parameter", "warn"
        elif correlation <= APART:
            words = "the two are told apart in part"
        elif contraction is not None and contraction < LEARNT:
            words = "the telemetry tells little of the parameter"
        else:
            words, states[len(rows), 3] = "the two are told apart", "good"
        rows.append([name, number(correlation, 2), percent(contraction, 0), words])
    header = ("parameter", "correlation", "contraction", "in words")
    return Table(header, rows, (1, 2), states=states)


def _contraction(run: RunFiles, name: str) -> float | None:
    """1 - sd of posterior / sd of prior; None without a prior."""
    if run.posterior is None or "prior" not in run.posterior.children or name not in run.posterior["prior"]:
        return None
    prior, posterior = (draws(run.posterior, group, [name]).std() for group in ("prior", "posterior"))
    return 1.0 - float(posterior / prior) if prior > 0 else None


def window_values(run: RunFiles) -> Table:
    """What the parameters that drift are in each training window, beside the common value."""
    if run.posterior is None or "windows" not in run.posterior.children:
        return Table((), [])
    values = run.posterior["windows"].to_dataset()
    infos = [i for i in run.parameters if i.name in values]
    labels = [str(label) for label in values["window"].values]
    rows = []
    for info in infos:
        common = draws(run.posterior, "posterior", [info.name])
        own = values[info.name].transpose("window", "chain", "draw").values
        cells = [
            interval(*(float(q) + info.offset for q in np.quantile(part, [0.5, 0.025, 0.975])))
            for part in (common, *own)
        ]
        rows.append([f"{info.name}, {info.unit}" if info.unit else info.name, *cells])
    header = ("parameter, unit", "common, median [95%]", *(f"in “{label}”" for label in labels))
    return Table(header, rows, range(1, 2 + len(labels)))
