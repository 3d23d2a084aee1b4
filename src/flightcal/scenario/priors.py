"""What is believed of a number before there is telemetry: the blocks of priors."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, Tag

from ._fields import Block, Number, one_of


class Uniform(Block):
    """Uniform between two bounds."""

    kind: Literal["uniform"] = "uniform"
    lower: Number
    upper: Number


class Normal(Block):
    """Normal."""

    kind: Literal["normal"] = "normal"
    mean: Number
    standard_deviation: Number = Field(gt=0)


class TruncatedNormal(Block):
    """Normal cut at two bounds."""

    kind: Literal["truncated_normal"] = "truncated_normal"
    mean: Number
    standard_deviation: Number = Field(gt=0)
    lower: Number
    upper: Number


class LogNormal(Block):
    """Log-normal: about 68% of the probability lies between median / factor and median * factor."""

    kind: Literal["lognormal"] = "lognormal"
    median: Number = Field(gt=0)
    factor: Number = Field(gt=1)


class HalfNormal(Block):
    """Half-normal."""

    kind: Literal["half_normal"] = "half_normal"
    scale: Number = Field(gt=0)


class Beta(Block):
    """Beta distribution on [lower, upper]."""

    kind: Literal["beta"] = "beta"
    alpha: Number = Field(gt=0)
    beta: Number = Field(gt=0)
    lower: Number = 0.0
    upper: Number = 1.0


Prior = Uniform | Normal | TruncatedNormal | LogNormal | HalfNormal | Beta
UncertainTags = (
    Annotated[Uniform, Tag("<Uniform>")]
    | Annotated[Normal, Tag("<Normal>")]
    | Annotated[TruncatedNormal, Tag("<TruncatedNormal>")]
    | Annotated[LogNormal, Tag("<LogNormal>")]
    | Annotated[HalfNormal, Tag("<HalfNormal>")]
    | Annotated[Beta, Tag("<Beta>")]
    | Annotated[float, Tag("<number>")]
)
"""What an uncertain number may be, for unions that choose by `one_of`."""
Uncertain = Annotated[
    UncertainTags,
    one_of(lambda value: "<number>" if isinstance(value, (int, float)) else None, "a number with its unit, or a prior"),
]
"""A number that is known, or has a prior."""
