"""What the scores say, and what a run lacks."""

from __future__ import annotations

from collections.abc import Sequence

from ...calibration import LINEAR
from ...prediction import Metric
from ...scenario import is_trained
from ...words import listed, number, percent
from ..run_files import STAGES, RunFiles
from .finding import ORDER, Finding

EQUAL = 0.02
"""Errors that differ by no more than this share are called equal."""


def _value(metrics: Sequence[Metric], method: str, window: str, name: str) -> float | None:
    """A score of all channels."""
    wanted = (method, window, "all", name)
    return next((m.value for m in metrics if (m.method, m.window, m.channel, m.metric) == wanted), None)


def scores(run: RunFiles) -> list[Finding]:
    """Errors of the methods on each window that was not trained on."""
    scored = [m.window for m in run.metrics if not is_trained(m.window)]
    found = [_scores(run, window) for window in dict.fromkeys([*run.test_windows, *scored])]
    return found or [Finding("none", "No scores", "There is no prediction of unseen telemetry.")]


def _scores(run: RunFiles, window: str) -> Finding:
    genetic = _value(run.metrics, "genetic", window, "rmse")
    stochastic = _value(run.metrics, "stochastic", window, "rmse")
    if stochastic is None and genetic is None:
        return Finding("none", f"No scores on the window “{window}”", "There are none in metrics.json.")
    where = f"On unseen telemetry (window “{window}”)"
    if genetic is None or stochastic is None:
        method, value = ("stochastic update", stochastic) if genetic is None else ("genetic algorithm", genetic)
        title = f"{where} the {method} is {number(value, 3)} K off (RMSE)"
        state, words = "good", "There is no other method to compare."
    else:
        state, title, words = _against_genetic(run.metrics, window, genetic, stochastic)
        title = f"{where} {title}"
    interval = _interval(run, window)
    reliable, caveat = "good", ""
    if stochastic is not None and run.diagnostics is not None and not run.diagnostics["passed"]:
        only_heat = all(g["passed"] or g["name"] == LINEAR for g in run.diagnostics.get("gates", []))
        rests_on = "parameters that cannot be relied on" if only_heat else "chains that have not converged"
        reliable, caveat = "warn", f"All this rests on {rests_on}."
    worst = max((state, reliable), key=ORDER.index)
    return Finding(worst, title, f"{words} {interval} {caveat}".strip())  # type: ignore[arg-type]


def _against_genetic(metrics: Sequence[Metric], window: str, genetic: float, stochastic: float) -> tuple[str, str, str]:
    """State, title and words on the two methods' errors."""
    better = _compared(stochastic, genetic)
    ratio = f", ratio {number(stochastic / genetic, 3)} (0.753 in the paper)" if genetic else ""
    words = (
        f"RMSE over all channels: stochastic {number(stochastic, 3)} K, genetic algorithm {number(genetic, 3)} K "
        f"(mean of its runs, as published){ratio}."
    )
    mape = [_value(metrics, method, window, "mape_kelvin") for method in ("genetic", "stochastic")]
    if mape[0] and mape[1] is not None:
        words += f" MAPE of the temperature in kelvin: ratio {number(mape[1] / mape[0], 3)} (0.885 in the paper)."
    best = _value(metrics, "genetic_best", window, "rmse")
    if best is not None:
        compared = _compared(best, stochastic)
        words += f" The best single run of the genetic algorithm has {number(best, 3)} K, {compared} the stochastic."
    state = "warn" if better == "worse than" else "good"
    return state, f"the stochastic update is {better} the genetic algorithm's mean", words


def _compared(error: float, other: float) -> str:
    """One error in words against another."""
    if abs(error - other) <= EQUAL * other:
        return "about as good as"
    return "better than" if error < other else "worse than"


def _interval(run: RunFiles, window: str) -> str:
    """How much of the telemetry the interval holds, in words; `holding` judges it by channel."""
    coverage = _value(run.metrics, "stochastic", window, "picp")
    width = _value(run.metrics, "stochastic", window, "mpiw")
    if coverage is None:
        return ""
    attributes = run.windows[window].attrs if window in run.windows else {}
    words = (
        f"The {run.interval} holds {percent(coverage)} of the telemetry of all channels (PICP) and is "
        f"{number(width, 3)} K wide on average (MPIW)."
    )
    shares = {
        m.channel: m.value for m in run.metrics if (m.method, m.window, m.metric) == ("stochastic", window, "picp")
    }
    by_channel = sorted((share, name) for name, share in shares.items() if share is not None and name != "all")
    if by_channel:
        words += f" By channel it holds from {percent(by_channel[0][0])} ({by_channel[0][1]}) to "
        words += f"{percent(by_channel[-1][0])} ({by_channel[-1][1]})."
    if contains := attributes.get("interval_contains"):
        words += f" It contains {contains}."
    return words


def missing(run: RunFiles) -> list[Finding]:
    """Files that the run lacks."""
    if not run.missing:
        return []
    lacking = listed([f"{STAGES[name]} ({name})" for name in run.missing])
    return [Finding("warn", "The run is not complete", f"Not in the run directory: {lacking}.")]
