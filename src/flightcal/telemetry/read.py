"""Telemetry files and their specification -> one Dataset in SI, with a reason for every sample not used."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import xarray as xr
from numpy.typing import NDArray

from ..environment import orbital_period
from ..errors import TelemetryError
from ..scenario import Channel, Packet, Scenario, TelemetryFile, TimeColumn
from ._flags import Flag, Flags, flag_attributes, meaning
from ._times import Nanoseconds, is_fill, parse_times, time_cells
from ._units import Conversion, conversion
from ._values import Values, channel_values
from .average import average
from .clean import order_rows, sampling_interval
from .merge import merged
from .readers import Source, content, locate, nearest, read_table
from .readings import of, side_by_side
from .stale import RowContent, repeats, row_content


@dataclass(frozen=True)
class _Rows:
    """Rows [R] of one or several files: times (ns), values (SI) and flags [R, C], and what tells rows apart."""

    times: Nanoseconds
    values: Values
    flags: Flags
    content: RowContent
    untimed: int
    """Rows of the files, besides these, that have a mark in the place of a time."""


def read(scenario: Scenario) -> xr.Dataset:
    """The telemetry of a scenario, cleaned; see `read_telemetry`. Raises TelemetryError."""
    period = orbital_period(scenario.environment, scenario.folder)
    return read_telemetry(scenario.telemetry, scenario.folder, period=period)


def read_telemetry(specification: TelemetryFile, folder: Path, *, period: float | None = None) -> xr.Dataset:
    """Flight data as `specification` describes them; several packets on the times of all of them, none interpolated.

    folder: where relative file names start. period: orbital period (s), kept for drivers that are bridged
    from other orbits.

    Returns dims `time` (datetime64[ns], UTC, strictly increasing) and `channel`: one float64 variable [time]
    for each channel in SI (temperature K, status 0 or 1), NaN where it cannot be used, and `flags` [time,
    channel] uint8 that say why. Attributes: files, sampling_interval_s, rows_read, untimed, duplicates, conflicts,
    conflict_times, unsorted, stale_checked, and period_s, average_s where given. Block averages carry also
    `rows` and `masked`, see `average`.

    Raises TelemetryError, which names file, line and column, and lists all channels that are wrong.
    """
    conversions = _conversions(specification)
    packets: dict[str, xr.Dataset] = {}
    for name, packet in specification.sources.items():
        chosen = {channel: conversions[channel] for channel in specification.channels_of(name)}
        if packet.readings is not None:
            packets |= _read_readings(specification, packet, chosen, folder)
        elif chosen:
            packets[name] = _read_packet(specification, name, packet, chosen, folder)
    dataset = merged(packets, list(specification.channels))
    if period is not None:
        dataset.attrs["period_s"] = float(period)
    return dataset


def _read_readings(
    specification: TelemetryFile, packet: Packet, conversions: dict[str, Conversion], folder: Path
) -> dict[str, xr.Dataset]:
    """The channels of a packet of readings, each with its own times. Raises TelemetryError with all that are wrong."""
    problems: list[str] = []
    found: dict[str, xr.Dataset] = {}
    table_of = cache(read_table)
    for channel, unit_conversion in conversions.items():
        try:
            found[channel] = _read_packet(specification, channel, packet, {channel: unit_conversion}, folder, table_of)
        except TelemetryError as error:
            problems.append(str(error))
    _raise_all(list(dict.fromkeys(problems)))
    return found


def _read_packet(
    specification: TelemetryFile,
    name: str,
    packet: Packet,
    conversions: dict[str, Conversion],
    folder: Path,
    table_of: Callable[..., pa.Table] = read_table,
) -> xr.Dataset:
    """Channels [C] that have their times in common: those of a packet, or one of a packet of readings.

    table_of: `read_table`, or one that remembers what it has read.
    """
    channels = {channel: specification.channels[channel] for channel in conversions}
    beside = [other for key, other in specification.sources.items() if key != name]
    files = []
    for file in packet.file:
        source = locate(folder, file, packet.sheet, packet.header)
        shared = any(file in other.file and packet.sheet == other.sheet for other in beside)
        files.append(_read_file(packet, channels, conversions, source, table_of, shared=shared))
    rows = _joined(files)
    told = pd.DataFrame(np.concatenate([rows.values, rows.flags], axis=1))
    order = order_rows(rows.times, pd.util.hash_pandas_object(told, index=False).to_numpy())
    times = rows.times[order.kept]
    interval = sampling_interval(times)
    if np.isnan(interval):
        names = ", ".join(packet.file)
        raise TelemetryError(f"{names}: found samples of one time only, expected at least two times")
    converted, flags = rows.values[order.kept], rows.flags[order.kept]
    repeated = repeats(rows.content.keys[order.kept], rows.content.repeating[order.kept])
    stale = _stale(repeated, channels) & (flags & Flag.MISSING == 0)
    left_out = _left_out(times, channels) & (flags & Flag.MISSING == 0)
    flags |= np.where(stale, Flag.STALE, 0).astype(np.uint8) | np.where(left_out, Flag.LEFT_OUT, 0).astype(np.uint8)
    _check_valid(", ".join(packet.file), channels, conversions, converted, flags)
    conflict_times = order.conflicts[:10].astype("datetime64[ns]")
    attributes = {
        "files": "\n".join(packet.file),
        "sampling_interval_s": interval,
        "rows_read": len(rows.times) + rows.untimed,
        "untimed": rows.untimed,
        "duplicates": order.duplicates,
        "conflicts": len(order.conflicts),
        "conflict_times": " ".join(np.datetime_as_string(conflict_times, unit="s")),
        # Files that are given in another order than that of their times are not unsorted.
        "unsorted": sum(order_rows(file.times, file.content.keys).unsorted for file in files),
        "stale_checked": int(rows.content.checked),
    }
    values = np.where(flags == 0, _with_status(converted, channels, conversions), np.nan)
    dataset = _dataset(name, channels, conversions, times, values, flags, attributes)
    length = packet.average or specification.average
    # A slow packet stays as it is beside fast ones that are averaged.
    if length is None or (name and packet.average is None and length < interval):
        return dataset
    return average(dataset, length, beside_others=packet.average is None and bool(beside or packet.readings))


def _with_status(values: Values, channels: dict[str, Channel], conversions: dict[str, Conversion]) -> Values:
    """With 1 and 0 where a channel [C] is a number that tells whether something is on."""
    found = values.copy()
    for i, (name, channel) in enumerate(channels.items()):
        threshold = conversions[name].threshold
        if threshold is not None:
            found[:, i] = values[:, i] > threshold if channel.on_above is not None else values[:, i] < threshold
    return found


def _conversions(specification: TelemetryFile) -> dict[str, Conversion]:
    """Units of all channels. Raises TelemetryError with all that are wrong."""
    problems, conversions = [], {}
    for name, channel in specification.channels.items():
        try:
            conversions[name] = conversion(channel)
        except ValueError as error:
            problems.append(f"channel '{name}': {error}")
    _raise_all(problems)
    return conversions


def _read_file(
    packet: Packet,
    channels: dict[str, Channel],
    conversions: dict[str, Conversion],
    source: Source,
    table_of: Callable[..., pa.Table],
    *,
    shared: bool,
) -> _Rows:
    """The rows of one file; shared: other packets are in it, so only rows that hold something of this one count."""
    time, readings = packet.time, packet.readings
    channels = {name: _with_validity(channel, packet) for name, channel in channels.items()}
    markers = [str(marker) for channel in channels.values() for marker in channel.invalid]
    named = {column for channel in channels.values() for column in channel.column}
    words = [column for channel in channels.values() if channel.base is not None for column in channel.column]
    if readings is not None:
        words = [*readings.name, readings.value]
    table = table_of(source, (*time.column, *words), (*markers, *map(str, time.invalid)))
    _check_columns(_wanted(packet, channels), table.column_names, source)
    table = without_empty_rows(table)
    beside = {column for channel in channels.values() for column in channel.valid_where}
    if readings is not None:
        table, source = side_by_side(table, readings, time.column, tuple(sorted(named)), tuple(sorted(beside)), source)
        channels = {name: _with_validity_of_readings(channel) for name, channel in channels.items()}
    elif shared:
        table, source = _of_packet(table, time, named, source)
        table = table.select([*time.column, *sorted((named | beside).difference(time.column))])
    timed = np.flatnonzero(~is_fill(time_cells(table, time), time))
    untimed = table.num_rows - len(timed)
    if untimed:
        table, source = _only(timed, table, source)
    if not len(timed):
        raise TelemetryError(
            f"{source.name}: found no row with a time, all are marked invalid; expected some that are not"
        )
    times = parse_times(time_cells(table, time), time, source)
    problems, values, flags = [], [], []
    for name, channel in channels.items():
        convert = conversions[name]
        try:
            in_file, flag = channel_values(name, channel, table, source)
        except TelemetryError as error:
            problems.append(str(error))
            continue
        si = convert.to_si(in_file)
        beyond = (si < convert.lowest) | (si > convert.highest)
        values.append(si)
        flags.append(flag | np.where(beyond, Flag.OUT_OF_RANGE, 0).astype(np.uint8))
    _raise_all(problems)
    rows = row_content(content(table, time.column), times, named)
    if readings is not None:
        # A row of one channel that repeats may as well be a quiet channel.
        rows = replace(rows, repeating=np.ones_like(rows.repeating), checked=True)
    return _Rows(times, np.stack(values, axis=1), np.stack(flags, axis=1), rows, untimed)


def _with_validity(channel: Channel, packet: Packet) -> Channel:
    """A channel that obeys its packet's columns of validity, too."""
    return channel.model_copy(update={"valid_where": packet.valid_where | channel.valid_where})


def _with_validity_of_readings(channel: Channel) -> Channel:
    """A channel of readings, each of which has a column of validity of its own."""
    conditions = {of(column, name): valid for column, valid in channel.valid_where.items() for name in channel.column}
    return channel.model_copy(update={"valid_where": conditions})


def _of_packet(table: pa.Table, time: TimeColumn, named: Collection[str], source: Source) -> tuple[pa.Table, Source]:
    """The rows in which one of the columns `named`, other than those of the time, holds something."""
    value_names = sorted(set(named).difference(time.column))
    held = np.any([table[name].is_valid().to_numpy() for name in value_names], axis=0)
    rows = np.flatnonzero(held)
    if not len(rows):
        names = ", ".join(f"'{name}'" for name in value_names)
        raise TelemetryError(f"{source.name}: found nothing in the columns {names}, expected telemetry")
    return _only(rows, table, source)


def _only(rows: NDArray[np.intp], table: pa.Table, source: Source) -> tuple[pa.Table, Source]:
    """Some rows of those that are looked at."""
    return table.take(rows), source.only(rows)


def _joined(files: list[_Rows]) -> _Rows:
    return _Rows(
        np.concatenate([file.times for file in files]),
        np.concatenate([file.values for file in files]),
        np.concatenate([file.flags for file in files]),
        RowContent(
            np.concatenate([file.content.keys for file in files]),
            np.concatenate([file.content.repeating for file in files]),
            checked=any(file.content.checked for file in files),
        ),
        sum(file.untimed for file in files),
    )


def _wanted(packet: Packet, channels: dict[str, Channel]) -> list[tuple[str, str]]:
    """Who wants which column of a packet's files."""
    wanted = [("time", column) for column in packet.time.column]
    wanted += [
        ("valid_where", column) for column in sorted({c for channel in channels.values() for c in channel.valid_where})
    ]
    if packet.readings is not None:
        return [*wanted, *(("readings", column) for column in (*packet.readings.name, packet.readings.value))]
    return wanted + [(f"channel '{name}'", column) for name, c in channels.items() for column in c.column]


def _check_columns(wanted: list[tuple[str, str]], columns: list[str], source: Source) -> None:
    problems = []
    for who, column in wanted:
        if columns.count(column) > 1:
            problems.append(f"{source.name}: {who}: found {columns.count(column)} columns '{column}', expected one")
        elif column not in columns:
            problems.append(f"{source.name}: {who}: found no column '{column}'{nearest(column, columns)}")
    if problems and len(problems) == len(wanted):
        problems.append(
            f"{source.name}: its columns are {', '.join(columns[:12])}{', ...' if len(columns) > 12 else ''}"
        )
    _raise_all(problems)


def without_empty_rows(table: pa.Table) -> pa.Table:
    """Without the lines of commas that spreadsheets write after the last row; row numbers stay."""
    last = max((_last_valid(column) for column in table.columns), default=-1)
    return table.slice(0, last + 1)


def _last_valid(column: pa.ChunkedArray) -> int:
    rows = column.length()
    if column.null_count == 0 or rows == 0 or column[rows - 1].is_valid:
        return rows - 1
    valid = np.flatnonzero(column.is_valid().to_numpy())
    return int(valid[-1]) if len(valid) else -1


def _stale(repeated: NDArray[np.int64], channels: dict[str, Channel]) -> NDArray[np.bool_]:
    """Whether a row only repeats the one before it, [T, C]: each channel has its own `stale_after`."""
    limits = np.array([channel.stale_after or np.inf for channel in channels.values()])
    return (repeated > 0)[:, np.newaxis] & (repeated[:, np.newaxis] >= limits)


def _left_out(times: Nanoseconds, channels: dict[str, Channel]) -> NDArray[np.bool_]:
    """Whether the scenario leaves a sample out, [T, C]."""
    found = np.zeros((len(times), len(channels)), dtype=bool)
    at = times.astype("datetime64[ns]")
    for i, channel in enumerate(channels.values()):
        for span in channel.leave_out:
            found[:, i] |= (at >= np.datetime64(span.start)) & (at <= np.datetime64(span.end))
    return found


def _check_valid(
    files: str, channels: dict[str, Channel], conversions: dict[str, Conversion], values: Values, flags: Flags
) -> None:
    problems = []
    for i, (name, channel) in enumerate(channels.items()):
        if (flags[:, i] == 0).any():
            continue
        counts = [(meaning(flag).replace("_", " "), np.count_nonzero(flags[:, i] & flag)) for flag in Flag]
        found = ", ".join(f"{count} {reason}" for reason, count in counts if count)
        columns = ", ".join(f"'{column}'" for column in channel.column)
        problem = f"{files}: channel '{name}', column {columns}: found no valid sample ({found})"
        beyond = values[flags[:, i] & Flag.OUT_OF_RANGE != 0, i]
        if beyond.size:
            convert = conversions[name]
            spans = [(beyond.min(), beyond.max()), (convert.lowest, convert.highest)]
            (low, high), (lowest, highest) = (sorted(map(convert.as_in_file, span)) for span in spans)
            unit = f" {channel.unit}" if channel.unit else ""
            problem += f": {low:.6g} to {high:.6g}{unit}, expected {lowest:.6g} to {highest:.6g}{unit}"
        problems.append(problem)
    _raise_all(problems)


def _dataset(
    packet: str,
    channels: dict[str, Channel],
    conversions: dict[str, Conversion],
    times: Nanoseconds,
    values: Values,
    flags: Flags,
    attributes: dict[str, object],
) -> xr.Dataset:
    variables: dict[str, tuple] = {}
    for i, (name, channel) in enumerate(channels.items()):
        variables[name] = (
            "time",
            values[:, i].copy(),
            {
                "kind": channel.kind,
                "units": "" if channel.kind == "status" else conversions[name].unit,
                "long_name": f"{channel.kind} '{name}'",
                "column": ", ".join(channel.column),
                "fill": channel.bridge,
                "longest_gap_s": channel.longest_gap or 0.0,
                "packet": packet,
            },
        )
    variables["flags"] = (("time", "channel"), flags, flag_attributes())
    coordinates = {"time": times.astype("datetime64[ns]"), "channel": list(channels)}
    dataset = xr.Dataset(variables, coordinates, attributes)
    dataset["time"].encoding = {"units": "nanoseconds since 1970-01-01", "dtype": "int64"}
    return dataset


def _raise_all(problems: list[str]) -> None:
    if len(problems) == 1:
        raise TelemetryError(problems[0])
    if problems:
        raise TelemetryError(
            f"{len(problems)} things are wrong with the telemetry:\n" + "\n".join(f"  {p}" for p in problems)
        )
