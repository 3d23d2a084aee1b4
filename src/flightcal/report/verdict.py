"""The report's first section: what the run says, in words, and how far it can be trusted."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..prediction import Metric
from ..probability import INDEPENDENT
from ..scenario import is_trained
from .panels.discrepancy import STANDS_IN, stand_ins
from .panels.heat import IMPLAUSIBLE, LARGE, gains, node_heats
from .panels.parameters import EDGE, WIDER, at_edge, shortened, widened
from .panels.residuals import TESTED, THERMOSTATS, assumption, channels, correlation_expected, noises, thermostats
from .run_files import STAGES, Record, RunFiles
from .text import listed, number, percent, shown

State = Literal["good", "warn", "bad", "none"]

EQUAL = 0.02
"""Errors that differ by no more than this share are called equal."""

LINEAR = "response to heat"
"""The gate that judges how heat was taken into account, not the chains."""

COVERAGE = 0.03
"""A coverage this near to the nominal one is called right."""


@dataclass(frozen=True)
class Finding:
    """One statement of the verdict. `state` gives its colour and, in words, its mark."""

    state: State
    title: str
    text: str
    details: tuple[str, ...] = ()

    @property
    def mark(self) -> str:
        """The state as a sign and a word, so that it does not rest on colour."""
        return {"good": "✓ good", "warn": "! caution", "bad": "✕ problem", "none": "– not in this run"}[self.state]


def verdict(run: RunFiles) -> list[Finding]:
    """All findings of a run, the most basic ones first."""
    scored = [m.window for m in run.metrics if not is_trained(m.window)]
    scores = [_scores(run, window) for window in dict.fromkeys([*run.test_windows, *scored])]
    return [
        *_interrupted(run),
        _convergence(run.diagnostics),
        *_explanations(run),
        *(scores or [_no_scores(run)]),
        _noise(run),
        *_heat(run),
        *_heaters(run),
        _edges(run),
        *_stand_in(run),
        *_missing(run),
    ]


def _interrupted(run: RunFiles) -> list[Finding]:
    if run.posterior is None or str(run.posterior.attrs.get("interrupted", "false")).lower() != "true":
        return []
    sizes = run.posterior["posterior"].to_dataset().sizes
    kept = f"{sizes.get('draw', 0)} draws of each of {sizes.get('chain', 0)} chains"
    return [Finding("bad", "The run was interrupted", f"Sampling was stopped early; all that follows rests on {kept}.")]


def _convergence(diagnostics: Record | None) -> Finding:
    if diagnostics is None:
        return Finding("none", "Convergence is not known", "There is no diagnosis of the chains (diagnostics.json).")
    gates = diagnostics.get("gates", [])
    failed = [g for g in gates if not g["passed"]]
    words = str(diagnostics.get("verdict") or "")
    if diagnostics["passed"]:
        # Other findings judge the model.
        words = words.removesuffix("The posterior can be used.")
        text = f"All {len(gates)} gates are passed. {words} This judges the sampling, not the model."
        return Finding("good", "The chains have converged", " ".join(text.split()))
    details = tuple(
        f"{g['name']}: found {shown(g['found'])}, required {shown(g['required'])}. {g.get('advice') or ''}".strip()
        for g in failed
    )
    share = f"{len(failed)} of {len(gates)} gates {'is' if len(failed) == 1 else 'are'} not passed."
    if all(g["name"] == LINEAR for g in failed):
        text = (
            f"{share} The chains agree, but they take the response of temperatures to heat for linear, and it is not. "
            "Do not rely on this posterior."
        )
        return Finding("bad", "The posterior cannot be relied on: the response to heat is not linear", text, details)
    # The rest of the words names the gates, as the details do.
    first = f"{words.split('. ')[0]}." if not words.startswith("Converged") else "Do not rely on this posterior."
    return Finding("bad", "The chains have not converged", f"{share} {first}", details)


def _explanations(run: RunFiles) -> list[Finding]:
    """Optima that were found beside the one that was sampled, and that explain the telemetry nearly as well."""
    found = [] if run.posterior is None else json.loads(run.posterior.attrs.get("other_explanations", "[]"))
    if not found:
        return []
    units = {info.name: info.unit for info in run.parameters}
    details = []
    for other in found:
        entries = other["differs"]
        values = [
            f"{name} {there:.6g} instead of {here:.6g} {units.get(name, '')}".rstrip()
            for name, here, there in entries[:3]
        ]
        more = f", and {len(entries) - 3} more" if len(entries) > 3 else ""
        details.append(f"{', '.join(values)}{more}: {other['below']:.1f} nats below the best.")
    text = (
        "The search found optima where no chain has been, of nearly the same density; intervals leave them out. They "
        "often are of a sensor that starts near its thermostat's threshold: a window that begins at another time tells "
        "them apart."
    )
    return [Finding("warn", "Another explanation fits nearly as well", text, tuple(details))]


def _value(metrics: Sequence[Metric], method: str, window: str, name: str) -> float | None:
    """A score of all channels."""
    wanted = (method, window, "all", name)
    return next((m.value for m in metrics if (m.method, m.window, m.channel, m.metric) == wanted), None)


def _scores(run: RunFiles, window: str) -> Finding:
    genetic = _value(run.metrics, "genetic", window, "rmse")
    stochastic = _value(run.metrics, "stochastic", window, "rmse")
    if stochastic is None and genetic is None:
        return Finding("none", f"No scores on the window “{window}”", "There are none in metrics.json.")
    unseen = f"On unseen telemetry (window “{window}”)"
    if genetic is None or stochastic is None:
        method, value = ("stochastic update", stochastic) if genetic is None else ("genetic algorithm", genetic)
        title = f"{unseen} the {method} is {number(value, 3)} K off (RMSE)"
        state, words = "good", "There is no other method to compare."
    else:
        state, title, words = _against_genetic(run.metrics, window, genetic, stochastic)
        title = f"{unseen} {title}"
    judged, interval = _interval(run, window)
    reliable, caveat = "good", ""
    if stochastic is not None and run.diagnostics is not None and not run.diagnostics["passed"]:
        only_heat = all(g["passed"] or g["name"] == LINEAR for g in run.diagnostics.get("gates", []))
        rests_on = "a posterior that cannot be relied on" if only_heat else "chains that have not converged"
        reliable, caveat = "warn", f"All this rests on {rests_on}."
    worst = max((state, judged, reliable), key=("good", "warn", "bad").index)
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


def _interval(run: RunFiles, window: str) -> tuple[str, str]:
    """State and words on how much of the telemetry the interval holds."""
    coverage = _value(run.metrics, "stochastic", window, "picp")
    width = _value(run.metrics, "stochastic", window, "mpiw")
    if coverage is None:
        return "good", ""
    attributes = run.windows[window].attrs if window in run.windows else {}
    nominal = float(attributes.get("interval", 0.95))
    error = coverage - nominal
    judged = "as it should" if abs(error) <= COVERAGE else "too narrow" if error < 0 else "wider than needed"
    words = (
        f"The {100 * nominal:g}% interval holds {percent(coverage)} of the telemetry (PICP; {judged}) and is "
        f"{number(width, 3)} K wide on average (MPIW)."
    )
    if contains := attributes.get("interval_contains"):
        words += f" It contains {contains}."
    return "bad" if error < -0.1 else "warn" if abs(error) > COVERAGE else "good", words


def _no_scores(run: RunFiles) -> Finding:
    if not run.windows:
        return Finding("none", "No scores", "There is no prediction (prediction.nc).")
    text = "The scenario has no window but `train`: nothing here says how well the model predicts unseen telemetry."
    return Finding("warn", "No test", text)


def _noise(run: RunFiles) -> Finding:
    checks = run.checks
    if not checks:
        return Finding("none", "The noise is not judged", "There is no stochastic prediction.")
    window = next((name for name in checks if is_trained(name)), next(iter(checks)))
    of_window = checks[window]
    against = [c for c in of_window if c.verdict == "contradicted"]
    details = tuple(c.words for c in of_window)
    if not against:
        assumed = assumption(of_window)
        judged = [c for c in of_window if c.verdict != "unknown"]
        if not judged:
            return Finding("none", "The noise is not judged", "There are too few residuals.", details)
        text = f"No channel's residuals in “{window}” contradict {assumed}."
        if any(c.tested == "innovations" for c in judged):
            text = " ".join(f"{text} {correlation_expected(judged)} {TESTED}".split())
        return Finding("good", "The residuals look like the noise that was assumed", text, details)
    worst = max(against, key=lambda c: c.factor)
    tested = listed(list(dict.fromkeys(c.tested for c in against)))
    assumed, discrepant = assumption(against), any(c.discrepancy for c in against)
    if plain := assumed == INDEPENDENT.in_full:
        lacking = (
            ", and the likelihood, which is that of the paper, has no term for it. No interval in this report contains "
            "this model discrepancy."
        )
    elif run.heat is not None:
        lacking = (
            " and that unmodelled heat and noise take up in part only: it may be faster than they are, or not of heat."
        )
    elif discrepant:
        lacking = " and that discrepancy and noise take up in part only: it may vary faster than they can."
    else:
        lacking = " and that this noise does not describe. No interval in this report contains this model discrepancy."
    contradicted = f"In “{window}” the {tested} of {channels(against, of_window)} contradict {assumed}."
    title = f"The assumption of {'iid noise' if plain else listed(noises(against))} is contradicted"
    if thermostats(run, window):
        return Finding("warn", title, f"{contradicted} {THERMOSTATS}", details)
    text = (
        f"{contradicted} Intervals of the "
        f"parameters are too narrow by up to about a factor of {number(worst.factor, 2)} ({worst.channel}, lag-1 "
        f"autocorrelation {number(worst.lag1, 3)}): the model lacks something that the telemetry shows{lacking}"
    )
    return Finding("bad" if worst.factor >= 2 else "warn", title, text, details)


def _heat(run: RunFiles) -> list[Finding]:
    """How large the heat is that no block of the scenario describes."""
    if run.heat is None:
        return []
    shares = {own.node: own.share for own in node_heats(run)}
    if of_gains := gains(run):
        shares["gains (relative errors of modes and absorbed fluxes)"] = of_gains.quantiles[1]
    shares = dict(sorted(shares.items(), key=lambda item: -item[1]))
    if not shares:
        return []
    wider, taken = widened(run), ""
    if wider:
        taken = f" It takes most from {shortened(wider)}: their intervals are more than {WIDER:g} times as wide."
    large = listed([f"{name} ({percent(share, 0)})" for name, share in shares.items() if share > LARGE])
    worst, share = next(iter(shares.items()))
    if share > IMPLAUSIBLE:
        text = (
            f"Share of the mean heat through the node: {large}. Above {IMPLAUSIBLE:.0%} heat can hide a wrong set-up: "
            f"look at attitude, areas, time tags and units before the parameters are used.{taken}"
        )
        return [Finding("bad", "Unmodelled heat is implausibly large", text)]
    if share > LARGE:
        text = (
            f"Share of the mean heat through the node: {large}. Look for what the scenario lacks, such as a load or a "
            "shadow."
            f"{taken}"
        )
        return [Finding("warn", f"Unmodelled heat is above {LARGE:.0%} of what flows", text)]
    text = f"At most {percent(share)} of the mean heat through any node ({worst}).{taken}"
    return [Finding("good", "Unmodelled heat is small", text)]


def _heaters(run: RunFiles) -> list[Finding]:
    """Whether telemetry's duty cycles on unseen windows lie within what is predicted."""
    findings = []
    for name, window in run.test_windows.items():
        if not window.sizes.get("heater", 0) or "duty_cycle" not in window:
            continue
        duty = window["duty_cycle"].values
        observed = window["observed_duty_cycle"].values
        low, high = np.nanquantile(duty, [0.025, 0.975], axis=0)
        seen = np.isfinite(observed)
        outside = seen & ((observed < low - 1e-9) | (observed > high + 1e-9))
        if not seen.any():
            continue
        details = tuple(
            f"{heater}: telemetry {percent(share)}, predicted {percent(mean)} [{percent(least)}, {percent(most)}]"
            f"{', which leaves telemetry out' if out else ''}."
            for heater, share, mean, least, most, out in zip(
                window["heater"].values, observed, np.nanmean(duty, axis=0), low, high, outside, strict=True
            )
        )
        inside = f"{int((seen & ~outside).sum())} of {int(seen.sum())}"
        findings.append(
            Finding(
                "warn" if outside.any() else "good",
                f"Heaters: {inside} duty cycles in “{name}” lie within the predicted 95%",
                "Share of the time on, telemetry against the mean and central 95% of what is predicted"
                f"{f', which contains {contents}' if (contents := window.attrs.get('duty_cycle_contains')) else ''}:",
                details,
            )
        )
    return findings


def _stand_in(run: RunFiles) -> list[Finding]:
    """Parameters in whose place the discrepancy stands, where there is one."""
    correlation = stand_ins(run)
    against = {name: value for name, value in correlation.items() if value <= STANDS_IN}
    if not correlation:
        return []
    if not against:
        worst, value = next(iter(correlation.items()))
        text = (
            f"The strongest correlation of a parameter with what the discrepancy takes up of its effect is "
            f"{number(value, 2)} ({worst}); at −1 it would tell their sum only."
        )
        return [Finding("good", "The telemetry tells the parameters from the discrepancy", text)]
    named = listed([f"{name} ({number(value, 2)})" for name, value in against.items()])
    text = (
        f"The posterior of {named} is correlated with how much of its effect the discrepancy takes up: the telemetry "
        "tells the sum of the two, and the two priors share it out. A prediction needs only the sum; a "
        "parameter's value alone rests on the discrepancy's prior."
    )
    title = f"The discrepancy stands in for {len(against)} parameter{'s' if len(against) > 1 else ''}"
    return [Finding("warn", title, text)]


def _edges(run: RunFiles) -> Finding:
    if run.posterior is None or not run.parameters:
        return Finding("none", "Priors are not compared", "There is no posterior, or no list of parameters.")
    edges = at_edge(run)
    if not edges:
        return Finding(
            "good",
            "No posterior presses against its prior's edge",
            f"At most {EDGE:.0%} of any lies outside its prior's 95%.",
        )
    text = (
        "Data and prior disagree, or the prior is too tight, or the parameter makes up for something that the model "
        "lacks: " + listed([f"{name} ({edge} edge)" for name, edge in edges.items()]) + "."
    )
    title = f"{len(edges)} posterior{'s' if len(edges) > 1 else ''} at the edge of the prior"
    return Finding("warn", title, text)


def _missing(run: RunFiles) -> list[Finding]:
    if not run.missing:
        return []
    lacking = listed([f"{STAGES[name]} ({name})" for name in run.missing])
    return [Finding("warn", "The run is not complete", f"Not in the run directory: {lacking}.")]
