from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from flightcal.telemetry import quality_table, read_telemetry
from flightcal.telemetry.quality import QualityRecord

from .files import CHANNELS, frame, read, specification


def test_clean_telemetry_has_no_findings(tmp_path: Path):
    assert quality_table(read(tmp_path, frame(30))) == ()


def test_every_finding_is_a_record_with_its_place(tmp_path: Path):
    table = frame(60).drop(index=range(50, 55))
    table.loc[[3, 4, 8], "TT_BAT"] = -1.0
    table.loc[12, "TT_BAT"] = 99.0
    table.loc[20:29, ["TT_BAT", "I_SA", "HTR"]] = [21.5, 120.0, 1]
    table = pd.concat([table, table.iloc[[0]], table.iloc[[1]].assign(TT_BAT=25.0)])
    battery = CHANNELS["battery"] | {"invalid": [-1], "valid_range": ["-50 degC", "90 degC"]}
    records = quality_table(read(tmp_path, table, channels={"battery": battery}))
    rows, samples = 57, 55
    at = np.datetime64("2024-03-01T00:00:00", "ns") + np.arange(60) * np.timedelta64(60, "s")
    differ = "rows that differ from a row of the same time; dropped, the first is used: 2024-03-01T00:01:00"
    assert records == (
        QualityRecord("", "duplicates", 1, 1 / rows, None, None, "rows that repeat a row of the same time; dropped"),
        QualityRecord("", "conflicts", 1, 1 / rows, None, None, differ),
        QualityRecord("", "unsorted", 2, 2 / rows, None, None, "rows after a row of a later time; sorted"),
        QualityRecord("", "gaps", 5, 5 / 60, at[49], at[55], "1 gap: 360 s from 2024-03-01T00:49:00"),
        QualityRecord(
            "battery",
            "invalid_marker",
            3,
            3 / samples,
            at[3],
            at[8],
            "2 runs of samples: 2 from 2024-03-01T00:03:00, 1 from 2024-03-01T00:08:00",
        ),
        QualityRecord(
            "battery", "out_of_range", 1, 1 / samples, at[12], at[12], "1 run of samples: 1 from 2024-03-01T00:12:00"
        ),
        QualityRecord(
            "battery", "stale", 9, 9 / samples, at[21], at[29], "1 run of samples: 9 from 2024-03-01T00:21:00"
        ),
    )


def test_only_the_longest_of_many_runs_are_listed_and_of_single_samples_the_first(tmp_path: Path):
    table = frame(100)
    table.loc[::4, "TT_BAT"] = np.nan
    table.loc[50:51, "TT_BAT"] = np.nan
    (record,) = quality_table(read(tmp_path, table))
    assert record.samples == 27
    assert record.detail == (
        "25 runs of samples: 3 from 2024-03-01T00:50:00; 24 of one sample, the first at 2024-03-01T00:00:00, "
        "2024-03-01T00:04:00, 2024-03-01T00:08:00"
    )
    table.loc[:, "TT_BAT"] = np.where(np.arange(100) % 6 < 2, np.nan, 20.0)
    (record,) = quality_table(read(tmp_path, table))
    assert record.detail.startswith("17 runs of samples, the longest: 2 from 2024-03-01T00:00:00, ")
    assert record.detail.count(" from ") == 5


def test_telemetry_whose_rows_normally_repeat_says_so(tmp_path: Path):
    table = frame(40).iloc[np.arange(120) // 3].reset_index(drop=True).assign(time=frame(120)["time"])
    records = quality_table(read(tmp_path, table))
    assert [record.finding for record in records] == ["stale_not_checked"]


def test_averaged_telemetry_counts_the_rows_of_the_file(tmp_path: Path):
    table = frame(60, interval=10.0)
    table.loc[[1, *range(12, 17)], "TT_BAT"] = np.nan
    records = quality_table(read(tmp_path, table, average="60 s", channels={"battery": CHANNELS["battery"]}))
    found = [(record.finding, record.samples, record.share) for record in records]
    assert found == [("missing", 6, 6 / 60), ("few_samples", 1, 1 / 10)]


def test_rows_of_two_files_are_the_same_where_their_channels_are(tmp_path: Path):
    table = frame(40).assign(counter=range(40), aux="1")
    table[:30].to_csv(tmp_path / "a.csv", index=False)
    table[28:].assign(counter=0, aux="unknown").to_csv(tmp_path / "b.csv", index=False)
    dataset = read_telemetry(specification(file=["a.csv", "b.csv"]), tmp_path)
    assert (dataset.attrs["duplicates"], dataset.attrs["conflicts"]) == (2, 0)
