from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from hypothesis import given
from hypothesis import strategies as st

from flightcal.telemetry.clean import find_gaps, order_rows, sampling_interval

from .files import frame, read


@given(rows=st.lists(st.tuples(st.integers(0, 9), st.integers(0, 2)), min_size=1, max_size=30))
def test_each_time_keeps_its_first_row(rows: list[tuple[int, int]]):
    times, content = (np.array(column) for column in zip(*rows, strict=True))
    order = order_rows(times.astype(np.int64), content.astype(np.uint64))
    first = {time: content[times == time][0] for time in sorted(set(times.tolist()))}
    assert times[order.kept].tolist() == list(first)
    assert content[order.kept].tolist() == list(first.values())
    differing = sorted(time for time, value in rows if value != first[time])
    assert order.conflicts.tolist() == differing
    assert order.duplicates == len(rows) - len(first) - len(differing)


def test_conflicting_rows_are_counted_and_the_first_is_used(tmp_path: Path):
    table = frame(6)
    table.loc[4, "time"] = table.loc[3, "time"]
    dataset = read(tmp_path, pd.concat([table, table.iloc[[1]]]))
    assert dataset.sizes["time"] == 5
    assert (dataset.attrs["duplicates"], dataset.attrs["conflicts"], dataset.attrs["unsorted"]) == (1, 1, 1)
    assert dataset.attrs["conflict_times"] == "2024-03-01T00:03:00"
    assert dataset["battery"][3] == table.loc[3, "TT_BAT"] + 273.15


def test_the_sampling_interval_is_the_median_and_gaps_stand_out():
    times = np.array([0, 10, 20, 31, 40, 100, 110, 120, 135, 145, 160], dtype=np.int64) * 1_000_000_000
    assert sampling_interval(times) == 10.0
    assert [(gap.start / 1e9, gap.end / 1e9, gap.samples) for gap in find_gaps(times)] == [(40.0, 100.0, 5)]


def test_packets_with_time_stamps_of_their_own_have_gaps_only_where_whole_cycles_lack():
    """Three packets a minute, 5 s and 7 s apart: each pause of 48 s is as usual."""
    cycles = np.delete(np.arange(700), [50, 51, 52, 200, 340, 341, 600])
    times = (60.0 * cycles[:, None] + np.array([0.0, 5.0, 12.0])).ravel()
    gaps = find_gaps((times * 1e9).astype(np.int64))
    assert [(gap.start / 1e9, gap.end / 1e9) for gap in gaps] == [
        (60.0 * before + 12.0, 60.0 * after) for before, after in ((49, 53), (199, 201), (339, 342), (599, 601))
    ]
    assert [gap.samples for gap in gaps] == [9, 3, 6, 3]


def test_a_long_gap_hides_no_short_one():
    times = np.concatenate([np.arange(0, 600, 60), np.arange(720, 1200, 60), np.arange(9e6, 9e6 + 600, 60)])
    assert [gap.samples for gap in find_gaps((times * 1e9).astype(np.int64))] == [2, 149980]


def test_intervals_that_never_come_again_have_gaps_where_they_are_far_longer_than_nineteen_of_twenty():
    rng = np.random.default_rng(1)
    times = np.cumsum(rng.uniform(5.0, 100.0, 400))
    times[200:] += 1000.0
    gaps = find_gaps((times * 1e9).astype(np.int64))
    assert len(gaps) == 1
    assert gaps[0].end == int(times[200] * 1e9)
