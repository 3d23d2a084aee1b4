"""The blocks of a reduction file: what is reduced, for which parameters and windows, and how good it must be."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from ..operational import Command
from ..scenario import Block, Calibration, Count, Duration, Kelvins, Number, Quantity, Stretch, Window


class FlightWindow(Stretch):
    """A stretch of flight that is simulated, and the mode changes in it."""

    timeline: tuple[Command, ...] | None = None
    """Seconds after the window's start; null: the spacecraft's own, counted from there."""


class Runs(Block):
    """Simulations of the full network: prior draws in every window."""

    seed: Annotated[Count, Field(ge=0, lt=2**32)] = 1
    draws: Count = Field(24, ge=2)
    """Of the parameters, in each window."""
    windows: dict[str, FlightWindow] = Field(min_length=1)


class Projection(Block):
    """Projection on the shapes that the network's temperatures take (POD-Galerkin)."""

    states: Annotated[Count, Field(ge=1)] | None = None
    """null: as few as keep the tolerance."""
    most_states: Count = Field(12, ge=1)
    settled: Annotated[Count, Field(ge=0)] = 6
    """Further shapes that settle at once, where that is better than none: they cost time, but no states."""
    sampled_nodes: Annotated[Count, Field(ge=1)] | None = None
    """At which radiation is evaluated, the model's own where so many of them radiate; null: two more than states."""
    follow_within: Duration = 300.0
    """Time constant up to which a node that exchanges heat by radiation only follows at once: fewer states, 0.05 K."""


class Reduction(Block):
    """The whole file."""

    name: str
    description: str = ""
    spacecraft: str
    """Spacecraft file, from this file's folder."""
    method: Literal["projection"] = "projection"
    parameters: dict[str, Any] = Field(min_length=1)
    """As in a scenario; in the paths `*` stands for any text, `?` for one character."""
    sensors: tuple[str, ...] = ()
    """Thermistors that the reduced model gives; none: all that are sent to ground."""
    tolerance: Kelvins = 0.3
    """95% of the absolute errors on unseen runs stay below."""
    step: Duration | None = None
    """Longest time step of the reduced model; by default as long as the tolerance on its error allows."""
    settling: Duration | None = None
    """At the beginning of every run, in which initial temperatures fade, not looked at; null: one orbit."""
    initial_spread: Kelvins = 5.0
    """Standard deviation of the initial temperatures of the runs."""
    pulse_width_band: Annotated[float, Quantity("K", above=0, difference=True)] = 0.2
    """Width of the hysteresis that stands for control by pulse width."""
    training: Runs
    held_out: Runs
    telemetry: str = "telemetry.csv"
    """What `flightcal fly` writes, from this file's folder: for the scenario that is written beside the model."""
    windows: dict[str, Window] = Field(default_factory=dict)
    """Of that scenario; none: two orbits after the settling, and the next two."""
    calibration: Calibration = Calibration()
    """Of that scenario."""
    quantile: Annotated[Number, Field(gt=0, lt=1)] = 0.95
    """Share of the errors that the tolerance is for."""
    projection: Projection = Projection()
