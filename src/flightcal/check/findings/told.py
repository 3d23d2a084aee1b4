"""Which parameters, and which combinations of them, the telemetry tells."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ...report import Finding
from ...words import listed, number, percent
from ..identifiability import BLIND, Combination, Move
from .checked import Checked

_LARGE = 0.25
"""Relative change of a parameter from which it matters that the telemetry cannot tell."""


def centre(checked: Checked) -> list[Finding]:
    """Where what is said of the posterior holds, if not at its mode."""
    if checked.centre.is_mode:
        return []
    text = f"What follows holds at {checked.centre.words}, which may be far from the best fit."
    return [Finding("warn", "The mode was not found for sure", text)]


def identifiability(checked: Checked) -> list[Finding]:
    """What the telemetry cannot tell, and which parameters it tells together alone."""
    combinations = checked.identifiability.combinations
    of_noise = [
        combination for combination in combinations if all(name.startswith("noise.") for name in combination.names)
    ]
    alone = (
        combinations
        if len(of_noise) < 2
        else [combination for combination in combinations if combination not in of_noise]
    )
    # Of what is told of the same parameters twice, the first: of it the telemetry says least.
    told: dict[frozenset[str], Finding] = {}
    for combination in alone:
        told.setdefault(frozenset(combination.names), combination_finding(checked, combination))
    found = list(told.values())
    if len(of_noise) > 1:
        found.append(_noise_finding(checked, of_noise))
    correlated = checked.identifiability.correlated
    if correlated:
        shown = tuple(f"{a} and {b}: correlation {number(r, 3)}." for a, b, r in correlated)
        text = (
            "The telemetry tells their combination better than each of them. Sampling is whitened and copes; "
            "but their intervals are wide one by one, and neither should be read alone."
        )
        pairs = f"{len(correlated)} pair{'s' if len(correlated) > 1 else ''} of parameters"
        found.append(Finding("warn", f"{pairs} with a correlation beyond 0.95", text, shown))
    if not checked.identifiability.combinations:
        least = 1.0 / math.sqrt(1.0 + float(checked.identifiability.information[0]))
        widest = int(np.argmax(checked.identifiability.width))
        name, width = checked.identifiability.names[widest], float(checked.identifiability.width[widest])
        text = (
            f"In the least known direction the posterior is {percent(least, 0)} as wide as the prior; "
            f"of the parameters {name} is known least ({percent(width, 0)})."
        )
        title = "The telemetry tells every parameter, and every combination of them"
        if checked.heat is not None and any(imitation.matters for imitation in checked.heat.parameters):
            title = "Without unmodelled heat the telemetry tells every parameter, and every combination of them"
        found.insert(0, Finding("good", title, text))
    return found


def _noise_finding(checked: Checked, combinations: Sequence[Combination]) -> Finding:
    """What the data cannot tell of the noise of several channels: of each a line would hide what matters."""
    names = sorted({name for combination in combinations for name in combination.names})
    channels = sorted({name.split(".")[1] for name in names})
    text = (
        "How long its errors last, or how large they are, is then as the prior says: the parameters' intervals are "
        "little changed by that."
    )
    details = tuple(_trade(checked, combination) for combination in combinations)
    return Finding("warn", f"The telemetry says little of the noise of {listed(channels)}", text, details)


def combination_finding(checked: Checked, combination: Combination) -> Finding:
    """What the data cannot tell, with advice.

    It matters where parameters of the scenario hide each other and may be far off together; a parameter of which the
    telemetry says nothing harms neither the sampling nor the prediction.
    """
    names = list(combination.names)
    blind = combination.information < BLIND
    width = f"the posterior is {percent(combination.width, 0)} as wide as the prior"
    if combination.kind == "alone":
        name = names[0]
        title = f"The telemetry says {'next to nothing' if blind else 'little'} of {name}"
        advice = (
            "It starts where the telemetry does not look; a tighter prior costs nothing."
            if name.startswith("initial.")
            else "Fix it, or trust its prior: its posterior will be that."
        )
        return Finding("warn", title, f"Along it {width}. {advice}", (_trade(checked, combination),))
    product = " × ".join(names)
    what, advice = {
        "product": (
            f"{listed(names)} act alike: only their product is known",
            f"Fix one of them, or replace them by one parameter for {product}.",
        ),
        "ratio": (
            f"{listed(names)} make up for each other: only their ratio is known",
            "Fix one of them, or let one parameter scale both and another set their ratio.",
        ),
        "scale": (
            f"{listed(names)} can all be scaled together: only their ratios are known",
            "Fix one of them, at best the one that drawings or tests tell, or give it a prior that is tight.",
        ),
        "mixed": (
            f"{listed(names)} make up for one another",
            f"Fix or tie {names[0]}, or say more in its prior.",
        ),
    }[combination.kind]  # fmt: skip
    both = sum(checked.info(name).kind == "parameter" for name in names) >= 2
    title = what if blind else f"{what}, {'for the most part' if combination.kind == 'mixed' else 'or little more'}"
    text = f"Along this combination {width}. {advice}"
    large = any(abs(move.change) > _LARGE for move in combination.moves)
    return Finding("bad" if blind and both and large else "warn", title, text, (_trade(checked, combination),))


def _trade(checked: Checked, combination: Combination) -> str:
    moved = listed([_moved(checked, move) for move in combination.moves])
    return f"The telemetry hardly notices {moved}{' together' if len(combination.moves) > 1 else ''}."


def _moved(checked: Checked, move: Move) -> str:
    """A move in percent where that has a meaning, else from one value to another, such as of a threshold in degC."""
    if math.isfinite(move.exponent) and move.before > 0.0 and checked.info(move.name).offset == 0.0:
        change = 100.0 * move.change
        return f"{move.name} {number(change, 2) if change < 0 else '+' + number(change, 2)}%"
    return f"{move.name} from {checked.value(move.name, move.before)} to {checked.value(move.name, move.after)}"
