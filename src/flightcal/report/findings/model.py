"""Is the model right for this telemetry?"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.stats import chi2, norm

from ...calibration import Calibrated, PriorScore
from ...probability import INDEPENDENT
from ...validation import ResidualCheck
from ...words import duration, listed, number, percent
from ..panels.discrepancy import STANDS_IN, stand_ins
from ..panels.duty import duties
from ..panels.heat import IMPLAUSIBLE, LARGE, WANDERING, gains, node_heats, state
from ..panels.parameters import MOST_NAMED, WIDER, shortened, widened
from ..panels.residuals import TESTED, assumption, channels, correlation_expected, noises
from ..run_files import ParameterInfo, RunFiles
from .finding import CHECK, Finding, State, duty_of, value_of

NARROWED = 1.3
"""Factor up to which residuals that are not quite the noise that is assumed are of no practical weight."""
OFF = 0.01
"""Probability that a right model is cautioned about for one of its channels, priors or heaters."""
_SHORT = 0.25
"""Of the time between samples: no packet says when in it a sensor was read."""
_NARROWED_MUCH = 0.8
"""Usual deviation of a normal score, from which that is worth no word."""
UNEXPLAINED = "everything"
"""Kind of the record that says that nothing simple is wrong, and the model far off."""
_RESTS = 2.0
"""Times as wide as it is, an interval that is wider than that if fixed numbers are off is named."""
_GUESSED, _BENDS = 4.0, 0.5
"""Deviations of a prior that is a guess, and those of the value that it bends, from which it matters."""
_MEMORY = ".correlation_time"
_BESIDE_THRESHOLDS = 1.0
"""K, by which a heater switches beside its thresholds, on and off alike, from which it is worth a word."""
_SURELY = 0.3
"""K, by which it does at least, on and off."""
FAR_OFF = 1e-6
"""The probability below which a model is called wrong."""


def likely(found: Sequence[Mapping[str, Any]]) -> list[Finding]:
    """Of the records of what is likely wrong: what telemetry shows by itself, and of what explains it the best.

    It was so before any sampling, and is not mended by it.
    """
    compared = [suspicion for suspicion in found if suspicion.get("nats") is not None]
    findings = [_likely(suspicion, "Likely wrong") for suspicion in found if suspicion.get("nats") is None]
    if len(compared) == 1:
        findings.append(_likely(compared[0], "Likely wrong"))
    elif compared:
        best = _likely(compared[0], f"Likely wrong, one of {len(compared)}")
        text = f"{best.text} What follows explains the telemetry nearly as well; or the model is too simple."
        findings.append(
            replace(best, text=text, details=tuple(f"Or: {suspicion['title']}." for suspicion in compared[1:]))
        )
    return findings


def _likely(suspicion: Mapping[str, Any], mark: str) -> Finding:
    title = suspicion["title"] if suspicion.get("kind") == UNEXPLAINED else f"{mark}: {suspicion['title']}"
    return Finding("bad", title, str(suspicion["sentence"]), then=f"{suspicion['advice']}.")


def noise(run: RunFiles) -> Finding:
    """Whether residuals are the noise that was assumed."""
    checks = run.checks_of_training
    if not checks:
        return Finding("none", "The noise is not judged", "There is no stochastic prediction.")
    every = [c for of_window in checks.values() for c in of_window]

    def matters(c: ResidualCheck) -> bool:
        """Of many channels and windows one is off by chance."""
        return c.verdict == "contradicted" and c.p_value < OFF / len(every) and c.factor >= NARROWED

    details = tuple(
        f"{f'“{name}”: ' if len(checks) > 1 else ''}{c.words}" for name, of_window in checks.items() for c in of_window
    )
    if not any(map(matters, every)):
        judged = [c for c in every if c.verdict != "unknown"]
        if not judged:
            return Finding("none", "The noise is not judged", "There are too few residuals.", details)
        over = listed([f"“{name}”" for name in checks])
        text = f"No channel's residuals in {over} contradict {assumption(every)} to an extent that matters."
        if any(c.tested == "innovations" for c in judged):
            text = " ".join(f"{text} {correlation_expected(judged)} {TESTED}".split())
        return Finding("good", "The residuals look like the noise that was assumed", text, details)
    worst = max(filter(matters, every), key=lambda c: c.factor)
    window, of_window = next((name, check) for name, check in checks.items() if worst in check)
    against = list(filter(matters, of_window))
    tested = listed(list(dict.fromkeys(c.tested for c in against)))
    assumed, discrepant = assumption(against), any(c.discrepant for c in against)
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
    then = "Leave `heat` and `noise` out of the scenario: flightcal then models both." if plain else CHECK
    return Finding("bad" if worst.factor >= 2 else "warn", title, text, details, ("intervals of parameters",), then)


def heat(run: RunFiles) -> list[Finding]:
    """How large the heat is that no block of the scenario describes."""
    wandering = _wandering_heat(run)
    return [*_lasting_heat(run, of="Unmodelled heat of every orbit" if wandering else "Unmodelled heat"), *wandering]


def _wandering_heat(run: RunFiles) -> list[Finding]:
    """Whether much heat comes and goes otherwise than with the orbit: a caution, and nothing else."""
    sizes = {node_heat.node: node_heat.wandering for node_heat in node_heats(run) if node_heat.wandering > WANDERING}
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
    return [Finding("warn", title, text, not_for=_doubted_by_heat(run, sizes), then=_find(worst))]


def _find(node: str) -> str:
    """What to do next where a node has much heat that nobody describes."""
    return f"Find what heats or cools {node} and the scenario lacks: a mode's power, a load, a pass, a shadow."


def _doubted_by_heat(run: RunFiles, nodes: Collection[str]) -> tuple[str, ...]:
    """What a run is not to be used for where much heat of these nodes is unmodelled: first what acts on them.

    A heater there whose status is not measured may be on for longer or shorter, and the heat make up for it.
    """
    simulator = run.written.get("simulator") or {}
    heaters = simulator.get("heaters")
    there = (
        [name for name, heater in heaters.items() if heater.get("node") in nodes]
        if isinstance(heaters, Mapping)
        else []
    )
    acting = [info.name for info in run.parameters if _acts_on(info, nodes, simulator)]
    doubted = sorted(widened(run), key=lambda name: name not in acting)
    return (*_unmeasured(run, there), *(tuple(map(value_of, doubted)) or ("values of parameters",)))


def _unmeasured(run: RunFiles, heaters: Collection[str]) -> list[str]:
    """The duty cycles of those of these heaters whose status is not measured."""
    found = [duty.heater for duty in duties(run) if duty.heater in heaters and not np.isfinite(duty.measured)]
    return list(map(duty_of, dict.fromkeys(found)))


def _acts_on(info: ParameterInfo, nodes: Collection[str], simulator: Mapping[str, Any]) -> bool:
    """Whether a parameter is a number of one of these nodes, or of a link, mode, heater, load or face that has one."""
    touched: set[str] = set()
    for path in info.target:
        block, *names = path.split(".")
        touched |= {part for name in names for part in (name, *name.split("-"))}
        blocks = simulator.get(block)
        item = blocks.get(names[0]) if isinstance(blocks, Mapping) and names else None
        touched |= {str(item.get("node"))} if isinstance(item, Mapping) else set()
    return not touched.isdisjoint(nodes)


def thresholds(run: RunFiles) -> list[Finding]:
    """Heaters that switch at other temperatures than the scenario says, by what their sensors' channels read."""
    known = next((dataset for dataset in run.windows.values() if "least_threshold_offset" in dataset), None)
    if known is None:
        return []
    beside = {
        str(name): float(off.mean())
        for name, off, least in zip(
            known["heater"].values,
            known["threshold_offset"].values.T,
            known["least_threshold_offset"].values.T,
            strict=True,
        )
        if abs(off.mean()) > _BESIDE_THRESHOLDS and off[0] * off[1] > 0.0 and np.abs(least).min() > _SURELY
    }
    if not beside:
        return []

    def said(name: str) -> str:
        off = beside[name]
        return f"{name} switches {number(abs(off), 2)} K {'above' if off > 0.0 else 'below'} its thresholds, or more"

    worst = max(beside, key=lambda name: abs(beside[name]))
    title = said(worst) + (f"; {len(beside) - 1} more are beside theirs" if len(beside) > 1 else "")
    text = (
        "So its measured switches show, beside what its sensor's channel reads. Its thresholds are others than the "
        "scenario says, or that channel reads beside its node's temperature by so much; predictions follow the "
        "channel."
    )
    details = tuple(f"{said(name)}." for name in beside)
    return [Finding("warn", title, text, details, tuple(f"the thresholds of {name}" for name in beside), CHECK)]


def _lasting_heat(run: RunFiles, of: str) -> list[Finding]:
    """How large the heat is that comes again with the orbit, which is called `of` where it is small."""
    if run.heat is None:
        return []
    found = [(node_heat.node, node_heat.share, node_heat.allowed) for node_heat in node_heats(run)]
    if of_gains := gains(run):
        found.append(("gains (relative errors of modes and absorbed fluxes)", of_gains.quantiles[0], 1.0))
    if not found:
        return []
    found.sort(key=lambda item: -item[1] / item[2])
    wider, taken = widened(run), ""
    if wider:
        taken = f" It takes most from {shortened(wider)}: their intervals are more than {WIDER:g} times as wide."
    large = listed([f"{name} ({percent(share, 0)})" for name, share, allowed in found if state(share, allowed)])
    worst, share, allowed = found[0]
    if state(share, allowed) == "bad":
        limit = percent(IMPLAUSIBLE * allowed, 0)
        text = (
            f"For sure, as a share of the mean heat through the node: {large}. Above {limit} heat can hide a "
            f"wrong set-up: look at attitude, areas, time tags and units before the parameters are used.{taken}"
        )
        title = f"Unmodelled heat is implausibly large: {worst}, {percent(share, 0)} of what flows"
        return [Finding("bad", title, text, then=CHECK)]
    if state(share, allowed):
        text = (
            f"For sure, as a share of the mean heat through the node: {large}. Look for what the scenario lacks, "
            f"such as a load or a shadow.{taken}"
        )
        title = f"Unmodelled heat is large: {worst}, {percent(share, 0)} of what flows"
        nodes = [name for name, share, allowed in found if state(share, allowed)]
        return [Finding("warn", title, text, not_for=_doubted_by_heat(run, nodes), then=_find(worst))]
    largest, share, _ = max(found, key=lambda item: item[1])
    text = f"The telemetry proves no more than {percent(share)} of the mean heat through any node ({largest})."
    if likely := max(node_heats(run), key=lambda node_heat: node_heat.most, default=None):
        text += f" Expected are up to {percent(likely.most)} ({likely.node}), which may as well be parameters."
    text += taken
    title = f"{of} is small" if share <= LARGE else f"{of} is no larger than the scenario expects"
    return [Finding("good", title, text)]


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
    return [Finding("warn", title, text, not_for=tuple(map(value_of, against)), then=CHECK)]


def prior_conflict(run: RunFiles) -> Finding:
    """Whether parameters and initial temperatures are where their priors expect them.

    The normal score of a posterior's median in its prior is as wide as the telemetry narrows the prior where that is
    right (`prior_scores`), and at most as N(0, 1). So the sum of squares of d of them is at most chi-squared with d
    degrees of freedom (a prior predictive check: Box 1980, J. R. Stat. Soc. A 143).

    Where a node without a channel starts is a guess of the scenario's, and no fault of the model.
    """
    kinds = {info.name: info.kind for info in run.parameters}
    judged = ("parameter", "initial", "time")
    out_by = {name: score for name, score in run.prior_scores.items() if kinds.get(name) in judged}
    if not out_by:
        return Finding("none", "Priors are not compared", "The run does not say where posteriors lie in their priors.")
    guessed = [info.name for info in run.parameters if not info.observed and info.name in out_by]
    believed = {name: score for name, score in out_by.items() if name not in guessed}
    conflict = _conflict(believed, [name for name in believed if kinds[name] == "parameter"])
    if conflict is not None:
        state, named = conflict
        text = (
            f"Telemetry and prior are in conflict: {_out_by(believed, named)}. Either the prior is wrong, or the "
            "parameter makes up for something else that is, such as a clock, an attitude, a unit or a missing heater."
        )
        targets = {info.name: info.target for info in run.parameters}
        heaters = [path.split(".")[1] for name in named for path in targets[name] if path.startswith("heaters.")]
        not_for = tuple(value_of(name) for name in named if kinds[name] != "time")
        if len(not_for) < len(named):
            text += (
                " The time error is held back by its prior, so parameters make up for the rest of it. Correct the time "
                "tags, or write how far they may be off, such as 'time_error: 30 s'."
            )
            if held := _held_drivers(run):
                text += (
                    f" Drivers with 'fill: hold' ({listed(held)}) are late by up to a sample, unless sent at changes."
                )
            not_for = ("intervals of parameters", *not_for)
            if _between_samples(run, named):
                state = "warn"
                text += " It is short beside the time between samples, and so moves temperatures by little."
        not_for = (*_unmeasured(run, heaters), *not_for)
        return Finding(state, _far_title(believed, named), text, not_for=not_for, then=CHECK)
    starts = _conflict({name: out_by[name] for name in guessed})
    if starts is not None:
        named = starts[1]
        if not any(_bent(out_by[name]) for name in named):
            text = (
                f"No channel sees where {listed(named[:MOST_NAMED])} begins, and its prior is a guess: "
                f"{_out_by(out_by, named)}. The telemetry tells it so well that the guess makes no difference."
            )
            return Finding("good", "Posteriors lie where their priors expect them", text)
        text = (
            f"No channel sees these nodes, so their priors are guesses: {_out_by(out_by, named)}. A wrong guess bends "
            "these values and what is learnt at the window's beginning, but no prediction of another window."
        )
        then = "Write 'initial' of these nodes nearer to what was found, or 'initial_state: {unobserved: 20 K}'."
        return Finding("warn", _far_title(out_by, named), text, not_for=tuple(map(value_of, named)), then=then)
    furthest = max(out_by, key=lambda name: abs(out_by[name].prior_score))
    text = (
        f"Furthest out is {furthest}, at {abs(out_by[furthest].prior_score):.1f} deviations of its prior; of "
        f"{len(out_by)} priors that is to be expected."
    )
    return Finding("good", "Posteriors lie where their priors expect them", text)


def _bent(prior_score: PriorScore) -> bool:
    """Whether a prior that is a guess bends a value: by some of its deviation, or it is far off anyhow."""
    narrowed = float(np.sqrt(max(0.0, 1.0 - prior_score.usual_score**2)))
    return abs(prior_score.prior_score) > min(_GUESSED, _BENDS / max(narrowed, 1e-9))


def _held_drivers(run: RunFiles) -> list[str]:
    """The drivers whose values stay until the next sample."""
    channels = (run.written.get("telemetry") or {}).get("channels") or {}
    return [
        name for name, channel in channels.items() if isinstance(channel, Mapping) and channel.get("fill") == "hold"
    ]


def _between_samples(run: RunFiles, named: list[str]) -> bool:
    """Whether what is named are time errors alone, each far shorter than the telemetry tells times."""
    errors = [quantity.mean for quantity in run.calibrated if quantity.kind == "time" and quantity.name in named]
    times = [window["time"].values for window in run.windows.values() if window.sizes["time"] > 1]
    if len(errors) < len(named) or not times:
        return False
    apart = min(float(np.median(np.diff(time)) / np.timedelta64(1, "s")) for time in times)
    return max(map(abs, errors)) < _SHORT * apart


def lasting_noise(run: RunFiles) -> list[Finding]:
    """Noise that is correlated for far longer than its prior says: it stands for what a simulator has wrong.

    Beside heat it is seldom: heat takes up what lasts.
    """
    places = {
        quantity.name: quantity
        for quantity in run.calibrated
        if quantity.kind == "noise" and quantity.name.endswith(_MEMORY)
    }
    out_by = {name: prior_score for name, prior_score in run.prior_scores.items() if name in places}
    conflict = _conflict(out_by) if run.heat is None else None
    named = [name for name in conflict[1] if out_by[name].prior_score > 0.0] if conflict else []
    if not named:
        return []
    lasts = {name.removesuffix(_MEMORY).removeprefix("noise."): duration(places[name].mean) for name in named}
    worst, *others = lasts
    of_all = listed([f"{channel} ({long})" for channel, long in lasts.items()])
    text = (
        f"The noise is correlated for {of_all}; its prior has {duration(places[named[0]].before)}. An error of the "
        "simulator that lasts does that, and is taken for chance: values may all be off together."
    )
    title = f"What is left over of {worst} lasts for {lasts[worst]}"
    title += f", and that of {len(others)} more lasts too" if others else ""
    return [Finding("warn", title, text, not_for=("intervals of parameters",), then=CHECK)]


def _conflict(out_by: dict[str, PriorScore], parameters: Sequence[str] = ()) -> tuple[State, list[str]] | None:
    """How bad it is that normal scores are so far out, and which are to be named; None: as is to be expected.

    parameters: those of them, which are judged beside each other: what is believed of them is seldom a mere guess.
    """
    if not out_by:
        return None
    by_usual = {name: abs(prior_score.prior_score) / prior_score.usual_score for name, prior_score in out_by.items()}
    beside = {name: len(parameters) if name in parameters else len(out_by) for name in out_by}
    alone = {name: 2.0 * float(norm.sf(score)) * beside[name] for name, score in by_usual.items()}
    together = float(chi2.sf(sum(prior_score.prior_score**2 for prior_score in out_by.values()), len(out_by)))
    order = sorted(out_by, key=lambda name: -by_usual[name])
    off = [name for name in order if alone[name] < OFF]
    if not off and together >= OFF:
        return None
    return "bad" if min([together, *alone.values()]) < FAR_OFF else "warn", off or order[:MOST_NAMED]


def _out_by(out_by: dict[str, PriorScore], named: list[str]) -> str:
    return listed([f"{name} ({_far(out_by[name])})" for name in named[:MOST_NAMED]])


def _far(prior_score: PriorScore) -> str:
    """In words; where the telemetry hardly narrows the prior, also what it can move it by."""
    words = f"{abs(prior_score.prior_score):.1f} deviations {'above' if prior_score.prior_score > 0 else 'below'}"
    if prior_score.usual_score > _NARROWED_MUCH:
        return words
    return f"{words}, and so little narrower than its prior that {prior_score.usual_score:.1f} is usual"


def _far_title(out_by: dict[str, PriorScore], named: list[str]) -> str:
    if named[1:]:
        return f"{len(named)} values lie far from where their priors expect them, worst {named[0]}"
    prior_score = out_by[named[0]]
    title = f"{named[0]} lies {abs(prior_score.prior_score):.1f} deviations from where its prior expects it"
    return (
        title if prior_score.usual_score > _NARROWED_MUCH else f"{title}, where {prior_score.usual_score:.1f} is usual"
    )


def resting(run: RunFiles) -> list[Finding]:
    """Values that are much less well known if fixed numbers are off: they bear on no prediction, and are no fault."""
    found = [
        quantity for quantity in run.calibrated if quantity.kind == "parameter" and quantity.times_as_wide > _RESTS
    ]
    if run.fixed_numbers is None or not found:
        return []
    found.sort(key=lambda quantity: -quantity.times_as_wide)
    within, footings = percent(run.fixed_numbers.within, 0), run.fixed_numbers.footings
    details = tuple(
        f"{quantity.name}: {number(quantity.times_as_wide, 2)} times as wide"
        + (
            f", most by {listed(on)}."
            if (on := [each.number for each in footings if each.name == quantity.name])
            else "."
        )
        for quantity in found
    )
    text = (
        f"With capacities, areas, links and other fixed numbers that are uncertain by {within}, these intervals are "
        f"more than {_RESTS:g} times as wide. No fit shows such an error: the values make up for it, and temperatures "
        "are right all the same."
    )
    title = f"What is known of {shortened([quantity.name for quantity in found])} rests on fixed numbers"
    return [Finding("good", title, text, details)]


def time_tags(run: RunFiles) -> list[Finding]:
    """An error that all time tags have in common, where the telemetry shows one: what follows allows for it."""
    found = [
        quantity
        for quantity in run.calibrated
        if quantity.kind == "time" and not quantity.lower <= 0.0 <= quantity.upper
    ]
    return [_time_tags(quantity) for quantity in found]


def _time_tags(quantity: Calibrated) -> Finding:
    # A reading of an earlier time than its tag says has a tag that is late.
    late = quantity.mean < 0.0
    lower, upper = sorted((abs(quantity.lower), abs(quantity.upper)))
    size = f"{number(abs(quantity.mean), 2)} s {'late' if late else 'early'}"
    text = (
        f"All temperatures seem to be of a time {number(lower, 2)} to {number(upper, 2)} s "
        f"{'earlier' if late else 'later'} than their tags say (95%). A clock, an orbit that is off along its "
        "track, or sensors that follow their nodes slowly do that. Values and intervals allow for it."
    )
    return Finding("good", f"Time tags are about {size}", text)
