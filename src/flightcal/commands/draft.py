"""A scenario for telemetry files: what they tell is written, and the rest are placeholders."""

from __future__ import annotations

import json
import os
import re
import unicodedata
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..errors import TelemetryError
from . import guess

if TYPE_CHECKING:
    import xarray

    from ..telemetry import FoundColumn, FoundModes, FoundPacket

_PLAIN = re.compile(r"[A-Za-z][\w.-]*( [A-Za-z][\w.-]*)*")
_WORDS = ("on", "off", "yes", "no", "true", "false", "null", "y", "n")
_EPOCH = np.datetime64("2000-01-01T12:00:00", "ns")
_RATES = (10, 100, 1000, 10_000, 100_000, 1_000_000, *(2**k for k in range(17)))
"""Hz, of clocks that count ticks."""
_LONGEST_COUNT = 4e9
"""s, of a clock that nothing else tells the rate of: some hundred years."""
_ABOUT = 0.15
_COLD, _WARM = -20, 60
"""degC, that stand for the lowest and the highest of raw readings."""
_LABELS = re.compile(r"\s*\{.*\}\s*$")
"""Of a dashboard's series, as in `EPS.battery_temp {sat="NIX-1"}`."""
_TIMELINE = "timeline.csv"
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
_GUESS = "  # PLACEHOLDER: a temperature by its values, not by its name"
_HEAD = """\
# A scenario for your telemetry. What the files tell is written. What says PLACEHOLDER is a guess: write yours.
#     flightcal lint {folder}/scenario.yaml
# lists what is wrong. Every number with a dimension carries its unit. Times are UTC. All blocks: docs/formats.md

name: {name}

"""


class _Channel(NamedTuple):
    name: str
    packet: str
    found: FoundColumn
    is_guess: bool = False
    """Whether it is a temperature by its values alone."""

    @property
    def column(self) -> str:
        return self.found.name

    @property
    def kind(self) -> str:
        return self.found.kind

    @property
    def unit(self) -> str | None:
        return self.found.unit


def draft(folder: Path, files: Sequence[Path]) -> tuple[dict[str, str], list[str]]:
    """The files of a scenario in `folder` for telemetry files, and what was found in these, a line each.

    Raises TelemetryError where no file has a temperature, or one cannot be read.
    """
    from ..telemetry import ENOUGH, dense_channels, detect

    packets = detect(list(files))
    names = _packet_names([packet for packet in packets if packet.columns])
    channels = _channels(names)
    if not any(channel.kind == "temperature" for channel in channels):
        channels = _by_values(names, channels)
    if not any(channel.kind == "temperature" for channel in channels):
        found = ", ".join(channel.column for channel in channels[:12]) or "none"
        where = ", ".join(map(str, files))
        raise TelemetryError(
            f"{where}: found no temperature among the columns ({found}), expected one; "
            "a name such as 'TT_BAT', 'Temp1' or 'Battery [degC]' tells"
        )
    data, average = _read(_telemetry(None, names, channels)), ""
    dense = dense_channels(data)
    if dense:
        apart = f"{min(dense.values()):.3g} s"
        average = f"  average: {ENOUGH:g} s  # samples are {apart} apart, and temperatures change in minutes\n"
        data = _read(_telemetry(None, names, channels) + average)
    together = _length_in_common(data, channels)
    if together is not None:
        average = f"  average: {together / 60:g} min  # packets are sampled at times of their own; means share theirs\n"
        data = _read(_telemetry(None, names, channels) + average)
    notes, turned = [], _quaternions(data, channels)
    for some in turned:
        where = ", ".join(file.name for file in names[some[0].packet].files)
        columns = ", ".join(f"'{member.column}'" for member in some)
        notes.append(f"{where}: {columns} are quaternions; not written: 'environment: attitude' takes them")
    channels = [member for member in channels if not any(member in some for some in turned)]
    names = {name: packet for name, packet in names.items() if any(member.packet == name for member in channels)}
    for name, packet in names.items():
        members = [channel for channel in channels if channel.packet == name]
        kinds = [channel.kind for channel in members]
        counts = ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds))
        written = "clock, whose epoch is a PLACEHOLDER"
        if packet.time is not None:
            begin = np.datetime_as_string(np.datetime64(int(packet.first), "ns"), "s")
            since = "" if packet.time.epoch is None else f" since {packet.time.epoch:%Y-%m-%dT%H:%M}"
            written = f"{packet.time.format}{since}, from {begin}"
        title = f"{', '.join(file.name for file in packet.files)}{f' ({packet.sheet})' if packet.sheet else ''}"
        clock = ", ".join(f"'{name}'" for name in packet.clock)
        notes.append(f"{title}: times in {clock} ({written}); channels: {counts}")
        bare = [f"'{channel.column}'" for channel in members if channel.kind == "driver" and channel.unit == "1"]
        if bare:
            notes.append(f"{title}: {', '.join(bare)}: {_NO_UNIT}")
        if packet.left_out:
            left_out = ", ".join(f"'{column}'" for column in packet.left_out)
            notes.append(f"{title}: left out {left_out}: {_LEFT_OUT}")
    for packet in packets:
        if not packet.columns and packet.modes is None:
            alone = ", ".join(file.name for file in packet.files)
            notes.append(
                f"{alone}: found times and no channel; not written. 'timeline_file' in 'environment: attitude' takes a "
                "timeline of attitudes, and in 'simulator' one of modes"
            )
    told = [packet.modes for packet in packets if packet.modes is not None]
    modes = told[0] if told else None
    if modes is not None and modes.of_activities:
        modes = _begun(modes, packets)
    head = _HEAD.format(folder=folder, name=json.dumps(folder.resolve().name))
    text = head + _telemetry(folder, names, channels) + average + _rest(data, channels, modes)
    made = {"scenario.yaml": text}
    if modes is not None:
        made[_TIMELINE] = _timeline(modes)
        listed = ", ".join(dict.fromkeys(modes.names))
        notes.append(f"modes in '{modes.column}' ({listed}): {len(modes.changes) - 1} changes, in {_TIMELINE}")
    notes += [f"modes in '{own.column}': not written; there is one timeline of modes" for own in told[1:]]
    return made, notes


def _length_in_common(data: xarray.Dataset, channels: Sequence[_Channel]) -> float | None:
    """Seconds over which means of packets have few times in common; null: they need none."""
    from ..telemetry import length_in_common

    if "packets" not in data.attrs:
        return None  # and no windows need to be guessed
    period = guess.period(data, [channel.name for channel in channels if channel.kind == "temperature"])
    packets = {channel.name: channel.packet for channel in channels}
    start, middle, _ = (np.datetime64(at) for at in guess.windows(data, packets, period))
    times = data["time"].to_numpy()
    return length_in_common(data, int(((times >= start) & (times < middle)).sum()))


def _by_values(names: Mapping[str, FoundPacket], channels: Sequence[_Channel]) -> list[_Channel]:
    """The channels where none is a temperature by its name: inputs without a unit that are as warm as satellites."""
    data = _read(_telemetry(None, names, channels)) if channels else None
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


def _quaternions(data: xarray.Dataset, channels: Sequence[_Channel]) -> list[list[_Channel]]:
    """Four measured inputs of a packet, one beside another, whose squares add up to one."""
    found: list[list[_Channel]] = []
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
    from ..telemetry import NOTHING

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
        rows.append([at, _slug(change.name), f"{change.within:.6g} s" if change.within else ""])
    return "".join(",".join(row[: 3 if modes.sampled else 2]) + "\n" for row in rows)


def _packet_names(packets: Sequence[FoundPacket]) -> dict[str, FoundPacket]:
    """Packets by a name of their own: the sheet's, or the file's."""
    names: dict[str, FoundPacket] = {}
    for packet in packets:
        stem = packet.files[0].name.split(".")[0]
        names[_unique(_slug(packet.sheet or stem), names)] = packet
    return names


def _channels(names: Mapping[str, FoundPacket]) -> list[_Channel]:
    taken: dict[str, object] = dict.fromkeys(("time", "channel", "flags", "finding", "rows", "masked", "space"))
    channels = []
    whole = {_title(column) for packet in names.values() for column in packet.columns}
    bare = Counter(_LABELS.sub("", title) for title in whole)
    for packet_name, packet in names.items():
        for column in packet.columns:
            bit, title = "" if column.bit is None else f"_{column.bit}", _title(column)
            short = _LABELS.sub("", title)
            name = _unique(f"{_slug(short if bare[short] == 1 else title)}{bit}", taken)
            taken[name] = None
            channels.append(_Channel(name, packet_name, column))
    return channels


def _title(column: FoundColumn) -> str:
    """What a column is called."""
    return column.called or column.name


def _telemetry(folder: Path | None, names: Mapping[str, FoundPacket], channels: Sequence[_Channel]) -> str:
    """The block for a scenario in a folder; null: with absolute paths."""
    lines = ["telemetry:"]
    single = len(names) == 1 and all(packet.sheet is None for packet in names.values())
    if not single:
        lines.append("  packets:                          # each has columns, sampling and a clock of its own")
    for name, packet in names.items():
        file = _texts(
            [str(path.absolute()) if folder is None else os.path.relpath(path, folder) for path in packet.files]
        )
        sheet = f", sheet: {_text(packet.sheet)}" if packet.sheet else ""
        header = f"header: {packet.header}" if packet.header else ""
        time = _time(packet, names)
        readings = ""
        if packet.readings is not None:
            found_readings = packet.readings
            readings = f"readings: {{name: {_texts(found_readings.name)}, value: {_text(found_readings.value)}}}"
        valid = ", ".join(f"{_text(column)}: {_text(word)}" for column, word in packet.valid_where.items())
        valid_where = f"valid_where: {{{valid}}}" if valid else ""
        comment = "" if packet.time is not None else "  # PLACEHOLDER: UTC at count 0, counts a second"
        if single:
            more = [f"  {key}" for key in (header, readings, valid_where) if key]
            lines += [f"  file: {file}", f"  time: {time}{comment}", *more]
        else:
            more = [f", {key}" for key in (header, readings, valid_where) if key]
            lines.append(f"    {name}: {{file: {file}{sheet}, time: {time}{''.join(more)}}}{comment}")
    lines += [
        "  channels:",
        "    # The name is yours. kind: temperature, status (on or off) or driver (measured input).",
    ]
    for channel in channels:
        packet_key = "" if single else f"packet: {channel.packet}, "
        unit = "" if channel.unit is None else f", unit: {_text(channel.unit) if channel.unit != '1' else 1}"
        lines.append(
            f"    {channel.name}: {{{packet_key}column: {_text(channel.column)}{unit}, kind: {channel.kind}"
            f"{_more(channel.found)}{_GUESS if channel.is_guess else ''}"
        )
    return "\n".join(lines) + "\n"


def _more(column: FoundColumn) -> str:
    """What says how a column is read, the bracket that ends it, and a comment."""
    if column.raw is not None:
        low, high = column.raw
        guess = f"[[{low:g}, {_COLD} degC], [{high:g}, {_WARM} degC]]"
        return f", curve: {guess}}}  # PLACEHOLDER: what the raw readings of {column.name} mean"
    if column.bit is not None:
        base = "" if column.base is None else f", base: {column.base}"
        return f", bits: {column.bit}{base}}}"
    if column.on_off is not None:
        on, off = map(_text, column.on_off)
        return f", on: [{on}], off: [{off}]}}"
    return "}" if column.on_above is None else f", on_above: {column.on_above}}}"


def _texts(values: Sequence[str]) -> str:
    """One text, or a list of several."""
    return _text(values[0]) if len(values) == 1 else f"[{', '.join(map(_text, values))}]"


def _time(packet: FoundPacket, names: Mapping[str, FoundPacket]) -> str:
    """The block `time` of a packet."""
    parts = [f"column: {_texts(packet.clock)}"]
    if packet.time is None:
        rate = _rate(packet, names)
        parts += ["format: clock", f"epoch: {_epoch(packet, names, rate)}", f"rate: {rate} Hz"]
        parts += [f"fine: {packet.fine}"] if packet.fine else []
    else:
        parts.append(f"format: {_text(packet.time.format)}")
        if packet.time.epoch is not None:
            per_day = 86400 * (packet.time.rate or 1.0)
            pace = "1 1/day" if round(per_day) == 1 else f"{per_day / 86400:g} Hz"
            parts += [f"epoch: {packet.time.epoch:%Y-%m-%dT%H:%M:%S}", f"rate: {pace}"]
        parts += ["leap_seconds: true"] if packet.time.leap_seconds else []
        marks = ", ".join(json.dumps(str(mark)) for mark in packet.time.invalid)
        parts += [f"invalid: [{marks}]"] if marks else []
    return f"{{{', '.join(parts)}}}"


def _epoch(packet: FoundPacket, names: Mapping[str, FoundPacket], rate: int) -> str:
    """A guess at a clock's epoch, with which it begins where the other packets do."""
    starts = [other.first for other in names.values() if other.time is not None]
    since = np.timedelta64(int(packet.first / rate), "s")
    epoch = _EPOCH if not starts else np.datetime64(int(max(starts)), "ns") - since
    return str(np.datetime_as_string(epoch, unit="s"))


def _rate(packet: FoundPacket, names: Mapping[str, FoundPacket]) -> int:
    """A guess at how often a clock counts a second: with it, it runs about as long as the other packets do."""
    longest = max((other.last - other.first for other in names.values() if other.time is not None), default=0.0) / 1e9
    if not longest:
        return next((rate for rate in sorted(_RATES) if packet.last / rate < _LONGEST_COUNT), max(_RATES))
    nearest = min(_RATES, key=lambda rate: abs(np.log((packet.last - packet.first) / rate / longest)))
    return nearest if abs(np.log((packet.last - packet.first) / nearest / longest)) < _ABOUT else 1


def _read(block: str) -> xarray.Dataset:
    """The telemetry as the scenario will read it."""
    from ruamel.yaml import YAML

    from ..scenario import TelemetryFile
    from ..telemetry import read_telemetry

    return read_telemetry(TelemetryFile.model_validate(YAML(typ="safe").load(block)["telemetry"]), Path())


def _rest(dataset: xarray.Dataset, channels: Sequence[_Channel], modes: FoundModes | None) -> str:
    """The other blocks: a node for each temperature, a heater for each status."""
    from ..scenario import kind_of

    nodes = [channel.name for channel in channels if channel.kind == "temperature"]
    statuses = [channel.name for channel in channels if channel.kind == "status"]
    heaters = guess.heaters(dataset, statuses, nodes)
    same = guess.same_heaters(dataset, heaters)
    heaters = {name: node for name, node in heaters.items() if name not in same}
    shadow = [name for name in statuses if guess.tells_shadow(name)][:1]
    period = guess.period(dataset, nodes)
    links = [f"    - {{between: [{a}, {b}], conductance: 0.5 W/K}}" for a, b in pairwise(nodes)]
    lines = [
        "",
        "# PLACEHOLDER: the orbital period; with `orbit` and `attitude`, sunlight on `faces` is computed.",
        "# Of a probe without an orbit, leave the block out.",
        *(["# In these telemetry files the temperatures come again after about this time."] if period else []),
        f"environment: {{period: {f'{period / 60:.4g}' if period else '95'} min}}",
        *(f"# With `orbit`, `eclipse: {{measured_by: {name}}}` takes the shadow from the flag." for name in shadow),
        "",
        "# PLACEHOLDER: every number of the thermal network.",
        "simulator:",
        "  nodes:",
        *(f"    {name}: {{capacity: 1000 J/K}}" for name in nodes),
        "    space: {boundary: -270 degC}",
        "  conductors:",
        *links,
        *(f"    - {{between: [{name}, space], radiative: 0.02 m^2}}" for name in nodes),
        *(["  heaters:"] if heaters else []),
    ]
    for name, other in same.items():
        lines.append(f"    # {name} is on and off as {other} is: the same heater.")
    for name, node in heaters.items():
        low, high = guess.thresholds(dataset["time"].values, dataset[node].values, dataset[name].values)
        lines.append(
            f"    {name}: {{node: {node}, power: 10 W, sensor: {node}, on_below: {low} degC, off_above: {high} degC, "
            f"measured_by: {name}}}"
        )
    powers = ", ".join(f"{name}: 5 W" for name in nodes)
    if modes is None:
        lines += ["  modes:", f"    nominal: {{{powers}}}", ""]
    else:
        lines += ["  modes:                            # PLACEHOLDER: what each unit takes in each mode"]
        lines += [f"    {name}: {{{powers}}}" for name in dict.fromkeys(map(_slug, modes.names))]
        lines += [f"  timeline_file: {_TIMELINE}", ""]
    if any(channel.kind == "driver" for channel in channels):
        driver = next(channel for channel in channels if channel.kind == "driver")
        # Of a power the coefficient is a share.
        power = driver.unit is not None and kind_of(driver.unit) == "a power"
        per = "" if driver.unit in (None, "1") else f"/{driver.unit}"
        coefficient = f"0.2 {driver.unit}{per}" if power else f"1 W{per}"
        lines += [
            "  # A driver heats a node by its value times a coefficient, such as",
            f"  # loads: {{sun: {{node: {nodes[0]}, driver: {driver.name}, coefficient: {coefficient}}}}}",
            "",
        ]
    if others := [name for name in statuses if name not in heaters and name not in same]:
        lines += [
            f"  # On or off, and by no temperature a heater's: {', '.join(others)}.",
            "  # To heat a node meanwhile, make it a driver (`kind: driver`, with `bits` or `on: [1]`), and add a load",
            "  # with the power as its coefficient, such as 2 W.",
            "",
        ]
    lines += ["# Uncertain numbers, each with what is believed of it.", "parameters:"]
    for name in nodes:
        lines.append(
            f"  {name}_capacity: {{scales: nodes.{name}.capacity, prior: {{lognormal: {{median: 1, factor: 2}}}}}}"
        )
        target = f"modes.nominal.{name}" if modes is None else f'"modes.*.{name}"'
        lines.append(f"  {name}_power: {{sets: {target}, prior: {{half_normal: 10 W}}}}")
    lines += ["", "# Which channel measures what.", "observations:"]
    lines += [f"  {name}: {{node: {name}}}" for name in nodes]
    lines += [f"  {name}: {{heater: {name}}}" for name in heaters]
    start, middle, end = guess.windows(dataset, {channel.name: channel.packet for channel in channels}, period)
    lines += [
        "",
        "# train is calibrated on; test is unseen, and scored.",
        "windows:",
        f"  train: {{start: {start}, end: {middle}}}",
        f"  test:  {{start: {middle}, end: {end}}}",
    ]
    return "\n".join(lines) + "\n"


def _slug(text: str) -> str:
    """A name for YAML and dotted paths."""
    plain = "".join(one for one in unicodedata.normalize("NFKD", text) if not unicodedata.combining(one))
    name = re.sub(r"\W+", "_", plain.strip(), flags=re.ASCII).strip("_").lower()
    return name if name[:1].isalpha() and name not in _WORDS else f"c_{name}".rstrip("_")


def _unique(name: str, taken: Mapping[str, object]) -> str:
    number = 2
    found = name
    while found in taken:
        found, number = f"{name}_{number}", number + 1
    return found


def _text(value: str) -> str:
    """Text as YAML has it inside of braces."""
    plain = _PLAIN.fullmatch(value) and value.lower() not in _WORDS
    return value if plain else json.dumps(value, ensure_ascii=False)
