"""The problem file as immutable objects: what a scenario may say, in SI and kelvin.

Every class mirrors one block of the YAML file. Numbers with a dimension are written with their unit and are
SI floats here; times are UTC. Cross-references between blocks are checked in `lint`, not here.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, Tag, model_validator

from ..errors import ScenarioError
from ._fields import (
    Block,
    BoundaryTemperature,
    ChannelUnit,
    Count,
    FaceNormal,
    Flag,
    Marker,
    Markers,
    Names,
    Number,
    Pair,
    Quaternion,
    Range,
    Time,
    TleLines,
    Vector,
    one_of,
)
from ._units import Angle, Duration, Power, Quantity, Temperature
from .external import (
    KINDS,
    CallableSimulator,
    ExecutableSimulator,
    FmuSimulator,
    UmbridgeSimulator,
    is_external,
    kind_of_simulator,
)

# --- telemetry ----------------------------------------------------------------------------------------------


class TimeColumn(Block):
    """Where the time stamps are and how they are written."""

    column: str
    format: Literal["iso8601", "unix", "year-doy"] = "iso8601"


class Channel(Block):
    """One telemetry channel: its column (or several, combined), unit, and what counts as invalid."""

    column: Names
    combine: Literal["mean", "sum", "product"] | None = None
    kind: Literal["temperature", "status", "driver"]
    unit: ChannelUnit | None = None
    """Unit as the file has it; for a product of columns, the unit of the product (``mA * mV``)."""
    valid_range: Range | None = None
    """Lowest and highest believable value, with units (for a driver without a unit, plain numbers)."""
    invalid: Markers = ()
    """Marker values of the ground system, as they stand in the file."""
    on: Markers = (1.0, "1", "ON", "on", "On", "true", "True", "TRUE")
    """For a status: the values that mean on."""
    stale_after: Annotated[Count, Field(ge=2)] | None = 6
    """This many identical rows of all channels that do not normally repeat are frozen; null: off."""
    fill: Literal["interpolate", "previous_orbit"] = "interpolate"
    """For a driver: how its gaps are bridged."""


class TelemetryFile(Block):
    """The flight data: one file or several, one time column, the channels."""

    file: Names
    time: TimeColumn
    average: Duration | None = None
    """Block mean over this long; null: every sample as it is."""
    channels: dict[str, Channel] = Field(min_length=1)


# --- environment --------------------------------------------------------------------------------------------


class CircularOrbit(Block):
    """Circular orbit by altitude, inclination, and local time or right ascension of the ascending node."""

    altitude: Annotated[float, Quantity("m", above=100e3, at_most=1e9)]
    inclination: Angle
    ltan: str | None = None
    """Local time of the ascending node, ``"HH:MM"``."""
    raan: Angle | None = None
    argument_of_latitude: Angle = 0.0
    """Angle from the ascending node at `epoch`."""
    epoch: Time


class KeplerianOrbit(Block):
    """Keplerian elements at an epoch, true equator of date; J2 moves node and perigee."""

    semi_major_axis: Annotated[float, Quantity("m", above=6.4e6, at_most=1e9)]
    eccentricity: Annotated[Number, Field(ge=0, lt=1)]
    inclination: Angle
    raan: Angle
    argument_of_perigee: Angle
    mean_anomaly: Angle
    epoch: Time


class TleOrbit(Block):
    """Two-line elements, propagated with SGP4."""

    tle: TleLines


class SampledOrbit(Block):
    """Positions from a CSV file: columns time (ISO 8601 UTC), x, y, z in metres, Earth-centred inertial."""

    positions: str


class InertialAttitude(Block):
    """Body axes fixed in inertial space: unit quaternion (w, x, y, z), from body to inertial vectors."""

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


def _orbit_kind(value: Any) -> str | None:
    if not isinstance(value, dict):
        return None
    if "tle" in value:
        return "<TleOrbit>"
    if "positions" in value:
        return "<SampledOrbit>"
    elements = {"semi_major_axis", "eccentricity", "argument_of_perigee", "mean_anomaly"}
    return "<KeplerianOrbit>" if elements & set(value) else "<CircularOrbit>"


def _attitude_kind(value: Any) -> str | None:
    if isinstance(value, str):
        return "<named>"
    if not isinstance(value, dict):
        return None
    if "inertial" in value:
        return "<InertialAttitude>"
    return "<SampledAttitude>" if "quaternions" in value else "<SpinningAttitude>"


Orbit = Annotated[
    Annotated[CircularOrbit, Tag("<CircularOrbit>")]
    | Annotated[KeplerianOrbit, Tag("<KeplerianOrbit>")]
    | Annotated[TleOrbit, Tag("<TleOrbit>")]
    | Annotated[SampledOrbit, Tag("<SampledOrbit>")],
    one_of(
        _orbit_kind,
        "an orbit: altitude and inclination, Keplerian elements, 'tle' or 'positions'",
    ),
]
Attitude = Annotated[
    Annotated[Literal["nadir", "sun_pointing"], Tag("<named>")]
    | Annotated[InertialAttitude, Tag("<InertialAttitude>")]
    | Annotated[SpinningAttitude, Tag("<SpinningAttitude>")]
    | Annotated[SampledAttitude, Tag("<SampledAttitude>")],
    one_of(
        _attitude_kind,
        "an attitude: nadir, sun_pointing, or a mapping with 'inertial', 'spin_axis' or 'quaternions'",
    ),
]


class AttitudeOffset(Block):
    """Small rotation of the body against its attitude, about its own axes; heat fluxes are taken as linear in it."""

    x: Annotated[float, Quantity("rad", at_least=-0.1, at_most=0.1)] = 0.0
    y: Annotated[float, Quantity("rad", at_least=-0.1, at_most=0.1)] = 0.0
    z: Annotated[float, Quantity("rad", at_least=-0.1, at_most=0.1)] = 0.0


class Environment(Block):
    """Orbit and attitude, from which heat fluxes follow; or only a period, where drivers replace the Sun."""

    orbit: Orbit | None = None
    period: Duration | None = None
    """Orbital period for windows and orbit phase; null: from the orbit."""
    attitude: Attitude = "nadir"
    attitude_offset: AttitudeOffset | None = None
    """null: none; where it is written, a parameter may set it."""
    albedo: Annotated[float, Quantity("", at_least=0, at_most=1)] = 0.3
    earth_infrared: Annotated[float, Quantity("W/m^2", at_least=0)] = 237.0
    solar_constant: Annotated[float, Quantity("W/m^2", at_least=0)] = 1361.0
    """At one astronomical unit (Kopp & Lean 2011: 1360.8 W/m2)."""


# --- simulator ----------------------------------------------------------------------------------------------


def _exactly_one(present: dict[str, bool], expected: str) -> None:
    found = [name for name, there in present.items() if there]
    if len(found) != 1:
        raise ValueError(f"found {' and '.join(map(repr, found)) or 'none of them'}, expected {expected}")


class Node(Block):
    """A thermal node: diffusive (has a capacity), arithmetic (massless) or boundary (temperature given)."""

    capacity: Annotated[float, Quantity("J/K", above=0)] | None = None
    initial: Temperature | None = None
    arithmetic: Flag = False
    boundary: BoundaryTemperature | None = None
    """A temperature, or the name of a temperature channel that is measured."""

    @model_validator(mode="after")
    def _one_kind(self) -> Node:
        kinds = {
            "capacity": self.capacity is not None,
            "arithmetic": self.arithmetic,
            "boundary": self.boundary is not None,
        }
        _exactly_one(kinds, "exactly one of 'capacity', 'arithmetic: true' (massless) and 'boundary' (given)")
        return self


class Face(Block):
    """A flat outer face of a node: absorbs sunlight, albedo and Earth infrared, radiates to deep space."""

    node: str
    area: Annotated[float, Quantity("m^2", above=0)]
    normal: FaceNormal
    """Outward normal in the body frame, of any length; "all": a convex body, averaged over directions."""
    absorptivity: Annotated[float, Quantity("", at_least=0, at_most=1)]
    emissivity: Annotated[float, Quantity("", at_least=0, at_most=1)]


class Conductor(Block):
    """A link between two nodes: linear (W/K), or radiative (m2: area x emissivity x view factor)."""

    between: Pair
    name: str | None = None
    """null: ``first-second``."""
    conductance: Annotated[float, Quantity("W/K", at_least=0)] | None = None
    radiative: Annotated[float, Quantity("m^2", at_least=0)] | None = None

    @model_validator(mode="after")
    def _one_law(self) -> Conductor:
        given = {"conductance": self.conductance is not None, "radiative": self.radiative is not None}
        _exactly_one(given, "exactly one of 'conductance' (W/K) and 'radiative' (m^2)")
        return self

    @property
    def label(self) -> str:
        """The name that parameters and reports use."""
        return self.name or "-".join(self.between)


class Heater(Block):
    """A heater switched by a hysteresis thermostat, or driven by its measured status."""

    node: str
    power: Annotated[float, Quantity("W", at_least=0)]
    sensor: str
    """The node whose temperature the thermostat watches; it must have a capacity."""
    on_below: Temperature
    off_above: Temperature
    initially_on: Flag = False
    measured_by: str | None = None
    """Status channel: it gives the state at the window's start, and the input in open loop."""


class ModeChange(Block):
    """From `at` on the spacecraft is in `mode`."""

    at: Time
    mode: str


class Load(Block):
    """Heat into a node in proportion to a measured driver channel (in SI units: A, V, W)."""

    node: str
    driver: str
    coefficient: Marker
    """Heat per unit of the driver, with its unit: ``12 W/A``, or a plain number for a driver in watts."""


class ReducedNumber(Block):
    """A number of a reduced order model that a parameter may set."""

    unit: str
    """SI; "" for a factor."""
    value: Number
    lower: Number | None = None
    upper: Number | None = None
    """null: no bound."""


class SimulatorError(Block):
    """Error of a simulator in the place of a slower one, of one channel: what is constant in a run, and what varies."""

    offset: Annotated[float, Quantity("K", at_least=0, difference=True)]
    """Standard deviation."""
    deviation: Annotated[float, Quantity("K", at_least=0, difference=True)]
    """Standard deviation."""
    correlation_time: Duration
    """Of what varies: its correlation falls to 1/e."""


class SimulatorModel(Block):
    """The thermal network and the control of its heaters."""

    reduced_model: str | None = None
    """File that `flightcal reduce` wrote: nodes, faces, heaters and modes come from it; what is written here besides
    (initial temperatures, thresholds, powers, `measured_by`) replaces what it says."""
    checked_on: str | None = None
    """Reduction file (that `flightcal reduce` read): at the end posterior draws fly on its operational simulator."""
    reduced_numbers: dict[str, ReducedNumber] = Field(default_factory=dict)
    """Filled in from that file: what parameters may set in it, ``reduced.<name>``."""
    errors: dict[str, SimulatorError] = Field(default_factory=dict)
    """Temperature channel -> error against the simulator that this one stands in for; it enters the likelihood."""
    step: Duration = 30.0
    """Longest time step of the integration."""
    nodes: dict[str, Node] = Field(min_length=1)
    conductors: tuple[Conductor, ...] = ()
    faces: dict[str, Face] = Field(default_factory=dict)
    heaters: dict[str, Heater] = Field(default_factory=dict)
    heater_input: Literal["simulated", "measured"] = "simulated"
    """simulated: thermostats act (closed loop); measured: status channels drive the heaters (open loop)."""
    modes: dict[str, dict[str, Power]] = Field(default_factory=dict)
    """Mode -> node -> dissipation."""
    timeline: tuple[ModeChange, ...] = ()
    loads: dict[str, Load] = Field(default_factory=dict)


def _simulator_kind(value: Any) -> str | None:
    if not isinstance(value, dict):
        return None
    if not is_external(value):
        return f"<{SimulatorModel.__name__}>"
    kind = kind_of_simulator(value)
    return f"<{KINDS[kind].__name__}>" if kind else None


AnySimulator = Annotated[
    Annotated[SimulatorModel, Tag("<SimulatorModel>")]
    | Annotated[CallableSimulator, Tag("<CallableSimulator>")]
    | Annotated[ExecutableSimulator, Tag("<ExecutableSimulator>")]
    | Annotated[FmuSimulator, Tag("<FmuSimulator>")]
    | Annotated[UmbridgeSimulator, Tag("<UmbridgeSimulator>")],
    one_of(
        _simulator_kind,
        "a simulator: a thermal network ('nodes'), or 'callable', 'executable', 'fmu' or 'umbridge'",
    ),
]


# --- parameters and observations ----------------------------------------------------------------------------


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
Uncertain = Annotated[
    Annotated[Uniform, Tag("<Uniform>")]
    | Annotated[Normal, Tag("<Normal>")]
    | Annotated[TruncatedNormal, Tag("<TruncatedNormal>")]
    | Annotated[LogNormal, Tag("<LogNormal>")]
    | Annotated[HalfNormal, Tag("<HalfNormal>")]
    | Annotated[Beta, Tag("<Beta>")]
    | Annotated[float, Tag("<number>")],
    one_of(lambda value: "<number>" if isinstance(value, (int, float)) else None, "a number with its unit, or a prior"),
]
"""A number that is known, or has a prior."""


class Parameter(Block):
    """An uncertain number: what it sets or scales (dotted paths), its prior and its SI unit."""

    sets: tuple[str, ...] = ()
    scales: tuple[str, ...] = ()
    prior: Annotated[Prior, Field(discriminator="kind")]
    unit: str
    """SI unit of the quantity it sets; "" when it scales."""
    drift: Annotated[Number, Field(gt=0)] | None = None
    """It differs between the windows of a calibration on several: scale of the half-normal prior of the standard
    deviation between them, in standard deviations of the parameter's own prior. null: it does not."""


class SwitchTimes(Block):
    """The times at which a heater switches, known to lie between samples of its status."""

    timing: Annotated[Prior, Field(discriminator="kind")] | float = LogNormal(median=20.0, factor=2.0)
    """Standard deviation of a switch's time around the simulated one, s: control cycle, delays and what the simulator
    lacks; a prior (inferred) or a known value."""
    error_rate: Annotated[Prior, Field(discriminator="kind")] | float = 1e-3
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
        given = {name: getattr(self, name) is not None for name in ("switch_times", "duty_cycle")}
        _exactly_one(given, "exactly one of 'switch_times' and 'duty_cycle'")
        return self


class Noise(Block):
    """Noise of temperature channels: independent or correlated from sample to sample, normal or with outliers."""

    model: Literal["iid", "ar1"] = "iid"
    """iid: independent; ar1: its correlation over a gap of the telemetry is exp(-gap / correlation_time)."""
    distribution: Literal["normal", "student_t"] = "normal"
    """student_t: heavy tails, for outliers; with ar1, of the innovations."""
    standard_deviation: Uncertain = HalfNormal(scale=2.0)
    """At one sample, K; of student_t: its scale."""
    correlation_time: Uncertain = LogNormal(median=600.0, factor=2.0)
    """Of ar1, s; what lasts longer is a discrepancy's."""
    white: Uncertain | None = None
    """Standard deviation of independent noise beside that of ar1, K; null: none."""
    degrees_of_freedom: Uncertain = 4.0
    """Of student_t."""
    quantisation: Annotated[float, Quantity("K", above=0, difference=True)] | None = None
    """Step to which the telemetry is rounded: the likelihood is the probability of the whole step (iid normal only)."""


class TimeDiscrepancy(Block):
    """Discrepancy as a Matern process in time; on another window it fades to its prior."""

    amplitude: Uncertain = HalfNormal(scale=1.0)
    """Prior standard deviation, K; it keeps the discrepancy from taking the parameters' place."""
    lengthscale: Uncertain | None = None
    """s, with two bounds; null: uniform from what `functions` can tell to a quarter of the window."""
    smoothness: Literal["3/2", "5/2"] = "3/2"
    functions: Count = Field(40, ge=4, le=400)
    shared: tuple[Literal["amplitude", "lengthscale"], ...] = ("lengthscale",)
    """What all channels have in common."""


class PhaseDiscrepancy(Block):
    """Discrepancy that comes again in every orbit: a Matern process around the orbit; it carries to other windows."""

    amplitude: Uncertain = HalfNormal(scale=1.0)
    """Prior standard deviation, K."""
    lengthscale: Uncertain = Uniform(lower=0.05, upper=0.5)
    """Orbits, with two bounds."""
    smoothness: Literal["3/2", "5/2"] = "3/2"
    harmonics: Count = Field(8, ge=1, le=100)
    shared: tuple[Literal["amplitude", "lengthscale"], ...] = ("lengthscale",)
    """What all channels have in common."""


class Discrepancy(Block):
    """What the simulator lacks, calibrated together with the parameters."""

    time: TimeDiscrepancy | None = None
    phase: PhaseDiscrepancy | None = None
    channels: tuple[str, ...] = ()
    """Temperature channels that have one; none named: all."""
    orthogonal: Flag = False
    """In each channel, to what the parameters do to the training window: repairs forecasts, not the parameters."""

    @model_validator(mode="after")
    def _some_part(self) -> Discrepancy:
        if self.time is None and self.phase is None:
            raise ValueError("found neither 'time' nor 'phase', expected one of them, or both")
        return self


def _noise_kind(value: Any) -> str | None:
    if isinstance(value, (int, float)):
        return "<number>"
    return "<Noise>" if isinstance(value, dict) else None


ChannelNoise = Annotated[
    Annotated[Uniform, Tag("<Uniform>")]
    | Annotated[Normal, Tag("<Normal>")]
    | Annotated[TruncatedNormal, Tag("<TruncatedNormal>")]
    | Annotated[LogNormal, Tag("<LogNormal>")]
    | Annotated[HalfNormal, Tag("<HalfNormal>")]
    | Annotated[Beta, Tag("<Beta>")]
    | Annotated[Noise, Tag("<Noise>")]
    | Annotated[float, Tag("<number>")],
    one_of(_noise_kind, "a standard deviation such as '0.1 K', its prior, or a mapping with 'model'"),
]


class Observation(Block):
    """What a channel measures: a temperature or a heater's status; sensor bias and noise."""

    node: str | None = None
    """Of the thermal network."""
    output: str | None = None
    """Temperature of an external simulator."""
    heater: str | None = None
    gain: Annotated[float, Quantity("", above=0)] = 1.0
    """Slope of the reading in degC: y = gain x + bias, with the simulated temperature x in degC."""
    bias: Number = 0.0
    """Kelvin, added to the simulated temperature."""
    time_offset: Annotated[float, Quantity("s")] = 0.0
    """The reading is of so much later than its time tag says (negative: earlier)."""
    lag: Duration | None = None
    """Time constant with which the sensor follows its node; null: at once."""
    noise: ChannelNoise | None = None
    """Standard deviation of independent normal noise, K: a prior (inferred) or a known value; or another model of
    noise; null: the scenario's `noise`."""
    likelihood: StatusLikelihood | None = None
    """Of a heater's status; null: it does not count."""

    @model_validator(mode="after")
    def _one_target(self) -> Observation:
        given = {name: getattr(self, name) is not None for name in ("node", "output", "heater")}
        _exactly_one(given, "exactly one of 'node', 'output' and 'heater'")
        return self


# --- windows and methods ------------------------------------------------------------------------------------


class Window(Block):
    """A stretch of telemetry: start and either a number of orbits or an end."""

    start: Time
    orbits: Annotated[Number, Field(gt=0)] | None = None
    end: Time | None = None

    @model_validator(mode="after")
    def _one_length(self) -> Window:
        given = {"orbits": self.orbits is not None, "end": self.end is not None}
        _exactly_one(given, "exactly one of 'orbits' and 'end'")
        if self.end is not None and self.end <= self.start:
            raise ValueError(f"found end {self.end.isoformat()}, expected one after {self.start.isoformat()}")
        return self


def is_trained(window: str) -> bool:
    """Whether the window of this name is one to calibrate on."""
    return window.partition(".")[0] == "train"


class GeneticSettings(Block):
    """The genetic algorithm."""

    runs: Count = Field(10, ge=1)
    population: Count = Field(64, ge=8)
    generations: Count = Field(120, ge=1)
    heater_status_weight: Number = Field(0.0, ge=0)
    """Kelvin that a status sample simulated wrongly counts as in the RMSE; 0: temperatures only."""


class NutsSettings(Block):
    """The No-U-Turn sampler and the gates its result must pass."""

    chains: Count = Field(4, ge=2)
    draws: Count = Field(1000, ge=50)
    warmup: Count = Field(400, ge=50)
    target_acceptance: Number = Field(0.9, gt=0.5, lt=1)
    max_r_hat: Number = Field(1.01, gt=1)
    min_ess: Number = Field(400, gt=0)


class EmulatorSettings(Block):
    """The emulator of a simulator without derivatives, and the real runs that it is made from."""

    runs: Count = Field(300, ge=40)
    """Budget of real runs of the training window; failed ones count, and the last check does."""
    start: Count | None = Field(None, ge=10)
    """Runs of the start design through the priors (default: ten for each parameter)."""
    batch: Count | None = Field(None, ge=1)
    """Runs that a round adds (default: four for each parameter)."""
    shift: Number = Field(0.1, gt=0)
    """By how many standard deviations the emulator's error, or a further round, may still shift the posterior."""


class PredictionSettings(Block):
    """Propagation of the posterior."""

    simulations: Count = Field(1000, ge=20)
    interval: Number = Field(0.95, gt=0, lt=1)
    initial_span: Duration = 600.0
    """The first samples of an unseen window, used for its initial temperatures and never scored."""


class Calibration(Block):
    """Settings of the methods."""

    seed: Annotated[Count, Field(ge=0, lt=2**32)] = 1
    genetic: GeneticSettings = GeneticSettings()
    nuts: NutsSettings = NutsSettings()
    prediction: PredictionSettings = PredictionSettings()
    emulator: EmulatorSettings = EmulatorSettings()


class InitialState(Block):
    """Prior of the initial temperatures, which are estimated with the parameters in every window.

    An observed node starts around its first samples; one without telemetry around its `initial` temperature.
    """

    observed: Annotated[float, Quantity("K", above=0, difference=True)] = 2.0
    """Standard deviation, K."""
    unobserved: Annotated[float, Quantity("K", above=0, difference=True)] = 5.0
    """Standard deviation, K."""


class Scenario(Block):
    """One calibration problem, whole."""

    name: str
    description: str = ""
    telemetry: TelemetryFile
    environment: Environment = Environment()
    simulator: AnySimulator
    initial_state: InitialState = InitialState()
    parameters: dict[str, Parameter] = Field(min_length=1)
    observations: dict[str, Observation] = Field(min_length=1)
    noise: Noise = Noise()
    """Of the temperature channels that have none of their own."""
    discrepancy: Discrepancy | None = None
    windows: dict[str, Window]
    """`train`, and any number of other windows, on which the result is scored. Several to train on are a list or a
    mapping in the place of `train`, and are called ``train.<name>``; other windows may be grouped likewise."""
    calibration: Calibration = Calibration()
    folder: Path = Field(default=Path(), exclude=True)
    """Folder of the file; relative paths start there."""

    @property
    def train_windows(self) -> tuple[str, ...]:
        """Names of the windows to calibrate on, in the file's order."""
        return tuple(name for name in self.windows if is_trained(name))

    @property
    def network(self) -> SimulatorModel:
        """The thermal network. Raises ScenarioError where the simulator is an external one."""
        if not isinstance(self.simulator, SimulatorModel):
            found = f"found an external simulator ({kind_of_simulator(self.simulator)})"
            raise ScenarioError(f"{self.name}: simulator: {found}, expected a thermal network: this needs its nodes")
        return self.simulator


def is_orthogonal(scenario: Scenario) -> bool:
    """Whether there is a discrepancy that is orthogonal to what the parameters do."""
    return scenario.discrepancy is not None and scenario.discrepancy.orthogonal


def noise_of(scenario: Scenario, channel: str) -> Noise:
    """The noise of a temperature channel: its own, or the scenario's."""
    own = scenario.observations[channel].noise
    if own is None:
        return scenario.noise
    return own if isinstance(own, Noise) else Noise(standard_deviation=own)
