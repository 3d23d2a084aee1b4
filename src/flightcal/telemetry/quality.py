"""What was found wrong with telemetry, as a table for the report."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ._flags import SAMPLE_FLAGS, Flag, meaning
from .clean import GAP_FACTOR, Gap, Nanoseconds, clock_text, find_gaps, usual_interval

_FEW = 20
"""Samples, of which it cannot be told whether they come at a pace of their own."""
LISTED = 5
"""Runs and gaps that a record's detail lists; the longest ones."""
_SINGLE = 3
"""Of these, so many of one sample each."""
_LONG = 100e9
"""ns."""


@dataclass(frozen=True)
class QualityRecord:
    """One finding of one channel, or of the file (channel "")."""

    channel: str
    finding: str
    """A flag's meaning, or untimed, duplicates, conflicts, unsorted, gaps, stale_not_checked."""
    samples: int
    """How many samples (rows of the file) it concerns; for gaps, how many are missing."""
    share: float
    """Of the channel's samples."""
    first: np.datetime64 | None
    last: np.datetime64 | None
    detail: str


def quality_table(dataset: xr.Dataset) -> tuple[QualityRecord, ...]:
    """All findings in `dataset`, which may be a window: those of the rows first, then channel by channel.

    Duplicates, conflicts and order are those of the whole file, as dropped rows belong to no window.
    """
    channels = [str(channel) for channel in dataset["channel"].to_numpy()]
    by_channel = {channel: _own_times(dataset, channel) for channel in channels}
    packets = json.loads(dataset.attrs.get("packets", "{}")) or {"": dataset.attrs}
    records = [record for name, attributes in packets.items() for record in _row_records(name, attributes)]
    if any(times is None for times in by_channel.values()):
        records += _gap_records("", dataset["time"].to_numpy().astype(np.int64))
    for channel in channels:
        records += _gap_records(channel, by_channel[channel])
        records += _channel_records(dataset, channel, by_channel[channel])
    return tuple(records)


def _own_times(dataset: xr.Dataset, channel: str) -> Nanoseconds | None:
    """When a channel whose packet has stamps of its own was sampled; null: it should be in every row."""
    flags = dataset["flags"].sel(channel=channel).to_numpy()
    times = dataset["time"].to_numpy()
    stamps = times[flags & (Flag.OTHER_PACKET | Flag.MISSING) == 0]
    if dataset[channel].attrs.get("packet"):
        return stamps.astype(np.int64)
    apart = len(stamps) > _FEW and usual_interval(stamps) > GAP_FACTOR * usual_interval(times)
    return stamps.astype(np.int64) if apart else None


def _row_records(packet: str, attributes: Mapping[str, Any]) -> list[QualityRecord]:
    """What was wrong with the rows of a packet ("": of all telemetry)."""
    of = f"packet '{packet}': " if packet else ""
    read = int(attributes["rows_read"])
    records = []
    details = {
        "untimed": "rows that have a mark in the place of a time; dropped",
        "duplicates": "rows that repeat a row of the same time; dropped",
        "conflicts": "rows that differ from a row of the same time; dropped, the first is used: "
        + attributes["conflict_times"],
        "unsorted": "rows after a row of a later time; sorted",
    }
    for finding, detail in details.items():
        count = int(attributes[finding])
        if count:
            records.append(QualityRecord("", finding, count, count / read, None, None, of + detail))
    if not attributes["stale_checked"]:
        text = "rows normally repeat, so a frozen row cannot be told from a quiet one"
        records.append(QualityRecord("", "stale_not_checked", read, 1.0, None, None, of + text))
    return records


def _gap_records(channel: str, times: Nanoseconds | None) -> list[QualityRecord]:
    """The gaps between the times of rows (channel ""), or of a channel's own."""
    gaps = [] if times is None or len(times) < 2 else find_gaps(times)
    if times is None or not gaps:
        return []
    missing = sum(gap.samples for gap in gaps)
    first, last = np.datetime64(gaps[0].start, "ns"), np.datetime64(gaps[-1].end, "ns")
    share = missing / (missing + len(times))
    return [QualityRecord(channel, "gaps", missing, share, first, last, _gaps_text(gaps))]


def _channel_records(dataset: xr.Dataset, channel: str, stamps: Nanoseconds | None) -> list[QualityRecord]:
    """Samples that flags took away; a row without a sample of a channel that has own times is another packet's."""
    in_packets, averaged = bool(dataset[channel].attrs.get("packet")), "masked" in dataset
    flags = dataset["flags"].sel(channel=channel).to_numpy()
    rows = flags & Flag.OTHER_PACKET == 0
    if stamps is not None and not in_packets and not averaged:
        rows &= flags & Flag.MISSING == 0
    times, flags = dataset["time"].to_numpy()[rows], flags[rows]
    total = int(dataset["rows"].sel(channel=channel).sum()) if averaged else len(times)
    records = []
    for flag in SAMPLE_FLAGS:
        if flag is Flag.MISSING and stamps is not None and not in_packets:
            continue
        if averaged:
            counts = dataset["masked"].sel(channel=channel, finding=meaning(flag)).to_numpy()[rows]
        else:
            counts = (flags & flag != 0).astype(np.int64)
        records += _record(channel, flag, counts, total, times)
    lost = (flags & Flag.FEW_SAMPLES != 0).astype(np.int64)
    records += _record(channel, Flag.FEW_SAMPLES, lost, len(times), times)
    return records


def _record(
    channel: str, flag: Flag, counts: NDArray[np.integer], total: int, times: NDArray[np.datetime64]
) -> list[QualityRecord]:
    """The record of a flag that took away counts [T] samples at `times`, or none."""
    hit = np.flatnonzero(counts)
    if not len(hit):
        return []
    samples = int(counts.sum())
    edges = np.flatnonzero(np.diff(hit) > 1)
    starts, ends = hit[np.append(0, edges + 1)], hit[np.append(edges, len(hit) - 1)]
    runs = [(int(counts[a : b + 1].sum()), times[a]) for a, b in zip(starts, ends, strict=True)]
    noun = "block" if flag is Flag.FEW_SAMPLES else "sample"
    return [
        QualityRecord(
            channel,
            meaning(flag),
            samples,
            samples / total,
            times[hit[0]],
            times[hit[-1]],
            _runs_text(runs, noun),
        )
    ]


def _runs_text(runs: list[tuple[int, np.datetime64]], noun: str) -> str:
    number = f"{len(runs)} run{'s' if len(runs) > 1 else ''} of {noun}s"
    single = [time for samples, time in runs if samples == 1]
    if len(runs) <= LISTED or len(single) <= _SINGLE:
        return _longest(number, [(samples, time, str(samples)) for samples, time in runs])
    some = f"{len(single)} of one {noun}, the first at {', '.join(map(clock_text, single[:_SINGLE]))}"
    longer = [(samples, time, str(samples)) for samples, time in runs if samples > 1]
    return f"{_longest(number, longer)}; {some}" if longer else f"{number}: {some}"


def _gaps_text(gaps: list[Gap]) -> str:
    lengths = [(gap.end - gap.start, np.datetime64(gap.start, "ns")) for gap in gaps]
    number = f"{len(gaps)} gap{'s' if len(gaps) > 1 else ''}"
    return _longest(number, [(length, begin, _seconds(length)) for length, begin in lengths])


def _seconds(length: int) -> str:
    """ns in words; of long ones no fractions are told."""
    return f"{round(length / 1e9)} s" if length > _LONG else f"{length / 1e9:g} s"


def _longest(number: str, spells: list[tuple[int, np.datetime64, str]]) -> str:
    """How many there are, and the longest of them in order of time; spells: how long, since when, and that in words."""
    listed = sorted(sorted(spells, key=lambda item: -item[0])[:LISTED], key=lambda item: item[1])
    text = ", ".join(f"{words} from {clock_text(begin)}" for _, begin, words in listed)
    return f"{number}: {text}" if len(spells) <= LISTED else f"{number}, the longest: {text}"
