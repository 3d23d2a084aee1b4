"""The problem file as immutable objects: what a scenario may say, in SI and kelvin.

Every class mirrors one block of the YAML file. Numbers with a dimension are written with their unit and are
SI floats here; times are UTC. Cross-references between blocks are checked in `lint`, not here.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, field_validator, model_validator
from pydantic_core import core_schema

from ..errors import ScenarioError
from .calibration import Calibration
from .environment import AttitudeTimeline, Environment
from .external import (
    KINDS,
    CallableSimulator,
    ExecutableSimulator,
    FmuSimulator,
    UmbridgeSimulator,
    is_external,
    kind_of_simulator,
    simulator_files,
)
from .fields import (
    FILLED_IN,
    Bits,
    Block,
    ChannelUnit,
    Count,
    Epoch,
    FileNames,
    Flag,
    Marker,
    Markers,
    Names,
    Number,
    OneOf,
    Paths,
    Range,
    TimeFormat,
    exactly_one,
    of_length,
    read_empty,
)
from .heat import Heat, WrittenHeat
from .network import SimulatorModel
from .priors import HalfNormal, LogNormal, Prior, prior_schema, read_prior
from .residuals import ChannelNoise, Discrepancy, Noise, StatusLikelihood
from .units import HOTTEST, Duration, Quantity
from .windows import Window, is_trained

# --- telemetry ----------------------------------------------------------------------------------------------


class TimeColumn(Block):
    """Where the time stamps are and how they are written."""

    column: Names
    """Several, such as a date and a time of day, are read as one text with spaces in between."""
    format: TimeFormat = "iso8601"
    """`unix`: seconds. `decimal-doy`: as in two-line elements. `clock`: a counter of the spacecraft, with its
    `epoch` beside it. Anything else: a pattern of strptime, such as '%d.%m.%Y %H:%M:%S'."""
    epoch: Epoch | None = None
    """Of a clock: UTC when it is at zero."""
    rate: Annotated[float, Quantity("Hz", above=0)] | None = None
    """Of a clock: counts a second; null: 1."""
    fine: Annotated[Count, Field(ge=2)] | None = None
    """Of a clock with a coarse and a fine part, such as 515721623:32768: counts of the fine to one of the coarse."""
    leap_seconds: Flag | None = None
    """Of a clock: true where it counts leap seconds too, as GPS time does; null: false, every day has 86400 s."""
    invalid: Markers = ()
    """What stands in the place of a time in rows that are fill; such rows are dropped."""

    @model_validator(mode="after")
    def _of_a_clock(self) -> TimeColumn:
        if self.format == "clock":
            if self.epoch is None:
                raise ValueError("missing key 'epoch', expected the UTC time at which the clock is at zero")
            return self
        given = [key for key in ("epoch", "rate", "fine", "leap_seconds") if getattr(self, key) is not None]
        if given:
            raise ValueError(f"found {given[0]!r} beside the format {self.format!r}, expected it of a 'clock' only")
        return self


CurvePoint = Annotated[
    tuple[Number, Annotated[float, Quantity("K", above=0, at_most=HOTTEST)]],
    of_length(2, "a point of a curve [reading, temperature]"),
]


class Channel(Block):
    """One telemetry channel: its column (or several, combined), unit, and what counts as invalid."""

    packet: str | None = None
    """Which of `packets` has its column; null where there are none."""
    column: Names
    combine: Literal["mean", "sum", "product"] | None = None
    kind: Literal["temperature", "status", "driver"]
    unit: ChannelUnit | None = None
    """Unit as the file has it; for a product of columns, the unit of the product (``mA * mV``)."""
    curve: tuple[CurvePoint, ...] = ()
    """Of a temperature that the file has as counts, volts or ohms, in the place of `unit`: readings and what they mean.
    Linear in between; readings beyond the ends are out of range."""
    valid_range: Range | None = None
    """Lowest and highest believable value, with units (for a driver without a unit, plain numbers)."""
    invalid: Markers = ()
    """Marker values of the ground system, as they stand in the file."""
    on: Markers = (1.0, "1", "ON", "on", "On", "true", "True", "TRUE", "YES", "ENABLED", "ENABLE", "ACTIVE", "CLOSED")
    """For a status: the values that mean on."""
    off: Markers = ()
    """For a status: values that mean off, besides 0, OFF, FALSE, NO, DISABLED, INACTIVE, OPEN and IDLE."""
    on_above: Marker | None = None
    """For a status: it is on where the column's number is larger than this, which is written with its unit."""
    on_below: Marker | None = None
    """For a status: it is on where the column's number is smaller than this, which is written with its unit."""
    bits: Bits | None = None
    """For a status: the bit (0: the least significant) of the column's word that tells it. Several are a number, the
    first its least significant; it is on where that is among `on`, by default where it is not 0."""
    base: Literal[2, 10, 16] | None = None
    """Of `bits`: that of words without 0x or 0b before them; null: 10."""
    stale_after: Annotated[Count, Field(ge=2)] | None = 6
    """This many identical rows of all channels that do not normally repeat are frozen; null: off."""
    fill: Literal["interpolate", "previous_orbit", "hold"] = "interpolate"
    """For a driver: how its gaps are bridged; hold: it has no gaps, for each value stays until the next sample."""

    @field_validator("curve")
    @classmethod
    def _goes_one_way(cls, curve: tuple[CurvePoint, ...]) -> tuple[CurvePoint, ...]:
        if len(curve) == 1:
            raise ValueError("found one point, expected two or more")
        ordered = tuple(sorted(curve))
        steps = [later[1] - earlier[1] for earlier, later in pairwise(ordered)]
        if any(one[0] == other[0] for one, other in pairwise(ordered)):
            raise ValueError("found a reading twice, expected one temperature for each")
        if min(steps, default=1.0) * max(steps, default=1.0) <= 0:
            raise ValueError("found temperatures that rise and fall, expected that they always rise or always fall")
        return ordered

    @property
    def threshold(self) -> Literal["on_above", "on_below"] | None:
        """The key that makes a status of a number; null: it is none that is made so."""
        return "on_above" if self.on_above is not None else "on_below" if self.on_below is not None else None


class Readings(Block):
    """Columns of a file that has a row for each reading; a channel's `column` is then the name of a reading."""

    name: str
    value: str


class Packet(Block):
    """Telemetry that shares a clock: one file or several with the same columns, and the time column."""

    file: FileNames
    sheet: str | None = None
    """Of a spreadsheet; null: its first."""
    header: Annotated[Count, Field(ge=1)] | None = None
    """Number of the line or row with the columns' names; null: the first that is not empty."""
    time: TimeColumn
    readings: Readings | None = None
    """Of a file with one row for each reading; null: each row has all channels."""
    average: Duration | None = None
    """Block mean over this long; null: that of all telemetry."""


class TelemetryFile(Block):
    """The flight data: one file or several, one time column, the channels; or several packets."""

    file: FileNames = ()
    """One file, or several with the same columns."""
    sheet: str | None = None
    """Of a spreadsheet; null: its first."""
    header: Annotated[Count, Field(ge=1)] | None = None
    """Number of the line or row with the columns' names; null: the first that is not empty."""
    time: TimeColumn | None = None
    readings: Readings | None = None
    """Of a file with one row for each reading; null: each row has all channels."""
    packets: dict[str, Packet] = Field(default_factory=dict)
    """In the place of `file` and `time`: files, each with columns, sampling and clock of its own."""
    average: Duration | None = None
    """Block mean over this long; null: every sample as it is."""
    channels: dict[str, Channel] = Field(min_length=1)

    @model_validator(mode="after")
    def _one_form(self) -> TelemetryFile:
        beside = [key for key in ("file", "sheet", "header", "time", "readings") if getattr(self, key)]
        if self.packets and beside:
            raise ValueError(f"found {beside[0]!r} beside 'packets', expected it in each of them")
        missing = [] if self.packets else [key for key in ("file", "time") if not getattr(self, key)]
        if missing:
            raise ValueError(f"missing key {missing[0]!r}")
        return self

    @property
    def sources(self) -> dict[str, Packet]:
        """The packets by name; what is written without a name is one called ""."""
        if self.packets:
            return self.packets
        assert self.time is not None  # the schema wants it
        packet = Packet.model_construct(
            file=self.file,
            sheet=self.sheet,
            header=self.header,
            time=self.time,
            readings=self.readings,
            average=None,
        )
        return {"": packet}

    @property
    def files(self) -> tuple[str, ...]:
        """Names of all files, each once."""
        return tuple(dict.fromkeys(name for packet in self.sources.values() for name in packet.file))

    def channels_of(self, packet: str) -> dict[str, Channel]:
        """The channels whose columns a packet has."""
        return {name: channel for name, channel in self.channels.items() if (channel.packet or "") == packet}


# --- simulator, parameters and observations -----------------------------------------------------------------


def _simulator_kind(value: Any) -> type[Block] | None:
    if not isinstance(value, dict):
        return None
    return KINDS.get(kind_of_simulator(value) or "") if is_external(value) else SimulatorModel


AnySimulator = Annotated[
    SimulatorModel | CallableSimulator | ExecutableSimulator | FmuSimulator | UmbridgeSimulator,
    OneOf(
        _simulator_kind,
        "a simulator: a thermal network ('nodes'), or 'callable', 'executable', 'fmu' or 'umbridge'",
    ),
]


def is_difference(path: str) -> bool:
    """Whether a path in kelvin is a temperature difference."""
    return path.startswith("observations.") and path.endswith(".bias")


class _OwnPrior:
    """Marks a prior that is written in the unit of its parameter."""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        def read(value: Any, info: core_schema.ValidationInfo) -> Prior:
            return read_prior(value, info.data["unit"], difference=any(map(is_difference, info.data.get("sets", ()))))

        return core_schema.with_info_plain_validator_function(read)

    def __get_pydantic_json_schema__(self, schema: core_schema.CoreSchema, handler: Any) -> dict[str, Any]:
        return prior_schema()


class Parameter(Block):
    """An uncertain number: what it sets or scales (dotted paths), its prior and its SI unit."""

    sets: Paths = ()
    scales: Paths = ()
    unit: Annotated[str, FILLED_IN]
    """SI unit of the quantity it sets; "" when it scales."""
    prior: Annotated[Prior, _OwnPrior()]
    drift: Annotated[Number, Field(gt=0)] | None = None
    """It differs between the windows of a calibration on several: scale of the half-normal prior of the standard
    deviation between them, in standard deviations of the parameter's own prior. null: it does not."""


class Observation(Block):
    """What a channel measures: a temperature or a heater's status; sensor bias and noise."""

    node: str | None = None
    """Of the thermal network."""
    output: str | None = None
    """Temperature of an external simulator."""
    heater: str | None = None
    gain: Annotated[float, Quantity("", above=0, believable=1e3)] = 1.0
    """Slope of the reading in degC: y = gain x + bias, with the simulated temperature x in degC."""
    bias: Annotated[float, Quantity("K", difference=True, believable=HOTTEST)] = 0.0
    """Kelvin, added to the simulated temperature."""
    time_offset: Annotated[float, Quantity("s", believable=86400)] = 0.0
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
        return exactly_one(self, ("node", "output", "heater"), "exactly one of 'node', 'output' and 'heater'")


# --- the whole --------------------------------------------------------------------------------------------------


class InitialState(Block):
    """Prior of the initial temperatures, which are estimated with the parameters in every window.

    An observed node starts around its first samples; one without telemetry around its `initial` temperature.
    """

    observed: Annotated[float, Quantity("K", above=0, difference=True, believable=HOTTEST)] = 2.0
    """Standard deviation, K."""
    unobserved: Annotated[float, Quantity("K", above=0, difference=True, believable=HOTTEST)] = 5.0
    """Standard deviation, K."""


_TimeError = Annotated[float, Quantity("s", above=0, believable=3600)]
WrittenTimeError = Annotated[
    _TimeError | Literal["none"],
    OneOf(lambda value: Literal["none"] if value == "none" else _TimeError, "none, or a duration such as '5 s'"),
]

_FINEST = 5e-3
"""K, error of the integration that no telemetry shows."""
_BY_DEFAULT = True
"""Whether a scenario that does not write `heat` has it."""
_TIME_ERROR = 3.0
"""s, where a scenario with unmodelled heat does not write `time_error`."""
NOISE_BESIDE_HEAT = Noise(
    model="ar1",
    standard_deviation=HalfNormal(scale=1.0),
    correlation_time=LogNormal(median=300.0, factor=2.0),
    white=HalfNormal(scale=0.5),
)
"""Noise where none is written: heat leaves what lasts for minutes."""


class Scenario(Block):
    """One calibration problem, whole."""

    name: str
    description: str = ""
    telemetry: TelemetryFile
    environment: Environment = Environment()
    simulator: AnySimulator
    initial_state: InitialState = InitialState()
    parameters: Annotated[
        dict[str, Parameter], BeforeValidator(read_empty, json_schema_input_type=dict[str, Parameter] | None)
    ]
    """None: initial temperatures and what noise and the like infer are all that is calibrated."""
    observations: dict[str, Observation] = Field(min_length=1)
    noise: Noise = Noise()
    """Of the temperature channels that have none of their own."""
    discrepancy: Discrepancy | None = None
    heat: WrittenHeat | None = None
    """Heat that the simulator does not know of; none: there is none."""
    time_error: WrittenTimeError | None = None
    """Standard deviation of an error that the time tags of all temperatures have in common, as where a clock, the
    orbit or the sensors are late; it is calibrated. none: there is none. Where it is not written: 3 s beside `heat`."""
    windows: dict[str, Window]
    """`train`, and any number of other windows, on which the result is scored. Several to train on are a list or a
    mapping in the place of `train`, and are called ``train.<name>``; other windows may be grouped likewise."""
    calibration: Calibration = Calibration()
    folder: Annotated[Path, FILLED_IN] = Field(default=Path(), exclude=True)
    """Folder of the file; relative paths start there."""

    def __repr__(self) -> str:
        model = self.simulator
        what = f"simulator: {kind_of_simulator(model)}"
        if isinstance(model, SimulatorModel):
            what = f"network of {len(model.nodes)} nodes"
        windows = ", ".join(self.windows)
        counts = f"{len(self.parameters)} parameters, {len(self.observations)} channels observed"
        return f"<Scenario {self.name!r}: {what}, {counts}, windows {windows}>"

    @property
    def train_windows(self) -> tuple[str, ...]:
        """Names of the windows to calibrate on, in the file's order."""
        return tuple(name for name in self.windows if is_trained(name))

    @property
    def uncertain(self) -> set[str]:
        """Dotted paths of the numbers that parameters set or scale."""
        return {path for parameter in self.parameters.values() for path in (*parameter.sets, *parameter.scales)}

    @property
    def network(self) -> SimulatorModel:
        """The thermal network. Raises ScenarioError where the simulator is an external one."""
        if not isinstance(self.simulator, SimulatorModel):
            found = f"found an external simulator ({kind_of_simulator(self.simulator)})"
            raise ScenarioError(f"{self.name}: simulator: {found}, expected a thermal network: this needs its nodes")
        return self.simulator

    @property
    def step_tolerance(self) -> float:
        """On the integration's error, K: see `SimulatorModel.tolerance`. Raises ScenarioError as `network`."""
        if self.network.tolerance is not None:
            return self.network.tolerance
        noises = [noise_of(self, name) for name, item in self.observations.items() if item.heater is None]
        written = [(noise.quantisation, noise.standard_deviation, noise.white) for noise in noises]
        return min([_FINEST, *(0.1 * value for values in written for value in values if isinstance(value, float))])


def not_normal(scenario: Scenario) -> list[str]:
    """What the noise of temperature channels is called where it is not normal."""
    channels = (name for name, item in scenario.observations.items() if item.heater is None)
    return sorted({found for name in channels if (found := _written_noise(scenario, name).not_normal)})


def noise_of(scenario: Scenario, channel: str) -> Noise:
    """The noise of a temperature channel: its own, or else the scenario's `default_noise`."""
    has_own = scenario.observations[channel].noise is not None
    return _written_noise(scenario, channel) if has_own else default_noise(scenario)


def default_noise(scenario: Scenario) -> Noise:
    """The noise of channels that have none of their own; where the scenario writes none, beside heat it is AR(1)."""
    written = "noise" in scenario.model_fields_set
    return scenario.noise if written or heat_of(scenario) is None else NOISE_BESIDE_HEAT


def heat_of(scenario: Scenario) -> Heat | None:
    """The heat that the simulator does not know of; None: there is none.

    Where the scenario does not write it, it has the defaults, unless the scenario has what heat cannot stand beside.
    """
    if scenario.heat is not None:
        return scenario.heat if isinstance(scenario.heat, Heat) else None
    return Heat() if _BY_DEFAULT and can_have_heat(scenario) else None


def time_error_of(scenario: Scenario) -> float | None:
    """Prior standard deviation, s, of the error that time tags have in common; None: they have none."""
    if not timed_together(scenario):
        return None
    if scenario.time_error is not None:
        return None if scenario.time_error == "none" else scenario.time_error
    return _TIME_ERROR if heat_of(scenario) is not None else None


def timed_together(scenario: Scenario) -> tuple[str, ...]:
    """Paths of the time offsets that the error of all time tags sets: of channels with none of their own."""
    if not isinstance(scenario.simulator, SimulatorModel):
        return ()
    found = [
        f"observations.{name}.time_offset"
        for name, item in scenario.observations.items()
        if item.node is not None and item.time_offset == 0.0
    ]
    return tuple(path for path in found if path not in scenario.uncertain)


def can_have_heat(scenario: Scenario) -> bool:
    """Whether the simulator takes heat, and the scenario has nothing that heat cannot stand beside."""
    model = scenario.simulator
    if not isinstance(model, SimulatorModel) or (model.errors and model.reduced_model is None):
        return False
    holds_heat = any(node.capacity is not None for node in model.nodes.values())
    return holds_heat and scenario.discrepancy is None and not not_normal(scenario)


def _written_noise(scenario: Scenario, channel: str) -> Noise:
    own = scenario.observations[channel].noise
    if own is None:
        return scenario.noise
    return own if isinstance(own, Noise) else Noise.model_construct(standard_deviation=own)


def input_files(scenario: Scenario) -> list[Path]:
    """Telemetry, orbit and attitude files and those that the simulator is made of, as paths that can be opened."""
    environment = scenario.environment
    named = [*scenario.telemetry.files]
    attitude = environment.attitude
    kinds = attitude.attitudes if isinstance(attitude, AttitudeTimeline) else (attitude,)
    for block, field in ((environment.orbit, "positions"), *((kind, "quaternions") for kind in kinds)):
        if hasattr(block, field):
            named.append(getattr(block, field))
    if isinstance(scenario.simulator, SimulatorModel):
        model = scenario.simulator
        named += [name for name in (model.reduced_model, model.checked_on) if name is not None]
    return [*(scenario.folder / name for name in named), *simulator_files(scenario.simulator, scenario.folder)]
