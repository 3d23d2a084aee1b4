"""Are values where their priors expect them?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.stats import chi2, norm

from ...calibration import PriorScore
from ...words import duration, listed
from ..panels.parameters import MOST_NAMED
from ..run_files import RunFiles
from .finding import CHECK, OFF, Finding, State, value_of
from .unmodelled import unmeasured

_SHORT = 0.25
"""Of the time between samples: no packet says when in it a sensor was read."""
_NARROWED_MUCH = 0.8
"""Usual deviation of a normal score, from which that is worth no word."""
_GUESSED, _BENDS = 4.0, 0.5
"""Deviations of a prior that is a guess, and those of the value that it bends, from which it matters."""
_MEMORY = ".correlation_time"
FAR_OFF = 1e-6
"""The probability below which a model is called wrong."""


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
        not_for = (*unmeasured(run, heaters), *not_for)
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
