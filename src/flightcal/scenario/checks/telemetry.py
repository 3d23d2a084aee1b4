"""The telemetry: files, and channels with units that suit their kind."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from ..blocks import readable
from ..document import Issue, Location
from ..reading import Reading
from ..telemetry import Channel
from ..units import celsius, did_you_mean, is_temperature, kind_of, parse_unit, show, si_unit, to_si
from .common import file_exists

_RESERVED = frozenset(["time", "channel", "flags", "finding", "rows", "masked"])
"""Variables that are beside the channels in a dataset of telemetry."""
_RAW = ("a plain number", "a voltage", "a resistance")
"""What a thermistor's reading is before it is made a temperature."""
_COMBINATIONS = {"temperature": ("mean",), "status": (), "driver": ("mean", "sum", "product")}


def check(reading: Reading, folder: Path) -> Iterator[Issue]:
    """Files exist; units, ranges and options of channels suit their kind."""
    files: dict[Location, tuple[str, ...]] = {("telemetry",): reading.blocks.files}
    packets = readable(reading.blocks.packets or {})
    files |= {("telemetry", "packets", name): packet.file for name, packet in packets.items()}
    for place, names in files.items():
        for name in names:
            yield from file_exists(folder, name, "a telemetry file,", (*place, "file"))
    yield from _check_packets(reading)
    for name, channel in readable(reading.blocks.channels).items():
        location = ("telemetry", "channels", name)
        if name in _RESERVED:
            message = f"found the name {name!r}, expected another: telemetry has something of its own that is called so"
            yield Issue(location, message)
        yield from _check_columns(channel, location)
        yield from _check_status(channel, location)
        unit_problem = _unit_problem(channel)
        if unit_problem:
            yield Issue((*location, "unit"), unit_problem)
        elif channel.valid_range is not None:
            yield from _check_range(channel, (*location, "valid_range"))
        yield from _check_limits(channel, (*location, "limits"), observed=name in reading.blocks.observations)
        yield from _check_options(channel, location, reading)
    yield from _check_shared(reading)


def _check_packets(reading: Reading) -> Iterator[Issue]:
    """Each channel is of one packet, and each packet has a channel."""
    if reading.blocks.packets is None:
        return
    packets = tuple(reading.blocks.packets)
    channels = reading.blocks.channels
    for name, channel in readable(channels).items():
        location: Location = ("telemetry", "channels", name)
        if channel.packet is None and packets:
            yield Issue(location, f"missing key 'packet', expected {' or '.join(packets)}")
        elif channel.packet is not None and channel.packet not in packets:
            wanted = f"expected {' or '.join(packets)}" if packets else "expected none: telemetry has no 'packets'"
            message = f"found {show(channel.packet)}, {wanted}{did_you_mean(channel.packet, packets)}"
            yield Issue((*location, "packet"), message)
    for packet in packets:
        if all(channel is not None and channel.packet != packet for channel in channels.values()):
            message = "found no channel of this packet, expected one, or the packet is not needed"
            yield Issue(("telemetry", "packets", packet), message, warning=True)


def _check_status(channel: Channel, location: Location) -> Iterator[Issue]:
    """What makes a status of a column is of a status or of a driver that is on or off, and there is one such thing."""
    keys = [key for key in ("on_above", "on_below", "bits") if getattr(channel, key) is not None]
    if not channel.is_state and channel.kind != "status":
        for key in [*(key for key in ("on", "off", "base") if key in channel.model_fields_set), *keys]:
            yield Issue((*location, key), f"found {key!r} for a {channel.kind}, expected it for a status only")
        return
    if "base" in channel.model_fields_set and channel.bits is None:
        yield Issue((*location, "base"), "found 'base' without 'bits', expected it beside them only")
    if len(keys) > 1:
        yield Issue((*location, keys[1]), f"found {keys[0]!r} and {keys[1]!r}, expected one of them")
    elif keys:
        excluded = ("off",) if keys == ["bits"] else ("on", "off")
        for key in excluded:
            if key in channel.model_fields_set:
                yield Issue((*location, key), f"found {key!r} beside {keys[0]!r}, expected one of them")
    if channel.threshold is not None and channel.unit is not None and not _unit_problem(channel):
        try:
            to_si(getattr(channel, channel.threshold), si_unit(channel.unit))
        except ValueError as error:
            yield Issue((*location, channel.threshold), str(error))


def _check_shared(reading: Reading) -> Iterator[Issue]:
    """Two observed channels or drivers had better not read one column: the same samples would count twice."""
    first: dict[tuple[str, str | None, tuple[int, ...] | None, str], str] = {}
    channels = readable(reading.blocks.channels)
    for name, channel in channels.items():
        if channel.kind != "driver" and name not in reading.blocks.observations:
            continue
        # Drivers that several columns make are the same where all columns are.
        for column in (", ".join(channel.column),) if channel.kind == "driver" else channel.column:
            other = first.setdefault((channel.kind, channel.packet, channel.bits, column), name)
            if other != name:
                message = f"found the column {show(column)}, which {other!r} reads too"
                wanted = "expected different ones: the same samples would count twice"
                if channel.kind == "driver":
                    wanted = "expected different ones, or one driver of several loads"
                yield Issue(("telemetry", "channels", name, "column"), f"{message}, {wanted}", warning=True)


def _unit_problem(channel: Channel) -> str | None:
    if channel.is_state:
        of_what = "a status" if channel.kind == "status" else "a driver that is on or off"
        return None if channel.unit is None else f"found {show(channel.unit)}, expected no unit for {of_what}"
    if channel.curve and channel.kind == "temperature":
        return None if channel.unit is None else f"found {show(channel.unit)} beside 'curve', expected one of them"
    is_temperature_channel = channel.kind == "temperature"
    wanted = "degC or K" if is_temperature_channel else "a unit, or 'dimensionless'"
    if channel.unit is None:
        what = f"a status with {channel.threshold!r}" if channel.threshold else f"a {channel.kind} channel"
        return f"missing unit of {what}, expected {wanted}"
    hint = did_you_mean(channel.unit, ("degF",) if "f" in channel.unit.lower() else ("degC", "K"))
    try:
        parse_unit(channel.unit)
        if not is_temperature_channel or is_temperature(channel.unit):
            return None
        kind = kind_of(channel.unit)
        if kind in _RAW:
            hint = ", or 'curve' in the place of 'unit'"
    except ValueError as error:
        return f"found {show(channel.unit)}, expected {wanted}{hint if is_temperature_channel else f': {error}'}"
    return f"found {show(channel.unit)} ({kind}), expected {wanted}{hint}"


def _check_columns(channel: Channel, location: Location) -> Iterator[Issue]:
    if channel.curve and (channel.kind != "temperature" or len(channel.column) > 1):
        found = f"a {channel.kind}" if channel.kind != "temperature" else f"{len(channel.column)} columns"
        yield Issue((*location, "curve"), f"found 'curve' for {found}, expected it for a temperature in one column")
    allowed = _COMBINATIONS["driver" if channel.threshold else channel.kind]
    if len(channel.column) > 1 and channel.combine is None:
        wanted = f"'combine' ({', '.join(allowed)}) beside them" if allowed else "one"
        message = f"found {len(channel.column)} columns, expected {wanted}"
        yield Issue((*location, "column"), message)
    elif channel.combine is not None and channel.combine not in allowed:
        wanted = ", ".join(allowed) or "one column"
        yield Issue((*location, "combine"), f"found {channel.combine!r} for a {channel.kind}, expected {wanted}")


def _check_range(channel: Channel, location: Location) -> Iterator[Issue]:
    assert channel.valid_range is not None
    if channel.is_state:
        yield Issue(location, "found a range, expected none for a status")
        return
    unit = "K" if channel.curve else si_unit(channel.unit or "")
    bounds = []
    for k, bound in enumerate(channel.valid_range):
        try:
            bounds.append(to_si(bound, unit))
        except ValueError as error:
            yield Issue((*location, k), str(error))
    if len(bounds) == 2 and not bounds[0] < bounds[1]:
        lowest, highest = map(show, channel.valid_range)
        yield Issue(location, f"found {lowest} to {highest}, expected the lowest value before the highest")


def _check_limits(channel: Channel, location: Location, *, observed: bool) -> Iterator[Issue]:
    if channel.limits is None:
        return
    lowest, highest = channel.limits
    if channel.kind != "temperature":
        yield Issue(location, f"found limits of a {channel.kind}, expected them of a temperature only")
    elif lowest is not None and highest is not None and not lowest < highest:
        found = f"found {celsius(lowest)} to {celsius(highest)}"
        yield Issue(location, f"{found}, expected the lowest value before the highest")
    elif not observed:
        message = "found limits of a channel that no observation has, expected one: it is not predicted"
        yield Issue(location, message, warning=True)


def _check_options(channel: Channel, location: Location, reading: Reading) -> Iterator[Issue]:
    if channel.kind != "driver" and "fill" in channel.model_fields_set:
        yield Issue((*location, "fill"), f"found 'fill' for a {channel.kind}, expected it for a driver only")
    if channel.longest_gap is not None and (channel.kind != "driver" or channel.fill != "interpolate"):
        message = "found 'longest_gap', expected it for a driver with 'fill: interpolate' only"
        yield Issue((*location, "longest_gap"), message)
    environment = reading.blocks.environment
    known = environment is None or environment.comes_again
    try:
        channel.bridge  # noqa: B018
    except ValueError as error:
        words = "expected interpolate, previous_orbit, hold or the value in gaps"
        yield Issue((*location, "fill"), f"{words}: {error}")
    if channel.fill == "previous_orbit" and not known:
        message = "found 'previous_orbit', expected 'orbit' or 'period' in environment: no orbital period is known"
        yield Issue((*location, "fill"), message)
