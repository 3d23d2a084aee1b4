"""The problem file as immutable objects: what a scenario may say, in SI and kelvin.

Every class mirrors one block of the YAML file. Numbers with a dimension are written with their unit and are
SI floats here; times are UTC. Cross-references between blocks are checked in `lint`, not here.
"""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from ._units import Angle, Duration, Temperature, quantity


class Block(BaseModel):
    """A block of the scenario file: immutable, and an unknown key is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid")


def _utc(value: Any) -> Any:
    """ISO 8601 text as a naive UTC datetime."""
    if isinstance(value, str):
        try:
            value = datetime.fromisoformat(value.strip())
        except ValueError:
            raise ValueError(f"found {value!r}, expected a UTC time such as 2024-03-01T00:00:00") from None
    if not isinstance(value, datetime):
        raise ValueError(f"found {value!r}, expected a UTC time such as 2024-03-01T00:00:00")
    if value.tzinfo is not None:
        offset = value.utcoffset()
        value = value.replace(tzinfo=None) - (offset or value.utcoffset() or (value - value))
    return value


Time = Annotated[datetime, BeforeValidator(_utc)]
Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


def _as_tuple(value: Any) -> Any:
    return (value,) if isinstance(value, str) else value


Names = Annotated[tuple[str, ...], BeforeValidator(_as_tuple), Field(min_length=1)]


# --- telemetry ------------------------------------------------------------------------------------------------


class TimeColumn(Block):
    """Where the time stamps are and how they are written."""

    column: str
    format: Literal["iso8601", "unix", "year-doy"] = "iso8601"


class Channel(Block):
    """One telemetry channel: its column (or several, combined), unit, and what counts as invalid."""

    column: Names
    combine: Literal["mean", "sum", "product"] | None = None
    kind: Literal["temperature", "status", "driver"]
    unit: str | None = None
    """Unit as the file has it; for a product of columns, the unit of the product (``mA * mV``)."""
    valid_range: tuple[str | float, str | float] | None = None
    """Lowest and highest believable value, with units (for a driver without a unit, plain numbers)."""
    invalid: tuple[float | str, ...] = ()
    """Marker values of the ground system, as they stand in the file."""
    on: tuple[float | str, ...] = (1, "1", "ON", "on", "On", "true", "True", "TRUE")
    """For a status: the values that mean on."""
    stale_after: int | None = 6
    """This many identical values in a row of all channels that do not normally repeat are a frozen row; null: off."""
    fill: Literal["interpolate", "previous_orbit"] = "interpolate"
    """For a driver: how its gaps are bridged."""


class TelemetryFile(Block):
    """The flight data: one file or several, one time column, the channels."""

    file: Names
    time: TimeColumn
    average: Duration | None = None
    """Block mean over this long; null: every sample as it is."""
    channels: dict[str, Channel] = Field(min_length=1)


# --- environment ----------------------------------------------------------------------------------------------


class CircularOrbit(Block):
    """Circular orbit by altitude, inclination and either local time or right ascension of the ascending node."""

    altitude: quantity("m", above=100e3)  # type: ignore[valid-type]
    inclination: Angle
    ltan: str | None = None
    """Local time of the ascending node, ``"HH:MM"``."""
    raan: Angle | None = None
    argument_of_latitude: Angle = 0.0
    """Angle from the ascending node at `epoch`."""
    epoch: Time


class KeplerianOrbit(Block):
    """Keplerian elements at an epoch, true equator of date; J2 moves node and perigee."""

    semi_major_axis: quantity("m", above=6.4e6)  # type: ignore[valid-type]
    eccentricity: Annotated[float, Field(ge=0, lt=1)]
    inclination: Angle
    raan: Angle
    argument_of_perigee: Angle
    mean_anomaly: Angle
    epoch: Time


class TleOrbit(Block):
    """Two-line elements, propagated with SGP4."""

    tle: tuple[str, str]


class SampledOrbit(Block):
    """Positions from a CSV file with columns time (ISO 8601 UTC), x, y, z in metres, Earth-centred inertial."""

    positions: str


class InertialAttitude(Block):
    """Body axes fixed in inertial space: unit quaternion (w, x, y, z) that turns body vectors into inertial ones."""

    inertial: Quaternion


class SpinningAttitude(Block):
    """Spin about a body axis that points along an inertial direction."""

    spin_axis: Vector
    """In the body."""
    direction: Vector
    """Inertial direction that the spin axis points to."""
    period: Duration | None = None
    """null: fast spin; fluxes are averaged over one turn."""


class SampledAttitude(Block):
    """Quaternions from a CSV file with columns time, w, x, y, z (body to inertial)."""

    quaternions: str


class Environment(Block):
    """Orbit and attitude, from which heat fluxes follow; or only an orbital period, where drivers replace the Sun."""

    orbit: CircularOrbit | KeplerianOrbit | TleOrbit | SampledOrbit | None = None
    period: Duration | None = None
    """Orbital period for windows and orbit phase; null: from the orbit."""
    attitude: Literal["nadir", "sun_pointing"] | InertialAttitude | SpinningAttitude | SampledAttitude = "nadir"
    albedo: quantity("", at_least=0, at_most=1) = 0.3  # type: ignore[valid-type]
    earth_infrared: quantity("W/m^2", at_least=0) = 237.0  # type: ignore[valid-type]
    solar_constant: quantity("W/m^2", at_least=0) = 1361.0  # type: ignore[valid-type]
    """At one astronomical unit (Kopp & Lean 2011: 1360.8 W/m2)."""


# --- simulator ------------------------------------------------------------------------------------------------


class Node(Block):
    """A thermal node. Diffusive: has a capacity. Arithmetic: massless, no capacity. Boundary: temperature given."""

    capacity: quantity("J/K", above=0) | None = None  # type: ignore[valid-type]
    initial: Temperature | None = None
    arithmetic: bool = False
    boundary: Temperature | str | None = None
    """A temperature, or the name of a temperature channel that is measured."""

    @model_validator(mode="after")
    def _one_kind(self) -> Node:
        kinds = [self.capacity is not None, self.arithmetic, self.boundary is not None]
        if sum(kinds) != 1:
            raise ValueError(
                "expected exactly one of 'capacity' (diffusive), 'arithmetic: true' (massless) and 'boundary' (given temperature)"
            )
        return self


class Face(Block):
    """A flat outer face of a node: absorbs sunlight, albedo and Earth infrared, radiates to deep space."""

    node: str
    area: quantity("m^2", above=0)  # type: ignore[valid-type]
    normal: Vector | Literal["all"]
    """Outward normal in the body frame (need not be of length one); "all": a small convex body, averaged over directions."""
    absorptivity: quantity("", at_least=0, at_most=1)  # type: ignore[valid-type]
    emissivity: quantity("", at_least=0, at_most=1)  # type: ignore[valid-type]


class Conductor(Block):
    """A link between two nodes: linear (W/K), or radiative (m2: area x emissivity x view factor)."""

    between: tuple[str, str]
    name: str | None = None
    """null: ``first-second``."""
    conductance: quantity("W/K", at_least=0) | None = None  # type: ignore[valid-type]
    radiative: quantity("m^2", at_least=0) | None = None  # type: ignore[valid-type]

    @model_validator(mode="after")
    def _one_law(self) -> Conductor:
        if (self.conductance is None) == (self.radiative is None):
            raise ValueError("expected exactly one of 'conductance' (W/K) and 'radiative' (m^2)")
        return self

    @property
    def label(self) -> str:
        """The name that parameters and reports use."""
        return self.name or "-".join(self.between)


class Heater(Block):
    """A heater switched by a hysteresis thermostat, or driven by its measured status."""

    node: str
    power: quantity("W", at_least=0)  # type: ignore[valid-type]
    sensor: str
    """The node whose temperature the thermostat watches; it must have a capacity."""
    on_below: Temperature
    off_above: Temperature
    initially_on: bool = False
    measured_by: str | None = None
    """Status channel of the telemetry; it gives the state at the window's start, and the input in open loop."""


class ModeChange(Block):
    """From `at` on the spacecraft is in `mode`."""

    at: Time
    mode: str


class Load(Block):
    """Heat into a node in proportion to a measured driver channel (in SI units: A, V, W)."""

    node: str
    driver: str
    coefficient: str | float
    """Heat per unit of the driver, with its unit: ``12 W/A``, or a plain number for a driver in watts."""


class SimulatorModel(Block):
    """The thermal network and the control of its heaters."""

    step: Duration = 30.0
    """Longest time step of the integration."""
    nodes: dict[str, Node] = Field(min_length=1)
    conductors: tuple[Conductor, ...] = ()
    faces: dict[str, Face] = {}
    heaters: dict[str, Heater] = {}
    heater_input: Literal["simulated", "measured"] = "simulated"
    """simulated: thermostats act (closed loop); measured: the status channels drive the heaters (open loop)."""
    modes: dict[str, dict[str, quantity("W")]] = {}  # type: ignore[valid-type]
    """Mode -> node -> dissipation."""
    timeline: tuple[ModeChange, ...] = ()
    loads: dict[str, Load] = {}


# --- parameters and observations ------------------------------------------------------------------------------


class Uniform(Block):
    """Uniform between two bounds."""

    kind: Literal["uniform"] = "uniform"
    lower: float
    upper: float


class Normal(Block):
    """Normal."""

    kind: Literal["normal"] = "normal"
    mean: float
    standard_deviation: float = Field(gt=0)


class TruncatedNormal(Block):
    """Normal cut at two bounds."""

    kind: Literal["truncated_normal"] = "truncated_normal"
    mean: float
    standard_deviation: float = Field(gt=0)
    lower: float
    upper: float


class LogNormal(Block):
    """Log-normal: about 68% of the probability lies between median / factor and median * factor."""

    kind: Literal["lognormal"] = "lognormal"
    median: float = Field(gt=0)
    factor: float = Field(gt=1)


class HalfNormal(Block):
    """Half-normal."""

    kind: Literal["half_normal"] = "half_normal"
    scale: float = Field(gt=0)


class Beta(Block):
    """Beta distribution on [lower, upper]."""

    kind: Literal["beta"] = "beta"
    alpha: float = Field(gt=0)
    beta: float = Field(gt=0)
    lower: float = 0.0
    upper: float = 1.0


Prior = Uniform | Normal | TruncatedNormal | LogNormal | HalfNormal | Beta


class Parameter(Block):
    """An uncertain number: what it sets or scales in the scenario (dotted paths), its prior and its unit (SI)."""

    sets: tuple[str, ...] = ()
    scales: tuple[str, ...] = ()
    prior: Annotated[Prior, Field(discriminator="kind")]
    unit: str
    """SI unit of the quantity it sets; "" when it scales."""


class Observation(Block):
    """What a channel measures: a node's temperature, or a heater's status; sensor bias and noise."""

    node: str | None = None
    heater: str | None = None
    bias: float = 0.0
    """Kelvin, added to the simulated temperature; settable by a parameter."""
    noise: Annotated[Prior, Field(discriminator="kind")] | float | None = None
    """Standard deviation of the channel's noise, K: a prior (inferred) or a known value; null: half-normal of 2 K."""

    @model_validator(mode="after")
    def _one_target(self) -> Observation:
        if (self.node is None) == (self.heater is None):
            raise ValueError("expected exactly one of 'node' and 'heater'")
        return self


# --- windows and methods --------------------------------------------------------------------------------------


class Window(Block):
    """A stretch of telemetry: start and either a number of orbits or an end."""

    start: Time
    orbits: Annotated[float, Field(gt=0)] | None = None
    end: Time | None = None

    @model_validator(mode="after")
    def _one_length(self) -> Window:
        if (self.orbits is None) == (self.end is None):
            raise ValueError("expected exactly one of 'orbits' and 'end'")
        if self.end is not None and self.end <= self.start:
            raise ValueError(f"found end {self.end.isoformat()}, expected a time after start {self.start.isoformat()}")
        return self


class GeneticSettings(Block):
    """The genetic algorithm."""

    runs: int = Field(10, ge=1)
    population: int = Field(64, ge=8)
    generations: int = Field(120, ge=1)
    heater_status_weight: float = Field(0.0, ge=0)
    """Kelvin that a status sample simulated wrongly counts as in the RMSE; 0: temperatures only."""


class NutsSettings(Block):
    """The No-U-Turn sampler and the gates its result must pass."""

    chains: int = Field(4, ge=2)
    draws: int = Field(1000, ge=50)
    warmup: int = Field(800, ge=50)
    target_acceptance: float = Field(0.9, gt=0.5, lt=1)
    max_r_hat: float = Field(1.01, gt=1)
    min_ess: float = Field(400, gt=0)


class PredictionSettings(Block):
    """Propagation of the posterior."""

    simulations: int = Field(1000, ge=20)
    interval: float = Field(0.95, gt=0, lt=1)
    initial_span: Duration = 600.0
    """The first samples of an unseen window, used for its initial temperatures and never scored."""


class Calibration(Block):
    """Settings of the methods."""

    seed: int = 1
    genetic: GeneticSettings = GeneticSettings()
    nuts: NutsSettings = NutsSettings()
    prediction: PredictionSettings = PredictionSettings()


class InitialState(Block):
    """Prior of the initial temperatures, which are estimated with the parameters in every window.

    An observed node starts around its first samples; a node without telemetry around its `initial` temperature.
    """

    observed: quantity("K", above=0) = 2.0  # type: ignore[valid-type]
    """Standard deviation, K."""
    unobserved: quantity("K", above=0) = 5.0  # type: ignore[valid-type]
    """Standard deviation, K."""


class Scenario(Block):
    """One calibration problem, whole."""

    name: str
    description: str = ""
    telemetry: TelemetryFile
    environment: Environment = Environment()
    simulator: SimulatorModel
    initial_state: InitialState = InitialState()
    parameters: dict[str, Parameter] = Field(min_length=1)
    observations: dict[str, Observation] = Field(min_length=1)
    windows: dict[str, Window]
    """`train`, and any number of other windows, on which the result is scored."""
    calibration: Calibration = Calibration()
    folder: Path = Field(default=Path(), exclude=True)
    """Folder of the file; relative paths start there."""
