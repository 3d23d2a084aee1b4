"""Several files, each with columns, sampling and a clock of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from flightcal.errors import TelemetryError
from flightcal.scenario import TelemetryFile, Window
from flightcal.telemetry import driver_series, quality_table, read_telemetry, select_window, status_fraction

from .files import START, seconds, text

THERMAL = 60.0 * np.arange(30)
POWER = 7.0 + 10.0 * np.arange(180)
UNIX = START.astype("datetime64[ms]").astype(np.int64)


def write_files(folder: Path) -> None:
    """Temperatures each minute on UTC, currents every 10 s in UNIX milliseconds, a status by the spacecraft's clock."""
    rng = np.random.default_rng(1)
    thermal = {"UTC": text(seconds(*THERMAL)), "TT_BAT": 20 + rng.normal(size=30), "TT_RAD": rng.normal(size=30)}
    pd.DataFrame(thermal).to_csv(folder / "thermal.csv", index=False)
    power = {"t_ms": UNIX + (1000 * POWER).astype(int), "I_SA": rng.uniform(100, 400, 180)}
    pd.DataFrame(power).to_parquet(folder / "power.parquet")
    onboard = {"SCLK": (1000 + 60.0 * np.arange(30) + 31) * 16, "HTR": np.arange(30) // 5 % 2, "n": rng.normal(size=30)}
    pd.DataFrame(onboard).to_csv(folder / "onboard.csv", index=False)


PACKETS: dict[str, Any] = {
    "thermal": {"file": "thermal.csv", "time": {"column": "UTC"}},
    "power": {"file": "power.parquet", "time": {"column": "t_ms", "format": "unix-ms"}},
    "onboard": {
        "file": "onboard.csv",
        "time": {"column": "SCLK", "format": "clock", "epoch": "2024-02-29T23:43:20", "rate": "16 Hz"},
    },
}
CHANNELS: dict[str, Any] = {
    "battery": {"packet": "thermal", "column": "TT_BAT", "kind": "temperature", "unit": "degC"},
    "sun": {"packet": "power", "column": "I_SA", "kind": "driver", "unit": "mA"},
    "heater": {"packet": "onboard", "column": "HTR", "kind": "status"},
    "radiator": {"packet": "thermal", "column": "TT_RAD", "kind": "temperature", "unit": "degC"},
}


def specification(**changes: Any) -> TelemetryFile:
    return TelemetryFile(**({"packets": PACKETS, "channels": CHANNELS} | changes))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_files(tmp_path)
    return tmp_path


def own(dataset: xr.Dataset, channel: str) -> xr.DataArray:
    """A channel where its packet has rows."""
    return dataset[channel][(dataset["flags"].sel(channel=channel) & 32 == 0).to_numpy()]


def test_each_channel_keeps_its_own_samples_and_stamps(folder: Path):
    dataset = read_telemetry(specification(), folder)
    assert list(dataset["channel"].to_numpy()) == list(CHANNELS)
    assert np.all(np.diff(dataset["time"].to_numpy()) > np.timedelta64(0))
    for name, times, column in (("battery", THERMAL, "TT_BAT"), ("radiator", THERMAL, "TT_RAD")):
        np.testing.assert_array_equal(own(dataset, name)["time"], seconds(*times))
        np.testing.assert_allclose(own(dataset, name), pd.read_csv(folder / "thermal.csv")[column] + 273.15)
    np.testing.assert_array_equal(own(dataset, "sun")["time"], seconds(*POWER))
    np.testing.assert_array_equal(own(dataset, "heater")["time"], seconds(*(THERMAL + 31)))
    # Nothing is made up at the times of other packets.
    for name, rows in (("battery", 30), ("sun", 180), ("heater", 30)):
        assert np.isfinite(dataset[name]).sum() == rows
    assert (dataset.attrs["rows_read"], dataset.attrs["sampling_interval_s"]) == (240, 10.0)
    assert dataset.attrs["files"] == "thermal.csv\npower.parquet\nonboard.csv"
    assert [dataset[name].attrs["packet"] for name in CHANNELS] == ["thermal", "power", "onboard", "thermal"]


def test_one_packet_is_what_a_file_alone_is(folder: Path):
    channels = {"battery": CHANNELS["battery"]}
    alone = TelemetryFile(**PACKETS["thermal"], channels={"battery": CHANNELS["battery"] | {"packet": None}})
    expected = read_telemetry(alone, folder)
    xr.testing.assert_equal(
        read_telemetry(specification(packets={"thermal": PACKETS["thermal"]}, channels=channels), folder), expected
    )


def test_merged_packets_have_no_findings_where_nothing_is_wrong(folder: Path):
    assert quality_table(read_telemetry(specification(), folder)) == ()


def test_gaps_are_counted_by_channel(folder: Path):
    table = pd.read_csv(folder / "thermal.csv").drop(index=range(10, 20))
    table.loc[[3, 4], "TT_RAD"] = np.nan
    table.to_csv(folder / "thermal.csv", index=False)
    records = {(r.channel, r.finding): r for r in quality_table(read_telemetry(specification(), folder))}
    assert set(records) == {("battery", "gaps"), ("radiator", "gaps"), ("radiator", "missing")}
    battery = records["battery", "gaps"]
    assert (battery.samples, battery.share) == (10, 10 / 30)
    assert battery.detail == "1 gap: 660 s from 2024-03-01T00:09:00"
    assert (records["radiator", "missing"].samples, records["radiator", "missing"].share) == (2, 2 / 20)


def test_packets_interleaved_in_one_file_have_gaps_by_channel_and_nothing_missing(tmp_path: Path):
    table = pd.DataFrame({"time": text(seconds(*(10.0 * np.arange(360)))), "n": np.sin(np.arange(360))})
    table["TT_BAT"] = np.where(np.arange(360) % 6 == 0, np.arange(360) / 10, np.nan)
    table["I_SA"] = np.where(np.arange(360) % 6 == 0, np.nan, np.cos(np.arange(360.0)))
    table.loc[120:179, "TT_BAT"] = np.nan  # ten samples of one channel, while the other goes on
    table.to_csv(tmp_path / "all.csv", index=False)
    channels = {
        "battery": {"column": "TT_BAT", "kind": "temperature", "unit": "degC"},
        "sun": {"column": "I_SA", "kind": "driver"},
    }
    dataset = read_telemetry(TelemetryFile(file="all.csv", time={"column": "time"}, channels=channels), tmp_path)
    (gap,) = (record for record in quality_table(dataset) if record.channel == "battery")
    assert (gap.finding, gap.samples) == ("gaps", 10)
    # Told as two packets, the same file gives the same samples, and no row of the one counts for the other.
    packet = {"file": "all.csv", "time": {"column": "time"}}
    named = {name: channel | {"packet": name} for name, channel in channels.items()}
    told = read_telemetry(specification(packets={"battery": packet, "sun": packet}, channels=named), tmp_path)
    assert told.attrs["rows_read"] == 350
    for name in channels:
        xr.testing.assert_equal(told[name].dropna("time"), dataset[name].dropna("time"))
    assert [(r.channel, r.finding, r.samples) for r in quality_table(told)] == [("battery", "gaps", 10)]


def test_a_file_with_a_time_column_beside_each_value_is_one_packet_for_each(tmp_path: Path):
    table = pd.DataFrame({"T1": text(seconds(0, 60, 120, 180)), "A": [1.0, 2.0, 4.0, 8.0]})
    table["T2"], table["B"] = [*text(seconds(5, 95)), None, None], [3.0, 5.0, None, None]
    table.to_csv(tmp_path / "pairs.csv", index=False)
    packets = {key: {"file": "pairs.csv", "time": {"column": f"T{key}"}} for key in ("1", "2")}
    channels = {c: {"packet": p, "column": c, "kind": "driver"} for c, p in (("A", "1"), ("B", "2"))}
    dataset = read_telemetry(specification(packets=packets, channels=channels), tmp_path)
    np.testing.assert_array_equal(dataset["time"], seconds(0, 5, 60, 95, 120, 180))
    np.testing.assert_array_equal(dataset["B"], [np.nan, 3, np.nan, 5, np.nan, np.nan])
    # Messages count the rows of the file, not those of the packet.
    table["A"], table["B"] = [None, 2.0, 4.0, 8.0], ["3", "5", "x", "6"]
    table["T2"] = text(seconds(5, 95, 100, 110))
    table.to_csv(tmp_path / "pairs.csv", index=False)
    with pytest.raises(TelemetryError, match=r"^pairs\.csv: line 4: channel 'B', column 'B': found 'x'"):
        read_telemetry(specification(packets=packets, channels=channels), tmp_path)


def test_a_frozen_packet_is_seen_while_others_go_on(folder: Path):
    table = pd.read_csv(folder / "thermal.csv")
    table.loc[10:19, ["TT_BAT", "TT_RAD"]] = [21.0, 3.0]
    table.to_csv(folder / "thermal.csv", index=False)
    records = quality_table(read_telemetry(specification(), folder))
    assert [(r.channel, r.finding, r.samples) for r in records] == [("battery", "stale", 9), ("radiator", "stale", 9)]
    # Rows of the other packets in between do not break the run.
    assert {record.detail for record in records} == {"1 run of samples: 9 from 2024-03-01T00:11:00"}


def test_findings_of_rows_name_their_packet_and_its_share(folder: Path):
    table = pd.read_csv(folder / "thermal.csv")
    pd.concat([table, table[:1], table[1:2].assign(TT_BAT=-5.0)]).to_csv(folder / "thermal.csv", index=False)
    onboard = pd.read_csv(folder / "onboard.csv").drop(columns="n")  # what is left repeats from row to row
    onboard.to_csv(folder / "onboard.csv", index=False)
    dataset = read_telemetry(specification(), folder)
    found = [(r.finding, r.samples, r.share, r.detail) for r in quality_table(dataset)]
    differ = "rows that differ from a row of the same time; dropped, the first is used: 2024-03-01T00:01:00"
    normal = "rows normally repeat, so a frozen row cannot be told from a quiet one"
    assert found == [
        ("duplicates", 1, 1 / 32, "packet 'thermal': rows that repeat a row of the same time; dropped"),
        ("conflicts", 1, 1 / 32, f"packet 'thermal': {differ}"),
        ("unsorted", 2, 2 / 32, "packet 'thermal': rows after a row of a later time; sorted"),
        ("stale_not_checked", 30, 1.0, f"packet 'onboard': {normal}"),
    ]
    assert dataset.attrs["duplicates"] == 1


def test_packets_are_averaged_each_by_itself_and_slow_ones_stay(folder: Path):
    dataset = read_telemetry(specification(average="30 s"), folder)
    np.testing.assert_array_equal(own(dataset, "battery")["time"], seconds(*THERMAL))
    raw = pd.read_parquet(folder / "power.parquet")["I_SA"].to_numpy() / 1000
    # Rows are 7, 17 and 27 s after a block begins, and its middle is 15 s after it.
    at_middle = [np.polyval(np.polyfit([-8.0, 2.0, 12.0], three, 1), 0.0) for three in raw.reshape(-1, 3)]
    np.testing.assert_allclose(own(dataset, "sun")[:-1], at_middle[: len(own(dataset, "sun")) - 1])
    assert np.isfinite(dataset["battery"]).sum() == 30
    assert quality_table(dataset) == ()
    # A packet's own length comes before that of all.
    changed = PACKETS | {"power": PACKETS["power"] | {"average": "60 s"}}
    assert own(read_telemetry(specification(packets=changed, average="30 s"), folder), "sun").size < 32


def test_findings_of_averaged_packets_count_rows_of_their_own_files(folder: Path):
    table = pd.read_parquet(folder / "power.parquet")
    table.loc[10:12, "I_SA"] = np.nan
    table.to_parquet(folder / "power.parquet")
    thermal = pd.read_csv(folder / "thermal.csv")
    thermal.loc[2, "TT_BAT"] = np.nan
    thermal.to_csv(folder / "thermal.csv", index=False)
    records = {(r.channel, r.finding): r for r in quality_table(read_telemetry(specification(average="30 s"), folder))}
    assert records["sun", "missing"].share == 3 / 180
    assert records["battery", "missing"].share == 1 / 30
    # Of blocks, those of the channel's own packet count.
    table.loc[10:16, "I_SA"] = np.nan
    table.to_parquet(folder / "power.parquet")
    (lost,) = (
        r for r in quality_table(read_telemetry(specification(average="30 s"), folder)) if r.finding == "few_samples"
    )
    assert (lost.channel, lost.samples, lost.share) == ("sun", 3, 3 / 60)


def test_a_window_has_no_rows_of_drivers_alone_and_drivers_keep_theirs(folder: Path):
    dataset = read_telemetry(specification(), folder)
    window = select_window(dataset, Window(start="2024-03-01T00:05:00", end="2024-03-01T00:15:00"))
    expected = seconds(*np.sort(np.concatenate([THERMAL[5:15], THERMAL[5:15] + 31])))
    np.testing.assert_array_equal(window["time"], expected)
    raw = pd.read_parquet(folder / "power.parquet")["I_SA"].to_numpy() / 1000
    between = driver_series(dataset, "sun", seconds(12.0))
    np.testing.assert_allclose(between, [(raw[0] + raw[1]) / 2])
    on = status_fraction(dataset, "heater", seconds(31.0 + 300.0, 31.0 + 480.0))
    np.testing.assert_allclose(on, [1.0])


def test_a_window_must_lie_within_every_packet(folder: Path):
    table = pd.read_parquet(folder / "power.parquet")
    table[:90].to_parquet(folder / "power.parquet")
    dataset = read_telemetry(specification(), folder)
    with pytest.raises(TelemetryError) as caught:
        select_window(dataset, Window(start="2024-03-01T00:05:00", end="2024-03-01T00:25:00"))
    assert str(caught.value) == (
        "window 2024-03-01T00:05:00 to 2024-03-01T00:25:00: found telemetry of packet 'power' in a part of it only, "
        "expected a window within it, or 'planned: true' of a time to come; it runs from 2024-03-01T00:00:07 to "
        "2024-03-01T00:14:57"
    )


def test_merged_telemetry_survives_netcdf(folder: Path):
    dataset = read_telemetry(specification(average="30 s"), folder, period=5400.0)
    dataset.to_netcdf(folder / "telemetry.nc", engine="h5netcdf")
    with xr.open_dataset(folder / "telemetry.nc", engine="h5netcdf") as restored:
        xr.testing.assert_equal(restored, dataset)
        assert restored.attrs["period_s"] == 5400.0


def test_a_channel_whose_column_its_packet_lacks_is_named(folder: Path):
    channels = CHANNELS | {"battery": CHANNELS["battery"] | {"packet": "power"}}
    with pytest.raises(TelemetryError, match=r"power\.parquet: channel 'battery': found no column 'TT_BAT'"):
        read_telemetry(specification(channels=channels), folder)


@pytest.mark.parametrize(
    ("telemetry", "message"),
    [
        ({"file": "a.csv"}, "missing key 'time'"),
        ({"time": {"column": "t"}}, "missing key 'file'"),
        ({"packets": PACKETS, "file": "a.csv"}, "found 'file' beside 'packets', expected it in each of them"),
    ],
)
def test_telemetry_is_one_file_with_a_time_or_packets(telemetry: dict, message: str):
    with pytest.raises(ValueError, match=message):
        TelemetryFile(**telemetry, channels=CHANNELS)
