"""Whether the prior reaches the telemetry, and can be simulated."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ...report import Finding
from ...words import listed, number, percent
from ..prior_predictive import EDGE, ChannelReach
from .checked import Checked

_REACHED = 0.5
"""Share of a channel's telemetry that the prior must reach."""
_MOSTLY = 0.95
"""The same, from which it is nearly all."""
_NO_MATTER = 0.3
"""K, up to which telemetry may leave what the prior gives, as far as it mostly does not."""
_FAILURES = 0.05
"""Share of the prior that may fail to be simulated."""


def reaches(checked: Checked) -> bool:
    """Whether the prior reaches much of every channel's telemetry."""
    return all(channel.reached >= _REACHED for channel in checked.predictive.channels)


def reach(checked: Checked) -> list[Finding]:
    """Telemetry and duty cycles that the prior leaves out, and parameters that are pulled to its edge."""
    found = []
    predictive = checked.predictive
    missed = _worst_first(c for c in predictive.channels if c.reached < _REACHED)
    partly = _worst_first(
        c for c in predictive.channels if _REACHED <= c.reached < _MOSTLY and abs(c.beyond) > _NO_MATTER
    )
    details = tuple(
        f"{checked.named(c.channel, c.window)}: {percent(c.reached)} of the telemetry is reached; at most it is "
        f"{number(abs(c.beyond), 3)} K {'above' if c.beyond > 0 else 'below'} all that the prior gives."
        for c in (*missed, *partly)
    )
    if missed:
        names = listed([checked.named(c.channel, c.window) for c in missed])
        text = (
            "No parameters that the prior holds likely bring the simulator there, whatever the noise. "
            "Look for a wrong unit, offset or load in the model first; then widen the priors of what drives "
            f"{'it' if len(missed) == 1 else 'them'}: {_drivers(checked, [c.channel for c in missed])}."
        )
        found.append(Finding("bad", f"The prior cannot reach the telemetry of {names}", text, details))
    elif partly:
        names = listed([checked.named(c.channel, c.window) for c in partly])
        text = "The model, or a prior that is too narrow, leaves parts of the telemetry out."
        found.append(Finding("warn", f"The prior does not reach all telemetry of {names}", text, details))
    out = [heater for heater in predictive.heaters if not heater.reached]
    if out:
        names = listed([checked.named(h.heater, h.window) for h in out])
        found.append(
            Finding(
                "warn",
                f"The prior does not reach the duty cycle of {names}",
                "Power, thresholds or losses may be off.",
                tuple(
                    f"{checked.named(h.heater, h.window)}: on for {percent(h.observed)} of the time, the prior gives "
                    f"{percent(h.lower)} to {percent(h.upper)}." for h in out
                ),
            )
        )  # fmt: skip
    if predictive.pressed:
        best = "is best at" if checked.centre.is_mode else "goes, as far as the best fit was sought, to"
        text = "Data and prior disagree, or the parameter makes up for something that the model lacks. " + " ".join(
            f"{p.name} {best} {checked.value(p.name, p.theta)}, {_tail(p.probability)} of its prior."
            for p in predictive.pressed
        )
        if checked.heat is not None:
            text += " This search knows of no unmodelled heat. A calibration does, and may well not go there."
        title = f"The telemetry pulls {listed([p.name for p in predictive.pressed])} to the edge of the prior"
        found.append(Finding("warn", title, text))
    if not found:
        lowest = min(predictive.channels, key=lambda c: np.nan_to_num(c.inside, nan=np.inf))
        where = checked.named(lowest.channel, lowest.window)
        share = "All" if lowest.inside == 1.0 else f"At least {percent(lowest.inside)} ({where})"
        text = (
            f"{share} of each channel's telemetry lies inside the prior's 95% band, and no parameter is pulled to the "
            f"outer {EDGE:.0%} of its prior."
        )
        found.append(Finding("good", "The prior reaches the telemetry", text))
    return found


def _worst_first(channels: Iterable[ChannelReach]) -> list[ChannelReach]:
    """By the share that the prior reaches, then by how far it is off."""
    return sorted(channels, key=lambda c: (c.reached, -abs(c.beyond)))


def _tail(probability: float) -> str:
    share = min(probability, 1.0 - probability)
    shown = f"{100 * share:.1g}%" if share > 1e-5 else "less than 0.001%"
    return f"in the {'lowest' if probability < 0.5 else 'highest'} {shown}"


def _drivers(checked: Checked, channels: list[str]) -> str:
    """The parameters that matter most to some channels."""
    rows = [checked.sensitivity.outputs.index(channel) for channel in channels]
    strength = checked.sensitivity.strongest[rows].max(axis=0)
    chosen = [k for k in np.argsort(-strength)[:3] if strength[k] > 0.05]
    return listed([checked.sensitivity.names[k] for k in chosen]) or "none of the parameters moves it"


def failures(checked: Checked) -> list[Finding]:
    """How much of the prior cannot be simulated, and why."""
    predictive = checked.predictive
    if not predictive.failed:
        return []
    share = predictive.failed / predictive.draws
    why = "".join(f" {said[0].upper()}{said[1:]}." for said in predictive.why)
    text = (
        f"{predictive.failed} of {predictive.draws} simulations at prior draws fail.{why} Where one fails the "
        "posterior is cut off; narrow the priors to what the simulator can do."
    )
    state = "bad" if share > 0.5 else "warn" if share > _FAILURES else "good"
    return [Finding(state, f"{percent(share)} of the prior cannot be simulated", text)]  # type: ignore[arg-type]
