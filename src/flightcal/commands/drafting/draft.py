"""A scenario for telemetry files: what they tell is written, and the rest are placeholders."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...errors import TelemetryError
from . import guess
from .channels import Channel, channels_of, packet_names, slug
from .network import TIMELINE, other_blocks
from .telemetry import telemetry_block

if TYPE_CHECKING:
    import xarray

    from ...telemetry import FoundModes, FoundPacket

_AS_WARM = {"degC": (-120.0, 140.0), "K": (150.0, 420.0)}
_VARIES, _REACHES = 2.0, 5.0
"""By how much a temperature varies at least, and what it reaches on one side of zero: currents in A are smaller."""
_UNIT_LENGTH, _NEARLY_ALL = 1e-3, 0.95
"""By how much the squares of a quaternion may differ from one, and of how many samples."""
_LEFT_OUT = (
    "for another time column write a packet of its own, for words of a heater's status `on` and `off`, for what says "
    "which rows are valid `valid_where`"
)
_NO_UNIT = "no unit, so measured inputs; of a temperature write `kind: temperature` and its unit"
_HEAD = """\
# A scenario for your telemetry. What the files tell is written. What says PLACEHOLDER is a guess: write yours.
#     flightcal lint {folder}/scenario.yaml
# lists what is wrong. Every number with a dimension carries its unit. Times are UTC. All blocks: docs/formats.md

name: {name}

"""


def draft(folder: Path, files: Sequence[Path]) -> tuple[dict[str, str], list[str]]:
    """The files of a scenario in `folder` for telemetry files, and what was found in these, a line each.

    Raises TelemetryError where no file has a temperature, or one cannot be read.
    """
    from ...telemetry import detect

    packets = detect(list(files))
    names = packet_names([packet for packet in packets if packet.columns])
    channels = _with_temperatures(names, channels_of(names), files)
    data, average = _averaged(names, channels)
    notes, quaternions = [], _quaternions(data, channels)
    for four in quaternions:
        where = ", ".join(file.name for file in names[four[0].packet].files)
        columns = ", ".join(f"'{member.column}'" for member in four)
        notes.append(f"{where}: {columns} are quaternions; not written: 'environment: attitude' takes them")
    channels = [member for member in channels if not any(member in four for four in quaternions)]
    names = {name: packet for name, packet in names.items() if any(member.packet == name for member in channels)}
    for name, packet in names.items():
        notes += _notes_of(packet, [channel for channel in channels if channel.packet == name])
    for packet in packets:
        if not packet.columns and packet.modes is None:
            alone = ", ".join(file.name for file in packet.files)
            notes.append(
                f"{alone}: found times and no channel; not written. 'timeline_file' in 'environment: attitude' takes a "
                "timeline of attitudes, and in 'simulator' one of modes"
            )
    timelines = [packet.modes for packet in packets if packet.modes is not None]
    modes = timelines[0] if timelines else None
    if modes is not None and modes.of_activities:
        modes = _begun(modes, packets)
    head = _HEAD.format(folder=folder, name=json.dumps(folder.resolve().name))
    text = head + telemetry_block(folder, names, channels) + average + other_blocks(data, channels, modes)
    made = {"scenario.yaml": text}
    if modes is not None:
        made[TIMELINE] = _timeline(modes)
        listed = ", ".join(dict.fromkeys(modes.names))
        notes.append(f"modes in '{modes.column}' ({listed}): {len(modes.changes) - 1} changes, in {TIMELINE}")
    notes += [f"modes in '{other.column}': not written; there is one timeline of modes" for other in timelines[1:]]
    return made, notes


def _with_temperatures(
    names: Mapping[str, FoundPacket], channels: Sequence[Channel], files: Sequence[Path]
) -> Sequence[Channel]:
    """The channels, of which some are temperatures, by their names or else by their values."""
    found = channels
    if not any(channel.kind == "temperature" for channel in channels):
        found = _by_values(names, channels)
    if any(channel.kind == "temperature" for channel in found):
        return found
    columns = ", ".join(channel.column for channel in channels[:12]) or "none"
    raise TelemetryError(
        f"{', '.join(map(str, files))}: found no temperature among the columns ({columns}), expected one; "
        "a name such as 'TT_BAT', 'Temp1' or 'Battery [degC]' tells"
    )


def _averaged(names: Mapping[str, FoundPacket], channels: Sequence[Channel]) -> tuple[xarray.Dataset, str]:
    """The telemetry as the scenario will read it, and the line `average` with which it does; "": without one."""
    from ...telemetry import ENOUGH, dense_channels

    block, average = telemetry_block(None, names, channels), ""
    data = _read(block)
    dense = dense_channels(data)
    if dense:
        apart = f"{min(dense.values()):.3g} s"
        average = f"  average: {ENOUGH:g} s  # samples are {apart} apart, and temperatures change in minutes\n"
        data = _read(block + average)
    together = _length_in_common(data, channels)
    if together is not None:
        average = f"  average: {together / 60:g} min  # packets are sampled at times of their own; means share theirs\n"
        data = _read(block + average)
    return data, average


def _notes_of(packet: FoundPacket, members: Sequence[Channel]) -> list[str]:
    """What was found in a packet, which has these channels, a line each."""
    kinds = [channel.kind for channel in members]
    counts = ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds))
    written = "clock, whose epoch is a PLACEHOLDER"
    if packet.time is not None:
        begin = np.datetime_as_string(np.datetime64(int(packet.first), "ns"), "s")
        since = "" if packet.time.epoch is None else f" since {packet.time.epoch:%Y-%m-%dT%H:%M}"
        written = f"{packet.time.format}{since}, from {begin}"
    title = f"{', '.join(file.name for file in packet.files)}{f' ({packet.sheet})' if packet.sheet else ''}"
    clock = ", ".join(f"'{name}'" for name in packet.clock)
    notes = [f"{title}: times in {clock} ({written}); channels: {counts}"]
    bare = [f"'{channel.column}'" for channel in members if channel.kind == "driver" and channel.unit == "1"]
    if bare:
        notes.append(f"{title}: {', '.join(bare)}: {_NO_UNIT}")
    if packet.left_out:
        left_out = ", ".join(f"'{column}'" for column in packet.left_out)
        notes.append(f"{title}: left out {left_out}: {_LEFT_OUT}")
    return notes


def _length_in_common(data: xarray.Dataset, channels: Sequence[Channel]) -> float | None:
    """Seconds over which means of packets have few times in common; null: they need none."""
    from ...telemetry import length_in_common

    if "packets" not in data.attrs:
        return None  # and no windows need to be guessed
    period = guess.period(data, [channel.name for channel in channels if channel.kind == "temperature"])
    packets = {channel.name: channel.packet for channel in channels}
    start, middle, _ = (np.datetime64(at) for at in guess.windows(data, packets, period))
    times = data["time"].to_numpy()
    return length_in_common(data, int(((times >= start) & (times < middle)).sum()))


def _by_values(names: Mapping[str, FoundPacket], channels: Sequence[Channel]) -> list[Channel]:
    """The channels where none is a temperature by its name: inputs without a unit that are as warm as satellites."""
    data = _read(telemetry_block(None, names, channels)) if channels else None
    found = []
    for channel in channels:
        low, high = 0.0, 0.0
        unknown = channel.kind == "driver" and channel.unit == "1" and not channel.found.is_called_an_input
        if data is not None and unknown:
            low, high = np.nanquantile(data[channel.name].to_numpy(), (0.05, 0.95)).tolist()
        unit = next((unit for unit, (least, most) in _AS_WARM.items() if least < low and high < most), None)
        if unit is not None and high - low > _VARIES and max(-low, high) > _REACHES:
            channel = channel._replace(found=replace(channel.found, kind="temperature", unit=unit), is_guess=True)
        found.append(channel)
    return found


def _quaternions(data: xarray.Dataset, channels: Sequence[Channel]) -> list[list[Channel]]:
    """Four measured inputs of a packet, one beside another, whose squares add up to one."""
    found: list[list[Channel]] = []
    for some in zip(channels, channels[1:], channels[2:], channels[3:], strict=False):
        alike = {(channel.packet, channel.kind) for channel in some} == {(some[0].packet, "driver")}
        if not alike or any(channel in four for channel in some for four in found):
            continue
        squares = np.sum([data[channel.name].to_numpy() ** 2 for channel in some], axis=0)
        known = squares[np.isfinite(squares)]
        if len(known) and np.mean(np.abs(known - 1.0) < _UNIT_LENGTH) > _NEARLY_ALL:
            found.append(list(some))
    return found


def _begun(activities: FoundModes, packets: Sequence[FoundPacket]) -> FoundModes:
    """The same with nothing going on from where telemetry begins."""
    from ...telemetry import NOTHING

    begin = min(packet.first for packet in packets if packet.time is not None)
    if begin >= activities.times[0]:
        return activities
    times = np.concatenate([np.array([begin], np.int64), activities.times])
    return replace(activities, times=times, names=(NOTHING, *activities.names))


def _timeline(modes: FoundModes) -> str:
    """The text of a timeline file."""
    changes = modes.changes
    times = np.datetime_as_string(np.array([1e3 * change.at for change in changes]).astype("datetime64[ms]"))
    rows = [["at", "mode", "within"]]
    for at, change in zip(times.tolist(), changes, strict=True):
        rows.append([at, slug(change.name), f"{change.within:.6g} s" if change.within else ""])
    return "".join(",".join(row[: 3 if modes.sampled else 2]) + "\n" for row in rows)


def _read(block: str) -> xarray.Dataset:
    """The telemetry as the scenario will read it."""
    from ruamel.yaml import YAML

    from ...scenario import TelemetryFile
    from ...telemetry import read_telemetry

    return read_telemetry(TelemetryFile.model_validate(YAML(typ="safe").load(block)["telemetry"]), Path())
