"""What was found wrong with telemetry, as a table for the report."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ._flags import SAMPLE_FLAGS, Flag, meaning
from .clean import Gap, clock_text, find_gaps

LISTED = 10
"""Runs and gaps that a record's detail lists; the longest ones."""


@dataclass(frozen=True)
class QualityRecord:
    """One finding of one channel, or of the file (channel "")."""

    channel: str
    finding: str
    """A flag's meaning, or duplicates, conflicts, unsorted, gaps, stale_not_checked."""
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
    records = _row_records(dataset)
    for channel in dataset["channel"].to_numpy():
        records += _channel_records(dataset, str(channel))
    return tuple(records)


def _row_records(dataset: xr.Dataset) -> list[QualityRecord]:
    attributes, times = dataset.attrs, dataset["time"].to_numpy()
    read = int(attributes["rows_read"])
    records = []
    details = {
        "duplicates": "rows that repeat a row of the same time; dropped",
        "conflicts": "rows that differ from a row of the same time; dropped, the first is used: "
        + attributes["conflict_times"],
        "unsorted": "rows after a row of a later time; sorted",
    }
    for finding, detail in details.items():
        count = int(attributes[finding])
        if count:
            records.append(QualityRecord("", finding, count, count / read, None, None, detail))
    if not attributes["stale_checked"]:
        text = "rows normally repeat, so a frozen row cannot be told from a quiet one"
        records.append(QualityRecord("", "stale_not_checked", read, 1.0, None, None, text))
    gaps = find_gaps(times.astype(np.int64))
    if gaps:
        missing = sum(gap.samples for gap in gaps)
        first, last = np.datetime64(gaps[0].start, "ns"), np.datetime64(gaps[-1].end, "ns")
        share = missing / (missing + len(times))
        records.append(QualityRecord("", "gaps", missing, share, first, last, _gapsclock_text(gaps)))
    return records


def _channel_records(dataset: xr.Dataset, channel: str) -> list[QualityRecord]:
    times = dataset["time"].to_numpy()
    flags = dataset["flags"].sel(channel=channel).to_numpy()
    averaged = "masked" in dataset
    total = int(dataset["rows"].sum()) if averaged else len(times)
    records = []
    for flag in SAMPLE_FLAGS:
        if averaged:
            counts = dataset["masked"].sel(channel=channel, finding=meaning(flag)).to_numpy()
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
            _runsclock_text(runs, noun),
        )
    ]


def _runsclock_text(runs: list[tuple[int, np.datetime64]], noun: str) -> str:
    listed = sorted(sorted(runs, key=lambda run: -run[0])[:LISTED], key=lambda run: run[1])
    text = ", ".join(f"{samples} from {clock_text(time)}" for samples, time in listed)
    number = f"{len(runs)} run{'s' if len(runs) > 1 else ''} of {noun}s"
    return f"{number}: {text}" if len(runs) <= LISTED else f"{number}, the longest: {text}"


def _gapsclock_text(gaps: list[Gap]) -> str:
    listed = sorted(sorted(gaps, key=lambda gap: gap.start - gap.end)[:LISTED], key=lambda gap: gap.start)
    text = ", ".join(
        f"{(gap.end - gap.start) / 1e9:g} s from {clock_text(np.datetime64(gap.start, 'ns'))}" for gap in listed
    )
    number = f"{len(gaps)} gap{'s' if len(gaps) > 1 else ''}"
    return f"{number}: {text}" if len(gaps) <= LISTED else f"{number}, the longest: {text}"
