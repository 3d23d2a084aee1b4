"""Windows of telemetry, alone or in groups: several to train on, several to test on."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, model_validator

from .document import Location
from .fields import Block, Number, Time, exactly_one


class Stretch(Block):
    """A stretch of time: start and either a number of orbits or an end."""

    start: Time
    orbits: Annotated[Number, Field(gt=0, le=1e6)] | None = None
    end: Time | None = None

    @model_validator(mode="after")
    def _one_length(self) -> Stretch:
        exactly_one(self, ("orbits", "end"), "exactly one of 'orbits' and 'end'")
        if self.end is not None and self.end <= self.start:
            raise ValueError(f"found end {self.end.isoformat()}, expected one after {self.start.isoformat()}")
        return self


class Window(Stretch):
    """A stretch of telemetry."""

    planned: bool = False
    """Of a time to come, of which there is no telemetry but of drivers that are planned: it is predicted, not scored.
    Once there is telemetry it is a window like others."""


def is_trained(window: str) -> bool:
    """Whether the window of this name is one to calibrate on."""
    return window.partition(".")[0] == "train"


def flat_windows(windows: Any, lines: dict[Location, int]) -> Any:
    """The block `windows` with ``<group>.<name>`` for the windows of a group, which is a list or a mapping of windows.

    Those of a list are called 1, 2, ...; lines get entries for the new names.
    """
    if not isinstance(windows, dict):
        return windows
    flat: dict[str, Any] = {}
    for name, block in windows.items():
        inside = _members(block)
        if inside is None:
            flat[name] = block
            continue
        for key, window in inside.items():
            label = key + 1 if isinstance(key, int) else key
            flat[f"{name}.{label}"] = window
            here: Location = ("windows", name, key)
            for location, line in list(lines.items()):
                if location[:3] == here:
                    lines["windows", f"{name}.{label}", *location[3:]] = line
    return flat


def grouped_windows(windows: dict[str, Any]) -> dict[str, Any]:
    """The reverse of `flat_windows`, as a user writes it."""
    grouped: dict[str, Any] = {}
    for name, window in windows.items():
        group, _, label = name.partition(".")
        if label:
            grouped.setdefault(group, {})[label] = window
        else:
            grouped[name] = window
    return grouped


def _members(block: Any) -> dict[Any, Any] | None:
    """The windows of a group; null: the block is a window."""
    if isinstance(block, list) and block:
        return dict(enumerate(block))
    if isinstance(block, dict) and block and all(isinstance(value, dict) for value in block.values()):
        return block
    return None
