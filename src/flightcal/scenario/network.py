"""The thermal network and the control of its heaters: the blocks of `simulator`."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, WrapValidator, field_validator, model_validator

from .body import Body
from .fields import (
    FILLED_IN,
    Block,
    FileName,
    Flag,
    Marker,
    Number,
    OneOf,
    Pair,
    Time,
    Vector,
    exactly_one,
    of_length,
)
from .units import HOTTEST, STRONGEST, Duration, Kelvins, Power, Quantity, QuantityOrName, Temperature

DEEP_SPACE = 2.725  # K, cosmic background (Fixsen 2009)
_ROOM = 293.15  # K


def _check_slope(block: Node | Conductor, key: str) -> None:
    """`key`_slope stands beside the number that it is of, and `at` beside it."""
    slope = getattr(block, f"{key}_slope")
    if slope is None and block.at is not None:
        raise ValueError(f"found 'at' without '{key}_slope', expected both or none")
    if slope is not None and getattr(block, key) is None:
        raise ValueError(f"found '{key}_slope' without '{key}', expected both")


class Node(Block):
    """A thermal node: diffusive (has a capacity), arithmetic (massless) or boundary (temperature given)."""

    capacity: Annotated[float, Quantity("J/K", above=0, believable=1e9)] | None = None
    capacity_slope: Annotated[float, Quantity("1/K", believable=0.1)] | None = None
    """Share by which the capacity grows with each kelvin of the node's temperature; null: it does not."""
    at: Temperature | None = None
    """Temperature of the node at which the capacity is what is written; null: 20 degC."""
    initial: Temperature | None = None
    arithmetic: Flag = False
    boundary: Annotated[float | str, QuantityOrName("K", at_least=0.0, believable=HOTTEST)] | None = None
    """A temperature, or the name of a temperature channel that is measured."""

    @model_validator(mode="after")
    def _one_kind(self) -> Node:
        _check_slope(self, "capacity")
        expected = "exactly one of 'capacity', 'arithmetic: true' (massless) and 'boundary' (given)"
        return exactly_one(self, ("capacity", "arithmetic", "boundary"), expected)

    @property
    def written_at(self) -> float:
        """K, `at` or its default."""
        return _ROOM if self.at is None else self.at


class SunTracking(Block):
    """How a face looks that a drive turns about an axis of the body, as near to the Sun as that can bring it."""

    tracks_sun_about: Vector
    """Axis of the drive, in the body frame."""
    back: Flag = False
    """Whether it is the side that looks away from the Sun."""


def _kind_of_normal(value: Any) -> Any:
    if isinstance(value, dict):
        return SunTracking
    return Literal["all"] if isinstance(value, str) else Vector


FaceNormal = Annotated[
    Vector | Literal["all"] | SunTracking,
    OneOf(_kind_of_normal, "a normal: three numbers [x, y, z], all, or a mapping with 'tracks_sun_about'"),
]


class Face(Block):
    """A flat outer face of a node: absorbs sunlight, albedo and Earth infrared, radiates to deep space."""

    node: str
    area: Annotated[float, Quantity("m^2", above=0, believable=1e6)]
    normal: FaceNormal
    """Outward normal in the body frame, of any length; "all": a convex body, averaged over directions; or a face that
    follows the Sun."""
    absorptivity: Annotated[float, Quantity("", at_least=0, at_most=1)]
    emissivity: Annotated[float, Quantity("", at_least=0, at_most=1)]


class Conductor(Block):
    """A link between two nodes: linear (W/K), or radiative (m2: area x emissivity x view factor)."""

    between: Pair
    name: str | None = None
    """null: ``first-second``."""
    conductance: Annotated[float, Quantity("W/K", at_least=0, believable=1e6)] | None = None
    conductance_slope: Annotated[float, Quantity("1/K", believable=0.1)] | None = None
    """Share by which the conductance grows with each kelvin of the mean temperature of its ends; null: it does not."""
    at: Temperature | None = None
    """Mean temperature of the ends at which the conductance is what is written; null: 20 degC."""
    radiative: Annotated[float, Quantity("m^2", at_least=0, believable=1e6)] | None = None

    @model_validator(mode="after")
    def _one_law(self) -> Conductor:
        _check_slope(self, "conductance")
        expected = "exactly one of 'conductance' (W/K) and 'radiative' (m^2)"
        return exactly_one(self, ("conductance", "radiative"), expected)

    @property
    def written_at(self) -> float:
        """K, `at` or its default."""
        return _ROOM if self.at is None else self.at

    @property
    def label(self) -> str:
        """The name that parameters and reports use."""
        return self.name or "-".join(self.between)


class Heater(Block):
    """A heater switched by a hysteresis thermostat, or driven by its measured status."""

    node: str
    power: Annotated[float, Quantity("W", at_least=0, believable=STRONGEST)]
    sensor: str
    """The node whose temperature the thermostat watches; it must have a capacity."""
    on_below: Temperature
    off_above: Temperature
    scatter: Kelvins = 0.0
    """Standard deviation of the temperature at which it switches around its thresholds, K: control cycle, noise of the
    readings. It counts in predictions; in a calibration thermostats are exact."""
    initially_on: Flag = False
    measured_by: str | None = None
    """Status channel: it gives the state at the window's start, and the input in open loop."""


class SwitchedHeater(Block):
    """A heater without a thermostat of its own: the switch of another heater turns it on and off."""

    node: str
    power: Annotated[float, Quantity("W", at_least=0, believable=STRONGEST)]
    switched_with: str
    """The heater whose thermostat, or measured status, it follows."""


AnyHeater = Annotated[
    Heater | SwitchedHeater,
    OneOf(lambda value: SwitchedHeater if isinstance(value, dict) and "switched_with" in value else Heater, "a heater"),
]


class NodePowers(dict[str, float]):
    """What a mode dissipates: node -> W."""


Powers = Annotated[
    dict[str, Power],
    WrapValidator(lambda value, read: value if isinstance(value, NodePowers) else NodePowers(read(value))),
]
"""A mode; once read it stays as it is."""


class ModeChange(Block):
    """From `at` on the spacecraft is in `mode`."""

    at: Time
    mode: str
    within: Annotated[float, Quantity("s", above=0)] | None = None
    """How long a time the change lies in, `at` in its middle: that between two samples, where samples tell of it."""


TablePoint = Annotated[tuple[Marker, Number], of_length(2, "a point of a table [driver, factor]")]


class Load(Block):
    """Heat into a node in proportion to a measured driver channel (in SI units: A, V, W), or by a table over it."""

    node: str
    driver: str
    coefficient: Marker
    """Heat per unit of the driver, with its unit: ``12 W/A``, or a plain number for a driver in watts; with `table`,
    watts."""
    absolute: Flag = False
    """The driver without its sign, as of a current that charges and discharges."""
    table: tuple[TablePoint, ...] = ()
    """Driver (in the channel's unit, or with one) -> factor of `coefficient`: linear in between, constant beyond."""

    @field_validator("table")
    @classmethod
    def _two_points(cls, table: tuple[TablePoint, ...]) -> tuple[TablePoint, ...]:
        if len(table) == 1:
            raise ValueError("found one point, expected two or more")
        return table


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

    offset: Kelvins
    """Standard deviation."""
    deviation: Kelvins
    """Standard deviation."""
    correlation_time: Duration
    """Of what varies: its correlation falls to 1/e."""


class SimulatorModel(Body):
    """The thermal network and the control of its heaters.

    Plates and boxes are meshed when it is read: then their cells are among the nodes, and it has none.
    """

    reduced_model: FileName | None = None
    """File that `flightcal reduce` wrote: nodes, faces, heaters and modes come from it; what is written here besides
    (initial temperatures, thresholds, powers, `measured_by`) replaces what it says."""
    reduced: dict[str, Marker] = Field(default_factory=dict)
    """Numbers of the reduced model by name, with their units, in the place of those in its file."""
    checked_on: FileName | None = None
    """Reduction file (that `flightcal reduce` read): at the end posterior draws fly on its operational simulator."""
    reduced_numbers: Annotated[dict[str, ReducedNumber], FILLED_IN] = Field(default_factory=dict)
    """Filled in from that file: what parameters may set in it, ``reduced.<name>``."""
    full_nodes: Annotated[tuple[str, ...], FILLED_IN] = ()
    """Likewise: nodes of the full network, into which unmodelled heat may go."""
    errors: dict[str, SimulatorError] = Field(default_factory=dict)
    """Temperature channel -> error against the simulator that this one stands in for; it enters the likelihood."""
    step: Annotated[float, Quantity("s", at_least=0.01, at_most=3600)] | None = None
    """Longest time step of the integration; by default as long as `tolerance` allows."""
    tolerance: Annotated[float, Quantity("K", above=0, difference=True)] | None = None
    """On the error of the integration, root mean square over time; by default 5 mK or, if that is less, a tenth of the
    least noise or resolution that the scenario writes for a temperature."""
    initial: Temperature | None = None
    """Temperature at which nodes start that have a capacity and no `initial` of their own; cells of plates need one."""
    nodes: dict[str, Node] = Field(min_length=1)
    """Besides the cells of plates, ``plate[row,column]``."""
    conductors: tuple[Conductor, ...] = ()
    faces: dict[str, Face] = Field(default_factory=dict)
    heaters: dict[str, AnyHeater] = Field(default_factory=dict)
    heater_input: Literal["simulated", "measured"] = "simulated"
    """simulated: thermostats act (closed loop); measured: status channels drive the heaters (open loop)."""
    modes: dict[str, Powers] = Field(default_factory=dict)
    """Mode -> node -> dissipation."""
    timeline: tuple[ModeChange, ...] = ()
    timeline_file: FileName | None = None
    """CSV file with columns at (UTC), mode and perhaps within, in the place of `timeline`: a row for each change, or
    each sample."""
    loads: dict[str, Load] = Field(default_factory=dict)

    @property
    def switches(self) -> dict[str, Heater]:
        """The heaters that have a thermostat: status, duty cycle and energy are by these."""
        return {name: heater for name, heater in self.heaters.items() if isinstance(heater, Heater)}

    def on_switch(self, name: str) -> dict[str, Heater | SwitchedHeater]:
        """The heater of this name, and those that are switched with it."""
        return {
            other: heater
            for other, heater in self.heaters.items()
            if other == name or (isinstance(heater, SwitchedHeater) and heater.switched_with == name)
        }
