from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from flightcal.errors import TelemetryError
from flightcal.scenario import TelemetryFile
from flightcal.telemetry import dense_channels, length_in_common, quality_table, read_telemetry

from .files import CHANNELS, START, frame, read, seconds, text


def table_of(times: list[float], **columns: list) -> pd.DataFrame:
    return pd.DataFrame({"time": text(seconds(*times))} | columns)


def test_blocks_are_means_at_the_mean_time_of_their_rows_and_status_is_the_majority(tmp_path: Path):
    table = table_of(
        [0, 10, 20, 30, 40, 50, 60, 70],
        TT_BAT=[20.0, 22.0, 24.0, 30.0, 30.0, 33.0, 1.0, 3.0],
        I_SA=[1000.0, 2000.0, 6000.0, 0.0, 0.0, 3000.0, 8.0, 9.0],
        HTR=[1, 1, 0, 0, 0, 1, 1, 0],
    )
    dataset = read(tmp_path, table, average="20 s")
    np.testing.assert_array_equal(dataset["time"], seconds(5, 25, 45, 65))
    np.testing.assert_allclose(dataset["battery"], np.array([21.0, 27.0, 31.5, 2.0]) + 273.15)
    np.testing.assert_allclose(dataset["sun"], [1.5, 3.0, 1.5, 0.0085])
    np.testing.assert_array_equal(dataset["heater"], [1, 0, 1, 1])
    assert dataset.attrs["sampling_interval_s"] == dataset.attrs["average_s"] == 20.0
    np.testing.assert_array_equal(dataset["rows"], [[2, 2, 2]] * 4)


def test_temperatures_whose_samples_are_seconds_apart_are_dense(tmp_path: Path):
    assert dense_channels(read(tmp_path, frame(30, interval=2.0))) == {"battery": 2.0}
    assert dense_channels(read(tmp_path, frame(30, interval=10.0))) == {}
    assert dense_channels(read(tmp_path, frame(30, interval=2.0), average="20 s")) == {}


def test_blocks_start_at_multiples_of_their_length(tmp_path: Path):
    dataset = read(tmp_path, frame(30, interval=10.0).iloc[4:], average="60 s")
    np.testing.assert_array_equal(dataset["time"], seconds(45, 85, 145, 205, 265))
    np.testing.assert_array_equal(dataset["rows"].sel(channel="battery"), [2, 6, 6, 6, 6])


@pytest.mark.parametrize("first", [0.0, 30.0])
def test_means_of_a_straight_line_lie_on_it(tmp_path: Path, first: float):
    after = first + 60.0 * np.arange(40)
    table = table_of(after.tolist(), TT_BAT=0.001 * after, I_SA=0.0, HTR=0)
    table.loc[[5, 6, 23], ["TT_BAT", "I_SA", "HTR"]] = np.nan
    dataset = read(tmp_path, table, average="4 min")
    at = (dataset["time"].to_numpy() - START) / np.timedelta64(1, "s")
    np.testing.assert_allclose(dataset["battery"], 0.001 * at + 273.15, atol=1e-9)


@pytest.mark.parametrize(("valid", "used"), [(6, True), (3, True), (2, False), (0, False)])
def test_a_block_needs_half_of_its_samples(tmp_path: Path, valid: int, used: bool):
    table = frame(30, interval=10.0)
    table.loc[12 + valid : 17, "TT_BAT"] = -999.0
    battery = CHANNELS["battery"] | {"valid_range": ["-50 degC", "90 degC"]}
    dataset = read(tmp_path, table, channels={"battery": battery}, average="60 s")
    np.testing.assert_array_equal(dataset["battery"].notnull(), [True, True, used, True, True])
    np.testing.assert_array_equal(dataset["flags"][:, 0], [0, 0, 0 if used else 4 + 16, 0, 0])
    if used:
        expected = table.loc[12 : 11 + valid, "TT_BAT"].mean() + 273.15
        np.testing.assert_allclose(dataset["battery"][2], expected)
    assert dataset["masked"].sel(channel="battery", finding="out_of_range").to_numpy().tolist() == [
        0,
        0,
        6 - valid,
        0,
        0,
    ]


def test_a_block_mostly_in_a_gap_is_not_used(tmp_path: Path):
    table = frame(60, interval=10.0).drop(index=range(14, 30))
    dataset = read(tmp_path, table, average="60 s")
    np.testing.assert_array_equal(dataset["time"], seconds(25, 85, 125, 325, 385, 445, 505, 565))
    np.testing.assert_array_equal(np.flatnonzero(dataset["battery"].isnull()), [2])
    np.testing.assert_array_equal(dataset["flags"][2], [16, 16, 16])


def test_a_channel_with_a_slower_sampling_of_its_own_is_averaged_by_that(tmp_path: Path):
    table = frame(60, interval=10.0)
    table.loc[table.index % 6 != 2, "TT_BAT"] = np.nan
    dataset = read(tmp_path, table, average="60 s")
    assert dataset["battery"].notnull().all()
    np.testing.assert_allclose(dataset["battery"], table["TT_BAT"].dropna() + 273.15)


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    lost=st.sets(st.integers(0, 59)),
    marked=st.sets(st.integers(0, 59)),
    average=st.sampled_from([None, "30 s", "70 s"]),
)
@example(lost={*range(13), 19, 21, 40, 42, *range(54, 58)}, marked={*range(10), 41, 43, 20, 22}, average="70 s")
def test_a_value_is_absent_exactly_where_it_has_a_flag(
    tmp_path: Path, lost: set[int], marked: set[int], average: str | None
):
    table = frame(80, interval=10.0)
    table.loc[sorted(lost), "TT_BAT"] = np.nan
    table.loc[sorted(marked), "TT_BAT"] = -1.0
    channels = CHANNELS | {"battery": CHANNELS["battery"] | {"invalid": [-1]}}
    dataset = read(tmp_path, table, channels=channels, average=average)
    for name in CHANNELS:
        np.testing.assert_array_equal(dataset[name].isnull(), dataset["flags"].sel(channel=name) > 0)
    found = {record.finding: record.samples for record in quality_table(dataset) if record.channel == "battery"}
    found.pop("few_samples", None)
    expected = {"missing": len(lost - marked), "invalid_marker": len(marked)}
    assert found == {finding: samples for finding, samples in expected.items() if samples}


def test_a_block_shorter_than_the_sampling_is_an_error(tmp_path: Path):
    with pytest.raises(TelemetryError, match="found 'average: 10 s', expected at least its sampling interval of 60 s"):
        read(tmp_path, frame(10), average="10 s")


def test_means_of_packets_that_are_sampled_at_different_times_have_their_times_in_common(tmp_path: Path):
    """Three thermistors in files of their own; one of them has lost most of the samples of two blocks."""
    rng, packets, channels = np.random.default_rng(2), {}, {}
    for name, every, first in (("a", 64.0, 11.0), ("b", 64.0, 47.3), ("c", 128.0, 90.0)):
        at = np.arange(first, 36_000.0, every)
        if name == "b":
            at = at[(at < 6000.0) | (at > 6410.0)]
        value = 20.0 + 1e-3 * at + 5.0 * np.sin(at / 4000.0) + 0.02 * rng.standard_normal(len(at))
        pd.DataFrame({"time": text(seconds(*at)), "T": value}).to_csv(tmp_path / f"{name}.csv", index=False)
        packets[name] = {"file": f"{name}.csv", "time": {"column": "time"}}
        channels[name] = {"packet": name, "column": "T", "kind": "temperature", "unit": "degC"}
    dataset = read_telemetry(TelemetryFile(packets=packets, average="10 min", channels=channels), tmp_path)
    assert dataset.sizes["time"] <= 36_000 / 600 + 2
    at = (dataset["time"].to_numpy() - START) / np.timedelta64(1, "s")
    for name, count in (("a", 9.4), ("b", 9.4), ("c", 4.7)):
        error = dataset[name].to_numpy() - 293.15 - 1e-3 * at - 5.0 * np.sin(at / 4000.0)
        known = np.isfinite(error)
        assert known.sum() >= 57
        # A mean over 600 s of what bends by 5 K / (4000 s)^2 is off by up to 5 x 600^2 / 24 / 4000^2 = 5 mK.
        assert np.sqrt(np.mean(error[known] ** 2)) < 0.005 + 1.4 * 0.02 / np.sqrt(count)


@pytest.mark.parametrize(
    ("interval", "packets", "times", "length"),
    [
        (64.0, 12, 9000, 300.0),  # of the slowest, which has twice the interval
        (64.0, 12, 5000, None),  # so few cost little
        (10.0, 12, 9000, 60.0),
        (64.0, 2, 9000, None),  # means of two would gain little
        (7200.0, 12, 9000, None),  # and of hours, nothing would be left
    ],
)
def test_means_are_advised_where_packets_have_many_times_of_their_own(tmp_path, interval, packets, times, length):
    channels = {}
    for k in range(packets):
        at = np.arange(40) * interval * (2 if k == 1 else 1) + k * interval / packets
        table_of(at.tolist(), T=np.linspace(20.0, 25.0, 40)).to_csv(tmp_path / f"{k}.csv", index=False)
        channels[f"t{k}"] = {"packet": f"p{k}", "column": "T", "kind": "temperature", "unit": "degC"}
    files = {f"p{k}": {"file": f"{k}.csv", "time": {"column": "time"}} for k in range(packets)}
    dataset = read_telemetry(TelemetryFile(packets=files, channels=channels), tmp_path)
    assert length_in_common(dataset, times) == length
