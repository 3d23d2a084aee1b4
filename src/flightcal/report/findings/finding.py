"""One statement of a verdict, and what a run is not to be used for in words."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Final, Literal

from ...words import listed
from ..panels.parameters import shortened

State = Literal["good", "warn", "bad", "none"]
ORDER: Final[tuple[State, ...]] = ("good", "none", "warn", "bad")
"""The best first."""

MARKS: dict[str, str] = {"good": "✓ good", "warn": "! caution", "bad": "✕ problem", "none": "– not in this run"}
"""State -> a sign and a word."""

CHECK = "flightcal check scenario.yaml --out checked"
AGAIN = "Run the same command again: it takes up where it stopped."
"""What to do next, as lines that can be copied."""
OFF = 0.01
"""Probability that a right model is cautioned about for one of its channels, priors or heaters."""
_VALUE = "the value of "
_TEMPERATURES = "temperatures of "


@dataclass(frozen=True)
class Finding:
    """One statement of the verdict. `state` gives its colour and, in words, its mark."""

    state: State
    title: str
    text: str
    details: tuple[str, ...] = ()
    not_for: tuple[str, ...] = ()
    """What the run is not to be used for because of it, where it is not good."""
    then: str = ""
    """What to do next, as a line that can be copied."""

    @property
    def mark(self) -> str:
        """The state as a sign and a word, so that it does not rest on colour."""
        return MARKS[self.state]


def value_of(name: str) -> str:
    """What a run is not to be used for where a parameter's value is in doubt."""
    return f"{_VALUE}{name}"


def valued(limit: str) -> str:
    """Of which parameter it is the value; "" of another use."""
    return limit.removeprefix(_VALUE) if limit.startswith(_VALUE) else ""


def temperatures_of(channel: str) -> str:
    """What a run is not to be used for where a channel's intervals do not hold."""
    return f"{_TEMPERATURES}{channel}"


def duty_of(heater: str) -> str:
    """What a run is not to be used for where a heater's duty cycle is in doubt."""
    return f"the duty cycle of {heater}"


def in_few_words(limits: Sequence[str], parameters: Collection[str] = ()) -> str:
    """What a run is not to be used for, each once, and of many channels or values the first.

    parameters: all that the run has.
    """
    limits = list(dict.fromkeys(limits))
    values = [limit.removeprefix(_VALUE) for limit in limits if limit.startswith(_VALUE)]
    channels = [limit.removeprefix(_TEMPERATURES) for limit in limits if limit.startswith(_TEMPERATURES)]
    said = [limit for limit in limits if not limit.startswith((_VALUE, _TEMPERATURES))]
    if channels:
        said.insert(0, f"{_TEMPERATURES}{shortened(channels)}")
    if parameters and len(values) > 1 and set(parameters) <= set(values):
        said.append("the values of its parameters")
    elif values:
        said.append(f"the value{'s' if len(values) > 1 else ''} of {shortened(values)}")
    return listed(said)
