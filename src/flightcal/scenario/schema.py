"""The problem file as immutable objects: what a scenario may say, in SI and kelvin.

Every class mirrors one block of the YAML file. Numbers with a dimension are written with their unit and are
SI floats here; times are UTC. Cross-references between blocks are checked in `lint`, not here.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator
from pydantic_core import core_schema

from ..errors import ScenarioError
from .attitude import AttitudeTimeline
from .calibration import Calibration
from .environment import Environment
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
    Block,
    Number,
    OneOf,
    Paths,
    exactly_one,
    read_empty,
)
from .heat import WrittenHeat
from .network import SimulatorModel
from .priors import Prior, prior_schema, read_prior
from .residuals import ChannelNoise, Noise, StatusLikelihood, WrittenDiscrepancy
from .telemetry import TelemetryFile
from .units import HOTTEST, Duration, Quantity
from .windows import Window, is_trained


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

    trend: Annotated[Number, Field(gt=0)] | None = None
    """It changes steadily, as a coating that ages: deviation of the normal prior of its change in a year, in standard
    deviations of the parameter's own prior. It is the same within a window. null: it does not."""

    @property
    def moves(self) -> bool:
        """Whether it is not the same in all windows."""
        return self.drift is not None or self.trend is not None

    @property
    def targets(self) -> tuple[str, ...]:
        """Dotted paths of all that it sets or scales."""
        return (*self.sets, *self.scales)


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
    discrepancy: WrittenDiscrepancy | None = None
    """What the simulator lacks, in temperature; none: nothing. Where it is not written: see `heat`."""
    heat: WrittenHeat | None = None
    """Heat that the simulator does not know of; none: there is none. Where it is not written: heat where the simulator
    takes it, and beside an external simulator a discrepancy that comes again in every orbit."""
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
        return {path for parameter in self.parameters.values() for path in parameter.targets}

    @property
    def network(self) -> SimulatorModel:
        """The thermal network. Raises ScenarioError where the simulator is an external one."""
        if not isinstance(self.simulator, SimulatorModel):
            found = f"found an external simulator ({kind_of_simulator(self.simulator)})"
            raise ScenarioError(f"{self.name}: simulator: {found}, expected a thermal network: this needs its nodes")
        return self.simulator


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
