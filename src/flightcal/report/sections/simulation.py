"""Telemetry beside what was simulated: scores, before calibration, and after it by both methods."""

from __future__ import annotations

import xarray as xr

from flightcal.scenario import is_trained

from .. import block, tables
from .. import figures as draw
from ..block import Block
from ..run_files import RunFiles, bins, has_prediction


def scores(run: RunFiles) -> list[Block]:
    """Scores of the two methods, side by side and in full."""
    if not run.metrics:
        return [block.note("There are no scores in this run (metrics.json).")]
    return [
        block.text(
            "Genetic algorithm (GA, mean of its runs as published) against the stochastic update (posterior mean), "
            "over all channels. A ratio below one (↓) says that the stochastic one is better. The paper's ratios are "
            "0.1014/0.1346 = 0.753 for RMSE and 0.054/0.061 = 0.885 for MAPE; its temperatures are masked, so that "
            "only ratios compare. A mean of runs can leave the ridge of good fits, so the best run stands beside it."
        ),
        block.table(tables.comparison(run.metrics), "There is no pair of methods to compare."),
        Block("heading", "By window and channel"),
        block.table(tables.scores(run.metrics)),
        Block("folded", "Every score of every method", table=tables.all_scores(run.metrics)),
        block.text(
            "Only samples that were not used for the initial state count. PICP: share of telemetry inside the 95% "
            "interval; MPIW: mean width of that interval; CRPS: continuous ranked probability score, for a point "
            "method its mean absolute error. MAPE in °C is undefined (–) where telemetry comes within 1 °C of 0 °C."
        ),
    ]


def before(run: RunFiles) -> list[Block]:
    """Figures 1 to 3: before calibration."""
    if not run.windows:
        return [block.note("There is no prediction in this run (prediction.nc): figures 1 to 4 and 6 are missing.")]
    name, window = next(iter(run.windows.items()))
    blocks = []
    for figure, method, words in (
        (1, "uncalibrated", "Uncalibrated: every parameter at its prior's median"),
        (2, "poorly_calibrated", "Poorly calibrated: best of the genetic algorithm's first generation"),
    ):
        if has_prediction(window, method):
            caption = f"Figure {figure}. {words}, against telemetry of the window “{name}”."
            if "eclipse" in window and (window["eclipse"] < 0.5).any():
                caption += " Eclipses are shaded."
            if figure == 1 and window.sizes["time"] > 6 * bins(run):
                caption += " Of a long series like this one, every figure shows the extremes of each stretch."
            blocks.append(block.figure(draw.figure_point(window, [method], bins(run)), caption))
        else:
            blocks.append(block.note(f"Figure {figure}: the prediction has no method “{method}”."))
    methods = [m for m in ("uncalibrated", "poorly_calibrated") if has_prediction(window, m)]
    if window.sizes.get("heater", 0) and methods:
        caption = f"Figure 3. Heater status of both against telemetry (grey area: on) in the window “{name}”."
        blocks.append(block.figure(draw.figure_heater_status(window, methods, bins(run)), caption))
    else:
        why = "neither was simulated" if window.sizes.get("heater", 0) else "the scenario has no heaters"
        blocks.append(block.note(f"Figure 3: {why}."))
    return blocks


def genetic(run: RunFiles) -> list[Block]:
    """Figure 4: the genetic algorithm."""
    windows = run.test_windows or run.windows
    blocks = [
        block.figure(
            draw.figure_point(window, [m for m in ("genetic", "genetic_best") if has_prediction(window, m)], bins(run)),
            f"Figure 4{_letter(i, windows)}. Genetic algorithm (solid: mean of its runs, as published; dotted: best "
            f"run) against telemetry of the window “{name}”.",
        )
        for i, (name, window) in enumerate(windows.items())
        if has_prediction(window, "genetic") or has_prediction(window, "genetic_best")
    ]
    return blocks or [block.note("Figure 4: there is no prediction by the genetic algorithm in this run.")]


def _letter(index: int, items: dict[str, xr.Dataset]) -> str:
    return chr(ord("a") + index % 26) if len(items) > 1 else ""


def prediction(run: RunFiles) -> list[Block]:
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
            f"Figure 6{_letter(i, order)}. Mean and interval of the posterior's prediction against telemetry of the "
            f"window “{name}”{beneath}. {' '.join(attributes)}"
        )
        blocks.append(block.figure(draw.figure_stochastic(window, bins(run)), caption))
    return blocks or [block.note("Figure 6: there is no stochastic prediction in this run.")]
