"""How are the values of parameters to be read?"""

from __future__ import annotations

from ...calibration import Calibrated
from ...words import listed, number, percent
from ..panels.discrepancy import STANDS_IN, stand_ins
from ..panels.parameters import shortened
from ..run_files import RunFiles
from .finding import CHECK, Finding, value_of

_RESTS = 2.0
"""Times as wide as it is, an interval that is wider than that if fixed numbers are off is named."""


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
