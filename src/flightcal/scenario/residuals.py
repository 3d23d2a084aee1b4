"""How telemetry may differ from the simulation: the blocks of noise, discrepancy and heater status."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from .fields import Block, Count, OneOf, exactly_one
from .priors import (
    FORMS,
    HalfNormal,
    LogNormal,
    Prior,
    Uncertain,
    UncertainDeviation,
    UncertainDuration,
    UncertainNumber,
    Uniform,
)
from .units import Duration, Quantity


class SwitchTimes(Block):
    """The times at which a heater switches, known to lie between samples of its status."""

    timing: UncertainDuration = LogNormal(median=20.0, factor=2.0)
    """Standard deviation of a switch's time around the simulated one, s: control cycle, delays and what the simulator
    lacks; a prior (inferred) or a known value."""
    error_rate: Annotated[Prior | float, Uncertain("", above=0.0, at_most=0.5)] = 1e-3
    """Share of status samples that are wrong, whatever the timing; a prior (inferred) or a known value."""


class DutyCycle(Block):
    """The share of time in which a heater is on."""

    over: Duration | None = None
    """Length of the stretches over which it is taken, from the window's start; null: the window."""
    standard_deviation: Annotated[float, Quantity("", above=0, at_most=1)] = 0.02


class StatusLikelihood(Block):
    """How a heater's measured status counts in the likelihood."""

    switch_times: SwitchTimes | None = None
    duty_cycle: DutyCycle | None = None

    @model_validator(mode="after")
    def _one_form(self) -> StatusLikelihood:
        return exactly_one(self, ("switch_times", "duty_cycle"), "exactly one of 'switch_times' and 'duty_cycle'")


NEEDS = {
    "correlation_time": ("model", "ar1"),
    "white": ("model", "ar1"),
    "degrees_of_freedom": ("distribution", "student_t"),
}
"""Numbers of noise, and what they go with alone."""
NOT_NORMAL = {"student_t": "Student's t"}
"""Distributions of noise beside which no weights can be integrated out, and what they are called."""


class Noise(Block):
    """Noise of temperature channels: independent or correlated from sample to sample, normal or with outliers."""

    model: Literal["iid", "ar1"] = "iid"
    """iid: independent; ar1: its correlation over a gap of the telemetry is exp(-gap / correlation_time)."""
    distribution: Literal["normal", "student_t"] = "normal"
    """student_t: heavy tails, for outliers; with ar1, of the innovations."""
    standard_deviation: UncertainDeviation = HalfNormal(scale=2.0)
    """At one sample, K; of student_t: its scale."""
    correlation_time: UncertainDuration = LogNormal(median=600.0, factor=2.0)
    """Of ar1, s; what lasts longer is a discrepancy's."""
    white: UncertainDeviation | None = None
    """Standard deviation of independent noise beside that of ar1, K; null: none."""
    degrees_of_freedom: UncertainNumber = 4.0
    """Of student_t."""
    quantisation: Annotated[float, Quantity("K", above=0, difference=True)] | None = None
    """Step to which the telemetry is rounded: the likelihood is the probability of the whole step (iid normal only)."""

    @property
    def not_normal(self) -> str | None:
        """What it is called where it is not normal."""
        return "quantised" if self.quantisation is not None else NOT_NORMAL.get(self.distribution)


class PhaseDiscrepancy(Block):
    """Discrepancy that comes again in every orbit: a Matern process around the orbit; it carries to other windows."""

    amplitude: UncertainDeviation = HalfNormal(scale=1.0)
    """Prior standard deviation, K; it keeps the discrepancy from taking the parameters' place."""
    lengthscale: UncertainNumber = Uniform(lower=0.05, upper=0.5)
    """Orbits, with two bounds."""
    smoothness: Literal["3/2", "5/2"] = "3/2"
    harmonics: Count = Field(8, ge=1, le=100)
    shared: tuple[Literal["amplitude", "lengthscale"], ...] = ("lengthscale",)
    """What all channels have in common."""


class Discrepancy(Block):
    """What the simulator lacks, calibrated together with the parameters."""

    phase: PhaseDiscrepancy
    channels: tuple[str, ...] = ()
    """Temperature channels that have one; none named: all."""


def _discrepancy_kind(value: Any) -> Any:
    return Discrepancy if isinstance(value, dict) else Literal["none"] if value == "none" else None


WrittenDiscrepancy = Annotated[
    Discrepancy | Literal["none"], OneOf(_discrepancy_kind, "none, or a mapping of 'phase' and 'channels'")
]


def _noise_kind(value: Any) -> Any:
    is_prior = isinstance(value, dict) and len(value) == 1 and set(value) <= set(FORMS)
    return Noise if isinstance(value, dict) and not is_prior else UncertainDeviation


ChannelNoise = Annotated[Noise | UncertainDeviation, OneOf(_noise_kind, "noise")]
