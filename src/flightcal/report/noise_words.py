"""What is assumed of the residuals, in words."""

from __future__ import annotations

from collections.abc import Sequence

from flightcal.validation import ResidualCheck
from flightcal.validation.residuals import IID

from .text import listed, number

SHOWN = 0.1
"""Lag-1 autocorrelation above which residuals are called correlated as AR(1) noise expects."""

IID_IN_WORDS = "independent, identically distributed (iid) noise"

TESTED = (
    "Tested are its innovations, the part of each residual that those before it do not tell. Whether sensors or "
    "simulator err in this way, telemetry does not tell."
)


def assumption(of_window: Sequence[ResidualCheck]) -> str:
    """What is assumed of a window's residuals, in words."""
    noise = listed([IID_IN_WORDS if name == IID else name for name in noises(of_window)])
    discrepant = [c for c in of_window if c.discrepancy]
    if not discrepant:
        return noise
    of = "" if len(discrepant) == len(of_window) else f" of {listed([c.channel for c in discrepant])}"
    return f"{noise} beside a discrepancy{of} in {discrepant[0].discrepancy.replace('phase', 'orbit phase')}"


def noises(of_window: Sequence[ResidualCheck]) -> list[str]:
    """What kinds of noise are assumed, by name."""
    return list(dict.fromkeys(c.noise for c in of_window))


def correlation_expected(of_window: Sequence[ResidualCheck]) -> str:
    """That residuals are correlated as AR(1) noise expects; nothing where there is no such noise, or none are."""
    found = [c for c in of_window if c.tested == "innovations" and c.residual_lag1 > SHOWN]
    if not found:
        return ""
    return (
        f"The residuals of the mean of {channels(found, of_window)} are correlated (lag-1 autocorrelation "
        f"{spread([c.residual_lag1 for c in found])}), which the AR(1) noise expects."
    )


def spread(values: Sequence[float]) -> str:
    """``0.62`` or ``0.62 to 0.91``."""
    low, high = number(min(values), 2), number(max(values), 2)
    return low if low == high else f"{low} to {high}"


def channels(some: Sequence[ResidualCheck], every: Sequence[ResidualCheck]) -> str:
    """Names of some channels; how many they are where they are all."""
    if len(some) == len(every) > 2:
        return f"all {len(every)} channels"
    return listed([c.channel for c in some])
