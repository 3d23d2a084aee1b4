"""A check as a page in the report's style."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..problem import Problem
from ..report import (
    GENETIC,
    PRIOR,
    STOCHASTIC,
    WARNING,
    Block,
    Cell,
    Finding,
    Section,
    Table,
    block,
    compose,
    figure_correlation,
)
from ..words import listed, number, percent
from . import figures as draw
from .findings import Checked, times, verdict_of
from .heat import ALIKE, WIDER, BesideHeat
from .suspicion import Suspects

_MOST_CORRELATED = 24
"""Parameters up to which the correlations are drawn."""


def render(checked: Checked, problem: Problem, findings: list[Finding], folder: Path, created: str) -> str:
    """The page as text."""
    passed, verdict = verdict_of(findings)
    first = Finding("good" if passed else "bad", verdict, f"Examined at {checked.centre.words}; {checked.budget}.")
    content = [
        Section("suspects", "What may be wrong", _suspects(checked.suspects)),
        Section("prior", "Prior predictive", _prior(checked, problem)),
        Section("identifiability", "Identifiability", _identifiability(checked)),
        *([] if checked.heat is None else [Section("heat", "Unmodelled heat", _heat(checked.heat))]),
        Section("sensitivity", "Sensitivity", _sensitivity(checked, problem)),
        Section("smoothness", "Smoothness", _smoothness(checked)),
        *([Section("profiles", "Profiles", _profiles(checked))] if checked.profiles else []),
    ]
    return compose("flightcal check", problem.scenario.name, folder, created, [first, *findings], content)


def _suspects(suspects: Suspects) -> list[Block]:
    text = (
        "Each simple wrong in turn was taken out of the telemetry of the first training window, or of the scenario. "
        "How probable the telemetry is with it is compared with how probable it is with nothing wrong but parameters, "
        "unmodelled heat of some percent, and noise. Only what is better by far is named."
        if suspects.looked
        else f"Only what the telemetry shows by itself was looked at: {suspects.why_not}."
    )
    if not suspects.found:
        return [block.text(f"{text} Nothing was found.")]
    rows = [
        [suspicion.title, suspicion.sentence, suspicion.advice, number(suspicion.nats or None, 3)]
        for suspicion in suspects.found
    ]
    header = ("what", "why", "what to do", "log odds against nothing wrong")
    return [block.text(text), block.table(Table(header, rows, (3,)))]


def _prior(checked: Checked, problem: Problem) -> list[Block]:
    predictive = checked.predictive
    rows = [
        [
            checked.named(c.channel, c.window),
            percent(c.inside),
            Cell(percent(c.reached), _state(c.reached)),
            _beyond(c.beyond),
        ]
        for c in predictive.channels
    ]
    names = [f"“{window.name}”" for window in problem.windows]
    blocks = [
        block.text(
            f"{predictive.draws} draws from the priors, simulated, against the telemetry of {listed(names)}. "
            "What the simulator can reach with the prior is the 99% band of its simulations, widened by twice the "
            "least noise that the prior holds plausible.",
        ),
        block.table(
            Table(
                ("channel", "inside the 95% band, with noise", "reached by the simulator", "beyond it at most, K"),
                rows,
                range(1, 4),
            ),
        ),
    ]  # fmt: skip
    if predictive.heaters:
        heaters = [
            [checked.named(h.heater, h.window), percent(h.observed), f"{percent(h.lower)} to {percent(h.upper)}"]
            for h in predictive.heaters
        ]
        header = ("heater", "duty cycle in telemetry", "prior's 95%")
        blocks.append(block.table(Table(header, heaters, range(1, 3))))
    for name, window, bands in zip(names, problem.windows, predictive.bands, strict=True):
        caption = f"Telemetry {f'of {name} ' if len(names) > 1 else ''}over the prior's bands."
        blocks.append(block.figure(draw.figure_predictive(window, bands), caption))
    return blocks


def _state(reached: float) -> str:
    return "bad" if reached < 0.5 else "warn" if reached < 0.95 else "good" if reached >= 0.95 else ""


def _beyond(value: float) -> str:
    return "–" if value == 0.0 else f"{number(abs(value), 3)} {'above' if value > 0 else 'below'}"


def _identifiability(checked: Checked) -> list[Block]:
    found = checked.identifiability
    blocks = [
        block.text(
            "All in units of the priors' standard deviations, on the scale on which the priors are about normal, in "
            "the Gaussian approximation of the posterior. A parameter whose open mark is far to the left of its filled "
            "one would be known well if others were known: it is hidden by a combination.",
        ),
        block.figure(draw.figure_widths(found), "Width of each parameter's posterior."),
        block.figure(
            draw.figure_spectrum(found),
            "Fisher information in every direction, in units of the prior's: how many times the telemetry counts for "
            "more than the prior. Crosses: it counts for less.",
        ),
        block.figure(
            draw.figure_directions(found),
            "What the least known directions are made of: weights in standard deviations of the priors.",
            wide=True,
        ),
    ]  # fmt: skip
    strength = np.abs(found.correlation - np.eye(len(found.names))).max(axis=0)
    chosen = np.sort(np.argsort(-strength)[:_MOST_CORRELATED])
    if len(chosen) > 1:
        correlation = found.correlation[np.ix_(chosen, chosen)]
        caption = "Correlation of the posterior, in the Gaussian approximation."
        names = [found.names[k] for k in chosen]
        blocks.append(block.figure(figure_correlation(names, correlation), caption, wide=True))
    return blocks


def _heat(found: BesideHeat) -> list[Block]:
    rows = [
        [
            imitation.name,
            imitation.node,
            Cell(f"{imitation.cosine:.2f}", "warn" if imitation.cosine > ALIKE else "good"),
            percent(imitation.without),
            percent(imitation.beside),
            Cell(times(imitation.growth), "warn" if imitation.growth > WIDER else "good"),
        ]
        for imitation in found.parameters
    ]
    header = ("parameter", "most like heat in", "cosine", "width without heat", "width with heat", "times as wide")
    return [
        block.text(
            "What heat that no block of the scenario describes takes from the parameters, in the linear approximation. "
            "Heat has its prior's size; where the telemetry shows less, it takes less. The cosine is between a "
            "parameter's effect on the temperatures and what heat in one node can do: near 1, it can do the same. "
            "Widths are those of the posterior, as a share of the prior's.",
        ),
        block.table(Table(header, rows, range(2, 6))),
    ]  # fmt: skip


def _sensitivity(checked: Checked, problem: Problem) -> list[Block]:
    found = checked.sensitivity
    kind = "total" if np.isfinite(found.indices.total).any() else "first-order"
    error = found.indices.total_error if kind == "total" else found.indices.first_error
    units = ["K"] * len(problem.channels) + ["of the time"] * len(problem.heaters)
    moved = [f"{number(float(d), 3)} {u}" for d, u in zip(found.deviation, units, strict=False)]
    rows = [[output, text] for output, text in zip(found.outputs, moved, strict=False)]
    return [
        block.text(
            f"{found.method}, {found.runs} simulations over the whole prior ({found.failed} failed). Outputs: RMS "
            "temperature change of each channel against the point that was examined, duty cycle of each heater, and "
            "the log likelihood by its rank, noise levels held. "
            f"A {kind} index is the share of an output's variance that a parameter "
            f"{'takes part in, alone or with others' if kind == 'total' else 'causes alone'}. "
            f"Their 95% error is up to {number(float(np.nanmax(error)), 2)}.",
        ),
        block.figure(draw.figure_sensitivity(found), f"Sensitivity, {kind} indices.", wide=True),
        block.folded("How far the prior moves each output", Table(("output", "deviation"), rows, (1,))),
    ]  # fmt: skip


def _smoothness(checked: Checked) -> list[Block]:
    found = checked.smoothness
    key = (
        ("log density", STOCHASTIC, "line"),
        ("Gaussian approximation", PRIOR, "dash"),
        ("heaters switch otherwise", GENETIC, "dash"),
        ("jump", WARNING, "mark"),
    )
    shown = tuple(draw.figure_scan(scan, checked.info(scan.name)) for scan in found.scans)
    caption = (
        "Log density along every parameter, relative to the point examined; the others follow as they are correlated "
        "with it. On each side of a dotted line the heaters switch another number of times."
    )
    blocks = [block.grid(shown, caption, key)]
    if found.gradient:
        rows = [
            [e.name, number(e.error, 2), number(e.gradient, 5), number(e.difference, 5)]
            for e in sorted(found.gradient, key=lambda e: -e.error)
        ]
        header = ("parameter", "largest error, nats per sd", "gradient there", "by differences")
        title = f"The gradient against differences at {found.points} points"
        if found.left_out:
            title += f" ({found.left_out} derivatives left out: the heaters switch otherwise next to the point)"
        blocks.append(block.folded(title, Table(header, rows, range(1, 4))))
    return blocks


def _profiles(checked: Checked) -> list[Block]:
    key = (("log density", STOCHASTIC, "line"), ("likelihood alone", PRIOR, "dash"))
    shown = tuple(draw.figure_profile(profile, checked.info(profile.name)) for profile in checked.profiles)
    caption = (
        "Profiles: all other parameters fitted again at every point. Dotted: 1.92 nats below the best, a 95% interval."
    )
    return [block.grid(shown, caption, key, large=True)]
