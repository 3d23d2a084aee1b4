"""What files seem to hold: time columns and their formats, kinds and units of the others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from flightcal.errors import TelemetryError
from flightcal.telemetry import detect

from .files import START, flight_data, frame, seconds, text

TIMES = seconds(*(60.0 * np.arange(8)))
UNIX = TIMES.astype(np.int64) // 1_000_000_000


def day_of_year(pattern: str) -> list[str]:
    return pd.to_datetime(TIMES).strftime(pattern).tolist()


@pytest.mark.parametrize(
    ("cells", "written"),
    [
        (text(TIMES), "iso8601"),
        ([cell.replace("T", " ").removesuffix("Z") for cell in text(TIMES)], "iso8601"),
        (UNIX, "unix"),
        (UNIX + 0.25, "unix"),
        (UNIX * 1000, "unix-ms"),
        (UNIX * 1_000_000, "unix-us"),
        (UNIX * 1_000_000_000, "unix-ns"),
        (day_of_year("%Y:%j:%H:%M:%S.000"), "year-doy"),
        (day_of_year("%y-%j/%H:%M:%S"), "year-doy"),
        (day_of_year("%Y.%j.%H.%M.%S"), "year-doy"),
        (day_of_year("%Y%j.%H%M%S"), "year-doy"),
        ([int(cell) for cell in day_of_year("%Y%j%H%M%S")], "year-doy"),
        ([f"2024-{61 + minute / 1440:.8f}" for minute in range(8)], "decimal-doy"),
        ([24061 + minute / 1440 for minute in range(8)], "decimal-doy"),
        ([f"0x{cell:X}" for cell in UNIX], "unix"),
        (day_of_year("%d.%m.%Y %H:%M:%S"), "%d.%m.%Y %H:%M:%S"),
        (day_of_year("%d.%m.%Y %H:%M:%S,250"), "%d.%m.%Y %H:%M:%S.%f"),
        (day_of_year("%d-%b-%Y %H:%M"), "%d-%b-%Y %H:%M"),
        (day_of_year("%Y%m%d_%H%M%S"), "%Y%m%d_%H%M%S"),
        ([int(cell) for cell in day_of_year("%Y%m%d%H%M%S")], "%Y%m%d%H%M%S"),
    ],
)
@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_a_time_column_and_its_format_are_found(tmp_path: Path, cells: list, written: str, suffix: str):
    table = pd.DataFrame({"frame": np.arange(8), "Stamp": cells, "TT_BAT": np.linspace(0, 9, 8)})
    path = tmp_path / f"data.{suffix}"
    table.to_csv(path, index=False) if suffix == "csv" else table.to_parquet(path)
    (found,) = detect([path])
    assert (found.clock, found.time.format if found.time else None) == (("Stamp",), written)
    assert found.first == pytest.approx(START.astype(np.int64), abs=1e9)


@pytest.mark.parametrize(("start", "epoch"), [(45352.5, "1899-12-30"), (60370.5, "1858-11-17")])
def test_numbers_of_days_are_those_of_a_spreadsheet_or_modified_julian_dates(tmp_path: Path, start: float, epoch: str):
    table = pd.DataFrame({"time": start + np.arange(8) / 1440, "TT_BAT": np.linspace(0, 9, 8)})
    table.to_csv(tmp_path / "data.csv", index=False)
    (found,) = detect([tmp_path / "data.csv"])
    assert found.time is not None
    assert found.time.epoch is not None
    assert (found.time.format, f"{found.time.epoch:%Y-%m-%d}") == ("clock", epoch)
    assert found.first == pytest.approx(np.datetime64("2024-03-01T12:00:00", "ns").astype(np.int64), abs=1e6)


@pytest.mark.parametrize("step", [1.0, 60.0])
@pytest.mark.parametrize("start", [24061.5, 45352.5, 60370.5])
def test_a_counter_is_no_day(tmp_path: Path, start: float, step: float):
    table = pd.DataFrame({"time": start + step * np.arange(8), "TT_BAT": np.linspace(0, 9, 8)})
    table.to_csv(tmp_path / "data.csv", index=False)
    (found,) = detect([tmp_path / "data.csv"])
    assert (found.clock, found.time) == (("time",), None)


@pytest.mark.parametrize(
    ("cells", "written"),
    [
        ({"Date": ["2024-03-01"] * 8, "Time": [f"00:{k:02d}:00" for k in range(8)]}, "iso8601"),
        ({"Datum": ["2024-03-01"] * 8, "Uhrzeit": [f"00:{k:02d}:00" for k in range(8)]}, "iso8601"),
        ({"Datum": ["01.03.2024"] * 8, "Uhrzeit": [f"00:{k:02d}:00" for k in range(8)]}, "%d.%m.%Y %H:%M:%S"),
        ({"DATE": ["2024-061"] * 8, "UTC": [f"00:{k:02d}:00" for k in range(8)]}, "year-doy"),
        ({"YEAR": [2024] * 8, "DOY": [61] * 8, "HMS": [f"00:{k:02d}:00" for k in range(8)]}, "year-doy"),
        ({"Year": [2024] * 8, "Day": [61] * 8, "H": [0] * 8, "M": list(range(8)), "S": [0.0] * 8}, "year-doy"),
    ],
)
def test_a_time_in_several_columns_is_found(tmp_path: Path, cells: dict, written: str):
    pd.DataFrame({**cells, "TT_BAT": np.linspace(0, 9, 8)}).to_csv(tmp_path / "data.csv", index=False)
    (found,) = detect([tmp_path / "data.csv"])
    assert (found.clock, found.time.format if found.time else None) == (tuple(cells), written)
    assert found.first == START.astype(np.int64)
    assert [column.name for column in found.columns] == ["TT_BAT"]


@pytest.mark.parametrize("days", [1, 3, 14])
@pytest.mark.parametrize("written", ["%m/%d/%Y %H:%M", "%d/%m/%Y %H:%M"])
def test_day_and_month_are_told_apart_by_how_close_times_lie(tmp_path: Path, written: str, days: int):
    times = pd.to_datetime(seconds(*(3600.0 * np.arange(24 * days))))
    table = pd.DataFrame({"time": times.strftime(written), "TT_BAT": np.linspace(0, 9, len(times))})
    table.to_csv(tmp_path / "data.csv", index=False)
    (found,) = detect([tmp_path / "data.csv"])
    assert found.time is not None
    # Of a single day nothing tells; day before month is then taken.
    assert found.time.format == ("%d/%m/%Y %H:%M" if days == 1 else written)


def test_marks_in_the_place_of_times_are_found_in_all_files_of_a_packet(tmp_path: Path):
    whole = frame(4000)
    for name, mark, rows in (("a", "0x00000000", slice(2000)), ("b", "0xFFFEFFFE", slice(2000, None))):
        table = whole[rows].reset_index(drop=True)
        table.loc[[0, 1500], "time"] = mark
        table.loc[[0, 1500], "TT_BAT"] = 1.0  # no unit, though it stands below the header
        table.to_csv(tmp_path / f"{name}.csv", index=False)
    (found,) = detect([tmp_path / "a.csv", tmp_path / "b.csv"])
    assert len(found.files) == 2
    assert found.time is not None
    assert found.time.invalid == ("0x00000000", "0xFFFEFFFE")
    assert [column.unit for column in found.columns] == ["degC", "1", None]


def test_typed_times_need_no_format(tmp_path: Path):
    pd.DataFrame({"a": TIMES, "TT_BAT": range(8)}).to_parquet(tmp_path / "data.parquet")
    (found,) = detect([tmp_path / "data.parquet"])
    assert (found.clock, found.time.format if found.time else None) == (("a",), "iso8601")


def test_values_of_corrupt_frames_are_no_bits_and_no_modes(tmp_path: Path):
    utc = pd.date_range("2024-03-01", periods=1000, freq="60s")
    word, mode = np.repeat([5, 7], 500), np.repeat([1, 2], 500)
    word[[40, 300, 700]], mode[[40, 300, 700]] = 0x8000, 255
    table = pd.DataFrame({"UTC": utc.astype(str), "HTR_WORD": word, "MODE": mode, "TT_BAT": range(1000)})
    table.to_csv(tmp_path / "a.csv", index=False)
    (found,) = detect([tmp_path / "a.csv"])
    assert [column.bit for column in found.columns if column.kind == "status"] == [1]
    assert found.modes is not None
    assert set(found.modes.names) == {"mode 1", "mode 2"}


def test_a_counter_is_a_clock_whose_epoch_is_not_known(tmp_path: Path):
    table = pd.DataFrame({"TT_BAT": [4.0, 3, 7, 5], "SCLK": [515721623, 515721683, 515721743, 515721803]})
    table.to_csv(tmp_path / "data.csv", index=False)
    (found,) = detect([tmp_path / "data.csv"])
    assert (found.clock, found.time, found.first) == (("SCLK",), None, 515721623)


@pytest.mark.parametrize(("epoch", "leap"), [("2000-01-01", None), ("2000-01-01T12:00", None), ("1980-01-06", True)])
def test_seconds_of_another_epoch_are_told_by_the_times_of_the_other_files(tmp_path: Path, epoch: str, leap: bool):
    utc = pd.date_range("2024-03-01", periods=200, freq="60s")
    seconds = (utc - pd.Timestamp(epoch)).total_seconds().astype(int)
    pd.DataFrame({"UTC": utc.astype(str), "TT_BAT": range(200)}).to_csv(tmp_path / "a.csv", index=False)
    pd.DataFrame({"obc_time": seconds[::3], "TT_PNL": range(67)}).to_csv(tmp_path / "b.csv", index=False)
    first, second = detect([tmp_path / "a.csv", tmp_path / "b.csv"])
    assert second.time is not None
    assert (second.time.format, pd.Timestamp(second.time.epoch)) == ("clock", pd.Timestamp(epoch))
    assert (second.time.leap_seconds, second.first) == (leap, first.first)
    # Alone, nothing says that they are no UNIX times.
    (alone,) = detect([tmp_path / "b.csv"])
    assert alone.time is None or alone.time.format == "unix"


@pytest.mark.parametrize(
    ("name", "cells", "expected"),
    [
        ("TT_BAT", [20.5, 21.0, -3.0, 4.0], ("temperature", "degC")),
        ("TBAT", [20.5, 21.0, -3.0, 4.0], ("temperature", "degC")),
        ("TPNL_N", [20.5, 21.0, -3.0, 4.0], ("temperature", "degC")),
        ("TEAST", [20.5, 21.0, -3.0, 4.0], ("temperature", "degC")),
        ("TESTS", [20.5, 21.0, -3.0, 4.0], ("driver", "1")),
        ("TH_PX", [20.5, 21.0, -3.0, 4.0], ("temperature", "degC")),
        ("NTC3", [20.5, 21.0, -3.0, 4.0], ("temperature", "degC")),
        ("I_PL_MA", [20.5, 210.0, 3.0, 4.0], ("driver", "mA")),
        ("tpx1", [20.5, 21.0, -3.0, 4.0], ("temperature", "degC")),
        ("TXPOWER", [20.5, 21.0, 3.0, 4.0], ("driver", "1")),
        ("Temp1", [20, 21, -3, 4], ("temperature", "degC")),
        ("battery_temperature", [293.0, 294.5, 290.0, 288.0], ("temperature", "K")),
        ("Battery [degC]", [20.5, 21.0, 3.0, 4.0], ("temperature", "degC")),
        ("Battery (°C)", [20.5, 21.0, 3.0, 4.0], ("temperature", "degC")),
        ("Panel [K]", [20.5, 21.0, 3.0, 4.0], ("temperature", "K")),
        ("Black Chassis deg. C", [20.5, 21.0, 3.0, 4.0], ("temperature", "degC")),
        ("Tot. Photo Curr. mA", [20.5, 21.0, 3.0, 4.0], ("driver", "mA")),
        ("bus_power [W]", [20.5, 21.0, 3.0, 4.0], ("driver", "W")),
        ("TT_RAD_A", [20.5, 21.0, 3.0, 4.0], ("temperature", "degC")),
        ("SHIELD_T_K", [293.0, 294.5, 290.0, 288.0], ("temperature", "K")),
        ("RAD_TEMP_F", [20.5, 21.0, 3.0, 4.0], ("temperature", "degF")),
        ("I_SUN", [20.5, 21.0, 3.0, 4.0], ("driver", "1")),
        ("HTR_BAT", [0, 1, 1, 0], ("status", None)),
        ("Temp [1]", [20.5, 21.0, 3.0, 4.0], ("temperature", "degC")),
        ("HTR_1_CUR [mA]", [3, 480, 481, 4], ("status", "mA")),
        ("I_HTR", [3, 480, 481, 4], ("driver", "1")),
        ("HTR_WORD", [0.5, 18, 18, 2], ("driver", "1")),
        ("HTR_WORD", [0, 16, 16, 16], ("status", None)),
        ("HTR_COUNTER_WORD", [0, 1023, 18, 2], ("driver", "1")),
        ("THM02_BATT", [20.5, 21.0, 3.0, 4.0], ("temperature", "degC")),
        ("TMP_BATT", [20.5, 21.0, 3.0, 4.0], ("temperature", "degC")),
        ("OBC T/K", [293.0, 294.5, 290.0, 288.0], ("temperature", "K")),
        ("PROP_TANK_K", [293.0, 294.5, 290.0, 288.0], ("temperature", "K")),
        ("TM.BAT.T_CELL", [20.5, 21.0, -3.0, 4.0], ("temperature", "degC")),
        ("TC_BAT", [20.5, 21.0, -3.0, 4.0], ("temperature", "degC")),
        ("TC_COUNT", [20, 21, 22, 22], ("driver", "1")),
        ("ecl_flag", [0, 1, 1, 0], ("status", None)),
        ("PROP_TANK", [293.0, 294.5, 290.0, 288.0], ("driver", "1")),
        ("BRANCH_K", [3.0, 4.5, 0.0, 8.0], ("driver", "1")),
        ("ANT_TEMP_RAW", [2093.0, 2294.5, 2290.0, 2088.0], ("temperature", None)),
        ("heater_current_A", [0.1, 0.2, 0.3, 0.4], ("driver", "1")),
        ("HTR_TEMP [degC]", [0.1, 0.1, 9.0, 9.1], ("temperature", "degC")),
        ("pitch [deg]", [0, 1, 1, 0], ("driver", "deg")),
        ("SUN_ASPECT_DEG", [0, 1, 1, 0], ("driver", "deg")),
        ("SUN_FLUX_W_M2", [1361.0, 1380.0, 1390.0, 1400.0], ("driver", "W/m^2")),
        ("flux [W/m2]", [1361.0, 1380.0, 1390.0, 1400.0], ("driver", "W/m^2")),
        ("SUN_DIST_AU", [1.0, 0.99, 0.98, 0.97], ("driver", "AU")),
        ("V_BUS_V", [28.1, 28.2, 28.0, 28.1], ("driver", "V")),
        ("P_TX_W", [28.1, 28.2, 28.0, 28.1], ("driver", "W")),
        ("PANEL_V", [28.1, 28.2, 28.0, 28.1], ("driver", "1")),
        ("T_STACK_mK", [272750, 273125, 288000, 290000], ("temperature", "mK")),
        ("T_RAD", [20.5, 21.0, -3.0, 4.0], ("temperature", "degC")),
        ("line 4", ["OFF", "ON", "ON", "OFF"], ("status", None)),
        ("line 4", ["ENABLED", "DISABLED", "", "DISABLED"], ("status", None)),
        ("line 4", [True, False, False, True], ("status", None)),
        ("remark", ["all well", "", "lost lock", ""], None),
        ("empty", ["", "", "", ""], None),
    ],
)
def test_a_column_has_a_kind_and_a_unit(tmp_path: Path, name: str, cells: list, expected: tuple | None):
    pd.DataFrame({"UTC": text(TIMES[:4]), name: cells}).to_csv(tmp_path / "data.csv", index=False)
    (found,) = detect([tmp_path / "data.csv"])
    assert [(column.kind, column.unit) for column in found.columns] == ([] if expected is None else [expected])


@pytest.mark.parametrize(
    ("words", "base"),
    [
        ([64, 82, 82, 66], None),
        (["0x40", "0x52", None, "0x42"], None),
        (["0b1000000", "0b1010010", "N/A", "0b1000010"], None),
        (["5C40", "5C52", "5C52", "5C42"], 16),
    ],
)
def test_each_bit_of_a_heaters_word_that_changes_is_a_status(tmp_path: Path, words: list, base: int | None):
    pd.DataFrame({"UTC": text(TIMES[:4]), "HTR_WORD": words}).to_csv(tmp_path / "data.csv", index=False)
    (found,) = detect([tmp_path / "data.csv"])
    assert [(column.kind, column.bit, column.base) for column in found.columns] == [
        ("status", 1, base),
        ("status", 4, base),
    ]
    assert not found.left_out


def test_text_that_is_no_word_of_heaters_is_left_out(tmp_path: Path):
    pd.DataFrame({"UTC": text(TIMES[:4]), "HTR_WORD": ["one", "two", "one", "x"]}).to_csv(
        tmp_path / "data.csv", index=False
    )
    (found,) = detect([tmp_path / "data.csv"])
    assert (found.columns, found.left_out) == ((), ("HTR_WORD",))


def test_a_last_letter_is_no_unit_where_it_names_a_branch(tmp_path: Path):
    table = pd.DataFrame(
        {"UTC": text(TIMES[:4]), "TT_RAD_E": [20.5, 21.0, 3.0, 4.0], "TT_RAD_F": [20.5, 21.0, 3.0, 4.0]}
    )
    table.to_csv(tmp_path / "data.csv", index=False)
    (found,) = detect([tmp_path / "data.csv"])
    assert [column.unit for column in found.columns] == ["degC", "degC"]


def test_columns_that_can_be_no_channel_are_named(tmp_path: Path):
    table = pd.DataFrame({"UTC": text(TIMES[:4]), "TT_BAT": [20.5, 21.0, 3.0, 4.0]})
    table["BUS time"] = text(TIMES[:4] + np.timedelta64(7, "s"))
    table["HTR"], table["empty"] = ["COLD", "WARM", "COLD", "WARM"], ""
    table.to_csv(tmp_path / "data.csv", index=False)
    (found,) = detect([tmp_path / "data.csv"])
    assert found.left_out == ("BUS time", "HTR")


def test_files_with_the_same_columns_are_one_packet_and_a_sheet_is_a_file(tmp_path: Path):
    pytest.importorskip("openpyxl", reason="needs the extra 'excel'")
    table = frame(10)
    table[:5].to_csv(tmp_path / "a.csv", index=False)
    table[5:].to_csv(tmp_path / "b.csv", index=False)
    with pd.ExcelWriter(tmp_path / "c.xlsx") as writer:
        pd.DataFrame({"about": ["us"], "version": [3]}).to_excel(writer, sheet_name="Info", index=False)
        table.to_excel(writer, sheet_name="HK", index=False)
        table.drop(columns="HTR").to_excel(writer, sheet_name="EPS", index=False)
    found = detect([tmp_path / name for name in ("a.csv", "b.csv", "c.xlsx")])
    assert [(tuple(file.name for file in packet.files), packet.sheet) for packet in found] == [
        (("a.csv", "b.csv"), None),
        (("c.xlsx",), "HK"),
        (("c.xlsx",), "EPS"),
    ]


def test_files_of_the_same_time_with_the_same_columns_are_of_different_things(tmp_path: Path):
    for name in ("primary", "redundant"):
        frame(10).to_csv(tmp_path / f"{name}.csv", index=False)
    found = detect([tmp_path / "primary.csv", tmp_path / "redundant.csv"])
    assert [[file.name for file in packet.files] for packet in found] == [["primary.csv"], ["redundant.csv"]]


def of_one_parameter(path: Path, start: int, values: list[str], unit: str = "degC") -> Path:
    """A file as archives export it: a title, raw counts beside engineering values, units, and what is valid."""
    times = text(seconds(*(60.0 * (start + np.arange(len(values))))))
    rows = [
        f"{time};{k % 7};{value};{unit};{'INVALID' if k == 3 else 'VALID'}"
        for k, (time, value) in enumerate(zip(times, values, strict=True))
    ]
    path.write_text("\n".join(["# ARCHIVE export", "# of today", "TIME;RAW;ENG;UNIT;VALIDITY", *rows]) + "\n")
    return path


def test_a_file_of_one_parameter_is_called_as_the_file_and_its_days_are_one_packet(tmp_path: Path):
    warm, cold = [f"{20 + 0.25 * (k % 9):.2f}" for k in range(30)], [f"{-5 - 0.25 * (k % 5):.2f}" for k in range(30)]
    states = ["ON" if k % 4 == 0 else "OFF" for k in range(30)]
    files = [
        of_one_parameter(tmp_path / "TB3001_20240301.dat", 0, warm),
        of_one_parameter(tmp_path / "TB3002_20240301.dat", 0, cold),
        of_one_parameter(tmp_path / "HB3001_20240301.dat", 0, states, "-"),
        of_one_parameter(tmp_path / "TB3002_20240302.dat", 30, cold),
        of_one_parameter(tmp_path / "TB3001_20240302.dat", 30, warm),
    ]
    found = detect(files)
    names = [[file.name[:6] for file in packet.files] for packet in found]
    assert names == [["TB3001"] * 2, ["TB3002"] * 2, ["HB3001"]]
    assert [
        (column.name, column.called[:6], column.kind, column.unit) for packet in found for column in packet.columns
    ] == [
        ("ENG", "TB3001", "temperature", "degC"),
        ("ENG", "TB3002", "temperature", "degC"),
        ("ENG", "HB3001", "status", None),
    ]
    assert {packet.header for packet in found} == {3}
    assert all(packet.valid_where == {"VALIDITY": "VALID"} for packet in found)
    assert all(packet.left_out == () for packet in found)


def test_a_value_beside_the_name_of_its_parameter_is_called_so(tmp_path: Path):
    table = pd.DataFrame(
        {"time": text(TIMES), "measurement": "EPS", "field": "battery_temp", "value": 20.0 + np.arange(8)}
    )
    table.to_csv(tmp_path / "data.csv", index=False)
    (found,) = detect([tmp_path / "data.csv"])
    assert [(column.name, column.called, column.kind) for column in found.columns] == [
        ("value", "EPS battery_temp", "temperature")
    ]


def test_numbers_with_their_unit_in_each_cell_are_numbers_in_the_first_ones_unit(tmp_path: Path):
    table = pd.DataFrame({"time": text(TIMES), "EPS.battery": [f"{20 + 0.5 * k:.1f} °C" for k in np.arange(8)]})
    table["PLD.power"] = [f"{950 + k} mW" if k % 2 else "1.2 W" for k in np.arange(8)]
    table["state"] = ["3 apples"] * len(TIMES)
    table.to_csv(tmp_path / "data.csv", index=False)
    (found,) = detect([tmp_path / "data.csv"])
    assert [(column.name, column.kind, column.unit) for column in found.columns] == [
        ("EPS.battery", "temperature", "degC"),
        ("PLD.power", "driver", "W"),
    ]
    assert found.left_out == ("state",)


@pytest.mark.parametrize("suffix", ["csv", "xlsx"])
def test_a_title_above_the_header_and_a_row_of_units_below_it_are_seen(tmp_path: Path, suffix: str):
    header = ["time", "Battery", "HTR_CUR"]
    rows = [[str(time)[:19], 20.0 + k, 480 if k % 3 else 3] for k, time in enumerate(TIMES)]
    lines = [["Export v3", "", ""], ["from", "to", ""], header, ["", "degC", "mA"], *rows]
    path = tmp_path / f"data.{suffix}"
    table = pd.DataFrame(lines)
    if suffix == "csv":
        table.to_csv(path, index=False, header=False)
    else:
        pytest.importorskip("openpyxl", reason="needs the extra 'excel'")
        table.to_excel(path, index=False, header=False)
    (found,) = detect([path])
    assert found.header == 3
    assert found.time is not None
    assert found.time.invalid == ("",)
    assert [(column.name, column.kind, column.unit, column.on_above) for column in found.columns] == [
        ("Battery", "temperature", "degC", None),
        ("HTR_CUR", "status", "mA", "242 mA"),
    ]


@pytest.mark.parametrize(
    ("name", "words", "expected"),
    [
        ("HTR_STATE", ["IDLE", "HEATING"], ("HEATING", "IDLE")),
        ("HTR_STATE", ["STOPPED", "RUNNING "], ("RUNNING", "STOPPED")),
        ("heater", ["Heat", "N/A", "Standby"], ("Heat", "Standby")),
        ("HTR_STATE", ["A", "B"], None),
        ("HTR_STATE", ["IDLE", "HEATING", "FAULT"], None),
        ("CAMERA", ["IDLE", "HEATING"], None),
    ],
)
def test_words_of_a_heaters_status_are_told(
    tmp_path: Path, name: str, words: list[str], expected: tuple[str, str] | None
):
    table = frame(8)
    table[name] = np.resize(words, len(table))
    table.to_csv(tmp_path / "data.csv", index=False)
    (found,) = detect([tmp_path / "data.csv"])
    assert {column.name: column.on_off for column in found.columns}.get(name) == expected
    assert (name in found.left_out) == (expected is None)


@pytest.mark.parametrize("rate", [1, 1000])
def test_a_column_of_gps_time_counts_leap_seconds_from_its_own_epoch(tmp_path: Path, rate: int):
    since = UNIX - np.datetime64("1980-01-06", "s").astype(np.int64) + 18
    pd.DataFrame({"GPS time": rate * since, "TT_BAT": np.linspace(0, 9, 8)}).to_csv(tmp_path / "data.csv", index=False)
    (found,) = detect([tmp_path / "data.csv"])
    assert found.time is not None
    assert (found.time.format, found.time.rate, found.time.leap_seconds) == ("clock", rate, True)
    assert found.first == UNIX[0] * 1e9


def test_a_file_without_times_is_told_with_its_columns(tmp_path: Path):
    frame(5).drop(columns="time").to_csv(tmp_path / "data.csv", index=False)
    with pytest.raises(TelemetryError) as caught:
        detect([tmp_path / "data.csv"])
    assert str(caught.value) == (
        "data.csv: found no column of times among TT_BAT, I_SA, HTR, expected one with UTC times, UNIX times, year and "
        "day of year, or a clock's counter"
    )


@pytest.mark.parametrize(
    ("name", "clock", "written", "temperatures"),
    [
        ("funcube1/funcube1_2016-02-04_first.csv", "Satellite Date/Time UTC", "iso8601", 8),
        ("bupt1/200B_Sun_FULL_1T_180.csv.gz", "TIME", "unix", 1),
        ("chandra_acis/telemetry_2017_jul.csv.gz", "time_utc", "iso8601", 1),
        ("suchai1/tm_status-17-10-27.csv", "time", "iso8601", 4),
    ],
)
def test_real_telemetry_is_recognised(name: str, clock: str, written: str, temperatures: int):
    (found,) = detect([flight_data(name)])
    assert (found.clock, found.time.format if found.time else None) == ((clock,), written)
    assert sum(column.kind == "temperature" for column in found.columns) >= temperatures


@pytest.mark.parametrize("step", [1, -1])
def test_a_packet_begins_at_its_earliest_time_whatever_its_order(tmp_path: Path, step: int):
    table = pd.DataFrame({"time": text(TIMES), "TT_BAT": np.linspace(0, 9, 8)})[::step]
    table.to_csv(tmp_path / "data.csv", index=False)
    (found,) = detect([tmp_path / "data.csv"])
    assert [found.first, found.last] == TIMES[[0, -1]].astype(np.int64).tolist()


def test_numbers_that_are_none_in_parquet_are_no_readings(tmp_path: Path):
    cells = {"a": np.linspace(200.0, 300.0, 8), "b": np.full(8, np.nan)}
    cells["a"][3] = np.nan
    table = pa.table({"time": TIMES, "T_A": cells["a"], "T_B": cells["b"]})
    pq.write_table(table, tmp_path / "data.parquet")
    (found,) = detect([tmp_path / "data.parquet"])
    assert [(column.name, column.unit) for column in found.columns] == [("T_A", "K")]


def test_raw_readings_beside_their_values_are_left_out(tmp_path: Path):
    table = pd.DataFrame({"time": text(TIMES)})
    for name in ("TT1_RAW", "TT1_ENG", "RAW_TT2", "TT2", "TT3_RAW"):
        table[name] = 280 + np.arange(8)
    table.to_csv(tmp_path / "data.csv", index=False)
    (found,) = detect([tmp_path / "data.csv"])
    assert [column.name for column in found.columns] == ["TT1_ENG", "TT2", "TT3_RAW"]
    assert found.left_out == ("TT1_RAW", "RAW_TT2")


def test_what_stands_where_times_are_looked_for_is_told(tmp_path: Path):
    pd.DataFrame({"Time": ["2025-03-08 01:05 CET"] * 3, "TT_BAT": [1.0, 2.0, 3.0]}).to_csv(tmp_path / "a.csv")
    with pytest.raises(TelemetryError, match=r"found no column of times .*; 'Time' holds '2025-03-08 01:05 CET'"):
        detect([tmp_path / "a.csv"])
