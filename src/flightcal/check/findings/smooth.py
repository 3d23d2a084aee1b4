"""Whether NUTS can follow the log density: its gradient, and its jumps."""

from __future__ import annotations

import numpy as np

from ...report import Finding
from ...words import listed, moment, number
from ..smoothness import REACH, TOLERANCE, DensityJump
from .checked import Checked

_SERIOUS = 1.0
"""Nats from which a jump hinders a sampler."""
_CLIFF = 100.0
"""Nats beyond which nothing of the posterior is left on the lower side."""
_NEAR = 2.0
"""Standard deviations within which most of the posterior is."""


def gradient(checked: Checked) -> list[Finding]:
    """Whether derivatives agree with differences."""
    errors = checked.smoothness.gradient
    if not errors:
        text = "The simulator has no derivatives; it will be calibrated through an emulator."
        return [Finding("none", "There is no gradient to check", text)]
    wrong = sorted((e for e in errors if e.error > TOLERANCE), key=lambda e: -e.error)
    if not wrong:
        worst = max(errors, key=lambda e: e.error)
        text = (
            f"At {checked.smoothness.points} points it agrees with differences of the log density to "
            f"{number(worst.error, 2)} ({worst.name}; in nats per standard deviation)."
        )
        return [Finding("good", "The gradient is right", text)]
    details = tuple(
        f"{e.name}: given {number(e.gradient)}, by differences {number(e.difference)} (on the unconstrained scale)."
        for e in wrong
    )
    text = (
        "NUTS follows the gradient: with a wrong one it rejects or gets lost. If the simulator is yours, check its "
        "derivatives; if it is flightcal's, report this."
    )
    return [Finding("bad", f"The gradient is wrong for {listed([e.name for e in wrong])}", text, details)]


def jumps(checked: Checked) -> list[Finding]:
    """Where a heater that switches once more makes the log density jump."""
    smoothness = checked.smoothness
    found = smoothness.jumps
    several = [scan.name for scan in smoothness.scans if len(set(scan.sequence)) > 1]
    where = f"within {REACH:g} standard deviations of the posterior"
    if not smoothness.located:
        text = f"{len(smoothness.scans[0].place)} points along each parameter are too few to find jumps."
        if several:
            text += (
                f" Along {listed(several)} the heaters switch another number of times; each such change may be a jump."
            )
        return [Finding("warn" if several else "none", "Jumps were not looked for", text)]
    if not found:
        text = f"Scans along every parameter find no jump of a tenth of a nat or more {where}."
        if several:
            text += f" Along {listed(several)} the heaters do switch another number of times."
        return [Finding("good", "The log density is smooth", text)]
    serious = [jump for jump in found if abs(jump.nats) >= _SERIOUS and abs(jump.place) <= _NEAR]
    causes = sorted({jump.heater for jump in found if jump.heater})
    title = f"The log density jumps by {_nats(found[0].nats, 'up to ')} {where}"
    text = (
        f"Along {listed(sorted({jump.name for jump in found}))}. "
        + (
            f"There the trajectory grazes a threshold of {listed(causes)}, and on one side switches once more. "
            if causes
            else "No heater switches otherwise there: look for a discontinuity in the simulator. "
        )
        + "A sampler that crosses such a place diverges, or stays on one side of it. Choose a window in which the "
        "sensor keeps clear of its threshold, or drive the heaters by their measured status (heater_input: measured)."
    )
    return [Finding("bad" if serious else "warn", title, text, tuple(jump_words(checked, jump) for jump in found))]


def jump_words(checked: Checked, jump: DensityJump) -> str:
    """A jump with its place and its cause."""
    words = (
        f"{jump.name} at {checked.value(jump.name, jump.theta)} ({number(jump.place, 2)} standard deviations from the "
        f"mode): {'up' if jump.nats > 0 else 'down'} by {_nats(jump.nats)} as it grows"
    )
    if not jump.heater:
        return words + "."
    time = checked.starts[jump.window] + np.timedelta64(round(1e3 * jump.seconds), "ms")
    below, above = jump.switches
    return (
        f"{words}; {jump.heater} switches {below} times below and {above} above: the runs part at {moment(time)} UTC."
    )


def _nats(value: float, before: str = "") -> str:
    """The size of a jump; of a cliff only that it is one."""
    return f"more than {_CLIFF:.0f} nats" if abs(value) > _CLIFF else f"{before}{number(abs(value), 2)} nats"
