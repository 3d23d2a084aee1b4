"""Telemetry files: which channels, from which columns, in which units, at which times."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from .fields import (
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
    Range,
    Time,
    TimeFormat,
    of_length,
)
from .units import HOTTEST, Duration, Quantity, kind_of, si_unit, to_si


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


Limit = Annotated[float, Quantity("K", above=0, at_most=HOTTEST)]
Limits = Annotated[
    tuple[Limit | None, Limit | None],
    of_length(2, "two temperatures [lowest, highest], null for one that there is not"),
]


Fill = Literal["interpolate", "previous_orbit", "hold"] | float
"""How a driver's gaps are bridged; a number: the value in them, SI."""


class Span(Block):
    """A stretch of time, both ends in it."""

    start: Time
    end: Time

    @model_validator(mode="after")
    def _goes_forward(self) -> Span:
        if self.end < self.start:
            raise ValueError(f"found end {self.end.isoformat()}, expected none before {self.start.isoformat()}")
        return self


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
    limits: Limits | None = None
    """Of a temperature: the lowest and the highest that operations allow, null for none. The chance that a plan passes
    one is told."""
    invalid: Markers = ()
    """Marker values of the ground system, as they stand in the file."""
    on: Markers = (1.0, "1", "ON", "on", "On", "true", "True", "TRUE", "YES", "ENABLED", "ENABLE", "ACTIVE", "CLOSED")
    """For a status: the values that mean on. With it or `bits`, a driver is a state: 1 on, 0 off."""
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
    valid_where: dict[str, Markers] = Field(default_factory=dict)
    """Columns that say which rows are valid, and what stands there then; beside those of the packet."""
    leave_out: tuple[Span, ...] = ()
    """Times of which no sample is used, such as those of a sensor that is stuck or has a spike."""
    fill: Literal["interpolate", "previous_orbit", "hold"] | Marker = "interpolate"
    """For a driver: how its gaps are bridged; hold: it has no gaps, for each value stays until the next sample. Or the
    value that it has wherever there are no samples, with its unit."""
    longest_gap: Duration | None = None
    """For a driver with `fill: interpolate`: the longest gap that a straight line bridges; null: a tenth of an orbit,
    at most 30 min."""

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
    def bridge(self) -> Fill:
        """`fill`; a value in the unit that samples are read in, SI."""
        match self.fill:
            case "interpolate" | "previous_orbit" | "hold":
                return self.fill
            case value:
                return to_si(value, si_unit(self.unit or "1"))

    @property
    def is_state(self) -> bool:
        """Whether its cells are words that mean on or off, or have bits that do."""
        of_words = self.bits is not None or not self.model_fields_set.isdisjoint(("on", "off"))
        return self.threshold is None and (self.kind == "status" or (self.kind == "driver" and of_words))

    @property
    def is_angle(self) -> bool:
        """Whether its unit is that of an angle."""
        return self.unit is not None and kind_of(self.unit) == "an angle"

    @property
    def says_on(self) -> str:
        """The key of a status that says what is on, in quotes."""
        return f"'{self.threshold or ('bits' if self.bits is not None else 'on')}'"

    @property
    def threshold(self) -> Literal["on_above", "on_below"] | None:
        """The key that makes a status of a number; null: it is none that is made so."""
        return "on_above" if self.on_above is not None else "on_below" if self.on_below is not None else None


class Readings(Block):
    """Columns of a file that has a row for each reading; a channel's `column` is then the name of a reading."""

    name: Names
    """Several, such as a subsystem and a field, are read as one text with spaces in between."""
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
    valid_where: dict[str, Markers] = Field(default_factory=dict)
    """Columns that say which rows are valid, and what stands there then: `{VALIDITY: VALID}`."""
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
    valid_where: dict[str, Markers] = Field(default_factory=dict)
    """Columns that say which rows are valid, and what stands there then."""
    packets: dict[str, Packet] = Field(default_factory=dict)
    """In the place of `file` and `time`: files, each with columns, sampling and clock of its own."""
    average: Duration | None = None
    """Block mean over this long; null: every sample as it is."""
    channels: dict[str, Channel] = Field(min_length=1)

    @model_validator(mode="after")
    def _one_form(self) -> TelemetryFile:
        beside = [key for key in ("file", "sheet", "header", "time", "readings", "valid_where") if getattr(self, key)]
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
            valid_where=self.valid_where,
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
