"""Are the residuals the noise that was assumed?"""

from __future__ import annotations

from ...probability import INDEPENDENT
from ...validation import ResidualCheck
from ...words import listed, number
from ..panels.residuals import TESTED, assumption, channels, correlation_expected, noises
from ..run_files import RunFiles
from .finding import CHECK, OFF, Finding

NARROWED = 1.3
"""Factor up to which residuals that are not quite the noise that is assumed are of no practical weight."""


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
