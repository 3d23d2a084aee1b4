"""What a run says, one statement after the other, and what each takes from its use."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import xarray as xr
from scipy.stats import chi2, norm

from ..prediction import HELD, Metric
from ..probability import INDEPENDENT
from ..scenario import is_trained
from .panels.discrepancy import STANDS_IN, stand_ins
from .panels.duty import CLOSED, duties
from .panels.heat import IMPLAUSIBLE, LARGE, WANDERING, gains, node_heats
from .panels.parameters import MOST_NAMED, WIDER, shortened, widened
from .panels.picture import holdings
from .panels.prediction import unseen, unseen_share
from .panels.residuals import TESTED, assumption, channels, correlation_expected, noises
from .run_files import STAGES, Record, RunFiles
from .text import listed, number, percent, shown

State = Literal["good", "warn", "bad", "none"]

MARKS: dict[str, str] = {"good": "✓ good", "warn": "! caution", "bad": "✕ problem", "none": "– not in this run"}
"""State -> a sign and a word."""

EQUAL = 0.02
"""Errors that differ by no more than this share are called equal."""

LINEAR = "response to heat"
"""The gate that judges how heat was taken into account, not the chains."""

NARROWED = 1.3
"""Factor up to which residuals that are not quite the noise that is assumed are of no practical weight."""
OFF = 0.01
"""Probability that a right model is cautioned about for one of its channels, priors or heaters."""
STRIKING = 0.6
"""Share inside the interval that no reader takes for 95%, though errors as long as the window can make it by chance."""
FAR_OFF = 1e-6
"""The same, below which a model is called wrong."""

_OUTSIDE = 0.05
"""Share of a window's time outside of what training contained, above which a title says so."""
_VALUE = "the value of "
_TEMPERATURES = "temperatures of "
_CHECK = "flightcal check scenario.yaml --out checked"
_AGAIN = "Run the same command again: it takes up where it stopped."


@dataclass(frozen=True)
class Finding:
    """One statement of the verdict. `state` gives its colour and, in words, its mark."""

    state: State
    title: str
    text: str
    details: tuple[str, ...] = ()
    not_for: tuple[str, ...] = ()
    """What the run is not to be used for because of it, where its state is "warn"."""
    then: str = ""
    """What to do next, as a line that can be copied."""

    @property
    def mark(self) -> str:
        """The state as a sign and a word, so that it does not rest on colour."""
        return MARKS[self.state]


def value_of(name: str) -> str:
    """What a run is not to be used for where a parameter's value is in doubt."""
    return f"{_VALUE}{name}"


def valued(limit: str) -> str:
    """Of which parameter it is the value; "" of another use."""
    return limit.removeprefix(_VALUE) if limit.startswith(_VALUE) else ""


def temperatures_of(channel: str) -> str:
    """What a run is not to be used for where a channel's intervals do not hold."""
    return f"{_TEMPERATURES}{channel}"


def in_few_words(limits: Sequence[str]) -> str:
    """What a run is not to be used for, each once, and of many channels or values the first."""
    limits = list(dict.fromkeys(limits))
    values = [limit.removeprefix(_VALUE) for limit in limits if limit.startswith(_VALUE)]
    channels = [limit.removeprefix(_TEMPERATURES) for limit in limits if limit.startswith(_TEMPERATURES)]
    said = [limit for limit in limits if not limit.startswith((_VALUE, _TEMPERATURES))]
    if channels:
        said.insert(0, f"{_TEMPERATURES}{shortened(channels)}")
    if values:
        said.append(f"the value{'s' if len(values) > 1 else ''} of {shortened(values)}")
    return listed(said)


def interrupted(run: RunFiles) -> list[Finding]:
    """Whether sampling was stopped."""
    if run.posterior is None or str(run.posterior.attrs.get("interrupted", "false")).lower() != "true":
        return []
    sizes = run.posterior["posterior"].to_dataset().sizes
    kept = f"{sizes.get('draw', 0)} draws of each of {sizes.get('chain', 0)} chains"
    text = f"Sampling was stopped early; all that follows rests on {kept}."
    return [Finding("bad", "The run was interrupted", text, then=_AGAIN)]


def convergence(diagnostics: Record | None) -> Finding:
    """Whether the chains passed their gates."""
    if diagnostics is None:
        text = "There is no diagnosis of the chains (diagnostics.json), so nothing here is a calibration."
        return Finding("bad", "The sampling did not finish", text, then=_AGAIN)
    gates = diagnostics.get("gates", [])
    failed = [g for g in gates if not g["passed"]]
    words = str(diagnostics.get("verdict") or "")
    if diagnostics["passed"]:
        text = f"All {len(gates)} gates are passed. {words} This judges the sampling, not the model."
        return Finding("good", "The chains have converged", " ".join(text.split()))
    details = tuple(
        f"{g['name']}: found {shown(g['found'])}, required {shown(g['required'])}. {g.get('advice') or ''}".strip()
        for g in failed
    )
    then = str(failed[0].get("advice") or "")
    share = f"{len(failed)} of {len(gates)} gates {'is' if len(failed) == 1 else 'are'} not passed."
    if all(g["name"] == LINEAR for g in failed):
        text = (
            f"{share} The chains agree, but they take the response of temperatures to heat for linear, and it is not. "
            "Do not rely on this posterior."
        )
        title = "The posterior cannot be relied on: the response to heat is not linear"
        return Finding("bad", title, text, details, then=then)
    # The rest of the words names the gates, as the details do.
    first = f"{words.split('. ')[0]}." if not words.startswith("Converged") else "Do not rely on this posterior."
    title = f"The chains have not converged: {failed[0]['name']}, {shown(failed[0]['found'])}"
    return Finding("bad", title, f"{share} {first}", details, then=then)


def explanations(run: RunFiles) -> list[Finding]:
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
    differ = dict.fromkeys(value_of(name) for other in found for name, *_ in other["differs"])
    title = "Another explanation fits nearly as well"
    return [
        Finding("warn", title, text, tuple(details), tuple(differ), "Train on a window that begins at another time.")
    ]


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
        rests_on = "a posterior that cannot be relied on" if only_heat else "chains that have not converged"
        reliable, caveat = "warn", f"All this rests on {rests_on}."
    worst = max((state, reliable), key=("good", "warn", "bad").index)
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
    nominal = float(attributes.get("interval", 0.95))
    words = (
        f"The {100 * nominal:g}% interval holds {percent(coverage)} of the telemetry of all channels (PICP) and is "
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


def suspected(run: RunFiles) -> list[Finding]:
    """What was likely to be wrong before any sampling, and is not mended by it."""
    return [
        Finding("bad", f"Likely wrong: {own['title']}", str(own["sentence"]), then=f"{own['advice']}.")
        for own in run.suspects
    ]


def noise(run: RunFiles) -> Finding:
    """Whether residuals are the noise that was assumed."""
    checks = run.checks
    if not checks:
        return Finding("none", "The noise is not judged", "There is no stochastic prediction.")
    window = next((name for name in checks if is_trained(name)), next(iter(checks)))
    of_window = checks[window]
    # With many channels one is off by chance.
    against = [
        c
        for c in of_window
        if c.verdict == "contradicted" and c.p_value < OFF / len(of_window) and c.factor >= NARROWED
    ]
    details = tuple(c.words for c in of_window)
    if not against:
        assumed = assumption(of_window)
        judged = [c for c in of_window if c.verdict != "unknown"]
        if not judged:
            return Finding("none", "The noise is not judged", "There are too few residuals.", details)
        text = f"No channel's residuals in “{window}” contradict {assumed} to an extent that matters."
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
    named = "independent noise" if plain else listed(noises(against))
    title = f"The residuals are not the {named} that was assumed, worst {worst.channel}"
    text = (
        f"{contradicted} Intervals of the "
        f"parameters are too narrow by up to about a factor of {number(worst.factor, 2)} ({worst.channel}, lag-1 "
        f"autocorrelation {number(worst.lag1, 3)}): the model lacks something that the telemetry shows{lacking}"
    )
    then = "Leave `heat` and `noise` out of the scenario: flightcal then models both." if plain else _CHECK
    return Finding("bad" if worst.factor >= 2 else "warn", title, text, details, ("intervals of parameters",), then)


def heat(run: RunFiles) -> list[Finding]:
    """How large the heat is that no block of the scenario describes."""
    return [*_lasting_heat(run), *_wandering_heat(run)]


def _wandering_heat(run: RunFiles) -> list[Finding]:
    """Whether much heat comes and goes otherwise than with the orbit: a caution, and nothing else."""
    sizes = {own.node: own.wandering for own in node_heats(run) if own.wandering > WANDERING}
    if not sizes:
        return []
    named = listed([f"{name} ({percent(share, 0)})" for name, share in sizes.items()])
    worst = max(sizes, key=lambda name: sizes[name])
    text = (
        f"Standard deviation of the slow part, as a share of the mean heat through the node: {named}. Look for what "
        "the scenario lacks and the orbit does not repeat, such as a mode's power or a pass of the transmitter. "
        "Nothing foresees such heat: on unseen orbits intervals are wide."
    )
    title = f"Much of the unmodelled heat comes and goes: {worst}, {percent(sizes[worst], 0)} of what flows"
    return [Finding("warn", title, text, not_for=_doubted_by_heat(run), then=_CHECK)]


def _doubted_by_heat(run: RunFiles) -> tuple[str, ...]:
    """What a run is not to be used for where much heat is unmodelled."""
    return tuple(map(value_of, widened(run))) or ("values of parameters",)


def _lasting_heat(run: RunFiles) -> list[Finding]:
    """How large the heat is that comes again with the orbit."""
    if run.heat is None:
        return []
    shares = {own.node: own.share for own in node_heats(run)}
    if of_gains := gains(run):
        shares["gains (relative errors of modes and absorbed fluxes)"] = of_gains.quantiles[0]
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
            f"For sure, as a share of the mean heat through the node: {large}. Above {IMPLAUSIBLE:.0%} heat can hide a "
            f"wrong set-up: look at attitude, areas, time tags and units before the parameters are used.{taken}"
        )
        title = f"Unmodelled heat is implausibly large: {worst}, {percent(share, 0)} of what flows"
        return [Finding("bad", title, text, then=_CHECK)]
    if share > LARGE:
        text = (
            f"For sure, as a share of the mean heat through the node: {large}. Look for what the scenario lacks, "
            f"such as a load or a shadow.{taken}"
        )
        title = f"Unmodelled heat is large: {worst}, {percent(share, 0)} of what flows"
        return [Finding("warn", title, text, not_for=_doubted_by_heat(run), then=_CHECK)]
    text = f"For sure it is at most {percent(share)} of the mean heat through any node ({worst}).{taken}"
    return [Finding("good", "Unmodelled heat is small", text)]


def holding(run: RunFiles) -> Finding:
    """Whether intervals hold on windows that were not trained on, all channels and windows together."""
    judged = holdings(run)
    if not run.windows:
        text = "There is no prediction in this run (prediction.nc), so nothing says whether it can be trusted."
        return Finding("bad", "Nothing is predicted: the run did not finish", text, then=_AGAIN)
    if not judged:
        text = "The scenario has no window that was not trained on: nothing says how well it predicts unseen telemetry."
        then = "Add a window: windows: {test: {start: ..., end: ...}}"
        return Finding("none", "No unseen telemetry", text, not_for=("windows that it was not trained on",), then=then)
    windows = {name: run.windows[name] for name in judged}
    failed: dict[str, None] = {}
    channels: dict[str, None] = {}
    few: dict[str, tuple[float, str]] = {}
    worst, details = ("", "", math.inf), []
    for name, held in judged.items():
        window = windows[name]
        words = []
        for k, channel in enumerate(map(str, window["channel"].values)):
            share, lower, upper = held.coverage[k], held.lower[k], held.upper[k]
            if not np.isfinite(share):
                continue
            channels[channel] = None
            said = f"{channel} {percent(share)} ({percent(lower)} to {percent(upper)})"
            if held.room[k] < 0.0:
                failed[channel] = None
                how = f"{percent(share)} inside"
                if held.error[k] > held.most_error[k]:
                    how += f" and {held.error[k]:.1f} deviations off"
                    said += f", {held.error[k]:.1f} deviations off (at most {held.most_error[k]:.1f})"
                worst = min(worst, (name, f"{channel} in “{name}”, {how}", held.room[k]), key=lambda w: w[2])
                said += ", which does not hold"
            elif share < STRIKING:
                few[channel] = min(few.get(channel, (1.0, "")), (share, name))
                said += ", which may be by chance"
            elif share > upper:
                said += ", wider than need be"
            words.append(said)
        details.append(f"“{name}”: {listed(words)}.")
        if outside := unseen(window):
            details.append(f"“{name}”: {outside}")
    interval = float(next(iter(windows.values())).attrs.get("interval", 0.95))
    text = (
        f"Share of the telemetry inside the {interval:.0%} interval, and in brackets where the share of a right "
        f"prediction lies: in all channels and windows together with {HELD:.0%} probability. Samples that follow each "
        "other share their errors. Where these are larger than any of a right prediction, it does not hold either."
    )
    over = listed([f"“{name}”" for name in windows])
    if not channels:
        return Finding("none", f"No sample of {over} is scored", text, tuple(details), ("unseen windows",))
    if not failed:
        if not few:
            return Finding("good", f"Intervals hold on {over}, in every channel", text, tuple(details))
        channel, (share, name) = min(few.items(), key=lambda own: own[1])
        title = f"Only {percent(share)} of {channel} in “{name}” is inside: too short to tell whether by chance"
        title += _outside(windows[name])
        then = "Add longer windows to test on: windows: {test: {start: ..., end: ...}}"
        return Finding("warn", title, text, tuple(details), tuple(map(temperatures_of, few)), then)
    title = f"Intervals do not hold in {len(failed)} of {len(channels)} channels, worst {worst[1]}"
    if len(channels) == 1:
        title = f"Intervals do not hold: {worst[1]}"
    title += _outside(windows[worst[0]])
    state: State = "bad" if 2 * len(failed) >= len(channels) else "warn"
    not_for = tuple(map(temperatures_of, [*failed, *few]))
    return Finding(state, title, text, tuple(details), not_for, _CHECK)


def _outside(window: xr.Dataset) -> str:
    """To be added to what a title says of a window, where much of it is outside of what training contained."""
    share = unseen_share(window)
    return f"; {percent(share, 0)} of the window is outside of what training contained" if share > _OUTSIDE else ""


def held_channels(run: RunFiles) -> list[str]:
    """Channels that are scored on some window that was not trained on."""
    found = [
        str(channel)
        for window in run.test_windows.values()
        if "coverage" in window
        for channel, share in zip(window["channel"].values, window["coverage"].values, strict=True)
        if np.isfinite(share)
    ]
    return list(dict.fromkeys(found))


def heaters(run: RunFiles) -> list[Finding]:
    """Whether telemetry's duty cycles on unseen windows lie within what is predicted."""
    findings = []
    measured = [own for own in duties(run) if np.isfinite(own.measured)]
    for name in dict.fromkeys(own.window for own in measured):
        found = [own for own in measured if own.window == name]
        outside = [own for own in found if own.outside]
        contents = run.windows[name].attrs.get("duty_cycle_contains")
        details = tuple(
            f"{own.heater}: telemetry {percent(own.measured)}, predicted {percent(own.mean)} "
            f"[{percent(own.lower)}, {percent(own.upper)}]{', which leaves telemetry out' if own.outside else ''}."
            for own in found
        )
        title = f"All {len(found)} duty cycles in “{name}” lie within what is predicted"
        if outside:
            own, *others = outside
            title = (
                f"{own.heater} is on for {percent(own.measured)} of “{name}”, predicted {percent(own.lower)} to "
                f"{percent(own.upper)}{f'; {len(others)} more outside' if others else ''}"
            )
        findings.append(
            Finding(
                "warn" if outside else "good",
                title,
                "Share of the time on, telemetry against the mean and central 95% of what is predicted"
                f"{f', which contains {contents}' if contents else ''}. "
                f"All together leave a right prediction's bands with {1.0 - CLOSED:.0%} probability:",
                details,
                tuple(f"the duty cycle of {own.heater}" for own in outside),
                _CHECK if outside else "",
            )
        )
    return findings


def stand_in(run: RunFiles) -> list[Finding]:
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
    title = f"The discrepancy, what the model lacks, stands in for {shortened(list(against))}"
    return [Finding("warn", title, text, not_for=tuple(map(value_of, against)), then=_CHECK)]


def prior_conflict(run: RunFiles) -> Finding:
    """Whether parameters and initial temperatures are where their priors expect them.

    The normal score of a posterior's median in its prior is at most as wide as N(0, 1) where the prior is right, so the
    sum of squares of d of them is at most chi-squared with d degrees of freedom (a prior predictive check: Box 1980,
    J. R. Stat. Soc. A 143).
    """
    kinds = {info.name: info.kind for info in run.parameters}
    out_by = {
        own["name"]: float(own["prior_score"])
        for own in (run.diagnostics or {}).get("parameters", [])
        if own.get("prior_score") is not None and kinds.get(own["name"]) in ("parameter", "initial")
    }
    if not out_by:
        return Finding("none", "Priors are not compared", "The run does not say where posteriors lie in their priors.")
    alone = {name: 2.0 * float(norm.sf(abs(score))) * len(out_by) for name, score in out_by.items()}
    together = float(chi2.sf(sum(score**2 for score in out_by.values()), len(out_by)))
    order = sorted(out_by, key=lambda name: -abs(out_by[name]))
    off = [name for name in order if alone[name] < OFF]
    if not off and together >= OFF:
        text = (
            f"Furthest out is {order[0]}, at {abs(out_by[order[0]]):.1f} deviations of its prior; of "
            f"{len(out_by)} priors that is to be expected."
        )
        return Finding("good", "Posteriors lie where their priors expect them", text)
    named = off or order[:MOST_NAMED]
    sides = {name: "above" if score > 0 else "below" for name, score in out_by.items()}
    said = listed([f"{name} ({abs(out_by[name]):.1f} deviations {sides[name]})" for name in named[:MOST_NAMED]])
    text = (
        f"Telemetry and prior are in conflict: {said}. Either the prior is wrong, or the parameter makes up for "
        "something else that is, such as a clock, an attitude, a unit or a missing heater."
    )
    state: State = "bad" if min([together, *alone.values()]) < FAR_OFF else "warn"
    title = f"{named[0]} lies {abs(out_by[named[0]]):.1f} deviations from where its prior expects it"
    if named[1:]:
        title = f"{len(named)} values lie far from where their priors expect them, worst {named[0]}"
    return Finding(state, title, text, not_for=tuple(map(value_of, named)), then=_CHECK)


def resting(run: RunFiles) -> list[Finding]:
    """Values that are as good as a fixed number of the scenario: they bear on no prediction, and are no fault."""
    if not run.footings:
        return []
    names = list(dict.fromkeys(str(own["parameter"]) for own in run.footings))
    details = tuple(
        f"{name}: as good as {listed([str(own['number']) for own in run.footings if own['parameter'] == name])}."
        for name in names
    )
    text = (
        "The telemetry tells these values together with numbers that the scenario has as fixed. No fit shows an error "
        "of such a number: the value makes up for it, and temperatures are right all the same."
    )
    title = f"What is known of {shortened(names)} rests on fixed numbers"
    return [Finding("good", title, text, details)]


def missing(run: RunFiles) -> list[Finding]:
    """Files that the run lacks."""
    if not run.missing:
        return []
    lacking = listed([f"{STAGES[name]} ({name})" for name in run.missing])
    return [Finding("warn", "The run is not complete", f"Not in the run directory: {lacking}.")]
