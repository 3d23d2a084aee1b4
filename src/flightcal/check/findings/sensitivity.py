"""What the likelihood depends on, and what it bounds alone."""

from __future__ import annotations

import math

import numpy as np

from ...report import Finding
from ...words import listed, percent
from ..evaluate import runs_for_draws
from ..profile import Profile
from ..sensitivity import LIKELIHOOD
from .checked import Checked

_IDLE = 0.01
"""Total index below which an output does not depend on a parameter."""


def sensitivity(checked: Checked) -> Finding:
    """What the likelihood depends on most over the whole prior."""
    found = checked.sensitivity
    least = 4 * (len(found.names) + 2)
    if found.runs - found.failed < least:
        return Finding("none", "Sensitivities are not known", _too_few(checked, least))
    strength = np.minimum(found.strongest[found.outputs.index(LIKELIHOOD)], 1.0)
    leaders = [k for k in np.argsort(-strength)[:3] if strength[k] > _IDLE]
    shares = listed([f"{found.names[k]} ({percent(strength[k], 0)})" for k in leaders])
    idle = [n for n, s in zip(found.names, found.strongest.max(axis=0), strict=True) if s < _IDLE]
    text = f"Share of the likelihood's variance (of its rank): {shares}." if leaders else ""
    if idle:
        text += (
            f" Next to what these do, {listed(idle)} {'do' if len(idle) > 1 else 'does'} nothing over the whole prior "
            "(less than 1% of any output's variance); nearer to the best fit the telemetry may tell all the same."
        )
    names = listed([found.names[k] for k in leaders]) or "no parameter"
    return Finding("good", f"Over the whole prior the likelihood depends most on {names}", text.strip())


def _too_few(checked: Checked, least: int) -> str:
    """Why there are too few simulations, of which a check needs at least so many in each window."""
    runs = checked.sensitivity.runs
    if checked.sensitivity.failed:
        return "Too few simulations finished."
    enough = runs_for_draws(least, len(checked.starts))
    return f"They need {least} simulations over the prior, and there are {runs}: check again with `--runs {enough}`."


def profile(checked: Checked, likelihood_profile: Profile) -> Finding:
    """What the likelihood alone says of a parameter."""
    lower, upper = (
        checked.value(likelihood_profile.name, v) if math.isfinite(v) else "open"
        for v in (likelihood_profile.lower, likelihood_profile.upper)
    )
    text = f"95% interval by its profile: {lower} to {upper}, all others fitted again."
    if likelihood_profile.told:
        return Finding("good", f"The likelihood alone bounds {likelihood_profile.name}", text)
    text += " Without the priors the profile stays within 1.92 nats on one side or both."
    return Finding("warn", f"The likelihood alone does not bound {likelihood_profile.name}", text)
