"""Heat that the simulator does not know of: the block `heat`."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from .fields import Block, Count, Number, OneOf
from .units import Duration


class HeatPattern(Block):
    """Heat that comes again: in every orbit, or at the same value of a driver."""

    harmonics: Count = Field(6, ge=0, le=24)
    """Of the orbit, beside the constant."""
    over: str | None = None
    """The driver channel, such as an angle to the Sun, of which it is a function in the place of the orbit's phase."""
    scale: Number = Field(0.05, gt=0)
    """Of the half-normal prior of its size, over the heat that flows through the node."""

    @model_validator(mode="after")
    def _one_argument(self) -> HeatPattern:
        if self.over is not None and "harmonics" in self.model_fields_set:
            raise ValueError("found 'harmonics' beside 'over', expected one of them: harmonics are of the orbit")
        return self


class HeatGains(Block):
    """Relative errors of modes, loads, absorbed sunlight, albedo and infrared."""

    scale: Number = Field(0.05, gt=0)
    """Of the half-normal prior of their size."""


class HeatSlow(Block):
    """Heat that drifts, and a pattern that wanders: Ornstein-Uhlenbeck processes."""

    time: Duration | None = None
    """Their correlation time, s; None: 3 h, and one orbit where a pattern comes again in longer ones."""
    scale: Number = Field(0.005, gt=0)
    """Of the prior of the drift's size, over the heat that flows through the node."""
    of_pattern: Number = Field(0.1, gt=0)
    """By how much the constant and each harmonic of the pattern wander, over the pattern's size."""


class Heat(Block):
    """Unmodelled heat of nodes, calibrated together with the parameters."""

    nodes: tuple[str, ...] = ()
    """Nodes that have it; none named: all that have a capacity."""
    pattern: HeatPattern | None = HeatPattern()
    """null: none."""
    gains: HeatGains | None = HeatGains()
    """null: none."""
    slow: HeatSlow | None = HeatSlow()
    """null: none."""

    @model_validator(mode="after")
    def _some_part(self) -> Heat:
        if self.pattern is None and self.gains is None and self.slow is None:
            raise ValueError("found neither 'pattern' nor 'gains' nor 'slow', expected one of them, or 'heat: none'")
        return self


def _heat_kind(value: Any) -> Any:
    return Heat if isinstance(value, dict) else Literal["none"] if value == "none" else None


WrittenHeat = Annotated[
    Heat | Literal["none"], OneOf(_heat_kind, "none, or a mapping of 'nodes', 'pattern', 'gains' and 'slow'")
]
