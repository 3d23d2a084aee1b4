"""Kinds of noise of a channel: one file each, and one line here."""

from __future__ import annotations

from ...errors import ScenarioError
from ...scenario import Noise
from .ar1 import Correlated
from .iid import Independent
from .kind import NoiseKind
from .rounded import Rounded
from .student import CorrelatedStudent, Student

INDEPENDENT: NoiseKind = Independent()
"""The published likelihood's, and what a search for the mode begins with."""

KINDS: tuple[NoiseKind, ...] = (
    INDEPENDENT,
    Correlated(),
    Student(),
    CorrelatedStudent(),
    Rounded(),
)

MOST_NUMBERS = max(len(kind.names) for kind in KINDS)
"""Of any kind."""


def kind_of_noise(written: Noise) -> NoiseKind:
    """The kind that a scenario says. Raises ScenarioError where there is none of that model and distribution."""
    for kind in KINDS:
        if kind.written == (written.model, written.distribution, written.quantisation is not None):
            return kind
    kinds = ", ".join(kind.words for kind in KINDS)
    raise ScenarioError(f"noise: found {written.model} noise that is {written.distribution}, expected one of {kinds}")


def called(words: str) -> NoiseKind:
    """The kind of that name."""
    return next(kind for kind in KINDS if kind.words == words)
