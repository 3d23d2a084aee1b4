"""Telemetry files and their specification -> one Dataset in SI, with a reason for every sample not used."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import xarray as xr
from numpy.typing import NDArray

from ..environment import orbital_period
from ..errors import TelemetryError
from ..scenario import Channel, Scenario, TelemetryFile
from ._flags import Flag, Flags, flag_attributes, meaning
from ._times import Nanoseconds, parse_times
from ._units import Conversion, conversion
from ._values import Values, channel_values
from .average import average
from .clean import order_rows, sampling_interval
from .readers import Source, content, locate, nearest, read_table
from .stale import RowContent, repeats, row_content

RESERVED_NAMES = frozenset(["time", "channel", "flags", "finding", "rows", "masked"])
"""Variables of the dataset that are not channels."""


@dataclass(frozen=True)
class _Rows:
    """Rows [R] of one or several files: times (ns), values (SI) and flags [R, C], and what tells rows apart."""

    times: Nanoseconds
    values: Values
    flags: Flags
    content: RowContent


def read(scenario: Scenario) -> xr.Dataset:
    """The telemetry of a scenario, cleaned; see `read_telemetry`. Raises TelemetryError."""
    period = orbital_period(scenario.environment, scenario.folder)
    return read_telemetry(scenario.telemetry, scenario.folder, period=period)


def read_telemetry(specification: TelemetryFile, folder: Path, *, period: float | None = None) -> xr.Dataset:
    """Flight data as `specification` describes them.

    folder: where relative file names start. period: orbital period (s), kept for drivers that are bridged
    from other orbits.

    Returns dims `time` (datetime64[ns], UTC, strictly increasing) and `channel`: one float64 variable [time]
    for each channel in SI (temperature K, status 0 or 1), NaN where it cannot be used, and `flags` [time,
    channel] uint8 that say why. Attributes: files, sampling_interval_s, rows_read, duplicates, conflicts,
    conflict_times, unsorted, stale_checked, and period_s, average_s where given. Block averages carry also
    `rows` and `masked`, see `average`.

    Raises TelemetryError, which names file, line and column, and lists all channels that are wrong.
    """
    conversions = _conversions(specification)
    files = [_read_file(specification, conversions, locate(folder, name)) for name in specification.file]
    rows = _joined(files)
    order = order_rows(rows.times, rows.content.keys)
    times = rows.times[order.kept]
    interval = sampling_interval(times)
    if np.isnan(interval):
        names = ", ".join(specification.file)
        raise TelemetryError(f"{names}: found samples of one time only, expected at least two times")
    converted, flags = rows.values[order.kept], rows.flags[order.kept]
    repeated = repeats(rows.content.keys[order.kept], rows.content.moving[order.kept])
    stale = _stale(repeated, specification) & (flags & Flag.MISSING == 0)
    flags = np.where(stale, flags | Flag.STALE, flags).astype(np.uint8)
    _check_valid(specification, conversions, converted, flags)
    conflict_times = order.conflicts[:10].astype("datetime64[ns]")
    attributes = {
        "files": "\n".join(specification.file),
        "sampling_interval_s": interval,
        "rows_read": len(rows.times),
        "duplicates": order.duplicates,
        "conflicts": len(order.conflicts),
        "conflict_times": " ".join(np.datetime_as_string(conflict_times, unit="s")),
        # Files that are given in another order than that of their times are not unsorted.
        "unsorted": sum(order_rows(file.times, file.content.keys).unsorted for file in files),
        "stale_checked": int(rows.content.checked),
    }
    if period is not None:
        attributes["period_s"] = float(period)
    values = np.where(flags == 0, converted, np.nan)
    dataset = _dataset(specification, conversions, times, values, flags, attributes)
    return dataset if specification.average is None else average(dataset, specification.average)


def _conversions(specification: TelemetryFile) -> list[Conversion]:
    """Units of all channels, in order. Raises TelemetryError with all that is wrong in their description."""
    problems, conversions = [], []
    for name, channel in specification.channels.items():
        problems += [f"channel '{name}': {problem}" for problem in _misfits(name, channel)]
        try:
            conversions.append(conversion(channel))
        except ValueError as error:
            problems.append(f"channel '{name}': {error}")
    _raise_all(problems)
    return conversions


def _misfits(name: str, channel: Channel) -> list[str]:
    problems = []
    if name in RESERVED_NAMES:
        reserved = ", ".join(sorted(RESERVED_NAMES))
        problems.append(f"found a name that the dataset needs itself, expected one other than {reserved}")
    if "/" in name:
        problems.append("found a slash in its name, expected a name that files can hold")
    if channel.kind == "status" and len(channel.column) > 1:
        problems.append(f"found {len(channel.column)} columns, expected one for a status")
    elif len(channel.column) > 1 and channel.combine is None:
        problems.append(f"found {len(channel.column)} columns and no 'combine', expected combine: mean, sum or product")
    elif channel.kind == "temperature" and channel.combine in ("sum", "product"):
        problems.append(f"found combine: {channel.combine}, expected mean for a temperature")
    return problems


def _read_file(specification: TelemetryFile, conversions: list[Conversion], source: Source) -> _Rows:
    markers = [str(marker) for channel in specification.channels.values() for marker in channel.invalid]
    table = read_table(source, specification.time.column, markers)
    _check_columns(specification, table.column_names, source)
    table = _without_empty_rows(table)
    times = parse_times(table[specification.time.column], specification.time.format, source)
    problems, values, flags = [], [], []
    for (name, channel), convert in zip(specification.channels.items(), conversions, strict=True):
        try:
            in_file, flag = channel_values(name, channel, table, source)
        except TelemetryError as error:
            problems.append(str(error))
            continue
        si = convert.scale * in_file + convert.offset
        beyond = (si < convert.lowest) | (si > convert.highest)
        values.append(si)
        flags.append(flag | np.where(beyond, Flag.OUT_OF_RANGE, 0).astype(np.uint8))
    _raise_all(problems)
    named = {column for channel in specification.channels.values() for column in channel.column}
    rows = row_content(content(table, specification.time.column), times, named)
    return _Rows(times, np.stack(values, axis=1), np.stack(flags, axis=1), rows)


def _joined(files: list[_Rows]) -> _Rows:
    return _Rows(
        np.concatenate([file.times for file in files]),
        np.concatenate([file.values for file in files]),
        np.concatenate([file.flags for file in files]),
        RowContent(
            np.concatenate([file.content.keys for file in files]),
            np.concatenate([file.content.moving for file in files]),
            checked=any(file.content.checked for file in files),
        ),
    )


def _check_columns(specification: TelemetryFile, columns: list[str], source: Source) -> None:
    wanted = [("time", specification.time.column)]
    wanted += [(f"channel '{name}'", column) for name, c in specification.channels.items() for column in c.column]
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


def _without_empty_rows(table: pa.Table) -> pa.Table:
    """Without the lines of commas that spreadsheets write after the last row; row numbers stay."""
    last = max((_last_valid(column) for column in table.columns), default=-1)
    return table.slice(0, last + 1)


def _last_valid(column: pa.ChunkedArray) -> int:
    rows = column.length()
    if column.null_count == 0 or rows == 0 or column[rows - 1].is_valid:
        return rows - 1
    valid = np.flatnonzero(column.is_valid().to_numpy())
    return int(valid[-1]) if len(valid) else -1


def _stale(repeated: NDArray[np.int64], specification: TelemetryFile) -> NDArray[np.bool_]:
    """Whether a row only repeats the one before it, [T, C]: each channel has its own `stale_after`."""
    limits = np.array([channel.stale_after or np.inf for channel in specification.channels.values()])
    return (repeated > 0)[:, np.newaxis] & (repeated[:, np.newaxis] >= limits)


def _check_valid(specification: TelemetryFile, conversions: list[Conversion], values: Values, flags: Flags) -> None:
    problems = []
    for i, (name, channel) in enumerate(specification.channels.items()):
        if (flags[:, i] == 0).any():
            continue
        counts = [(meaning(flag).replace("_", " "), np.count_nonzero(flags[:, i] & flag)) for flag in Flag]
        found = ", ".join(f"{count} {reason}" for reason, count in counts if count)
        columns = ", ".join(f"'{column}'" for column in channel.column)
        problem = f"channel '{name}', column {columns}: found no valid sample ({found})"
        beyond = values[flags[:, i] & Flag.OUT_OF_RANGE != 0, i]
        if beyond.size:
            spans = [beyond.min(), beyond.max(), conversions[i].lowest, conversions[i].highest]
            low, high, lowest, highest = (f"{conversions[i].as_in_file(value):.6g}" for value in spans)
            unit = f" {channel.unit}" if channel.unit else ""
            problem += f": {low} to {high}{unit}, expected {lowest} to {highest}{unit}"
        problems.append(problem)
    _raise_all(problems)


def _dataset(
    specification: TelemetryFile,
    conversions: list[Conversion],
    times: Nanoseconds,
    values: Values,
    flags: Flags,
    attributes: dict[str, object],
) -> xr.Dataset:
    variables: dict[str, tuple] = {}
    for i, (name, channel) in enumerate(specification.channels.items()):
        variables[name] = (
            "time",
            values[:, i].copy(),
            {
                "kind": channel.kind,
                "units": conversions[i].unit,
                "long_name": f"{channel.kind} '{name}'",
                "column": ", ".join(channel.column),
                "fill": channel.fill,
            },
        )
    variables["flags"] = (("time", "channel"), flags, flag_attributes())
    coordinates = {"time": times.astype("datetime64[ns]"), "channel": list(specification.channels)}
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
