from __future__ import annotations

import gzip
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.csv
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from flightcal.errors import TelemetryError
from flightcal.telemetry import quality_table, read_telemetry
from flightcal.telemetry.readers import nearest

from .files import CHANNELS, frame, read, seconds, specification, text

MANY = settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])


def test_channels_are_in_si_on_utc_time(tmp_path: Path):
    table = frame(20)
    dataset = read(tmp_path, table)
    np.testing.assert_array_equal(dataset["time"], seconds(*(60.0 * np.arange(20))))
    assert dataset["time"].dtype == "datetime64[ns]"
    np.testing.assert_allclose(dataset["battery"], table["TT_BAT"] + 273.15)
    np.testing.assert_allclose(dataset["sun"], table["I_SA"] / 1000)
    np.testing.assert_array_equal(dataset["heater"], table["HTR"])
    assert [dataset[name].attrs["units"] for name in CHANNELS] == ["K", "A", ""]
    assert [dataset[name].attrs["kind"] for name in CHANNELS] == ["temperature", "driver", "status"]
    assert dataset.attrs["sampling_interval_s"] == 60.0
    assert dataset.attrs["rows_read"] == 20
    assert not dataset["flags"].any()


@pytest.mark.parametrize("unit", ["degC", "K", "degF", "kelvin"])
@MANY
@given(kelvin=st.lists(st.floats(1.0, 1e4), min_size=3, max_size=9))
def test_temperatures_survive_the_way_through_any_unit(tmp_path: Path, unit: str, kelvin: list[float]):
    scale, offset = {"degC": (1.0, -273.15), "degF": (1.8, -459.67)}.get(unit, (1.0, 0.0))
    table = pd.DataFrame({"time": frame(len(kelvin))["time"], "T": scale * np.array(kelvin) + offset})
    # Equal values one after another are what they are here, not stale.
    channels = {"battery": {"column": "T", "kind": "temperature", "unit": unit, "stale_after": None}}
    dataset = read(tmp_path, table, channels=channels)
    np.testing.assert_allclose(dataset["battery"], kelvin, atol=1e-9, rtol=1e-12)


def test_raw_readings_are_temperatures_along_a_curve(tmp_path: Path):
    table = pd.DataFrame({"time": frame(5)["time"], "ADC": [4095, 3000, 2500, 1000, 0]})
    points = [[3000, "-20 degC"], [2000, "0 degC"], [1000, "60 degC"]]
    channels = {"battery": {"column": "ADC", "kind": "temperature", "curve": points}}
    dataset = read(tmp_path, table, channels=channels)
    np.testing.assert_allclose(dataset["battery"] - 273.15, [np.nan, -20.0, -10.0, 60.0, np.nan], atol=1e-9)
    wider = {"battery": {**channels["battery"], "valid_range": ["-50 degC", "130 degC"]}}
    np.testing.assert_allclose(read(tmp_path, table, channels=wider)["battery"][[0, -1]] - 273.15, [-41.9, 120.0])


def test_readings_that_are_all_beyond_a_curve_are_told_as_the_file_has_them(tmp_path: Path):
    table = pd.DataFrame({"time": frame(3)["time"], "ADC": [4000, 4095, 4090]})
    curve = [[1000, "60 degC"], [3000, "-20 degC"]]
    with pytest.raises(TelemetryError, match="4000 to 4095, expected 1000 to 3000"):
        read(tmp_path, table, channels={"battery": {"column": "ADC", "kind": "temperature", "curve": curve}})


def left_out(*spans):
    """The channels, the first of which leaves out times from s to s after the first row."""
    written = [dict(zip(("start", "end"), map(str, seconds(*span)), strict=True)) for span in spans]
    return {**CHANNELS, "battery": CHANNELS["battery"] | {"leave_out": written}}


def test_samples_of_times_that_are_left_out_are_not_used_ends_included(tmp_path: Path):
    table = frame(20)
    whole, dataset = read(tmp_path, table), read(tmp_path, table, channels=left_out((120, 300), (540, 540)))
    without = [2, 3, 4, 5, 9]
    assert np.flatnonzero(dataset["flags"].sel(channel="battery")).tolist() == without
    assert (dataset["flags"].sel(channel="battery")[without] == 64).all()
    assert np.isnan(dataset["battery"][without]).all()
    kept = np.setdiff1d(np.arange(20), without)
    xr.testing.assert_equal(dataset["battery"][kept], whole["battery"][kept])
    xr.testing.assert_equal(dataset["sun"], whole["sun"])
    (record,) = (row for row in quality_table(dataset) if row.channel == "battery")
    assert (record.finding, record.samples) == ("left_out", 5)


def test_a_mean_is_of_the_samples_that_are_not_left_out(tmp_path: Path):
    table = frame(60, 10.0)
    dataset = read(tmp_path, table, channels=left_out((0, 10), (60, 110)), average="60 s")
    expected = table["TT_BAT"][2:6].mean() + 273.15
    assert dataset["battery"][0] == pytest.approx(expected)
    assert np.isnan(dataset["battery"][1])
    assert dataset["flags"].sel(channel="battery")[:3].to_numpy().tolist() == [0, 80, 0]


def test_a_channel_of_which_all_is_left_out_is_an_error(tmp_path: Path):
    with pytest.raises(TelemetryError, match=r"'battery'.*no valid sample \(20 left out\)"):
        read(tmp_path, frame(20), channels=left_out((0, 1200)))


@MANY
@given(order=st.permutations(range(30)))
def test_shuffled_rows_give_the_same_dataset(tmp_path: Path, order: list[int]):
    table = frame(30)
    table.loc[10:20, ["TT_BAT", "I_SA", "HTR"]] = [21.5, 120.0, 1]
    straight, shuffled = read(tmp_path, table), read(tmp_path, table.iloc[order])
    assert shuffled.attrs.pop("unsorted") == sum(row < max(order[:i], default=-1) for i, row in enumerate(order))
    straight.attrs.pop("unsorted")
    xr.testing.assert_identical(straight, shuffled)
    assert (shuffled["flags"].sel(channel="battery") == 8).sum() == 10


def test_files_in_any_order_are_one_series_and_their_overlap_is_dropped(tmp_path: Path):
    table = frame(40)
    # Whole numbers only in one file: its columns are read as integers, and still are the same rows.
    table.loc[15:, "TT_BAT"] = np.arange(25) + 20
    table[:25].to_csv(tmp_path / "first.csv", index=False)
    table[15:].astype({"TT_BAT": int}).to_csv(tmp_path / "second.csv", index=False)
    table.to_csv(tmp_path / "data.csv", index=False)
    whole = read_telemetry(specification(), tmp_path)
    for files in (["first.csv", "second.csv"], ["second.csv", "first.csv"]):
        joined = read_telemetry(specification(file=files), tmp_path)
        assert joined.attrs["duplicates"] == 10
        assert joined.attrs["conflicts"] == joined.attrs["unsorted"] == 0
        assert joined.attrs["files"] == "\n".join(files)
        xr.testing.assert_equal(joined, whole)


@pytest.mark.parametrize("name", ["data.csv", "data.csv.gz", "data.parquet", "typed.parquet"])
def test_every_kind_of_file_gives_the_same_dataset(tmp_path: Path, name: str):
    table = frame(20)
    reference = read(tmp_path, table)
    if name == "data.csv.gz":
        (tmp_path / name).write_bytes(gzip.compress(table.to_csv(index=False).encode()))
    elif name == "data.parquet":
        table.to_parquet(tmp_path / name)
    elif name == "typed.parquet":
        typed = table.assign(
            time=pd.to_datetime(table["time"]), HTR=pd.Categorical(table["HTR"].map({0: "OFF", 1: "ON"}))
        )
        typed.to_parquet(tmp_path / name)
    xr.testing.assert_equal(read_telemetry(specification(file=name), tmp_path), reference)


@pytest.mark.parametrize(
    ("combine", "expected"),
    [("mean", [2.0, np.nan, 4.0]), ("sum", [4.0, np.nan, 8.0]), ("product", [3.0, np.nan, 16.0])],
)
def test_combined_columns_are_missing_where_one_is(tmp_path: Path, combine: str, expected: list[float]):
    table = pd.DataFrame({"time": frame(3)["time"], "a": [1.0, 2.0, 4.0], "b": [3.0, np.nan, 4.0]})
    dataset = read(tmp_path, table, channels={"both": {"column": ["a", "b"], "combine": combine, "kind": "driver"}})
    np.testing.assert_array_equal(dataset["both"], expected)
    np.testing.assert_array_equal(dataset["flags"].sel(channel="both"), [0, 1, 0])


def test_a_product_of_columns_has_the_unit_of_the_product(tmp_path: Path):
    table = pd.DataFrame({"time": frame(2)["time"], "U": [8000, 8100], "I": [200, 210]})
    channels = {"power": {"column": ["U", "I"], "combine": "product", "kind": "driver", "unit": "mV * mA"}}
    dataset = read(tmp_path, table, channels=channels)
    np.testing.assert_allclose(dataset["power"], [1.6, 1.701])
    assert dataset["power"].attrs["units"] == "W"


@pytest.mark.parametrize(
    ("invalid", "cells", "flags"),
    [
        ([-1], ["20", "-1", "-1.0", ""], [0, 2, 2, 1]),
        (["-1"], ["20", "-1", "-1.00", ""], [0, 2, 2, 1]),
        (["ERR", -999], ["20", "ERR", "-999", "NaN"], [0, 2, 2, 1]),
        (["N/A"], ["20", "N/A", "", "n/a"], [0, 2, 1, 1]),
        ([""], ["20", "", "21", "22"], [0, 2, 0, 0]),
        ([], ["20", "nan", "-300", "1e400"], [0, 1, 4, 1]),
    ],
)
def test_marks_of_invalid_values_are_taken_as_they_stand(
    tmp_path: Path, invalid: list, cells: list[str], flags: list[int]
):
    channels = {"battery": {"column": "T", "kind": "temperature", "unit": "degC", "invalid": invalid}}
    table = pd.DataFrame({"time": frame(4)["time"], "T": cells, "other": [1, 2, 3, 4]})
    dataset = read(tmp_path, table.to_csv(index=False), channels=channels)
    np.testing.assert_array_equal(dataset["flags"].sel(channel="battery"), flags)
    np.testing.assert_array_equal(dataset["battery"].isnull(), np.array(flags) > 0)


def test_a_mark_of_one_channel_is_a_missing_value_in_another(tmp_path: Path):
    channels = {
        "battery": {"column": "T", "kind": "temperature", "unit": "degC", "invalid": ["N/A"]},
        "sun": {"column": "I", "kind": "driver"},
    }
    table = pd.DataFrame({"time": frame(3)["time"], "T": ["20", "N/A", "21"], "I": ["1", "2", "N/A"]})
    dataset = read(tmp_path, table.to_csv(index=False), channels=channels)
    np.testing.assert_array_equal(dataset["flags"], [[0, 0], [2, 0], [0, 1]])


@pytest.mark.parametrize(
    ("on", "cells", "status"),
    [
        (None, ["1", "0", "1", "0.0"], [1, 0, 1, 0]),
        (None, ["ON", "OFF", "on", "off"], [1, 0, 1, 0]),
        (None, ["true", "false", "TRUE", "False"], [1, 0, 1, 0]),
        (["ENABLED"], ["ENABLED", "DISABLED", "enabled", ""], [1, 0, 1, np.nan]),
        ([1, 2, 3], ["1", "2", "3", "0"], [1, 1, 1, 0]),
        ([0], ["0", "off", "0", "0"], [1, 0, 1, 1]),
    ],
)
def test_status_is_on_for_the_values_that_mean_on(
    tmp_path: Path, on: list | None, cells: list[str], status: list[float]
):
    channel = {"column": "HTR", "kind": "status"} | ({} if on is None else {"on": on})
    table = pd.DataFrame({"time": frame(4)["time"], "HTR": cells, "n": [4, 1, 7, 3]})
    np.testing.assert_array_equal(
        read(tmp_path, table.to_csv(index=False), channels={"heater": channel})["heater"], status
    )


@pytest.mark.parametrize(("column", "channel"), [("TT_BAT", "battery"), ("I_SA", "sun")])
def test_a_value_that_no_sensor_can_mean_is_out_of_range(tmp_path: Path, column, channel):
    table = frame(20)
    table.loc[3, column] = 1e308
    dataset = read(tmp_path, table)
    assert np.isnan(dataset[channel][3])
    assert np.isfinite(dataset[channel]).sum() == 19
    table[column] = 1e308
    with pytest.raises(TelemetryError, match=f"{column}'.*no valid sample .20 out of range.*1e.308"):
        read(tmp_path, table)


def test_values_outside_the_valid_range_are_flagged(tmp_path: Path):
    table = frame(4).assign(TT_BAT=[-41.0, -40.0, 60.0, 61.0])
    battery = CHANNELS["battery"] | {"valid_range": ["-40 degC", "60 degC"]}
    dataset = read(tmp_path, table, channels={"battery": battery})
    np.testing.assert_array_equal(dataset["flags"][:, 0], [4, 0, 0, 4])


@pytest.mark.parametrize("invalid", [[], [""]])
def test_lines_of_commas_and_blank_lines_are_no_rows(tmp_path: Path, invalid: list[str]):
    header, *rows = frame(6).to_csv(index=False).splitlines()
    written = "\n".join(["\ufeff" + header, *rows[:3], "", *rows[3:], ",,,", ",,,", ""])
    battery = CHANNELS["battery"] | {"invalid": invalid}
    assert read(tmp_path, written, channels={"battery": battery}).sizes["time"] == 6


def test_an_error_counts_blank_lines_and_the_header(tmp_path: Path):
    header, *rows = frame(6).to_csv(index=False).splitlines()
    rows[4] = rows[4].replace("Z,", "Z,bad ", 1)
    with pytest.raises(TelemetryError, match=r"^data\.csv: line 8: channel 'battery', column 'TT_BAT': found 'bad "):
        read(tmp_path, "\n".join([header, "", *rows[:2], "", *rows[2:]]))


def test_an_error_in_parquet_names_the_row(tmp_path: Path):
    frame(5).assign(HTR=["ON", "OFF", "?", "ON", "?"]).to_parquet(tmp_path / "data.parquet")
    with pytest.raises(TelemetryError, match=r"^data\.parquet: row 3: channel 'heater'.* \(and in 1 more row\)"):
        read_telemetry(specification(file="data.parquet"), tmp_path)


def test_all_channels_that_cannot_be_read_are_listed(tmp_path: Path):
    table = frame(5).astype({"TT_BAT": object, "HTR": object})
    table.loc[1, "TT_BAT"] = "ERR"
    table.loc[3, "HTR"] = 7
    with pytest.raises(TelemetryError) as caught:
        read(tmp_path, table)
    first, second, third = str(caught.value).splitlines()
    assert first == "2 things are wrong with the telemetry:"
    assert "line 3: channel 'battery'" in second
    assert "line 5: channel 'heater'" in third


@pytest.mark.parametrize("average", [None, "120 s"])
def test_the_dataset_survives_netcdf(tmp_path: Path, average: str | None):
    table = frame(30, interval=0.1 if average is None else 10.0)
    table.loc[5:15, ["TT_BAT", "I_SA", "HTR"]] = [21.5, 120.0, 1]
    dataset = read(tmp_path, table, average=average, period=5400.0)
    dataset.to_netcdf(tmp_path / "telemetry.nc", engine="h5netcdf")
    with xr.open_dataset(tmp_path / "telemetry.nc", engine="h5netcdf") as restored:
        xr.testing.assert_equal(restored, dataset)
        assert restored["time"].dtype == "datetime64[ns]"
        assert restored["flags"].dtype == np.uint8
        assert (
            restored["flags"].attrs["flag_meanings"]
            == "missing invalid_marker out_of_range stale few_samples other_packet left_out"
        )
        np.testing.assert_array_equal(restored["flags"].attrs["flag_masks"], [1, 2, 4, 8, 16, 32, 64])
        assert restored["battery"].attrs == dataset["battery"].attrs
        assert {name: restored.attrs[name] for name in dataset.attrs} == dataset.attrs


@MANY
@given(content=st.binary(max_size=200))
@pytest.mark.parametrize("name", ["data.csv", "data.csv.gz", "data.parquet"])
def test_any_bytes_give_a_message_and_no_traceback(tmp_path: Path, name: str, content: bytes):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(TelemetryError, match="data"):
        read_telemetry(specification(file=name), tmp_path)


@settings(MANY, max_examples=150)
@given(
    damage=st.lists(
        st.tuples(st.floats(0, 1, exclude_max=True), st.binary(min_size=1, max_size=3)), min_size=1, max_size=4
    )
)
@pytest.mark.parametrize("name", ["data.csv", "data.csv.gz", "data.parquet"])
def test_a_damaged_file_gives_a_dataset_or_a_message(tmp_path: Path, name: str, damage: list[tuple[float, bytes]]):
    table = frame(12)
    if name == "data.parquet":
        table.to_parquet(tmp_path / name)
        content = bytearray((tmp_path / name).read_bytes())
    else:
        written = table.to_csv(index=False).encode()
        content = bytearray(gzip.compress(written) if name.endswith("gz") else written)
    for place, junk in damage:
        start = int(place * len(content))
        content[start : start + len(junk)] = junk
    (tmp_path / name).write_bytes(content)
    try:
        rows = read_telemetry(specification(file=name), tmp_path).attrs["rows_read"]
    except TelemetryError:
        return
    assert rows >= 2


@MANY
@given(
    line=st.integers(0, 11),
    cells=st.lists(st.text(st.characters(exclude_categories=["Cs"]), max_size=8), min_size=1, max_size=6),
)
def test_any_line_of_text_gives_a_dataset_or_a_message(tmp_path: Path, line: int, cells: list[str]):
    lines = frame(10).to_csv(index=False).splitlines()
    lines[line : line + 1] = [",".join(cells)]
    try:
        rows = read(tmp_path, "\n".join(lines)).sizes["time"]
    except TelemetryError:
        return
    assert rows >= 8


def test_three_hundred_thousand_rows_are_read_in_seconds(tmp_path: Path):
    table = pa.Table.from_pandas(frame(300_000, interval=1.0), preserve_index=False)
    pa.csv.write_csv(table, tmp_path / "data.csv")
    start = time.process_time()
    dataset = read_telemetry(specification(average="60 s"), tmp_path)
    assert time.process_time() - start < 6
    assert dataset.sizes["time"] == 5000


def test_a_title_above_the_header_is_passed_over(tmp_path: Path):
    table, title = frame(6).to_csv(index=False), 'Export of "HK", v3\n\nfrom,to\n'
    dataset = read(tmp_path, title + table, header=4)
    np.testing.assert_array_equal(dataset["battery"], read(tmp_path, table)["battery"])
    bad = table.replace(table.splitlines()[3].split(",")[1], "ERR")
    with pytest.raises(TelemetryError, match=r"^data\.csv: line 7: channel 'battery', column 'TT_BAT': found 'ERR'"):
        read(tmp_path, title + bad, header=4)
    with pytest.raises(TelemetryError, match=r"^data\.csv: line 5: found values .*, expected the columns' names"):
        read(tmp_path, title + frame(6).assign(time=1).to_csv(index=False), header=5)
    with pytest.raises(TelemetryError, match=r"^data\.csv: found no line 40, expected the columns' names there"):
        read(tmp_path, title + table, header=40)


def test_a_row_of_units_is_a_row_without_a_time(tmp_path: Path):
    lines = frame(6).to_csv(index=False).splitlines()
    with_units = "\n".join([lines[0], ",degC,mA,", *lines[1:]])
    dataset = read(tmp_path, with_units, time={"column": "time", "invalid": ""})
    np.testing.assert_array_equal(dataset["battery"], read(tmp_path, "\n".join(lines))["battery"])
    assert (dataset.attrs["rows_read"], dataset.attrs["untimed"]) == (7, 1)


@pytest.mark.parametrize(("separator", "decimal"), [(";", "."), ("\t", "."), ("|", "."), (";", ","), ("\t", ",")])
def test_columns_may_be_separated_by_other_marks_and_numbers_have_a_comma(tmp_path: Path, separator: str, decimal: str):
    table = frame(20)
    expected = read(tmp_path, table)
    table.to_csv(tmp_path / "other.csv", sep=separator, decimal=decimal, index=False)
    found = read_telemetry(specification(file="other.csv"), tmp_path)
    for name in CHANNELS:
        np.testing.assert_allclose(found[name], expected[name], rtol=1e-12)


def test_a_decimal_comma_is_read_beside_marks_and_whole_numbers(tmp_path: Path):
    lines = ["time;TT_BAT;I_SA;HTR"]
    lines += [f"2024-03-01T00:{k:02d}:00Z;{20 + k};100,5;1" for k in range(60)]
    lines += ["2024-03-01T01:00:00Z;BAD;100,5;1", "2024-03-01T01:01:00Z;-7,25;100,5;0"]
    (tmp_path / "data.csv").write_text("\n".join(lines) + "\n")
    channels = CHANNELS | {"battery": CHANNELS["battery"] | {"invalid": ["BAD"]}}
    found = read_telemetry(specification(channels), tmp_path)
    np.testing.assert_allclose(found["battery"][[0, 59, 61]] - 273.15, [20.0, 79.0, -7.25])
    assert np.isnan(found["battery"][60])
    np.testing.assert_allclose(found["sun"], 0.1005)


def test_a_line_with_too_many_values_is_named_where_semicolons_separate(tmp_path: Path):
    table = frame(20)
    table.to_csv(tmp_path / "data.csv", sep=";", index=False)
    lines = (tmp_path / "data.csv").read_text().splitlines()
    lines[4] += ";7"
    (tmp_path / "data.csv").write_text("\n".join(lines) + "\n")
    with pytest.raises(TelemetryError, match=rf"data.csv: line 5: found {len(table.columns) + 1} values"):
        read_telemetry(specification(), tmp_path)


def test_a_number_may_have_its_unit_beside_it(tmp_path: Path):
    table = frame(6)
    table["TT_BAT"] = ["20.5 °C", "21 °C", "294.65 K", "68 degF", "", "22.5"]
    table["I_SA"] = ["950 mA", "1.2 A", "-3e2 mA", "0.5 A", "7", "8 mA"]
    dataset = read(tmp_path, table)
    np.testing.assert_allclose(dataset["battery"], [293.65, 294.15, 294.65, 293.15, np.nan, 295.65])
    np.testing.assert_allclose(dataset["sun"], [0.95, 1.2, -0.3, 0.5, 0.007, 0.008])


@pytest.mark.parametrize("cell", ["20.5 V", "20.5 apples", "20,5 °C", "°C"])
def test_a_number_with_a_unit_of_another_kind_is_an_error_with_its_line(tmp_path: Path, cell: str):
    table = frame(6)
    table["TT_BAT"] = ["20 °C", "21 °C", cell, "22 °C", "23 °C", "24 °C"]
    with pytest.raises(TelemetryError, match=f"line 4: channel 'battery', column 'TT_BAT': found '{cell}'"):
        read(tmp_path, table)


def test_rows_that_a_column_says_are_invalid_are_not_used_whatever_stands_in_them(tmp_path: Path):
    table = frame(8)
    table["TT_BAT"] = [20.0, 21.0, "---", 23.0, 24.0, 25.0, 26.0, 27.0]
    table["OK"] = ["VALID", "valid", "INVALID", "VALID", "", "SUSPECT", "VALID", "VALID"]
    table["I_OK"] = [1, 1, 1, 0, 1, 1, 1, 1]
    channels = CHANNELS | {"sun": CHANNELS["sun"] | {"valid_where": {"I_OK": 1}}}
    table.to_csv(tmp_path / "data.csv", index=False)
    dataset = read_telemetry(specification(channels, valid_where={"OK": ["VALID"]}), tmp_path)
    valid = np.array([True, True, False, True, False, False, True, True])
    np.testing.assert_array_equal(dataset["battery"].notnull(), valid)
    np.testing.assert_array_equal(dataset["sun"].notnull(), valid & (table["I_OK"] == 1))
    assert {(record.channel, record.finding, record.samples) for record in quality_table(dataset)} == {
        ("battery", "invalid_marker", 3), ("sun", "invalid_marker", 4), ("heater", "invalid_marker", 3),
    }  # fmt: skip
    with pytest.raises(TelemetryError, match=r"data\.csv: valid_where: found no column 'OKAY'; nearest: 'OK'"):
        read_telemetry(specification(valid_where={"OKAY": "VALID"}), tmp_path)


INFLUX = [
    "#group,false,false,false,false", "#datatype,string,long,dateTime:RFC3339,double", "#default,mean,,,",
    ",result,table,time,TT_BAT",
]  # fmt: skip


@pytest.mark.parametrize("lines", [INFLUX, INFLUX[3:]])
def test_tables_below_each_other_are_one_and_lines_are_those_of_the_file(tmp_path: Path, lines: list[str]):
    rows = [f",,0,{time},{20 + k}" for k, time in enumerate(text(seconds(*(60.0 * np.arange(8)))))]
    (tmp_path / "data.csv").write_text("\r\n".join([*lines, *rows[:4], "", *lines, *rows[4:], ""]))
    channel = {"battery": CHANNELS["battery"]}
    dataset = read_telemetry(specification(channel), tmp_path)
    np.testing.assert_allclose(dataset["battery"], 293.15 + np.arange(8))
    wrong = [*lines, *rows[:4], "", *lines, *rows[4:7], rows[7].replace("27", "warm"), ""]
    (tmp_path / "data.csv").write_text("\r\n".join(wrong))
    with pytest.raises(
        TelemetryError, match=f"line {len(wrong) - 1}: channel 'battery', column 'TT_BAT': found 'warm'"
    ):
        read_telemetry(specification(channel), tmp_path)


def test_comments_below_the_last_row_are_left_out_and_a_row_that_is_cut_off_is_not(tmp_path: Path):
    table = frame(6)
    written = table.to_csv(index=False)
    np.testing.assert_allclose(
        read(tmp_path, f"{written}# End of report, 6 rows\n")["battery"], table["TT_BAT"] + 273.15
    )
    with pytest.raises(TelemetryError, match="line 8: found 2 values, expected 4 as in the header"):
        read(tmp_path, f"{written}2024-03-01T00:06:00Z,20\n")


def test_the_nearest_column_is_one_with_a_longer_name_before_one_with_other_letters():
    assert nearest("T_PAY", ["T_PY", "T_PX", "T_PAYLOAD"]) == "; nearest: 'T_PAYLOAD'"
    assert nearest("T_PAYLOAD_1", ["T_PAYLOAD", "T_RADIATOR_1"]) == "; nearest: 'T_PAYLOAD'"
    assert nearest("T_PQ", ["T_PY", "U_BUS"]) == "; nearest: 'T_PY'"
